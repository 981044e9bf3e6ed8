"""Exercises of chapter 6: the matching."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import FunctionExerciseMaker


def _intrinsics(rng):
    fx, fy = rng.uniform(2800, 3000, 2)
    return np.array([[fx, 0, rng.uniform(600, 680)], [0, fy, rng.uniform(480, 540)], [0, 0, 1]])


def _F(K_left, K_right, R, T):
    # the rows of np.cross(np.eye(3), T) are e_k x T, which is [T]x as it stands
    return np.linalg.inv(K_right).T @ np.cross(np.eye(3), T) @ R @ np.linalg.inv(K_left)


def _unit(line):
    return line / math.hypot(line[0], line[1])


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


expected_correlation_exercise = FunctionExerciseMaker(
    "06.4", "How alike can they be?", "ex-matching-ncc", points=4
)


@expected_correlation_exercise.solution
def expected_correlation(patch, sigma_left, sigma_right):
    """The correlation (Eq. 18) that two noisy images of one and the same patch have, in a large window.

    Parameters
    ----------
    patch
        (n, m), grey levels without noise.
    sigma_left, sigma_right
        Standard deviations of the noise of a pixel in the two images, grey levels; the noises are
        independent.

    Returns
    -------
    float
        S; 0 where the patch is flat, all of one grey level.
    """
    signal = np.var(patch)
    if signal == 0:
        return 0.0
    left = signal + sigma_left**2
    right = signal + sigma_right**2
    return signal / math.sqrt(left * right)


@expected_correlation_exercise.cases
def _patch_cases(rng):
    edge = np.where(np.arange(12) < 6, 90.0, 220.0) * np.ones((12, 1))
    return [
        (edge, 3.0, 3.0),
        (edge, 0.0, 40.0),
        (edge, 40.0, 0.0),
        (np.full((5, 5), 120.0), 3.0, 2.0),
        (rng.normal(60, 4, (9, 7)), 4.0, 2.0),
        (rng.uniform(0, 255, (21, 21)), 30.0, 55.0),
        (edge, 0.0, 0.0),
        (np.full((5, 5), 120.0), 0.0, 0.0),
    ]


ALIKE = "6, Do they look alike? Eq. 18"


def _signal(patch):
    """Variance of the patch; NaN in place of 0, where a fraction would be 0/0."""
    return np.var(patch) or np.nan


@expected_correlation_exercise.mistake(ALIKE)
def _deviations_added(patch, sigma_left, sigma_right):
    """Standard deviations are added up. Variances add up: square sigma first."""
    signal = _signal(patch)
    S = signal / math.sqrt((signal + sigma_left) * (signal + sigma_right))
    return float(np.nan_to_num(S))


@expected_correlation_exercise.mistake(ALIKE)
def _without_root(patch, sigma_left, sigma_right):
    """The root under the fraction is missing: each image gives the root of its own variance."""
    signal = _signal(patch)
    return float(np.nan_to_num(signal / ((signal + sigma_left**2) * (signal + sigma_right**2))))


@expected_correlation_exercise.mistake(ALIKE)
def _brightness(patch, sigma_left, sigma_right):
    """The mean square of the patch is taken. Eq. 18 removes the mean, so that brightness counts for
    nothing: take the variance.
    """
    square = np.mean(np.square(patch))
    if np.var(patch) == 0:
        return 0.0
    return square / math.sqrt((square + sigma_left**2) * (square + sigma_right**2))


@expected_correlation_exercise.mistake(ALIKE)
def _noise_in_common(patch, sigma_left, sigma_right):
    """Noise stands above the fraction as well. The two noises are independent, so that the mean of
    their product is 0.
    """
    signal = np.var(patch)
    if signal == 0:
        return 0.0
    left, right = signal + sigma_left**2, signal + sigma_right**2
    return (signal + sigma_left * sigma_right) / math.sqrt(left * right)


@expected_correlation_exercise.mistake(ALIKE)
def _left_alone(patch, sigma_left, sigma_right):
    """Only the left image has noise here. Each image has its own below the fraction."""
    return expected_correlation(patch, sigma_left, 0.0)


@expected_correlation_exercise.mistake(ALIKE)
def _mean_of_both(patch, sigma_left, sigma_right):
    """The two variances are averaged. Below the fraction is the root of their *product*."""
    both = math.sqrt((sigma_left**2 + sigma_right**2) / 2)
    return expected_correlation(patch, both, both)


@expected_correlation_exercise.mistake("6, Exercises")
def _flat_is_nan(patch, sigma_left, sigma_right):
    """A flat patch gives 0/0 without noise. There the result is to be 0."""
    signal = _signal(patch)
    return signal / math.sqrt((signal + sigma_left**2) * (signal + sigma_right**2))


distance_sigma_exercise = FunctionExerciseMaker(
    "06.5", "How wide must the gate be?", "ex-matching-write", points=4
)


@distance_sigma_exercise.solution
def distance_sigma(F, uv_left, uv_right, sigma):
    """How much the distance of a right pixel from its line scatters by the noise of both (Eq. 17).

    Parameters
    ----------
    F
        (3, 3), the fundamental matrix: (u_r, v_r, 1) F (u_l, v_l, 1)^T = 0.
    uv_left, uv_right
        (2,) each, px: a right pair without noise, so that one lies on the other's line.
    sigma
        Standard deviation of each of the four coordinates, px; their errors are independent and
        small.

    Returns
    -------
    float
        Standard deviation of the distance in the right image, px.
    """
    a, b, _ = F @ [*uv_left, 1]
    back_a, back_b, _ = F.T @ [*uv_right, 1]
    right = a**2 + b**2
    left = back_a**2 + back_b**2
    return sigma * math.sqrt((right + left) / right)


@distance_sigma_exercise.cases
def _gate_cases(rng):
    rows = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of two parallel cameras
    cases = [(rows, [50.0, 60.0], [30.0, 60.0], 0.3), (2 * rows, [50.0, 60.0], [30.0, 60.0], 0.1)]
    for k, (K_left, K_right, R, T, uv_left) in enumerate(_line_cases(rng)[2:]):
        F = _F(K_left, K_right, R, T)
        F = F / np.linalg.norm(F)
        a, b, c = F @ [*uv_left, 1]
        foot = np.array([-a * c, -b * c]) / (a * a + b * b)
        along = np.array([-b, a]) / math.hypot(a, b)
        cases.append((F, uv_left, foot + rng.uniform(-500, 500) * along, 0.2 + 0.1 * k))
    return cases


def _of_normals(F, uv_left, uv_right, way_back):
    """Squared lengths of the two lines' normals, right and left."""
    there, back = F @ [*uv_left, 1], way_back @ [*uv_right, 1]
    return there[:2] @ there[:2], back[:2] @ back[:2]


@distance_sigma_exercise.mistake("6, What the paper says: Eq. 17")
def _right_noise_alone(F, uv_left, uv_right, sigma):
    """Only the right pixel has noise here. The line moves as well, with the left pixel."""
    return sigma


@distance_sigma_exercise.mistake("6, What the paper says: Eq. 17")
def _both_alike(F, uv_left, uv_right, sigma):
    """This is sigma times the root of 2. By how much the line moves with the left pixel depends on the
    rig, and need not be as much as the pixel itself.
    """
    return sigma * math.sqrt(2)


@distance_sigma_exercise.mistake("6, A spot gets a line")
def _same_matrix(F, uv_left, uv_right, sigma):
    """For the left pixel's share F itself is used. The derivative by the left pixel has the
    coefficients of the transposed F.
    """
    right, left = _of_normals(F, uv_left, uv_right, F)
    return sigma * math.sqrt((right + left) / right)


@distance_sigma_exercise.mistake("6, A spot gets a line")
def _in_the_left_image(F, uv_left, uv_right, sigma):
    """This is the scatter of the distance in the left image. That in the right one is asked for."""
    right, left = _of_normals(F, uv_left, uv_right, F.T)
    return sigma * math.sqrt((right + left) / left)


@distance_sigma_exercise.mistake("6, Exercises")
def _scatters_added(F, uv_left, uv_right, sigma):
    """The two standard deviations are added up. Variances of independent errors add up."""
    right, left = _of_normals(F, uv_left, uv_right, F.T)
    return sigma * (1 + math.sqrt(left / right))


@distance_sigma_exercise.mistake("6, Exercises")
def _variance(F, uv_left, uv_right, sigma):
    """This is the variance. The standard deviation is its root."""
    return distance_sigma(F, uv_left, uv_right, sigma) ** 2


@distance_sigma_exercise.mistake("6, What the paper says: Eq. 17")
def _undivided(F, uv_left, uv_right, sigma):
    """This is the scatter of a u + b v + c without the division: its size depends on that of F, and is
    no distance.
    """
    right, left = _of_normals(F, uv_left, uv_right, F.T)
    return sigma * math.sqrt(right + left)


left_to_right_exercise = FunctionExerciseMaker(
    "06.8", "Lines that miss on the table", "ex-matching-repair", points=3
)


@left_to_right_exercise.solution
def left_to_right(R_left, t_left, R_right, t_right):
    """The motion from the left camera's frame to the right one's.

    Parameters
    ----------
    R_left, t_left, R_right, t_right
        (3, 3) and (3,) of each camera: X_camera = R X_world + t, mm.

    Returns
    -------
    R, T
        (3, 3) and (3,): X_right = R X_left + T, mm.
    """
    R = R_right @ R_left.T
    T = t_right - R @ t_left
    return R, T


@left_to_right_exercise.broken
def _shift_added(R_left, t_left, R_right, t_right):
    """The left camera's shift has the wrong sign: on the way to the world it is taken off."""
    R = R_right @ R_left.T
    T = t_right + R @ t_left
    return R, T


@left_to_right_exercise.cases
def _rig_cases(rng):
    def turn(size):
        return Rotation.from_rotvec(rng.normal(0, size, 3)).as_matrix()

    still = np.eye(3), np.zeros(3)
    return [
        (*still, np.eye(3), np.array([-100.0, 0.0, 0.0])),
        (*still, turn(0.3), rng.normal(0, 100, 3)),
        (np.eye(3), np.array([40.0, 10.0, 500.0]), np.eye(3), np.array([-60.0, 10.0, 500.0])),
        *[(turn(0.5), rng.normal(0, 300, 3), turn(0.5), rng.normal(0, 300, 3)) for _ in range(4)],
    ]


@left_to_right_exercise.mistake("6, A spot gets a line")
def _shifts_subtracted(R_left, t_left, R_right, t_right):
    """The left shift is not turned. It is written in the left camera's axes, and has to be brought
    into the right one's.
    """
    return R_right @ R_left.T, t_right - t_left


@left_to_right_exercise.mistake("6, A spot gets a line")
def _all_signs(R_left, t_left, R_right, t_right):
    """The whole of T has the wrong sign now."""
    R, T = left_to_right(R_left, t_left, R_right, t_right)
    return R, -T


@left_to_right_exercise.mistake("6, A spot gets a line")
def _right_to_left(R_left, t_left, R_right, t_right):
    """This is the motion from the right camera's frame to the left one's."""
    return left_to_right(R_right, t_right, R_left, t_left)


@left_to_right_exercise.mistake("6, A spot gets a line")
def _order_of_turns(R_left, t_left, R_right, t_right):
    """The rotation was right, and is not any more: first the left one is undone, and what comes first
    stands on the right.
    """
    R = R_left.T @ R_right
    return R, t_right - R @ t_left


@left_to_right_exercise.mistake("6, A spot gets a line")
def _centres(R_left, t_left, R_right, t_right):
    """This T is the baseline in the world's axes, from centre to centre. It is wanted in the right
    camera's axes.
    """
    R, _ = left_to_right(R_left, t_left, R_right, t_right)
    return R, R_left.T @ -t_left - R_right.T @ -t_right


EXERCISES = (
    epipolar_line_exercise.made(),
    expected_correlation_exercise.made(),
    distance_sigma_exercise.made(),
    left_to_right_exercise.made(),
)
