"""Instants of a recording that say most of rig and handle, and the pixels of their markers' centres.

A bundle adjustment needs instants at which the handle is still, because a moving marker's centre is
measured less well, and which are spread over its motion, because similar ones add no information.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from ..calibration.bundle import Centres
from ..camera import Rig
from ..checks import Array
from ..estimators.centroids import centre_pixels
from ..estimators.pixels import FLOOR_PX
from ..files.journal import Journal
from ..files.recording import Recording, some_instants
from ..handle import Handle

MAX_SLANT_DEG = 65.0  # beyond, the image model misplaces a marker's centre by more than its noise
# Way of a marker while the shutter is open, up to which an instant counts as still. Beyond, errors of
# a moving marker's centre are larger than its noise says, and alike in neighbouring frames.
MAX_WAY_PX = 4.0
SPREAD_MM, SPREAD_RAD = 50.0, 0.5  # distances that count alike in the choice of instants


class Motion(NamedTuple):
    """The handle's motion at some instants, by the poses before and after.

    Attributes
    ----------
    speed : ndarray, shape (n,)
        mm/s, of the faster of the two steps.
    way_px : ndarray, shape (n,)
        Way of a marker while the shutter is open, in the camera in which it is longest.
    """

    speed: Array
    way_px: Array

    @property
    def still(self) -> np.ndarray:
        """Whether the handle is still enough, bool (n,)."""
        return self.way_px < MAX_WAY_PX


def motion(shown: pd.DataFrame, rig: Rig, exposure_s: float) -> Motion:
    """The handle's motion at the rows of a table of poses; a single one counts as still."""
    if len(shown) < 2:
        return Motion(np.zeros(len(shown)), np.zeros(len(shown)))
    places = shown[["x_mm", "y_mm", "z_mm"]].to_numpy(float)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(shown["t_s"])
    speed = np.maximum(np.append(steps, 0.0), np.append(0.0, steps))
    pixels_a_mm = [
        camera.focal.max() / np.maximum(camera.T_cam_world.apply(places)[:, 2], 1.0)
        for camera in rig.cameras
    ]
    return Motion(speed, exposure_s * speed * np.max(pixels_a_mm, axis=0))


def spread_out(poses: RigidTransform, most: int) -> np.ndarray:
    """Choose poses that spread: each next one is that which is farthest from all chosen before.

    Parameters
    ----------
    poses : RigidTransform
        A batch of n.
    most : int

    Returns
    -------
    ndarray of int
        At most as many indices, in increasing order.
    """
    if len(poses) <= most:
        return np.arange(len(poses))
    places = poses.translation / SPREAD_MM
    turns = poses.rotation
    chosen = [0]
    nearest = np.full(len(poses), np.inf)
    while len(chosen) < most:
        away = np.linalg.norm(places - places[chosen[-1]], axis=1)
        turned = (turns * turns[chosen[-1]].inv()).magnitude() / SPREAD_RAD
        nearest = np.minimum(nearest, np.hypot(away, turned))
        chosen.append(int(nearest.argmax()))
    return np.sort(chosen)


def measured_centres(
    recording: Recording,
    handle: Handle,
    frames: np.ndarray,
    poses: RigidTransform,
    kept_in: Path,
    made_from: str,
    progress: bool,
) -> Centres:
    """The markers' centres in the images of some frames.

    Parameters
    ----------
    recording : Recording
    handle : Handle
    frames : ndarray of int, shape (n,)
        They increase.
    poses : RigidTransform
        T_world_handle at these frames, a batch, right to a pixel or two.
    kept_in : path
        A file that grows with each instant, and from which an interrupted measurement resumes.
    made_from : str
        An identifier of this measurement.
    progress : bool

    Returns
    -------
    Centres
        `Centres.instant` counts along `frames`.
    """
    with Journal(
        kept_in, f"{made_from}\n", lambda number, line: _is_row(frames, number, line)
    ) as lines:
        done = len(lines.lines())
        remaining = some_instants(recording, frames[done:].tolist())
        with (
            logging_redirect_tqdm(),
            tqdm(
                total=len(frames),
                initial=done,
                unit="instant",
                desc="centres",
                disable=None if progress else True,
            ) as bar,
        ):
            for number, now in enumerate(remaining, start=done):
                rows = _centres_of(now.images, recording.rig, handle, poses[number])
                lines.add_line(json.dumps([now.frame, rows]))
                bar.update()
        return _as_centres([json.loads(line)[1] for line in lines.lines()])


def _centres_of(
    images: Sequence[np.ndarray], rig: Rig, handle: Handle, pose: RigidTransform
) -> list[list[float]]:
    """A row for each centre: camera, marker, u, v, and its covariance row by row."""
    centres = centre_pixels(images, rig, handle, pose, MAX_SLANT_DEG)
    if centres is None:
        return []
    covariance = centres.covariance + FLOOR_PX**2 * np.eye(2)
    return [
        [int(c), int(m), *centres.uv[c, m].tolist(), *covariance[c, m].ravel().tolist()]
        for c, m in zip(*np.nonzero(np.isfinite(centres.uv[..., 0])), strict=True)
    ]


def _is_row(frames: np.ndarray, number: int, line: str) -> bool:
    """Whether a line has the centres of the frame of its number."""
    try:
        frame, rows = json.loads(line)
        return number < len(frames) and frame == frames[number] and isinstance(rows, list)
    except (ValueError, TypeError):
        return False


def _as_centres(rows: list[list[list[float]]]) -> Centres:
    instant = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    every = np.array([cells for row in rows for cells in row]).reshape(-1, 8)
    return Centres(
        instant,
        every[:, 0].astype(int),
        every[:, 1].astype(int),
        every[:, 2:4],
        every[:, 4:].reshape(-1, 2, 2),
    )
