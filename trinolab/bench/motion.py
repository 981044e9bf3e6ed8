"""Poses of the standard scene: drawn at random, and smooth motion like that of a person's hand.

Every coordinate of the motion is a smooth function of time, a sum of a few sinusoids: position and
orientation have continuous derivatives, and keep to their ranges because each goes through a sine.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from ..checks import Array, as_array, as_number, as_rng, as_transform

_BANDS_HZ = (0.1, 0.2, 0.35, 0.5)  # a coordinate is the sum of one sinusoid from each band
_RAMP_S = 0.3  # to come to rest, and to start again
# measured: with them the medians over a long time are the speeds asked for
_SPEED, _TURN = 1.77, 0.67
# of `human_motion`
_HAND_MM_S = 313.0
_HAND_DEG_S = 16.2
_SLOWEST_MM_S = 20.0
_PACE = 0.9


def random_pose(
    rng: np.random.Generator,
    x_mm: tuple[float, float] = (-90, 90),
    y_mm: tuple[float, float] = (-60, 60),
    z_mm: tuple[float, float] = (520, 620),
    tilt_deg: tuple[float, float] = (60, 120),
) -> RigidTransform:
    """Draw a pose T_world_handle of the standard scene.

    Parameters
    ----------
    rng : numpy.random.Generator
    x_mm, y_mm, z_mm : (float, float)
        Range of the handle's origin in the world frame.
    tilt_deg : (float, float)
        Range of the angle between the handle's axis and the world's z axis (the line of sight of a
        first camera whose frame is the world). The axis is uniform over that band of the sphere,
        the turn about it uniform.
    """
    ranges = as_array((x_mm, y_mm, z_mm), "x_mm, y_mm, z_mm", (3, 2))
    position = as_rng(rng).uniform(ranges.min(axis=1), ranges.max(axis=1))
    polar = np.arccos(
        rng.uniform(*np.sort(np.cos(np.deg2rad(as_array(tilt_deg, "tilt_deg", (2,))))))
    )
    azimuth, turn = rng.uniform(0, 2 * np.pi, 2)
    return RigidTransform.from_components(position, orientation(azimuth, polar, turn))


def smooth_motion(
    rng: np.random.Generator,
    duration_s: float,
    fps: float,
    start: RigidTransform | None = None,
    **options: Any,
) -> RigidTransform:
    """Draw the poses T_world_handle of a clip: ``round(duration_s * fps)`` of them at 0, 1/fps,
    2/fps, ... seconds.

    See `motion_at` for `start`, the options and the errors; also raises ValueError for a clip
    without a frame.
    """
    fps = as_number(fps, "fps", 0.0, open_low=True)
    count = round(as_number(duration_s, "duration_s", 0.0) * fps)
    if count < 1:
        raise ValueError(
            f"duration_s: expected one frame or more at {fps:g} frames per second, got {duration_s!r}"
        )
    return motion_at(rng, np.arange(count) / fps, start, **options)


def motion_at(
    rng: np.random.Generator,
    times_s: ArrayLike,
    start: RigidTransform | None = None,
    *,
    rest_s: tuple[float, float] | None = None,
    speed_mm_s: float = 200.0,
    turn_deg_s: float = 20.0,
    x_mm: tuple[float, float] = (-90, 90),
    y_mm: tuple[float, float] = (-60, 60),
    z_mm: tuple[float, float] = (520, 620),
    tilt_deg: tuple[float, float] = (60, 120),
) -> RigidTransform:
    """Draw a smooth random motion and evaluate it; times need not be evenly spaced.

    One state of `rng` gives one motion, whatever the times.

    Parameters
    ----------
    rng : numpy.random.Generator
    times_s : array_like, shape (n,)
        s; `start` is the pose at 0.
    start : RigidTransform or None
        T_world_handle; None for the middle of the ranges, the free end upwards (the world's -y).
    rest_s : (float, float) or None
        The handle rests, all poses equal, between these times; 0.3 s before and after it slows down
        and speeds up.
    speed_mm_s, turn_deg_s : float
        Typical speed and turn rate: about their medians over a long time. With the default tilt the
        turn rate stays below 3.3 times `turn_deg_s`.
    x_mm, y_mm, z_mm, tilt_deg : (float, float)
        Ranges as in `random_pose`; the motion never leaves them.

    Returns
    -------
    RigidTransform
        n poses T_world_handle.

    Raises
    ------
    ValueError
        If `start` lies outside the ranges.
    """
    ranges = _ranges(x_mm, y_mm, z_mm, tilt_deg)
    first, azimuth, turn = _coordinates(start, ranges)
    speed = as_number(speed_mm_s, "speed_mm_s", 0.0)
    rate = np.deg2rad(as_number(turn_deg_s, "turn_deg_s", 0.0))
    times = as_array(times_s, "times_s", (None,))
    if rest_s is not None:
        times = _rested(times, *np.sort(as_array(rest_s, "rest_s", (2,))))
    half = np.ptp(ranges, axis=1) / 2
    phases = _wander(as_rng(rng), times, 6)  # (6, n), unit rate
    inside = _within(
        ranges[:3],
        first[:3],
        phases[:3] * speed * _SPEED / max(float(np.linalg.norm(half[:3])), 1e-12),
    )
    polar = _within(ranges[3:], first[3:], phases[3:4] * rate * _TURN / max(float(half[3]), 1e-12))[
        0
    ]
    spins = phases[4:] * rate * _TURN
    return RigidTransform.from_components(
        inside.T, orientation(azimuth + spins[0], polar, turn + spins[1])
    )


def human_motion(rng: np.random.Generator, times_s: ArrayLike) -> RigidTransform:
    """Draw a motion of the standard scene at a person's pace: poses T_world_handle at times from 0
    on.

    The path is `motion_at`'s. Positions follow it at a more even speed (the root of the path's
    own), orientations by a clock that nearly stops at times and runs at double speed at others. In
    a handheld recording, freiburg1_xyz of the TUM RGB-D benchmark at 30 instants per second, the
    median of the speed is 329 mm/s and its 95 % quantile 496 mm/s; those of the turn rate are 15.3
    and 36.1 deg/s. Over 12 seeds of a minute this motion has 328 and 484 mm/s, 15.5 and 37.6 deg/s.
    Accelerations are twice as large, because the bench is smaller.
    """
    times = as_array(times_s, "times_s", (None,))
    as_number(times.min(initial=0.0), "times_s: the first", 0.0)
    seed = int(as_rng(rng).integers(2**62))
    rate = 2 * np.pi * rng.uniform(0.15, 0.6, (2, 1))
    phase = rng.uniform(0, 2 * np.pi, (2, 1))
    clock = times + (_PACE / 2 / rate * (np.sin(rate * times + phase) - np.sin(phase))).sum(axis=0)
    places = _person(seed, _even_pace(seed, times)).translation
    return RigidTransform.from_components(places, _person(seed, clock).rotation)


def _person(seed: int, times: Array) -> RigidTransform:
    return motion_at(
        np.random.default_rng(seed), times, speed_mm_s=_HAND_MM_S, turn_deg_s=_HAND_DEG_S
    )


def _even_pace(seed: int, times: Array, step_s: float = 0.01) -> Array:
    """Times of the path at which a hand passes that makes the root of the path's speed, shape of
    `times`.
    """
    # of the path that it may pass by then
    longest = times.max(initial=0.0) * np.sqrt(_HAND_MM_S / _SLOWEST_MM_S)
    path_s = np.arange(0, longest + 2 * step_s, step_s)
    speed = np.linalg.norm(np.gradient(_person(seed, path_s).translation, step_s, axis=0), axis=1)
    pace = np.sqrt((speed + _SLOWEST_MM_S) / _HAND_MM_S)  # seconds per second of the path
    passed = np.concatenate([[0.0], np.cumsum(step_s * (pace[1:] + pace[:-1]) / 2)])
    return np.interp(times, passed, path_s)


def _ranges(*ranges: tuple[float, float]) -> Array:
    """Ranges of x, y, z (mm) and of the tilt (rad) in increasing order, shape (4, 2)."""
    sorted_ranges = np.sort(as_array(ranges, "x_mm, y_mm, z_mm, tilt_deg", (4, 2)), axis=1)
    sorted_ranges[3] = np.deg2rad(sorted_ranges[3])
    return sorted_ranges


def _coordinates(start: RigidTransform | None, ranges: Array) -> tuple[Array, float, float]:
    """x, y, z and tilt at time 0, shape (4,); azimuth of the axis and turn about it, rad."""
    if start is None:
        return ranges.mean(axis=1), -np.pi / 2, 0.0
    axis = as_transform(start, "start").rotation.as_matrix()[:, 1]
    first = np.array([*start.translation, np.arctan2(np.hypot(axis[0], axis[1]), axis[2])])
    if (first < ranges[:, 0] - 1e-9).any() or (first > ranges[:, 1] + 1e-9).any():
        at = ", ".join(f"{value:.4g}" for value in (*first[:3], np.rad2deg(first[3])))
        raise ValueError(
            f"start: expected x, y, z (mm) and tilt (deg) within their ranges, got {at}"
        )
    azimuth = float(np.arctan2(axis[1], axis[0]))
    turn = (orientation(azimuth, first[3], 0.0).inv() * start.rotation).as_rotvec()[1]
    return first, azimuth, float(turn)


def orientation(azimuth: Array | float, polar: Array | float, turn: Array | float) -> Rotation:
    """Orientations of a handle: its y axis laid on the world's z, tipped to the polar angle, and
    turned to the azimuth.

    Parameters
    ----------
    azimuth, polar, turn : float, or ndarray of shape (n,)
        Direction of the handle's axis, and turn about it, rad.
    """
    azimuth, polar, turn = np.broadcast_arrays(azimuth, polar, turn)
    angles = np.stack([azimuth, polar, np.full(polar.shape, np.pi / 2)], axis=-1)
    return Rotation.from_euler("ZYX", angles) * Rotation.from_rotvec(
        turn[..., None] * [0.0, 1.0, 0.0]
    )


def _wander(rng: np.random.Generator, times: Array, count: int) -> Array:
    """Smooth random functions of time that are 0 at 0 and have a slope of unit root mean square;
    shape (count, n).
    """
    bands = len(_BANDS_HZ) - 1
    omega = 2 * np.pi * rng.uniform(_BANDS_HZ[:-1], _BANDS_HZ[1:], (count, bands))[..., None]
    phase = rng.uniform(0, 2 * np.pi, (count, bands))[..., None]
    return (np.sqrt(2 / bands) / omega * (np.sin(omega * times + phase) - np.sin(phase))).sum(
        axis=1
    )


def _within(ranges: Array, first: Array, travel: Array) -> Array:
    """Coordinates that start at `first`, move by about `travel` (rad a half range), and stay in
    range; shape (m, n).
    """
    middle = ranges.mean(axis=1)
    half = np.ptp(ranges, axis=1) / 2
    angle = np.arcsin(np.clip((first - middle) / np.maximum(half, 1e-12), -1, 1))
    return middle[:, None] + half[:, None] * np.sin(angle[:, None] + travel)


def _rested(times: Array, begin: float, end: float) -> Array:
    """Time that stands still from `begin` to `end`, with smooth ramps before and after; 0 stays
    0.
    """

    def warped(t: Array) -> Array:
        before = np.minimum(t, begin)
        return before - _ramp(before - begin + _RAMP_S) + _ramp(t - end)

    return warped(times) - warped(np.zeros(1))


def _ramp(t: Array) -> Array:
    """Integral over time of a smooth step from 0 to 1 that begins at 0 and takes `_RAMP_S`."""
    share = np.clip(t / _RAMP_S, 0, 1)
    return _RAMP_S * (share**3 - share**4 / 2) + np.maximum(t - _RAMP_S, 0)
