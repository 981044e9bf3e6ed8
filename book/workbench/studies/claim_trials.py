"""What counts in a trial of a claim on the simulated bench, whose truth is known: a pose that is
close, a marker by its true name, the cost of a search.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab.bench.hand import Arm, true_visibility
from trinolab.camera import Camera
from trinolab.checks import Array, as_points
from trinolab.handle import Handle, facing_pixels
from trinolab.markers import find_markers
from trinolab.measurement import Measurement
from trinolab.window import Window

FPS = 30.0  # of the paper's cameras
CLOSE_MM, CLOSE_DEG = 1.0, 5.0  # a pose further off than this is wrong
# a found marker further off than this is another thing; half a marker, of which the limb hides a
# part
SAME_PX = 8.0
# a marker is 34 deg wide, so that some of it shows until its middle is turned away by this
LIMB_DEG = 105.0


def share_close(
    measurements: Sequence[Measurement],
    truths: Sequence[RigidTransform],
    handle: Handle,
    equivalents: bool,
) -> float:
    """Share of the measurements that are close to their truth, with `equivalents` up to the
    handle's symmetry.
    """
    symmetries = handle.symmetries if equivalents else handle.symmetries[:1]
    return float(
        np.mean(
            [
                any(_close(m.pose.T_world_handle, T * S) for S in symmetries)
                for m, T in zip(measurements, truths, strict=True)
            ]
        )
    )


def true_labels(
    camera: Camera, handle: Handle, T_world_handle: RigidTransform, uv: ArrayLike
) -> np.ndarray:
    """The marker that each found pixel is, by the truth: the nearest one that shows, int (n,); -1
    for none.

    Raises ValueError if `uv` is not of shape (n, 2).
    """
    visible = facing_pixels(handle, camera, T_world_handle, LIMB_DEG)
    label, distance = nearest(as_points(uv, "uv", 2), visible)
    return np.where(distance < SAME_PX, label, -1)


class Searched(NamedTuple):
    """What a search for markers costs and brings: mean share of the image, mean CPU time, s; found,
    of these false.
    """

    area: float
    seconds: float
    found: int
    false: int


def searched(
    images: Sequence[ArrayLike],
    windows: Sequence[Window | None],
    camera: Camera,
    handle: Handle,
    truths: Sequence[RigidTransform | None],
) -> Searched:
    """Look for markers in a window of each image, and ask the truth which of them are none
    (Sect. 4.2).

    An instant without a window or without a handle is left out. Raises ValueError if no other is
    left.
    """
    complete = [
        (image, window, T)
        for image, window, T in zip(images, windows, truths, strict=True)
        if window is not None and T is not None
    ]
    if not complete:
        raise ValueError("windows, truths: expected an instant that has both, got none")
    begin = time.process_time()
    windows_found = [
        find_markers(window.crop(image), len(handle.marker_centres), handle.markers).uv
        + [window.u, window.v]
        for image, window, _ in complete
    ]
    seconds = (time.process_time() - begin) / len(complete)
    false = [
        int((true_labels(camera, handle, T, uv) < 0).sum())
        for (*_, T), uv in zip(complete, windows_found, strict=True)
    ]
    area = float(np.mean([window.area for _, window, _ in complete]) / np.prod(camera.size))
    return Searched(area, seconds, sum(map(len, windows_found)), sum(false))


def share_of_image(
    window: Window | None, camera: Camera, handle: Handle, truth: RigidTransform
) -> float:
    """Area of a search window as a share of the image: all of it if a marker that is truly seen,
    with a hand on the handle, lies outside.
    """
    seen = true_visibility(camera, handle, truth, Arm())
    uv = camera.project(truth.apply(handle.marker_centres[seen]))
    contained = window is not None and window.contains(uv).all()
    return float(window.area / np.prod(camera.size)) if window and contained else 1.0


def nearest(uv: Array, predicted: Array) -> tuple[np.ndarray, Array]:
    """Index of, and distance to, the nearest predicted pixel of each found one."""
    distance = np.linalg.norm(uv[:, None] - predicted, axis=2)
    distance = np.where(np.isnan(distance), np.inf, distance)
    return distance.argmin(axis=1), distance.min(axis=1)


def _close(estimate: RigidTransform | None, truth: RigidTransform) -> bool:
    if estimate is None:
        return False
    turn = np.rad2deg((estimate.inv() * truth).rotation.magnitude())
    return bool(
        np.linalg.norm(estimate.translation - truth.translation) <= CLOSE_MM and turn <= CLOSE_DEG
    )
