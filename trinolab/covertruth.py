"""What truly moves in the frames of a rendered recording: the pixels that handle, hand and forearm cover.

A shadow is not what moves; it lies on the background.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .background import BackgroundParameters, Detection, step
from .checks import Array, as_array, as_number
from .exposure import smeared
from .filming import Job
from .layer import over
from .window import Window


class Regions(NamedTuple):
    """Pixels of which it is clear what they show, bool (height, width): the moving, and the background."""

    inside: np.ndarray
    outside: np.ndarray


class Wrong(NamedTuple):
    """Shares of the background that count as moving, and of the moving that does not; NaN where there is none."""

    false: float
    missed: float


class Watched(NamedTuple):
    """What `background.step` made of a clip of n frames: shares as in `Wrong`, shape (n,), windows, last background."""

    false: Array
    missed: Array
    windows: list[Window | None]
    background: np.ndarray


def cover(job: Job, frame: int, index: int) -> Array:
    """The share of each pixel that handle, hand and forearm cover while a camera's shutter is open, (height, width)."""
    camera, shot = job.rig.cameras[index], job.shots[frame]
    nothing = np.zeros(camera.size[::-1])
    if shot.T_world_handle is None:
        return nothing
    layer = smeared(camera, job.handle, shot.T_world_handle, job.bench, shot.velocity, shot.turn_rate, shot.arm)
    return over(layer._replace(light=layer.cover), nothing)


def regions(covered: ArrayLike, seam_px: int = 3) -> Regions:
    """Leave out the seam: pixels less than `seam_px` columns and rows from an outline, which blur mixes.

    Raises ValueError if `covered` is no image of shares, or `seam_px` is negative.
    """
    share = as_array(covered, "covered", (None, None))
    side = 2 * int(as_number(seam_px, "seam_px", 0, 1000)) + 1
    square = np.ones((side, side), np.uint8)
    inside, touched = ((share > low).view(np.uint8) for low in (0.999, 0.0))
    return Regions(cv2.erode(inside, square).astype(bool), cv2.dilate(touched, square) == 0)


def wrong(detection: Detection, truth: Regions) -> Wrong:
    """Hold a detection against the truth."""
    found, inside, outside = detection.mask, *truth
    return Wrong(float(found[outside].mean()) if outside.any() else np.nan,
                 float(1 - found[inside].mean()) if inside.any() else np.nan)


def watch(frames: Sequence[ArrayLike], background: ArrayLike, truths: Sequence[Regions],
          parameters: BackgroundParameters | None = None) -> Watched:
    """Take the steps of a clip, from the background before it, and hold each against the truth.

    Raises ValueError if there are not as many truths as frames, or a frame or the background is not what `step` takes.
    """
    shares, windows, state = [], [], np.asarray(background)
    for frame, truth in zip(frames, truths, strict=True):
        state, detection = step(state, frame, parameters)
        shares.append(wrong(detection, truth))
        windows.append(detection.window)
    false, missed = np.array(shares).reshape(-1, 2).T
    return Watched(false, missed, windows, state)
