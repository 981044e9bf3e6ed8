"""Exercises of chapter 7: the calibration."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import FunctionExerciseMaker


def _lens_of(homographies, size, of_columns, normalise=True, equations_of=None):
    """`square_lens` with another last step, `of_columns`: from the entries of B to f, cx, cy; in
    units of the image's size, or in the pixels as they are.
    """
    unit = max(size) if normalise else 1
    middle = (np.array(size) - 1) / 2 if normalise else np.zeros(2)
    N = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, unit]]) / unit
    equations = []
    for H in homographies:
        H = N @ H / np.linalg.norm(N @ H)
        h1, h2 = (equations_of or (lambda H: H.T[:2]))(H)
        p, q, r = (np.outer(a, b) for a, b in ((h1, h2), (h1, h1), (h2, h2)))
        for M in (p, q - r):
            M = M + M.T
            equations.append([(M[0, 0] + M[1, 1]) / 2, M[0, 2], M[1, 2], M[2, 2] / 2])
    with np.errstate(all="ignore"):
        f, cx, cy = of_columns(*np.linalg.svd(np.array(equations))[2][-1])
    return N, np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])


def _entries(B11, B13, B23, B33):
    cx, cy = -B13 / B11, -B23 / B11
    return np.sqrt(B33 / B11 - cx**2 - cy**2), cx, cy


def _principal_point_left_out(B11, B13, B23, B33):
    return np.sqrt(abs(B33 / B11)), -B13 / B11, -B23 / B11


def _no_root(B11, B13, B23, B33):
    f, cx, cy = _entries(B11, B13, B23, B33)
    return f**2, cx, cy


def _signs(B11, B13, B23, B33):
    f, cx, cy = _entries(B11, B13, B23, B33)
    return f, -cx, -cy


square_lens_exercise = FunctionExerciseMaker(
    "07.3", "Pixels that are square", "ex-calibration-square", points=4
)


@square_lens_exercise.solution
def square_lens(homographies, size):
    """The intrinsic matrix of a camera with square pixels, from images of a flat board (Sect. 6.2).

    Parameters
    ----------
    homographies
        Two or more, (3, 3) each: from points (X, Y, 1) of the board to pixels (u, v, 1), up to a
        factor.
    size
        Width and height of the image, px.

    Returns
    -------
    array
        (3, 3): f, 0, cx; 0, f, cy; 0, 0, 1, px.
    """
    width, height = size
    unit = max(size)
    N = np.array(
        [[1 / unit, 0, (1 - width) / 2 / unit], [0, 1 / unit, (1 - height) / 2 / unit], [0, 0, 1]]
    )

    def row(a, b):  # a^T B b as coefficients of B11 = B22, B13, B23, B33
        return [
            a[0] * b[0] + a[1] * b[1],
            a[0] * b[2] + a[2] * b[0],
            a[1] * b[2] + a[2] * b[1],
            a[2] * b[2],
        ]

    equations = []
    for H in homographies:
        H = N @ H
        h1, h2 = H[:, 0] / np.linalg.norm(H), H[:, 1] / np.linalg.norm(H)
        equations.append(row(h1, h2))
        equations.append(np.subtract(row(h1, h1), row(h2, h2)))
    B11, B13, B23, B33 = np.linalg.svd(np.array(equations))[2][-1]
    cx, cy = -B13 / B11, -B23 / B11
    f = np.sqrt(B33 / B11 - cx**2 - cy**2)
    return np.linalg.inv(N) @ np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])


SIZES = (
    (2, (1280, 1024)),
    (3, (640, 480)),
    (2, (800, 1200)),
    (5, (1280, 1024)),
    (4, (1024, 1024)),
    (3, (1920, 1080)),
)


@square_lens_exercise.cases
def _lens_cases(rng):
    """Exact homographies, so that it does not matter how the equations are weighted."""
    cases = []
    for count, size in SIZES:
        f = rng.uniform(0.8, 3) * max(size)
        cx, cy = np.array(size) / 2 + rng.uniform(-40, 40, 2)
        K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
        homographies = []
        for k in range(count):
            tilt = Rotation.from_euler("xyz", [20 + 15 * k, -35 + 30 * k, 25 * k], degrees=True)
            columns = tilt.as_matrix()
            columns[:, 2] = [*rng.uniform(-40, 40, 2), 500]
            homographies.append(rng.choice([-1, 1]) * rng.uniform(0.2, 3) * K @ columns)
        cases.append((homographies, size))
    return cases


@square_lens_exercise.mistake("7, The algorithm: a start in closed form")
def _focal_of_squares(homographies, size):
    """This focal length is its own square: B11 is 1 by f squared, up to the factor, so that a root
    has to be taken.
    """
    N, K = _lens_of(homographies, size, _no_root)
    return np.linalg.inv(N) @ K


@square_lens_exercise.mistake("7, The algorithm: a start in closed form")
def _without_principal_point(homographies, size):
    """The principal point is missing from f: B33 is 1 plus both of its squares by f squared, and
    these have to be taken off.
    """
    N, K = _lens_of(homographies, size, _principal_point_left_out)
    return np.linalg.inv(N) @ K


@square_lens_exercise.mistake("7, The algorithm: a start in closed form")
def _wrong_signs(homographies, size):
    """The principal point has the wrong sign: B13 is -cx by f squared."""
    N, K = _lens_of(homographies, size, _signs)
    return np.linalg.inv(N) @ K


@square_lens_exercise.mistake("7, The algorithm: a start in closed form")
def _focal_of_squares_px(homographies, size):
    """This focal length is its own square, in px^2: B11 is 1 by f squared, up to the factor, so that
    a root has to be taken.
    """
    return _lens_of(homographies, size, _no_root, normalise=False)[1]


@square_lens_exercise.mistake("7, The algorithm: a start in closed form")
def _without_principal_point_px(homographies, size):
    """The principal point, in px, is missing from f: B33 is 1 plus both of its squares by f squared,
    and these have to be taken off.
    """
    return _lens_of(homographies, size, _principal_point_left_out, normalise=False)[1]


@square_lens_exercise.mistake("7, The algorithm: a start in closed form")
def _wrong_signs_px(homographies, size):
    """The principal point, in px, has the wrong sign: B13 is -cx by f squared."""
    return _lens_of(homographies, size, _signs, normalise=False)[1]


@square_lens_exercise.mistake("7, The algorithm: a start in closed form")
def _units_left(homographies, size):
    """The result is still in the units in which you have solved. Undo the scaling and the shift of
    the pixels.
    """
    return _lens_of(homographies, size, _entries)[1]


@square_lens_exercise.mistake("7, The smallest calibration")
def _rows_of_H(homographies, size):
    """You have taken rows of H. Its columns are the images of the board's directions."""
    N, K = _lens_of(homographies, size, _entries, equations_of=lambda H: H[:2])
    return np.linalg.inv(N) @ K


@square_lens_exercise.mistake("7, From a point to a pixel")
def _middle_of_the_image(homographies, size):
    """The principal point is taken for the image's middle. The boards say where it is, a few dozen
    pixels beside.
    """
    K = square_lens(homographies, size)
    K[:2, 2] = np.array(size) / 2
    return K


@square_lens_exercise.mistake("7, Exercises")
def _focal_alone(homographies, size):
    """Only the focal length is returned. The whole matrix is asked for."""
    return square_lens(homographies, size)[0, 0]


EXERCISES = (square_lens_exercise.made(),)
