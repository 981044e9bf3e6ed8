"""Exercises of chapter 6: the matching."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


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


def _intrinsics(rng):
    fx, fy = rng.uniform(2800, 3000, 2)
    return np.array([[fx, 0, rng.uniform(600, 680)], [0, fy, rng.uniform(480, 540)], [0, 0, 1]])


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


def _F(K_left, K_right, R, T):
    return np.linalg.inv(K_right).T @ np.cross(np.eye(3), T).T @ R @ np.linalg.inv(K_left)


def _unit(line):
    return line / math.hypot(line[0], line[1])


def _line_undivided(K_left, K_right, R, T, uv_left):
    return _F(K_left, K_right, R, T) @ [*uv_left, 1]


def _line_of_unit_length(K_left, K_right, R, T, uv_left):
    line = _F(K_left, K_right, R, T) @ [*uv_left, 1]
    return line / np.linalg.norm(line)


def _line_other_way(K_left, K_right, R, T, uv_left):
    return epipolar_line(K_left, K_right, R.T, -R.T @ T, uv_left)


def _line_transposed(K_left, K_right, R, T, uv_left):
    return _unit(_F(K_left, K_right, R, T).T @ [*uv_left, 1])


def _line_factors_exchanged(K_left, K_right, R, T, uv_left):
    between = R @ np.cross(np.eye(3), T).T
    return _unit(np.linalg.inv(K_right).T @ between @ np.linalg.inv(K_left) @ [*uv_left, 1])


def _line_swapped(K_left, K_right, R, T, uv_left):
    return epipolar_line(K_left, K_right, R, T, uv_left[::-1])


def _line_inverse_alone(K_left, K_right, R, T, uv_left):
    between = np.cross(np.eye(3), T).T @ R
    return _unit(np.linalg.inv(K_right) @ between @ np.linalg.inv(K_left) @ [*uv_left, 1])


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


def _map_cases(rng):
    image = rng.integers(0, 256, (9, 12))
    flat = image.copy()
    flat[:, 6:] = 90
    return [
        ([[1, 2], [3, 4]], [[1, 3], [2, 4]]),
        (image[2:5, 3:8], image),
        (image[2:5, 3:8], flat),
        (255 - image[2:5, 3:8], image),
        (np.full((3, 3), 40), image),
        (rng.integers(0, 256, (4, 2)), rng.integers(0, 256, (6, 8))),
    ]


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


def _means_left(template, image):
    return _each_window(template, image, _cosine)


def _mean_of_the_image(template, image):
    mean = np.mean(image)
    return _each_window(template, image, lambda t, i: _cosine(t - t.mean(), i - mean))


def _no_root(template, image):
    def judge(t, i):
        t, i = t - t.mean(), i - i.mean()
        return _or_zero((t * i).sum(), (t**2).sum() * (i**2).sum())

    return _each_window(template, image, judge)


def _mean_by_sums(template, image):
    return ncc_map(template, image) / np.size(template)


def _flat_is_nan(template, image):
    def judge(t, i):
        t, i = t - t.mean(), i - i.mean()
        return (t * i).sum() / np.sqrt((t**2).sum() * (i**2).sum())

    return _each_window(template, image, judge)


def _map_transposed(template, image):
    return ncc_map(template, image).T


def _last_places_left_out(template, image):
    return ncc_map(template, image)[:-1, :-1]


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


def _distance_cases(rng):
    rows = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of two parallel cameras
    cases = [(rows, [50.0, 60.0], [30.0, 63.0]), (rows, [50.0, 63.0], [30.0, 60.0])]
    for K_left, K_right, R, T, uv_left in _line_cases(rng)[2:]:
        F = _F(K_left, K_right, R, T)
        cases.append((F / np.linalg.norm(F), uv_left, rng.uniform(0, 1000, 2)))
    return cases


def _distances(F, uv_left, uv_right, F_back):
    point, other = np.array([*uv_left, 1]), np.array([*uv_right, 1])
    there, back = F @ point, F_back @ other
    value = np.abs([there @ other, back @ point])
    return value / [math.hypot(*there[:2]), math.hypot(*back[:2])], value


def _same_matrix(F, uv_left, uv_right):
    return _distances(F, uv_left, uv_right, F)[0].max()


def _inverse_for_back(F, uv_left, uv_right):
    return _distances(F, uv_left, uv_right, np.linalg.pinv(F))[0].max()


def _smaller(F, uv_left, uv_right):
    return _distances(F, uv_left, uv_right, F.T)[0].min()


def _mean_distance(F, uv_left, uv_right):
    return _distances(F, uv_left, uv_right, F.T)[0].mean()


def _sum_of_distances(F, uv_left, uv_right):
    return _distances(F, uv_left, uv_right, F.T)[0].sum()


def _there_alone(F, uv_left, uv_right):
    return _distances(F, uv_left, uv_right, F.T)[0][0]


def _undivided(F, uv_left, uv_right):
    return _distances(F, uv_left, uv_right, F.T)[1][0]


STEP = 50 / 570 - 50 / 550

EXERCISES = (
    ValueExercise(
        "06.1",
        "pencil",
        "Strangers in the gate",
        "ex-matching-strangers",
        2,
        (
            Mistake(
                "The band is 4 px high: the gate lets pass what is less than 2 px above the line, "
                "and what is less than 2 px below it.",
                "6, What the paper says: Eq. 17",
                {"wrong": 0.03125},
            ),
            Mistake(
                "There are five others. The sixth spot is the partner itself.",
                "6, A spot gets a line",
                {"wrong": 0.075},
            ),
            Mistake(
                "This is the probability for one stranger. There are five of them.",
                "6, A spot gets a line",
                {"wrong": 0.0125},
            ),
        ),
        {"wrong": Asked(0.0625, within=0.001)},
    ),
    ValueExercise(
        "06.2",
        "pencil",
        "When order fails",
        "ex-matching-order",
        2,
        (
            Mistake(
                "The signs are the other way round: the far nail less the near one is asked for, and "
                "what is farther away is nearer to the middle of the image.",
                "6, Both directions, and order",
                {"left_step": -STEP, "right_step": STEP},
            ),
            Mistake(
                "The right camera stands 100 mm to the right, so that the nails are 50 mm to its "
                "left: both of its coordinates are negative.",
                "6, Both directions, and order",
                {"right_step": STEP},
            ),
            Mistake(
                "The nails stand midway: they are 50 mm beside each camera, half of the baseline.",
                "6, Both directions, and order",
                {"left_step": 2 * STEP, "right_step": -2 * STEP},
            ),
            Mistake(
                "Two markers of the rod may well lie at different depths and on one line. But where "
                "their order would change, the rod itself stands between.",
                "6, Both directions, and order",
                {"why": "equal depth"},
            ),
            Mistake(
                "However far apart two nails are, there is a place midway where their order "
                "changes. What forbids it is the body that carries the markers.",
                "6, Both directions, and order",
                {"why": "too near"},
            ),
        ),
        {
            "left_step": Asked(STEP, within=0.00005),
            "right_step": Asked(-STEP, within=0.00005),
            "why": Asked("hidden", choices=("hidden", "too near", "equal depth")),
        },
    ),
    FunctionExercise(
        "06.3",
        "write",
        "An epipolar line",
        "ex-matching-line",
        4,
        (
            Mistake(
                "The line is not divided by the root of a^2 + b^2: as it is, a u + b v + c is no "
                "distance in px.",
                "6, What the paper says: Eq. 17",
                _line_undivided,
            ),
            Mistake(
                "The line is divided by the length of (a, b, c). Only a and b belong under the root: "
                "they are the line's normal.",
                "6, What the paper says: Eq. 17",
                _line_of_unit_length,
            ),
            Mistake(
                "This is the line for the motion from right to left. R and T lead from left to right "
                "here, and need not be inverted.",
                "6, A spot gets a line",
                _line_other_way,
            ),
            Mistake(
                "F is transposed. The transposed matrix gives the line of a right pixel in the left "
                "image.",
                "6, A spot gets a line",
                _line_transposed,
            ),
            Mistake(
                "R and the matrix of the cross product are exchanged: first R turns the left ray, "
                "then comes the product with T.",
                "6, A spot gets a line",
                _line_factors_exchanged,
            ),
            Mistake(
                "u and v are swapped: a pixel is (u, v), column before row.",
                "6, A spot gets a line",
                _line_swapped,
            ),
            Mistake(
                "The inverse of K_right has to be transposed: it stands to the left of the product "
                "because the right ray, a row, is multiplied from the left.",
                "6, A spot gets a line",
                _line_inverse_alone,
            ),
        ),
        epipolar_line,
        _line_cases,
    ),
    FunctionExercise(
        "06.4",
        "write",
        "A map of the correlation",
        "ex-matching-ncc",
        4,
        (
            Mistake(
                "The means are not removed. Without that two bright windows are alike, whatever they "
                "show.",
                "6, Do they look alike? Eq. 18",
                _means_left,
            ),
            Mistake(
                "The mean of the whole image is removed. Each window has a mean of its own.",
                "6, Do they look alike? Eq. 18",
                _mean_of_the_image,
            ),
            Mistake(
                "The root under the fraction is missing.",
                "6, Do they look alike? Eq. 18",
                _no_root,
            ),
            Mistake(
                "Above the fraction a mean is taken, and below it sums: S is too small by the number "
                "of pixels.",
                "6, Do they look alike? Eq. 18",
                _mean_by_sums,
            ),
            Mistake(
                "A flat window gives 0/0. There the result is to be 0.",
                "6, Exercises",
                _flat_is_nan,
            ),
            Mistake(
                "Rows and columns of the result are swapped: images are indexed by v first, and so "
                "is the map.",
                "6, Do they look alike? Eq. 18",
                _map_transposed,
            ),
            Mistake(
                "The last row and the last column are missing: a window of n rows fits into an image "
                "of n rows once.",
                "6, Exercises",
                _last_places_left_out,
            ),
        ),
        ncc_map,
        _map_cases,
        1e-5,  # OpenCV's map is in single precision
    ),
    FunctionExercise(
        "06.5",
        "write",
        "A symmetric distance",
        "ex-matching-write",
        4,
        (
            Mistake(
                "The way back uses F itself. The line of a right pixel in the left image has the "
                "coefficients of the transposed F.",
                "6, A spot gets a line",
                _same_matrix,
            ),
            Mistake(
                "The way back uses an inverse of F. F has none, since its rank is 2; what leads back "
                "is the transposed matrix.",
                "6, A spot gets a line",
                _inverse_for_back,
            ),
            Mistake(
                "The smaller distance is returned. The larger one is asked for.",
                "6, Exercises",
                _smaller,
            ),
            Mistake(
                "The mean of both distances is returned. The larger one is asked for.",
                "6, Exercises",
                _mean_distance,
            ),
            Mistake(
                "Both distances are added up. The larger one is asked for.",
                "6, Exercises",
                _sum_of_distances,
            ),
            Mistake(
                "This is the distance in the right image alone.",
                "6, What the paper says: Eq. 17",
                _there_alone,
            ),
            Mistake(
                "This is a u + b v + c without the division: its size depends on that of F, and is "
                "no distance.",
                "6, What the paper says: Eq. 17",
                _undivided,
            ),
        ),
        symmetric_distance,
        _distance_cases,
        1e-7,
    ),
    ValueExercise(
        "06.6",
        "predict",
        "No correlation at all",
        "ex-matching-change",
        3,
        (
            Mistake(
                "This is the table at the threshold 0.5: run the chapter anew with -1.",
                "6, What each constraint contributes",
                {"wrong": 4},
            ),
            Mistake(
                "These are the wrong pairs near the line, without both directions and order. The row "
                "with all four constraints is asked for.",
                "6, What each constraint contributes",
                {"wrong": 75},
            ),
            Mistake(
                "Both directions and order stay. Only the threshold is gone, and with it the third "
                "of the four constraints.",
                "6, What each constraint contributes",
                {"becomes": "epipolar line"},
            ),
            Mistake(
                "What is without order has both directions and no threshold now; all four have the "
                "order as well.",
                "6, What each constraint contributes",
                {"becomes": "without order"},
            ),
            Mistake(
                "This row has used the threshold, and changes with it.",
                "6, What each constraint contributes",
                {"cannot_change": "+ correlation"},
            ),
        ),
        {
            "wrong": Asked(6, within=0.5),
            "missing": Asked(4, within=0.5),
            "becomes": Asked(
                "without correlation",
                choices=("epipolar line", "without correlation", "without order", "by the layout"),
            ),
            "cannot_change": Asked(
                "epipolar line",
                choices=("epipolar line", "+ correlation", "+ both directions", "without order"),
            ),
        },
    ),
    ValueExercise(
        "06.7",
        "project",
        "The best set of pairs",
        "ex-matching-project",
        5,
        (
            Mistake(
                "The sum of S has been made smallest: SciPy's function minimises, and wants -S.",
                "6, Exercises",
                {"wrong": 47, "missing": 47},
            ),
            Mistake(
                "The epipolar line is missing. The best set of all pairs is mostly wrong, since all "
                "markers look alike.",
                "6, What each constraint contributes",
                {"wrong": 101, "missing": 69},
            ),
            Mistake(
                "This is the set with the smallest distances from the line. Try that afterwards; "
                "first the largest sum of S is asked for.",
                "6, Exercises",
                {"wrong": 5, "missing": 3},
            ),
            Mistake(
                "These are the counts of the paper's four constraints. Put the assignment in place of "
                "both directions and order.",
                "6, What each constraint contributes",
                {"missing": 4},
            ),
        ),
        {"wrong": Asked(4, within=0.4), "missing": Asked(2, within=0.4)},
    ),
)
