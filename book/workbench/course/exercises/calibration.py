"""Exercises of chapter 7: the calibration."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


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


def _lens_cases(rng):
    """Exact homographies, so that it does not matter how the equations are weighted."""
    cases = []
    for count, size in ((2, (1280, 1024)), (3, (640, 480)), (2, (800, 1200)), (5, (1280, 1024))):
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


def _lens_of(homographies, size, of_columns, normalise=True, equations_of=None):
    """`square_lens` with another last step, `of_columns`: from the entries of B to f, cx, cy."""
    unit = max(size) if normalise else 1
    middle = (np.array(size) - 1) / 2
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


def _focal_of_squares(homographies, size):
    N, K = _lens_of(homographies, size, _no_root)
    return np.linalg.inv(N) @ K


def _without_principal_point(homographies, size):
    N, K = _lens_of(homographies, size, _principal_point_left_out)
    return np.linalg.inv(N) @ K


def _wrong_signs(homographies, size):
    N, K = _lens_of(homographies, size, _signs)
    return np.linalg.inv(N) @ K


def _units_left(homographies, size):
    return _lens_of(homographies, size, _entries)[1]


def _rows_of_H(homographies, size):
    N, K = _lens_of(homographies, size, _entries, equations_of=lambda H: H[:2])
    return np.linalg.inv(N) @ K


def _middle_of_the_image(homographies, size):
    K = square_lens(homographies, size)
    K[:2, 2] = np.array(size) / 2
    return K


def _focal_alone(homographies, size):
    return square_lens(homographies, size)[0, 0]


EXERCISES = (
    ValueExercise(
        "07.1",
        "pencil",
        "The other way round",
        "ex-calibration-inverse",
        2,
        (
            Mistake(
                "The minus is missing: the point that the left camera has at T_rl is the right "
                "camera's own centre, and has to become zero.",
                "7, The algorithm: Eq. 25",
                {"T_x": 100.0, "turned_x": 86.60, "turned_z": 50.0},
            ),
            Mistake(
                "T_rl has changed its sign, and has not been turned. It is written in the left "
                "camera's axes, and T is wanted in the right camera's.",
                "7, The algorithm: Eq. 25",
                {"turned_x": -100.0, "turned_z": 0.0},
            ),
            Mistake(
                "T_rl has been turned by R_rl. It has to be turned back, by the inverse, which is "
                "the transposed matrix.",
                "7, The algorithm: Eq. 25",
                {"turned_z": 50.0},
            ),
            Mistake(
                "Sine and cosine are exchanged.",
                "7, The smallest calibration",
                {"turned_x": -50.0, "turned_z": -86.60},
            ),
        ),
        {
            "T_x": Asked(-100.0, "mm", within=0.01),
            "turned_x": Asked(-86.603, "mm", within=0.1),
            "turned_z": Asked(-50.0, "mm", within=0.1),
        },
    ),
    ValueExercise(
        "07.2",
        "pencil",
        "How many positions?",
        "ex-calibration-count",
        2,
        (
            Mistake(
                "The cost falls with the root of the number of positions: five times less cost needs "
                "twenty-eight times as many, not five times.",
                "7, What happens if there are fewer positions, or more?",
                {"positions": 74.5},
            ),
            Mistake(
                "This is by what factor there have to be more positions. Their number is asked for.",
                "7, What happens if there are fewer positions, or more?",
                {"positions": 28.3},
            ),
            Mistake(
                "This many positions cost 0.31 mm. A tenth of that is asked for.",
                "7, What happens if there are fewer positions, or more?",
                {"positions": 3.97},
            ),
            Mistake(
                "The noise of the corners counts in proportion, because all errors are linear in it, "
                "and not by its root.",
                "7, The algorithm: one least squares",
                {"noise_factor": 28.3},
            ),
            Mistake(
                "The noise of the corners counts in proportion, because all errors are linear in it, "
                "and not by its square.",
                "7, The algorithm: one least squares",
                {"noise_factor": 2.31},
            ),
        ),
        {
            "positions": Asked(396.6, within=30.0),
            "noise_factor": Asked(5.32, within=0.25),
        },
    ),
    FunctionExercise(
        "07.3",
        "write",
        "Pixels that are square",
        "ex-calibration-square",
        4,
        (
            Mistake(
                "This focal length is its own square: B11 is 1 by f squared, up to the factor, so "
                "that a root has to be taken.",
                "7, The algorithm: a start in closed form",
                _focal_of_squares,
            ),
            Mistake(
                "The principal point is missing from f: B33 is 1 plus both of its squares by f "
                "squared, and these have to be taken off.",
                "7, The algorithm: a start in closed form",
                _without_principal_point,
            ),
            Mistake(
                "The principal point has the wrong sign: B13 is -cx by f squared.",
                "7, The algorithm: a start in closed form",
                _wrong_signs,
            ),
            Mistake(
                "The result is still in the units in which you have solved. Undo the scaling and the "
                "shift of the pixels.",
                "7, The algorithm: a start in closed form",
                _units_left,
            ),
            Mistake(
                "You have taken rows of H. Its columns are the images of the board's directions.",
                "7, The smallest calibration",
                _rows_of_H,
            ),
            Mistake(
                "The principal point is taken for the image's middle. The boards say where it is, a "
                "few dozen pixels beside.",
                "7, From a point to a pixel",
                _middle_of_the_image,
            ),
            Mistake(
                "Only the focal length is returned. The whole matrix is asked for.",
                "7, Exercises",
                _focal_alone,
            ),
        ),
        square_lens,
        _lens_cases,
        1e-7,
    ),
    ValueExercise(
        "07.4",
        "predict",
        "A smaller board",
        "ex-calibration-small",
        3,
        (
            Mistake(
                "The lens is known half as well: what tells focal length from distance is how far the "
                "board tapers, and it tapers half as much.",
                "7, The smallest calibration",
                {"focal_sigma": "the same"},
            ),
            Mistake(
                "The board's taper goes with its width, and not with its area: half of it is half as "
                "good.",
                "7, The smallest calibration",
                {"focal_sigma": "four times"},
            ),
            Mistake(
                "Chi-square measures the errors by their own covariance. Both grow, so that it stays "
                "near 6 as long as the covariance is honest.",
                "7, May we trust the standard deviations?",
                {"chi_square": "twice"},
            ),
            Mistake(
                "Chi-square measures the errors by their own covariance. An honest calibration says "
                "itself that it is worse.",
                "7, May we trust the standard deviations?",
                {"chi_square": "four times"},
            ),
            Mistake(
                "This is the cost of the board with squares of 15 mm: run the chapter anew.",
                "7, What happens if there are fewer positions, or more?",
                {"cost_mm": 0.165},
            ),
        ),
        {
            "focal_sigma": Asked("twice", choices=("the same", "twice", "four times")),
            "chi_square": Asked("the same", choices=("the same", "twice", "four times")),
            "cost_mm": Asked(0.280, "mm", within=0.045),
        },
    ),
    ValueExercise(
        "07.5",
        "project",
        "A board that is bent",
        "ex-calibration-bent",
        5,
        (
            Mistake(
                "These are the numbers of a flat board. Are the bent points the ones that are "
                "projected, and does `calibrate` get the flat ones?",
                "7, Limits, and a broken case",
                {"noise_px": 0.0495, "chi_square": 7.94, "cost_mm": 0.172},
            ),
            Mistake(
                "This board has a quarter of the bend: x counts from a corner of the board, and not "
                "from its middle.",
                "7, Exercises",
                {"noise_px": 0.0583, "cost_mm": 0.974},
            ),
            Mistake(
                "This board is bent by 2 mm, ten times as much: 0.2 mm are asked for.",
                "7, Exercises",
                {"noise_px": 1.24, "cost_mm": 43.3},
            ),
            Mistake(
                "This noise is that of a corner in the plane, sqrt 2 times as much as that of a "
                "coordinate.",
                "7, The algorithm: one least squares",
                {"noise_px": 0.1856},
            ),
            Mistake(
                "Chi-square is the mean of the six, not their sum.",
                "7, May we trust the standard deviations?",
                {"chi_square": 533.0},
            ),
        ),
        {
            "noise_px": Asked(0.1334, "px", within=0.012),
            "chi_square": Asked(88.9, within=38.0),
            "cost_mm": Asked(4.09, "mm", within=0.65),
        },
    ),
)
