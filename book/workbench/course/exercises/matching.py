"""Exercises of chapter 6: the matching."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import FunctionExerciseMaker

__all__ = ["epipolar_line", "ncc_map", "symmetric_distance"]


def _intrinsics(rng):
    fx, fy = rng.uniform(2800, 3000, 2)
    return np.array([[fx, 0, rng.uniform(600, 680)], [0, fy, rng.uniform(480, 540)], [0, 0, 1]])


def _F(K_left, K_right, R, T):
    # the rows of np.cross(np.eye(3), T) are e_k x T, which is [T]x as it stands
    return np.linalg.inv(K_right).T @ np.cross(np.eye(3), T) @ R @ np.linalg.inv(K_left)


def _unit(line):
    return line / math.hypot(line[0], line[1])


def _each_window(template, image, judge):
    """A map of what `judge` says of the template and each window."""
    template = np.asarray(template, dtype=float)
    image = np.asarray(image, dtype=float)
    windows = np.lib.stride_tricks.sliding_window_view(image, template.shape)
    with np.errstate(all="ignore"):
        return np.array([[judge(template, window) for window in row] for row in windows])


def _or_zero(a, b):
    return a / b if b > 0 else 0.0


def _cosine(t, i):
    return _or_zero((t * i).sum(), np.sqrt((t**2).sum() * (i**2).sum()))


def _distances(F, uv_left, uv_right, F_back):
    point, other = np.array([*uv_left, 1]), np.array([*uv_right, 1])
    there, back = F @ point, F_back @ other
    value = np.abs([there @ other, back @ point])
    return value / [math.hypot(*there[:2]), math.hypot(*back[:2])], value


epipolar_line_exercise = FunctionExerciseMaker(
    "06.3", "An epipolar line", "ex-matching-line", points=4
)


@epipolar_line_exercise.solution
def epipolar_line(K_left, K_right, R, T, uv_left):
    """The epipolar line of a left pixel in the right image (Sect. 5.2).

    Parameters
    ----------
    K_left, K_right
        (3, 3), the intrinsic matrices, px.
    R, T
        (3, 3) and (3,): from the left camera's frame to the right one's, X_right = R X_left + T, mm.
    uv_left
        (2,), the pixel in the left image.

    Returns
    -------
    array
        (a, b, c) of the line a u + b v + c = 0: the product of F and (u, v, 1), divided by a positive
        number so that a^2 + b^2 = 1. So a u + b v + c is a distance in px.
    """
    tx, ty, tz = T
    cross = np.array([[0, -tz, ty], [tz, 0, -tx], [-ty, tx, 0]])
    F = np.linalg.inv(K_right).T @ cross @ R @ np.linalg.inv(K_left)
    a, b, c = F @ [*uv_left, 1]
    return np.array([a, b, c]) / math.hypot(a, b)


@epipolar_line_exercise.cases
def _line_cases(rng):
    parallel = (np.eye(3), np.array([-100.0, 0, 0]))
    upwards = (np.eye(3), np.array([0.0, 80, 0]))
    turned = [
        (Rotation.from_rotvec(rng.normal(0, 0.4, 3)).as_matrix(), rng.normal(0, 100, 3))
        for _ in range(6)
    ]
    return [
        (_intrinsics(rng), _intrinsics(rng), R, T, rng.uniform(0, 1000, 2))
        for R, T in (parallel, upwards, *turned)
    ]


@epipolar_line_exercise.mistake("6, What the paper says: Eq. 17")
def _line_undivided(K_left, K_right, R, T, uv_left):
    """The line is not divided by the root of a^2 + b^2: as it is, a u + b v + c is no distance in
    px.
    """
    return _F(K_left, K_right, R, T) @ [*uv_left, 1]


@epipolar_line_exercise.mistake("6, What the paper says: Eq. 17")
def _line_of_unit_length(K_left, K_right, R, T, uv_left):
    """The line is divided by the length of (a, b, c). Only a and b belong under the root: they are
    the line's normal.
    """
    line = _F(K_left, K_right, R, T) @ [*uv_left, 1]
    return line / np.linalg.norm(line)


@epipolar_line_exercise.mistake("6, A spot gets a line")
def _line_other_way(K_left, K_right, R, T, uv_left):
    """This is the line for the motion from right to left. R and T lead from left to right here,
    and need not be inverted.
    """
    return epipolar_line(K_left, K_right, R.T, -R.T @ T, uv_left)


@epipolar_line_exercise.mistake("6, A spot gets a line")
def _line_transposed(K_left, K_right, R, T, uv_left):
    """F is transposed. The transposed matrix gives the line of a right pixel in the left image."""
    return _unit(_F(K_left, K_right, R, T).T @ [*uv_left, 1])


@epipolar_line_exercise.mistake("6, A spot gets a line")
def _line_factors_exchanged(K_left, K_right, R, T, uv_left):
    """R and the matrix of the cross product are exchanged: first R turns the left ray, then comes
    the product with T.
    """
    between = R @ np.cross(np.eye(3), T)
    return _unit(np.linalg.inv(K_right).T @ between @ np.linalg.inv(K_left) @ [*uv_left, 1])


@epipolar_line_exercise.mistake("6, A spot gets a line")
def _line_swapped(K_left, K_right, R, T, uv_left):
    """u and v are swapped: a pixel is (u, v), column before row."""
    return epipolar_line(K_left, K_right, R, T, uv_left[::-1])


@epipolar_line_exercise.mistake("6, A spot gets a line")
def _line_inverse_alone(K_left, K_right, R, T, uv_left):
    """The inverse of K_right has to be transposed: it stands to the left of the product because
    the right ray, a row, is multiplied from the left.
    """
    between = np.cross(np.eye(3), T) @ R
    return _unit(np.linalg.inv(K_right) @ between @ np.linalg.inv(K_left) @ [*uv_left, 1])


@epipolar_line_exercise.mistake("6, A spot gets a line")
def _line_turned(K_left, K_right, R, T, uv_left):
    """All three numbers have the other sign. It is the same line, and the signed distance changes
    its sides: keep the sign of the product, with [T]x R and not its negative.
    """
    return -epipolar_line(K_left, K_right, R, T, uv_left)


ncc_map_exercise = FunctionExerciseMaker(
    "06.4", "A map of the correlation", "ex-matching-ncc", points=4, within=1e-05
)


@ncc_map_exercise.solution
def ncc_map(template, image):
    """Correlation of a template with the window of an image at each place (Eq. 18).

    Parameters
    ----------
    template
        (n, m), grey levels.
    image
        (height, width), grey levels; at least as large.

    Returns
    -------
    array
        (height - n + 1, width - m + 1). Row y and column x have S(x, y): the window begins at row y
        and column x of the image. 0 where template or window is flat, all of one grey level.
    """
    template = np.asarray(template, dtype=float)
    image = np.asarray(image, dtype=float)
    n, m = template.shape
    t = template - template.mean()
    S = np.zeros((image.shape[0] - n + 1, image.shape[1] - m + 1))
    for y in range(S.shape[0]):
        for x in range(S.shape[1]):
            window = image[y : y + n, x : x + m]
            i = window - window.mean()
            length = np.sqrt((t**2).sum() * (i**2).sum())
            if length > 0:
                S[y, x] = (t * i).sum() / length
    return S


@ncc_map_exercise.cases
def _map_cases(rng):
    image = rng.integers(0, 256, (9, 12))
    flat = image.copy()
    flat[:, 6:] = 90
    return [
        ([[1, 2], [3, 4]], [[1, 3], [2, 4]]),
        (image[2:5, 3:8], image),
        (image[2:5, 3:8], flat),
        (255 - image[2:5, 3:8], image),
        (np.full((3, 3), 40), flat),
        (np.uint8(image[4:7, 1:6]), np.uint8(image)),  # as a file gives it
        (rng.integers(0, 256, (4, 2)), rng.integers(0, 256, (6, 8))),
        ([[1, 1], [1, 2]], [[5, 5, 6], [5, 5, 5], [5, 6, 5]]),  # hardly any contrast
    ]


@ncc_map_exercise.mistake("6, Do they look alike? Eq. 18")
def _means_left(template, image):
    """The means are not removed. Without that two bright windows are alike, whatever they show."""
    return _each_window(template, image, _cosine)


@ncc_map_exercise.mistake("6, Do they look alike? Eq. 18")
def _mean_of_the_image(template, image):
    """The mean of the whole image is removed. Each window has a mean of its own."""
    mean = np.mean(image)
    return _each_window(template, image, lambda t, i: _cosine(t - t.mean(), i - mean))


@ncc_map_exercise.mistake("6, Do they look alike? Eq. 18")
def _no_root(template, image):
    """The root under the fraction is missing."""

    def judge(t, i):
        t, i = t - t.mean(), i - i.mean()
        return _or_zero((t * i).sum(), (t**2).sum() * (i**2).sum())

    return _each_window(template, image, judge)


@ncc_map_exercise.mistake("6, Do they look alike? Eq. 18")
def _mean_by_sums(template, image):
    """Above the fraction a mean is taken, and below it sums: S is too small by the number of
    pixels.
    """
    return ncc_map(template, image) / np.size(template)


@ncc_map_exercise.mistake("6, Exercises")
def _flat_is_nan(template, image):
    """A flat window gives 0/0. There the result is to be 0."""

    def judge(t, i):
        t, i = t - t.mean(), i - i.mean()
        return (t * i).sum() / np.sqrt((t**2).sum() * (i**2).sum())

    return _each_window(template, image, judge)


@ncc_map_exercise.mistake("6, Exercises")
def _bytes_overflow(template, image):
    """The products are of the pixels' own 8 bits, in which 200 times 200 is 64. Make template and
    image float first.

    By sums of products, in the type that template and image have.
    """
    template, image = np.asarray(template), np.asarray(image)

    def judge(t, i):
        top = (t * i).mean() - t.mean() * i.mean()
        below = ((t * t).mean() - t.mean() ** 2) * ((i * i).mean() - i.mean() ** 2)
        return top / np.sqrt(below) if below > 1e-9 else 0.0

    windows = np.lib.stride_tricks.sliding_window_view(image, template.shape)
    return np.array([[judge(template, window) for window in row] for row in windows])


@ncc_map_exercise.mistake("6, Do they look alike? Eq. 18")
def _map_transposed(template, image):
    """Rows and columns of the result are swapped: images are indexed by v first, and so is the
    map.
    """
    return ncc_map(template, image).T


@ncc_map_exercise.mistake("6, Exercises")
def _last_places_left_out(template, image):
    """The last row and the last column are missing: a window of n rows fits into an image of n
    rows once.
    """
    return ncc_map(template, image)[:-1, :-1]


symmetric_distance_exercise = FunctionExerciseMaker(
    "06.5", "A symmetric distance", "ex-matching-write", points=4
)


@symmetric_distance_exercise.solution
def symmetric_distance(F, uv_left, uv_right):
    """How far two pixels are from each other's epipolar line, the larger of the two (Eq. 17).

    Parameters
    ----------
    F
        (3, 3), the fundamental matrix: (u_r, v_r, 1) F (u_l, v_l, 1)^T = 0.
    uv_left, uv_right
        (2,) each, px.

    Returns
    -------
    float
        px.
    """

    def distance(F, point, other):
        a, b, c = F @ [*point, 1]
        u, v = other
        return abs(a * u + b * v + c) / math.hypot(a, b)

    return max(distance(F, uv_left, uv_right), distance(F.T, uv_right, uv_left))


@symmetric_distance_exercise.cases
def _distance_cases(rng):
    rows = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of two parallel cameras
    cases = [(rows, [50.0, 60.0], [30.0, 63.0]), (rows, [50.0, 63.0], [30.0, 60.0])]
    for K_left, K_right, R, T, uv_left in _line_cases(rng)[2:]:
        F = _F(K_left, K_right, R, T)
        cases.append((F / np.linalg.norm(F), uv_left, rng.uniform(0, 1000, 2)))
    return cases


@symmetric_distance_exercise.mistake("6, A spot gets a line")
def _same_matrix(F, uv_left, uv_right):
    """The way back uses F itself. The line of a right pixel in the left image has the coefficients
    of the transposed F.
    """
    return _distances(F, uv_left, uv_right, F)[0].max()


@symmetric_distance_exercise.mistake("6, A spot gets a line")
def _inverse_for_back(F, uv_left, uv_right):
    """The way back uses an inverse of F. F has none, since its rank is 2; what leads back is the
    transposed matrix.
    """
    return _distances(F, uv_left, uv_right, np.linalg.pinv(F))[0].max()


@symmetric_distance_exercise.mistake("6, Exercises")
def _smaller(F, uv_left, uv_right):
    """The smaller distance is returned. The larger one is asked for."""
    return _distances(F, uv_left, uv_right, F.T)[0].min()


@symmetric_distance_exercise.mistake("6, Exercises")
def _mean_distance(F, uv_left, uv_right):
    """The mean of both distances is returned. The larger one is asked for."""
    return _distances(F, uv_left, uv_right, F.T)[0].mean()


@symmetric_distance_exercise.mistake("6, Exercises")
def _sum_of_distances(F, uv_left, uv_right):
    """Both distances are added up. The larger one is asked for."""
    return _distances(F, uv_left, uv_right, F.T)[0].sum()


@symmetric_distance_exercise.mistake("6, What the paper says: Eq. 17")
def _there_alone(F, uv_left, uv_right):
    """This is the distance in the right image alone."""
    return _distances(F, uv_left, uv_right, F.T)[0][0]


@symmetric_distance_exercise.mistake("6, What the paper says: Eq. 17")
def _undivided(F, uv_left, uv_right):
    """This is a u + b v + c without the division: its size depends on that of F, and is no
    distance.
    """
    return _distances(F, uv_left, uv_right, F.T)[1][0]


EXERCISES = (
    epipolar_line_exercise.made(),
    ncc_map_exercise.made(),
    symmetric_distance_exercise.made(),
)
