"""Sequences: what the simulated bench takes of a handle in motion, and the poses that the tracker
finds in a sequence, rendered or recorded.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scenario import Job, Shot, take
from trinolab.bench.scene import radiance
from trinolab.checks import Array, frozen
from trinolab.files.poses import transforms
from trinolab.files.recording import Frames
from trinolab.following import posetracker
from trinolab.metrics import nearest_equivalent, track_equivalent
from trinolab.pose import Pose
from trinolab.rigid import motion_between
from workbench.studies.replication import replicate

from .setup import Setup

FPS = 30.0
FOUND = ("measured", "ambiguous")
Row = list[Any]  # of a kept file: time, status, sigmas, seconds, position, quaternion


class Track(NamedTuple):
    """The poses of a sequence of n instants.

    Attributes
    ----------
    t_s : ndarray, shape (n,)
        Mid-exposure.
    status : ndarray of str, shape (n,)
    positions : ndarray, shape (n, 3)
        mm; NaN where nothing was measured.
    quaternions : ndarray, shape (n, 4)
        x, y, z, w.
    sigmas : ndarray, shape (n, 2)
        Reported standard deviations, mm and deg.
    cpu_s : ndarray, shape (n,)
        Processor time of the measurement, NaN where nobody took it.
    """

    t_s: Array
    status: np.ndarray
    positions: Array
    quaternions: Array
    sigmas: Array
    cpu_s: Array

    @property
    def found(self) -> np.ndarray:
        """The instants that have a measured pose, bool (n,)."""
        return np.isin(self.status, FOUND)

    def only(self, chosen: np.ndarray) -> Track:
        """The same at chosen instants, bool (n,)."""
        return Track(*(values[chosen] for values in self))

    def poses(self, chosen: np.ndarray | None = None) -> RigidTransform:
        """The measured poses, or those of chosen instants; at least one."""
        rows = self.found if chosen is None else chosen
        turns = Rotation.from_quat(self.quaternions[rows])
        return RigidTransform.from_components(self.positions[rows], turns)


def row_of(t_s: float, pose: Pose, cpu_s: float = np.nan) -> Row:
    """An instant of a track as numbers for a file; a pose that was not measured has none."""
    T = pose.T_world_handle
    if pose.status not in FOUND or T is None:
        status = "lost" if pose.status in FOUND else pose.status
        return [t_s, status, None, None, cpu_s, *[None] * 7]
    place = [*T.translation.tolist(), *T.rotation.as_quat(canonical=True).tolist()]
    return [t_s, pose.status, pose.sigma_mm, pose.sigma_deg, cpu_s, *place]


def rows_at_rest(
    setup: Setup, name: str, poses: Sequence[RigidTransform], part: range
) -> list[Row]:
    """Render and measure some of the poses of a test of the sheet, each with its own noise."""
    rows = []
    for i in part:
        (measurements,) = replicate(
            [poses[i]],
            setup.rig,
            setup.handle,
            setup.number(name, i),
            parameters=setup.parameters,
        )
        rows.append(row_of(float(i), measurements.pose))
    return rows


def as_track(rows: Sequence[Row]) -> Track:
    """The track of such rows."""
    status = np.array([row[1] for row in rows])
    numbers = np.array([[row[0], *row[2:]] for row in rows], dtype=float).reshape(-1, 11)
    return Track(
        numbers[:, 0], status, numbers[:, 4:7], numbers[:, 7:], numbers[:, 1:3], numbers[:, 3]
    )


def track_of_table(table: pd.DataFrame) -> Track:
    """The track of a table of poses, as `trinolab track` writes it."""
    status = table["status"].to_numpy(str)
    measured = np.isin(status, FOUND)
    places = np.full((len(table), 7), np.nan)
    if measured.any():
        T = transforms(table[measured])
        places[measured] = np.column_stack([T.translation, T.rotation.as_quat(canonical=True)])
    sigmas = table[["sigma_mm", "sigma_deg"]].to_numpy(float)
    t_s = table["t_s"].to_numpy(float)
    return Track(t_s, status, places[:, :3], places[:, 3:], sigmas, np.full(len(table), np.nan))


def follow(frames: Iterable[Frames], setup: Setup) -> list[Row]:
    """The tracker's way through a sequence, with the processor time that each instant took."""
    rows = []
    state = None
    for now in frames:
        if state is None:
            state = posetracker.start(now.t_s - 1.0)
        begin = time.process_time()
        state, tracked = posetracker.step(
            state, now.images, now.t_s, setup.rig, setup.handle, setup.parameters
        )
        rows.append(row_of(now.t_s, tracked.measurement.pose, time.process_time() - begin))
    return rows


def instants(n: int, rng: np.random.Generator) -> Array:
    """Times of n instants, s, from some time within the first interval on, shape (n,)."""
    return frozen((np.arange(n) + rng.uniform()) / FPS)


def moving(
    setup: Setup, times_s: Array, poses: RigidTransform, velocities: Array, seed: int
) -> Iterator[Frames]:
    """The bench's frames of a handle that moves without turning, with motion blur.

    Parameters
    ----------
    setup : Setup
    times_s : ndarray, shape (n,)
    poses : RigidTransform
        n poses T_world_handle, at mid-exposure.
    velocities : ndarray, shape (n, 3)
        mm/s.
    seed : int
        Of the noise.
    """
    lights = (1.0,) * len(setup.rig.cameras)
    shots = [
        Shot(T, None, lights, velocity, np.zeros(3), False)
        for T, velocity in zip(poses, velocities, strict=True)
    ]
    return taken(Job(setup.rig, setup.handle, shots, times_s, seed))


def taken(job: Job) -> Iterator[Frames]:
    """The frames of a recording's job, as they are asked for."""
    for k, t in enumerate(job.times_s):
        yield Frames(k, float(t), [take(job, k, c) for c in range(len(job.rig.cameras))])


def resting(setup: Setup, pose: RigidTransform, n: int, seed: int) -> Iterator[Frames]:
    """The bench's frames of a handle at rest: the same light each time, with other noise."""
    bench = Bench()
    rng = np.random.default_rng(seed)
    light = [
        blurred(radiance(camera, setup.handle, pose, bench), bench) for camera in setup.rig.cameras
    ]
    for k in range(n):
        yield Frames(k, k / FPS, [digitise(image, bench, rng) for image in light])


def errors(
    track: Track, truths: RigidTransform, setup: Setup, one_track: bool = True
) -> tuple[Array, np.ndarray]:
    """Measured against true poses, up to the handle's symmetry.

    Parameters
    ----------
    track : Track
        n instants.
    truths : RigidTransform
        n poses T_world_handle.
    one_track : bool
        By one equivalent for all of them, so that a flip is an error; else each by its nearest.

    Returns
    -------
    errors : ndarray, shape (n, 6)
        Position (mm) and rotation vector (rad), measured minus true; NaN where there is no pose.
    found : ndarray of bool, shape (n,)
    """
    measured = track.found
    off = np.full((len(measured), 6), np.nan)
    if measured.any():
        compare = track_equivalent if one_track else nearest_equivalent
        true = truths[measured]
        turned = compare(track.poses(), true, setup.handle.symmetries)
        off[measured] = [motion_between(a, b) for a, b in zip(turned, true, strict=True)]
    return off, measured


def lengths(errors: Array) -> tuple[Array, Array]:
    """Distances (mm) and angles (deg) of errors (n, 6), each (n,)."""
    return (
        np.linalg.norm(errors[:, :3], axis=1),
        np.rad2deg(np.linalg.norm(errors[:, 3:], axis=1)),
    )
