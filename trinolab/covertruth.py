"""What truly moves in the frames of a rendered recording: the pixels that handle, hand and forearm cover.

A shadow is not what moves; it lies on the background. `standard_clip` has a camera's frames with their truth.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .arm import true_visibility
from .background import BackgroundParameters, Detection, step
from .camera import Rig
from .checks import Array, as_array, as_number, as_whole
from .datasets import load_handle, load_rig
from .exposure import smeared
from .filming import Job
from .footage import frames_of, open_footage
from .greyimage import read_grey
from .layer import over
from .rendering import scripted
from .scene import scaled
from .standard import standard_recording
from .window import Window


class Regions(NamedTuple):
    """Pixels of which it is clear what they show, bool (height, width): the moving, and the background."""

    inside: np.ndarray
    outside: np.ndarray


class Wrong(NamedTuple):
    """Shares of the background that count as moving, and of the moving that does not; NaN where there is none."""

    false: float
    missed: float


class Clip(NamedTuple):
    """One camera's part of a standard recording, every few rows and columns of it, and its truth.

    Attributes
    ----------
    frames : ndarray of uint8, shape (n, height, width)
    empty : ndarray of uint8, shape (height, width)
        The empty scene in the light of the first instant.
    truths : list of Regions
        One a frame.
    job : Job
        The script, for cameras of as many pixels.
    camera_index : int
    """

    frames: np.ndarray
    empty: np.ndarray
    truths: list[Regions]
    job: Job
    camera_index: int


class Watched(NamedTuple):
    """What `background.step` made of a clip of n frames: shares as in `Wrong`, shape (n,), windows, last background."""

    false: Array
    missed: Array
    windows: list[Window | None]
    background: np.ndarray


def standard_clip(name: str, index: int, every: int = 4, seconds: float = 2.0) -> Clip:
    """A camera's part of a standard recording, seed 0; a seam of 8 px of the recording is left out of the truth.

    Parameters
    ----------
    name : {"calm", "hard"}
    index : int
        Of the camera.
    every : int
        Rows and columns from one that is looked at to the next; a divisor of the image's sides.
    seconds : float
        Length.

    Raises
    ------
    ValueError
        As `standard_recording`, or if the rig has no such camera, or `every` does not divide the image.
    """
    rig = load_rig("raised_40deg")
    camera = rig.cameras[as_whole(index, "index", 0, len(rig.cameras) - 1)]
    small = Rig(tuple(scaled(one, 1 / as_whole(every, "every", 1, 64)) for one in rig.cameras))
    folder = standard_recording(name, seconds=seconds, progress=False)
    empty = read_grey(folder / "background" / f"{camera.name}.png", camera.size, set())
    frames = frames_of(open_footage(folder / "images" / camera.name), camera.size, 0, set())
    job = scripted(name, small, load_handle("coded"), 0, seconds)
    truths = [regions(cover(job, k, index), max(1, round(8 / every))) for k in range(len(job.shots))]
    return Clip(np.array([frame[::every, ::every] for frame in frames]), empty[::every, ::every], truths, job, index)


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


def held(windows: Sequence[Window | None], clip: Clip) -> np.ndarray:
    """Whether each window holds all markers that the clip's camera truly sees, bool (n,)."""
    camera, handle = clip.job.rig.cameras[clip.camera_index], clip.job.handle
    found = []
    for window, shot in zip(windows, clip.job.shots, strict=True):
        uv = np.empty((0, 2))
        if shot.T_world_handle is not None:
            seen = true_visibility(camera, handle, shot.T_world_handle, shot.arm)
            uv = camera.project(shot.T_world_handle.apply(handle.marker_centres[seen]))
        found.append(len(uv) == 0 or (window is not None and bool(window.contains(uv).all())))
    return np.array(found)
