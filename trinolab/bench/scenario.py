"""The scenario of a recording: who moves, how bright it is, what is in the way, and the frames that
come of it.

Two scenarios are the standard recordings, `calm` and `hard`. In `slow` the handle moves as slowly
as `trinolab refine` asks for; `following` holds it along given poses. A scenario does not depend on
how long it is played: the first seconds of a longer one are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig
from ..checks import Array, as_array
from ..handle import Handle
from .hand import Arm, true_visibility
from .layer import over, shadow
from .motion import human_motion, motion_at
from .optics import Bench, background, blurred, digitise
from .scene import EXPOSURE_S, smeared

# The hard script's times, s. A camera is its place in the rig; a rig of two takes them in turn.
HIDDEN = ((0.6, 1.4, 2), (4.4, 5.2, 0), (9.0, 9.8, 1))  # a second hand is before this camera
LIGHT_STEP_S = 1.5
LIGHT_BEFORE = 0.8
LIGHT_AFTER = 1.2
COVERED = (3.0, 4.0, 1)  # this camera is dark
# the handle leaves the images, and comes back
OUT_S = 5.6
AWAY_S = 6.6
BACK_S = 6.9
INSIDE_S = 7.9
ABSENT_S = (8.2, 8.7)  # nobody is there
EMPTY_S = 1.0  # of the calm script, at its start
_AWAY_MM = 350.0  # along the world's x: beyond every image
# in which the second hand comes from out of the images, and how far
_APPROACH_S, _APPROACH_MM = 0.2, 450.0
_MIDDLE = np.array([0.0, 0.0, 570.0])  # of the standard scene
_FROM = np.array([0.2, 0.75, 0.63])  # direction from which the second hand enters
_DRIFT, _DRIFT_S = 0.08, 8.0  # the light's slow drift: its share, its period
_SLOW_MM_S, _SLOW_DEG_S = 30.0, 10.0  # of the slow script: typical speed and turn rate, /s
_LEAD_S = 0.1  # the motion has begun before the first instant
# the elbow is outside the images
HOLDING = Arm(forearm=(0.78, 0.58, 0.24), forearm_length_mm=500.0)


class Shot(NamedTuple):
    """One instant, at mid-exposure.

    Attributes
    ----------
    T_world_handle : RigidTransform or None
        None where there is no handle, and nobody.
    arm : Arm or None
    gains : tuple of float
        The light for each camera of the rig; 0 for one that is covered.
    velocity, turn_rate : ndarray, shape (3,)
        mm/s and rad/s, world frame: what smears the image.
    shadows : bool
        Whether handle and arm throw one on the background.
    """

    T_world_handle: RigidTransform | None
    arm: Arm | None
    gains: tuple[float, ...]
    velocity: Array
    turn_rate: Array
    shadows: bool


def calm(rig: Rig, times_s: ArrayLike, seed: int) -> list[Shot]:
    """An empty first second, then a person's motion; steady light, no motion blur."""
    times = as_array(times_s, "times_s", (None,))
    poses = human_motion(np.random.default_rng([seed, 0]), times + _LEAD_S)
    return following(rig, [None if t < EMPTY_S else T for t, T in zip(times, poses, strict=True)])


def slow(rig: Rig, times_s: ArrayLike, seed: int) -> list[Shot]:
    """A handle that moves slowly through the volume and turns; steady light, no motion blur."""
    times = as_array(times_s, "times_s", (None,))
    rng = np.random.default_rng([seed, 2])
    return following(
        rig, list(motion_at(rng, times + _LEAD_S, speed_mm_s=_SLOW_MM_S, turn_deg_s=_SLOW_DEG_S))
    )


def following(rig: Rig, poses: Sequence[RigidTransform | None]) -> list[Shot]:
    """A hand that holds the handle at these poses, T_world_handle; None where nobody is there."""
    lights = (1.0,) * len(rig.cameras)
    rest = np.zeros(3)
    return [Shot(T, None if T is None else HOLDING, lights, rest, rest, False) for T in poses]


def hard(rig: Rig, times_s: ArrayLike, seed: int) -> list[Shot]:
    """A scenario with all that makes tracking hard, at the times above: see `HIDDEN` to `ABSENT_S`.

    A second hand hides one camera's view, the light steps by 1.5 and drifts, one camera is covered,
    the handle leaves the images and is away; motion smears the images over the exposure, and
    shadows move on the background.
    """
    times = as_array(times_s, "times_s", (None,))
    begin, middle, end = (
        _hard_poses(seed, times + t) for t in (-EXPOSURE_S / 2, 0.0, EXPOSURE_S / 2)
    )
    velocities = (end.translation - begin.translation) / EXPOSURE_S
    turns = (end.rotation * begin.rotation.inv()).as_rotvec() / EXPOSURE_S
    shots = []
    for t, T, velocity, turn in zip(times, middle, velocities, turns, strict=True):
        present = not ABSENT_S[0] <= t < ABSENT_S[1]
        shots.append(
            Shot(
                T if present else None,
                replace(HOLDING, hides_from=_hidden_from(rig, t)) if present else None,
                _gains(rig, t),
                velocity,
                turn,
                True,
            )
        )
    return shots


def _hard_poses(seed: int, times: Array) -> RigidTransform:
    away = _smooth_step((times - OUT_S) / (AWAY_S - OUT_S)) - _smooth_step(
        (times - BACK_S) / (INSIDE_S - BACK_S)
    )
    poses = human_motion(np.random.default_rng([seed, 1]), times + _LEAD_S)
    shift = np.column_stack([_AWAY_MM * away, np.zeros((len(times), 2))])
    return RigidTransform.from_components(poses.translation + shift, poses.rotation)


def _gains(rig: Rig, t: float) -> tuple[float, ...]:
    """The light for each camera at a time."""
    light = (LIGHT_BEFORE if t < LIGHT_STEP_S else LIGHT_AFTER) * (
        1 + _DRIFT * np.sin(2 * np.pi * t / _DRIFT_S)
    )
    count = len(rig.cameras)
    (begin, end, covered) = COVERED
    return tuple(
        0.0 if k == covered % count and begin <= t < end else float(light) for k in range(count)
    )


def _hidden_from(rig: Rig, t: float) -> tuple[float, float, float] | None:
    """The viewpoint from which the second hand hides the handle at a time: a camera's centre, or
    aside while it comes and goes.
    """
    for begin, end, index in HIDDEN:
        if begin <= t < end:
            near = _smooth_step(np.array(min(t - begin, end - t) / _APPROACH_S))
            camera = rig.cameras[index % len(rig.cameras)]
            x, y, z = camera.centre + (1 - near) * _APPROACH_MM * _aside(camera)
            return float(x), float(y), float(z)
    return None


def _aside(camera: Camera) -> Array:
    """Direction across a camera's sight from which the second hand comes: from below, shape
    (3,).
    """
    sight = camera.centre - _MIDDLE
    sight /= np.linalg.norm(sight)
    across = _FROM - (_FROM @ sight) * sight
    return across / max(float(np.linalg.norm(across)), 1e-12)


def _smooth_step(share: Array) -> Array:
    """A smooth step from 0 at 0 to 1 at 1, at rest at both."""
    share = np.clip(share, 0, 1)
    return share**2 * (3 - 2 * share)


class Job(NamedTuple):
    """A recording to make: cameras, handle, the instants with their times (s), and the seed of the
    noise.
    """

    rig: Rig
    handle: Handle
    shots: list[Shot]
    times_s: Array
    seed: int
    bench: Bench = Bench()


def take(job: Job, frame: int, index: int) -> np.ndarray:
    """A camera's image of an instant, uint8 (height, width)."""
    return noisy(job, frame, index, light_of(job, frame, index))


def light_of(job: Job, frame: int, index: int) -> Array:
    """The light that reaches a camera at an instant, before noise and rounding, grey levels
    (height, width).
    """
    camera = job.rig.cameras[index]
    shot = job.shots[frame]
    bench = job.bench
    light: Array = background(camera, bench)
    if shot.T_world_handle is not None and shot.gains[index] > 0:
        if shot.shadows:
            light = light * (
                1 - bench.shading * shadow(camera, job.handle, shot.T_world_handle, bench, shot.arm)
            )
        layer = smeared(
            camera, job.handle, shot.T_world_handle, bench, shot.velocity, shot.turn_rate, shot.arm
        )
        light = over(layer, light)
    return shot.gains[index] * blurred(light, bench)


def noisy(job: Job, frame: int, index: int, light: Array, draw: int = 0) -> np.ndarray:
    """The image of what a camera gets to see, `light_of` it, uint8 (height, width); each draw has
    noise of its own.
    """
    again = (draw,) if draw else ()
    return digitise(light, job.bench, _noise(job, index, 1 + frame, *again))


def seen_markers(job: Job, frame: int) -> list[int]:
    """Numbers of markers that each camera truly sees at an instant; 0 for a covered camera."""
    shot = job.shots[frame]
    if shot.T_world_handle is None:
        return [0] * len(job.rig.cameras)
    return [
        int(true_visibility(camera, job.handle, shot.T_world_handle, shot.arm).sum())
        if gain > 0
        else 0
        for camera, gain in zip(job.rig.cameras, shot.gains, strict=True)
    ]


def empty(job: Job, index: int) -> np.ndarray:
    """A camera's image of the empty bench in the light of the first instant."""
    light = job.shots[0].gains[index] * blurred(
        background(job.rig.cameras[index], job.bench), job.bench
    )
    return digitise(light, job.bench, _noise(job, index, 0))


def _noise(job: Job, index: int, *numbers: int) -> np.random.Generator:
    return np.random.default_rng([job.seed, index, *numbers])
