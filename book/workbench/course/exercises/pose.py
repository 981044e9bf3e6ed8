"""Exercises of chapter 8: from points to the pose."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..exercise import FunctionExerciseMaker


def _forms(xy_left, xy_right, R, T):
    ray = np.array([*xy_left, 1.0])
    turned = R @ ray
    n = T[:2] - np.asarray(xy_right) * T[2]
    d = np.asarray(xy_right) * turned[2] - turned[:2]
    return ray, turned, n, d


def _at(z, ray, turned, T):
    return z * ray if z > 0 and z * turned[2] + T[2] > 0 else np.full(3, np.nan)


def _form(which):
    def point(xy_left, xy_right, R, T):
        ray, turned, n, d = _forms(xy_left, xy_right, R, T)
        with np.errstate(all="ignore"):
            return _at(n[which] / d[which], ray, turned, T)

    return point


def _fitted(on_rod, measured, rotation, keep_all=False):
    """A fit with another rotation, of U and the transposed V."""
    seen = np.isfinite(measured).all(axis=1) | keep_all
    p, q = on_rod[seen], measured[seen]
    U, _, Vt = np.linalg.svd((q - q.mean(axis=0)).T @ (p - p.mean(axis=0)))
    F = np.eye(4)
    F[:3, :3] = rotation(U, Vt)
    F[:3, 3] = q.mean(axis=0) - F[:3, :3] @ p.mean(axis=0)
    return F


def _guarded(U, Vt):
    return U @ np.diag([1, 1, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt


def _ends(centre_left, ray_left, centre_right, ray_right):
    """The nearest points of the two rays."""
    sides = np.stack([ray_left, -ray_right], axis=1)
    a, b = np.linalg.solve(sides.T @ sides, sides.T @ (centre_right - centre_left))
    return centre_left + a * ray_left, centre_right + b * ray_right


point_of_pixels_exercise = FunctionExerciseMaker(
    "08.3", "A point by both forms", "pose-ex-point", points=4
)


@point_of_pixels_exercise.solution
def point_of_pixels(xy_left, xy_right, R, T):
    """A marker's place from its pixels in two cameras: both forms of z by least squares (Eq. 20).

    Parameters
    ----------
    xy_left, xy_right
        (2,) each: pixels from the principal point, divided by the focal lengths, X/f and Y/f.
    R, T
        (3, 3) and (3,): from the left camera's frame to the right one's, X_right = R X_left + T, mm.

    Returns
    -------
    array
        (3,), mm, in the left camera's frame and on the left ray. NaN in all three if the point is
        not in front of both cameras.
    """
    ray = np.array([*xy_left, 1.0])
    a, b, c = R @ ray
    x_right, y_right = xy_right
    n = np.array([T[0] - x_right * T[2], T[1] - y_right * T[2]])
    d = np.array([x_right * c - a, y_right * c - b])
    z = (n @ d) / (d @ d)
    in_front = z > 0 and z * c + T[2] > 0
    return z * ray if in_front else np.full(3, np.nan)


@point_of_pixels_exercise.cases
def _point_cases(rng):
    """Cameras side by side, one above the other, turned; and points behind the one or the other."""
    side, above = np.array([-100.0, 0, 0]), np.array([0, 110.0, 20])
    turned = Rotation.from_rotvec([0.05, 0.2, -0.1]).as_matrix()
    behind = Rotation.from_euler("y", 100, degrees=True).as_matrix()
    motions = [
        (np.eye(3), side),
        (Rotation.from_rotvec([0.2, 0.02, 0.1]).as_matrix(), above),
        (turned, np.array([-90.0, 15, 12])),
        (turned.T, np.array([60.0, -70, 5])),
        (np.eye(3), -side),
    ]
    cases = []
    for R, T in motions:
        point = rng.uniform([-60, -60, 500], [60, 60, 620])
        in_right = R @ point + T
        noise = rng.normal(0, 2e-4, (2, 2))
        xy = np.array([point[:2] / point[2], in_right[:2] / in_right[2]]) + noise
        cases.append((xy[0], xy[1], R, T))
    cases[-1] = (*cases[-1][:3], side)  # the wrong sign of the baseline: behind both
    point = np.array([30.0, -20, 560])
    in_right = behind @ point + side
    xy_right = in_right[:2] / in_right[2] + [1e-4, -2e-4]
    cases.append((point[:2] / point[2], xy_right, behind, side))  # behind the right one
    # far along the right axis, so that the depth there is little without T, or less than nothing
    half = Rotation.from_euler("y", 85, degrees=True).as_matrix()
    for R, T, place in (
        (half, np.array([-400.0, 10, 700.0]), np.array([20.0, -30, 540])),
        (behind, np.array([-300.0, 0, 250.0]), np.array([-25.0, 15, 580])),
        (np.eye(3), np.array([-40.0, 25, -900.0]), np.array([30.0, 10, 560])),  # it stands beyond
        # close before and close behind the one, the other
        (np.eye(3), np.array([-100.0, 5, 100.0]), np.array([3.0, -2, 0.5])),
        (np.eye(3), np.array([-100.0, 5, 100.0]), np.array([3.0, -2, -0.5])),
        (np.eye(3), np.array([-100.0, 5, -559.5]), np.array([30.0, -20, 560])),
        (np.eye(3), np.array([-100.0, 5, -560.5]), np.array([30.0, -20, 560])),
    ):
        in_right = R @ place + T
        xy_right = in_right[:2] / in_right[2] + rng.normal(0, 2e-4, 2)
        cases.append((place[:2] / place[2], xy_right, R, T))
    return cases


point_of_pixels_exercise.known_mistake(
    "This is the first form alone. With one camera above the other it is 0/0.",
    "8, The algorithm: from pixels to points",
    _form(0),
)


@point_of_pixels_exercise.mistake("8, The algorithm: from pixels to points")
def _first_anywhere(xy_left, xy_right, R, T):
    """This is the first form alone, which is 0/0 with one camera above the other; and points
    behind a camera are returned, too.
    """
    ray, _, n, d = _forms(xy_left, xy_right, R, T)
    with np.errstate(all="ignore"):
        return n[0] / d[0] * ray


point_of_pixels_exercise.known_mistake(
    "This is the second form alone. With cameras side by side it is 0/0.",
    "8, The algorithm: from pixels to points",
    _form(1),
)


@point_of_pixels_exercise.mistake("8, The algorithm: from pixels to points")
def _mean_of_forms(xy_left, xy_right, R, T):
    """This is the mean of both forms. A form that says nothing spoils it: in the least squares
    solution each form counts with its own d.
    """
    ray, turned, n, d = _forms(xy_left, xy_right, R, T)
    with np.errstate(all="ignore"):
        return _at((n / d).mean(), ray, turned, T)


@point_of_pixels_exercise.mistake("8, What is wrong in print")
def _as_printed(xy_left, xy_right, R, T):
    """R and T have been inverted. Here they lead from left to right already, as Eq. 20 needs them;
    it is Eq. 25 that defines the way back.
    """
    return point_of_pixels(xy_left, xy_right, R.T, -R.T @ T)


@point_of_pixels_exercise.mistake("8, The algorithm: from pixels to points")
def _anywhere(xy_left, xy_right, R, T):
    """A point behind a camera is returned. Its images fit, and only the sign of the depth shows
    that it cannot be.
    """
    ray, _, n, d = _forms(xy_left, xy_right, R, T)
    return (n @ d) / (d @ d) * ray


@point_of_pixels_exercise.mistake("8, The algorithm: from pixels to points")
def _before_the_left(xy_left, xy_right, R, T):
    """The point is in front of the left camera, and nobody has asked the right one: its depth
    there is the third component of R X + T.
    """
    ray, _, n, d = _forms(xy_left, xy_right, R, T)
    z = (n @ d) / (d @ d)
    return z * ray if z > 0 else np.full(3, np.nan)


@point_of_pixels_exercise.mistake("8, The algorithm: from pixels to points")
def _depth_less_T(xy_left, xy_right, R, T):
    """The depth in the right camera has the wrong sign of T: it is the third component of R X + T,
    and not of R X - T.
    """
    ray, turned, n, d = _forms(xy_left, xy_right, R, T)
    z = (n @ d) / (d @ d)
    return z * ray if z > 0 and z * turned[2] - T[2] > 0 else np.full(3, np.nan)


@point_of_pixels_exercise.mistake("8, What the paper says")
def _ray_and_depth(xy_left, xy_right, R, T):
    """x and y are those of the ray at the depth 1. Multiply them by z."""
    x, y, z = point_of_pixels(xy_left, xy_right, R, T)
    return np.array([x / z, y / z, z])


rigid_motion_exercise = FunctionExerciseMaker("08.4", "The rigid fit", "pose-ex-fit", points=4)


@rigid_motion_exercise.solution
def rigid_motion(on_rod, measured):
    """The rigid motion that carries the rod's markers onto measured points (Eq. 23, 24).

    Parameters
    ----------
    on_rod
        (n, 3), the markers' places on the rod, mm.
    measured
        (n, 3), row by row the same markers in the world, mm. A row of NaN is a marker that was not
        measured.

    Returns
    -------
    array
        (4, 4), the matrix F of Eq. 23: a rotation, never a reflection, and a translation, with the
        least sum of squared distances. Rows with a NaN do not count.
    """
    seen = np.isfinite(measured).all(axis=1)
    p, q = on_rod[seen], measured[seen]
    p_mean, q_mean = p.mean(axis=0), q.mean(axis=0)
    U, _, Vt = np.linalg.svd((q - q_mean).T @ (p - p_mean))
    mirror = np.linalg.det(U) * np.linalg.det(Vt)
    F = np.eye(4)
    F[:3, :3] = U @ np.diag([1, 1, mirror]) @ Vt
    F[:3, 3] = q_mean - F[:3, :3] @ p_mean
    return F


@rigid_motion_exercise.cases
def _fit_cases(rng):
    """Points all around, with missing ones, and nearly flat sets, of which noise turns some over.

    In a set that is flat but for rounding, rounding would decide what a fit without a guard gives.
    """
    rod = rng.normal(0, 10, (8, 3))
    plate = rod[:5] * [1, 1, 0.02]
    over = plate * [1, 1, -0.5]
    cases = []
    sets = [
        (rod, rod),
        (rod, rod),
        (plate, plate),
        (plate, over),
        (plate, over),
        (rod[2:6], rod[2:6]),
    ]
    for points, seen in sets:
        turn = Rotation.from_rotvec(rng.normal(0, 1.5, 3))
        noise = rng.normal(0, 0.02, points.shape)
        cases.append((points, turn.apply(seen) + rng.normal(0, 300, 3) + noise))
    cases[1][1][[1, 6]] = np.nan
    return cases


@rigid_motion_exercise.mistake("8, The algorithm: from points to the pose")
def _without_guard(on_rod, measured):
    """The guard against reflections is missing: with markers in a plane your matrix may have the
    determinant -1.
    """
    return _fitted(on_rod, measured, lambda U, Vt: U @ Vt)


@rigid_motion_exercise.mistake("8, The algorithm: from points to the pose")
def _negative(on_rod, measured):
    """A reflection has been turned into a rotation by a minus before the whole matrix. That is a
    rotation, but not the best one: only the third direction changes its sign.
    """
    return _fitted(on_rod, measured, lambda U, Vt: U @ Vt * np.linalg.det(U @ Vt))


@rigid_motion_exercise.mistake("8, The algorithm: from points to the pose")
def _axis_of_the_rotation(on_rod, measured):
    """The sign is at the wrong place: it stands between U and the transposed V, and belongs to the
    smallest singular value, not to an axis of the rod.
    """
    return _fitted(on_rod, measured, lambda U, Vt: U @ Vt @ np.diag([1, 1, np.linalg.det(U @ Vt)]))


@rigid_motion_exercise.mistake("8, What is wrong in print")
def _any_matrix(on_rod, measured):
    """This is the best matrix of all, which stretches and shears the rod. Only a rotation and a
    translation can be a pose.
    """
    seen = np.isfinite(measured).all(axis=1)
    with_ones = np.column_stack([on_rod[seen], np.ones(seen.sum())])
    F = np.eye(4)
    F[:3] = np.linalg.lstsq(with_ones, measured[seen])[0].T
    return F


@rigid_motion_exercise.mistake("8, The algorithm: from points to the pose")
def _rotation_back(on_rod, measured):
    """The rotation is transposed: it turns the world's axes into the rod's."""
    return _fitted(on_rod, measured, lambda U, Vt: _guarded(U, Vt).T)


@rigid_motion_exercise.mistake("8, What the paper says")
def _way_back(on_rod, measured):
    """This motion leads from the world to the rod. F leads from the rod to the world."""
    return np.linalg.inv(rigid_motion(on_rod, measured))


@rigid_motion_exercise.mistake("8, The algorithm: from points to the pose")
def _difference_of_means(on_rod, measured):
    """The shift is the difference of the two means. The rod's mean has to be rotated before it is
    taken off.
    """
    F = rigid_motion(on_rod, measured)
    F[:3, 3] = np.nanmean(measured, axis=0)
    seen = np.isfinite(measured).all(axis=1)
    F[:3, 3] -= on_rod[seen].mean(axis=0)
    return F


@rigid_motion_exercise.mistake("8, The algorithm: from points to the pose")
def _missing_counted(on_rod, measured):
    """Markers that were not measured count, so that NaN spreads over everything. Leave their rows
    out of both lists.
    """
    return _fitted(on_rod, measured, _guarded, keep_all=True)


@rigid_motion_exercise.mistake("8, The algorithm: from points to the pose")
def _one_mean_over_all(on_rod, measured):
    """The rod's mean is over all markers, the world's over those that were measured. Both means
    are of the same markers.

    Means with the places of markers that were not measured.
    """
    F = rigid_motion(on_rod, measured)
    F[:3, 3] = np.nanmean(measured, axis=0) - F[:3, :3] @ on_rod.mean(axis=0)
    return F


midpoint_exercise = FunctionExerciseMaker("08.5", "The midpoint", "pose-ex-midpoint", points=4)


@midpoint_exercise.solution
def midpoint(centre_left, ray_left, centre_right, ray_right):
    """The middle of the shortest line between two rays.

    Parameters
    ----------
    centre_left, centre_right
        (3,) each: the cameras' places, mm.
    ray_left, ray_right
        (3,) each: the rays' directions, of any length, in the same frame. They are not parallel.

    Returns
    -------
    array
        (3,), mm.
    """
    sides = np.stack([ray_left, -ray_right], axis=1)
    (a, b), *_ = np.linalg.lstsq(sides, centre_right - centre_left)
    return (centre_left + a * ray_left + centre_right + b * ray_right) / 2


@midpoint_exercise.cases
def _ray_cases(rng):
    cases = []
    for scale in (1.0, 1.0, 0.4, 3.0, 1.0, 7.0):
        left, right = rng.normal(0, 80, (2, 3))
        point = rng.uniform([-60, -60, 500], [60, 60, 620])
        rays = [point + rng.normal(0, 2, 3) - centre for centre in (left, right)]
        rays = [ray / np.linalg.norm(ray) * scale for ray in rays]
        cases.append((left, rays[0], right, rays[1] / scale**0.5))
    return cases


@midpoint_exercise.mistake("8, Exercises")
def _left_end(*rays):
    """This point lies on the left ray. Half way to the right ray is asked for."""
    return _ends(*rays)[0]


@midpoint_exercise.mistake("8, Exercises")
def _right_end(*rays):
    """This point lies on the right ray. Half way to the left ray is asked for."""
    return _ends(*rays)[1]


@midpoint_exercise.mistake("8, Exercises")
def _sum_of_ends(*rays):
    """The two nearest points are added up, and not divided by 2."""
    return np.sum(_ends(*rays), axis=0)


@midpoint_exercise.mistake("8, Exercises")
def _line_between(*rays):
    """This is the way from the one ray to the other. The place of its middle is asked for."""
    left, right = _ends(*rays)
    return right - left


@midpoint_exercise.mistake("8, Exercises")
def _same_sign(centre_left, ray_left, centre_right, ray_right):
    """The right ray has the wrong sign: from c_l + a d_l = c_r + b d_r follows a d_l - b d_r = c_r
    - c_l.
    """
    sides = np.stack([ray_left, ray_right], axis=1)
    (a, b), *_ = np.linalg.lstsq(sides, centre_right - centre_left)
    return (centre_left + a * ray_left + centre_right + b * ray_right) / 2


@midpoint_exercise.mistake("8, Exercises")
def _as_if_of_length_one(centre_left, ray_left, centre_right, ray_right):
    """This formula takes the directions for unit vectors. They may have any length."""
    base, cosine = centre_right - centre_left, ray_left @ ray_right
    with np.errstate(all="ignore"):
        a = (base @ ray_left - cosine * (base @ ray_right)) / (1 - cosine**2)
        b = (cosine * (base @ ray_left) - base @ ray_right) / (1 - cosine**2)
    return (centre_left + a * ray_left + centre_right + b * ray_right) / 2


in_world_exercise = FunctionExerciseMaker(
    "08.8", "A camera that sees double the turn", "pose-ex-repair", points=3
)


@in_world_exercise.solution
def in_world(points, R, t):
    """Points of a camera's frame, seen from the world.

    Parameters
    ----------
    points
        (n, 3), a point per row, in the camera's frame, mm.
    R, t
        (3, 3) and (3,): X_camera = R X_world + t, mm.

    Returns
    -------
    array
        (n, 3), the same points in the world's frame, mm.
    """
    return (points - t) @ R


@in_world_exercise.broken
def _for_columns(points, R, t):
    """The inverse of R is its transpose, and a row needs the transpose of that once more."""
    return (points - t) @ R.T


@in_world_exercise.cases
def _frame_cases(rng):
    points = rng.uniform([-80, -60, 500], [80, 60, 620], (5, 3))
    turned = [Rotation.from_rotvec(rng.normal(0, size, 3)).as_matrix() for size in (0.1, 0.5, 1.5)]
    return [
        (points, np.eye(3), np.zeros(3)),
        (points, np.eye(3), np.array([-100.0, 0.0, 10.0])),
        (points[:1], turned[0], rng.normal(0, 100, 3)),
        (points, turned[1], rng.normal(0, 300, 3)),
        (points, turned[2], rng.normal(0, 300, 3)),
        (points[:3], turned[2], np.zeros(3)),
    ]


@in_world_exercise.mistake("8, The algorithm: from pixels to points")
def _shift_behind(points, R, t):
    """The shift is undone behind the rotation. It was made last, and has to be undone first."""
    return points @ R - t


@in_world_exercise.mistake("8, The algorithm: from pixels to points")
def _from_the_world(points, R, t):
    """This goes from the world to the camera. The way back is asked for."""
    return points @ R.T + t


@in_world_exercise.mistake("8, The algorithm: from pixels to points")
def _shift_added(points, R, t):
    """The shift is added once more. On the way back it is taken off."""
    return (points + t) @ R


@in_world_exercise.mistake("8, Exercises")
def _columns(points, R, t):
    """The points come out as columns. A point a row is asked for."""
    return in_world(points, R, t).T


@in_world_exercise.mistake("8, The algorithm: from pixels to points")
def _no_turn(points, R, t):
    """The rotation is left out, so that only cameras that are not turned are right."""
    return points - t


EXERCISES = (
    point_of_pixels_exercise.made(),
    rigid_motion_exercise.made(),
    midpoint_exercise.made(),
    in_world_exercise.made(),
)
