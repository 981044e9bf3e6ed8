"""The frames of a script: what each camera of the simulated bench takes, and what it truly sees."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arm import true_visibility
from .bench import Bench, background, blurred, digitise
from .camera import Rig
from .checks import Array
from .exposure import smeared
from .handle import Handle
from .layer import over
from .script import Shot
from .shadow import shadow


class Job(NamedTuple):
    """A recording to make: cameras, handle, the instants with their times (s), and the seed of the noise."""

    rig: Rig
    handle: Handle
    shots: list[Shot]
    times_s: Array
    seed: int
    bench: Bench = Bench()


def take(job: Job, frame: int, index: int) -> np.ndarray:
    """A camera's image of an instant, uint8 (height, width)."""
    camera, shot, bench = job.rig.cameras[index], job.shots[frame], job.bench
    light: Array = background(camera, bench)
    if shot.T_world_handle is not None and shot.gains[index] > 0:
        if shot.shadows:
            light = light * (1 - bench.shading * shadow(camera, job.handle, shot.T_world_handle, bench, shot.arm))
        layer = smeared(camera, job.handle, shot.T_world_handle, bench, shot.velocity, shot.turn_rate, shot.arm)
        light = over(layer, light)
    return digitise(shot.gains[index] * blurred(light, bench), bench, _noise(job, index, 1 + frame))


def seen_markers(job: Job, frame: int) -> list[int]:
    """How many markers each camera truly sees at an instant; a covered camera none."""
    shot = job.shots[frame]
    if shot.T_world_handle is None:
        return [0] * len(job.rig.cameras)
    return [int(true_visibility(camera, job.handle, shot.T_world_handle, shot.arm).sum()) if gain > 0 else 0
            for camera, gain in zip(job.rig.cameras, shot.gains, strict=True)]


def empty(job: Job, index: int) -> np.ndarray:
    """A camera's image of the empty bench in the light of the first instant."""
    light = job.shots[0].gains[index] * blurred(background(job.rig.cameras[index], job.bench), job.bench)
    return digitise(light, job.bench, _noise(job, index, 0))


def _noise(job: Job, index: int, number: int) -> np.random.Generator:
    return np.random.default_rng([job.seed, index, number])
