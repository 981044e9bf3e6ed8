"""Recordings of the simulated bench in memory, with what is truly in them, and spots and pixels held against it.

A shadow is not what moves; it lies on the background. Chapters 1 and 3 to 6.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .. import background
from ..background import BackgroundParameters, Detection, step
from ..bench.hand import true_visibility
from ..bench.layer import over
from ..bench.recordings import scripted, standard_recording
from ..bench.scenario import Job
from ..bench.scene import scaled, smeared
from ..camera import Camera, Rig
from ..checks import Array, as_array, as_number, as_points, as_whole, frozen
from ..datasets import load_handle, load_rig
from ..files.images import read_grey
from ..files.poses import poses_by_frame, read_poses
from ..files.recording import (
    Instant,
    find_footage,
    frames_of,
    instants,
    list_instants,
    open_footage,
    open_recording,
    read_instant,
)
from ..files.rigs import read_handle, read_rig
from ..handle import Handle, facing_pixels, slants
from ..matching import epipolar_distances
from ..parameters import Parameters
from ..window import Window
from .claim_trials import true_labels

SHOWN_DEG = 80.0  # markers turned further away hardly ever give a spot


class Clip(NamedTuple):
    """What the cameras of a rig took together, and the truth.

    Attributes
    ----------
    rig : Rig
    handle : Handle
    times_s : ndarray, shape (n,)
    films : tuple of tuples of ndarray, shape (height, width)
        The n images of each camera.
    empty : tuple of ndarray
        Each camera's image of the empty scene.
    truths : tuple of RigidTransform or None
        T_world_handle at each instant; None where there is no handle.
    """

    rig: Rig
    handle: Handle
    times_s: Array
    films: tuple[tuple[np.ndarray, ...], ...]
    empty: tuple[np.ndarray, ...]
    truths: tuple[RigidTransform | None, ...]


def read_clip(folder: str | Path) -> Clip:
    """Read a recording folder with timestamps, backgrounds and truth; 4 MB an instant of three cameras.

    Raises
    ------
    ValueError
        Names the file that is missing or cannot be read.
    """
    root, said = Path(folder), set[str]()
    rig = read_rig(root / "rig.toml")
    recorded = open_recording(find_footage(root, rig), rig, timestamps=root / "timestamps.csv")
    now = list(instants(recorded))
    empty = tuple(read_grey(root / "background" / f"{camera.name}.png", camera.size, said) for camera in rig.cameras)
    known = poses_by_frame(read_poses(root / "truth.csv"))
    times, films = [one.t_s for one in now], tuple(zip(*(one.images for one in now), strict=True))
    return Clip(rig, read_handle(root / "handle.toml"), frozen(np.array(times)), films, empty,
                tuple(known.get(one.frame) for one in now))


class Regions(NamedTuple):
    """Pixels of which it is clear what they show, bool (height, width): the moving, and the background."""

    inside: np.ndarray
    outside: np.ndarray


class Wrong(NamedTuple):
    """Shares of the background that count as moving, and of the moving that does not; NaN where there is none."""

    false: float
    missed: float


class CoverClip(NamedTuple):
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


def standard_clip(name: str, index: int, every: int = 4, seconds: float = 2.0) -> CoverClip:
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
    thinned = np.array([frame[::every, ::every] for frame in frames])
    return CoverClip(thinned, empty[::every, ::every], truths, job, index)


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


def held(windows: Sequence[Window | None], clip: CoverClip) -> np.ndarray:
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


class Known(NamedTuple):
    """One instant of a recording whose truth is known.

    Attributes
    ----------
    frame : int
    t_s : float
    images : list of ndarray
        Grey, one a camera.
    T_world_handle : RigidTransform or None
        None where there is no handle.
    seen : ndarray of bool, shape (cameras, markers)
        What each camera truly sees, see `hand.true_visibility`.
    """

    frame: int
    t_s: float
    images: list[np.ndarray]
    T_world_handle: RigidTransform | None
    seen: np.ndarray


class KnownRecording(NamedTuple):
    """A recording with its truth: cameras, handle, an image a camera of the empty bench, and instants."""

    rig: Rig
    handle: Handle
    empty: list[np.ndarray]
    instants: list[Known]


def known_recording(name: str, frames: Iterable[int] | None = None, seconds: float = 2.0) -> KnownRecording:
    """Read a standard recording, or some of its frames, with the truth; it is rendered if it is not there yet.

    Parameters
    ----------
    name : {"calm", "hard"}
    frames : iterable of int, optional
        The instants to read, in this order; all by default.
    seconds : float
        Length of the recording, at 30 frames a second.

    Raises
    ------
    ValueError
        As `standard_recording`, or if the recording has no such frame.
    """
    folder = standard_recording(name, seconds=seconds, progress=False)
    rig, handle = read_rig(folder / "rig.toml"), read_handle(folder / "handle.toml")
    job, shown = scripted(name, rig, handle, 0, seconds), list_instants(folder / "images", rig)
    chosen = range(len(shown)) if frames is None else [int(k) for k in frames]
    if outside := [k for k in chosen if not 0 <= k < len(shown)]:
        raise ValueError(f"frames: expected frames 0 to {len(shown) - 1}, got {outside[0]}")
    empty = Instant(0, tuple(folder / "background" / f"{camera}.png" for camera in rig.names))
    return KnownRecording(rig, handle, read_instant(empty, rig),
                          [_known(job, k, read_instant(shown[k], rig)) for k in chosen])


def _known(job: Job, frame: int, images: list[np.ndarray]) -> Known:
    """An instant with its truth, from the script."""
    shot, cameras = job.shots[frame], job.rig.cameras
    seen = np.zeros((len(cameras), len(job.handle.marker_centres)), bool)
    if (T := shot.T_world_handle) is not None:
        seen |= [true_visibility(camera, job.handle, T, shot.arm) for camera in cameras]
        seen[np.array(shot.gains) == 0] = False
    return Known(frame, float(job.times_s[frame]), images, T, seen)


class Spots(NamedTuple):
    """What spots are worth that were found in images.

    Attributes
    ----------
    slants_deg : ndarray, shape (k,)
        Of each marker that a camera truly sees.
    errors_px : ndarray, shape (k,)
        Distance of its spot from the image of its centre; NaN where there is no spot.
    false : int
        Spots that are no marker.
    """

    slants_deg: Array
    errors_px: Array
    false: int


def judge_spots(camera: Camera, handle: Handle, instant: Known, seen: np.ndarray, uv: ArrayLike) -> Spots:
    """Hold the spots found in one image against the truth.

    Parameters
    ----------
    camera : Camera
    handle : Handle
    instant : Known
    seen : ndarray of bool, shape (markers,)
        The camera's row of `Known.seen`.
    uv : array_like, shape (n, 2)
        Spots, px; NaN rows are left out.

    Raises
    ------
    ValueError
        If `uv` is not of shape (n, 2).
    """
    spots = as_points(uv, "uv", 2)
    spots = spots[~np.isnan(spots).any(axis=1)]
    if (T := instant.T_world_handle) is None:
        return Spots(frozen(np.empty(0)), frozen(np.empty(0)), len(spots))
    labels, centres = true_labels(camera, handle, T, spots), camera.project(T.apply(handle.marker_centres))
    off = np.array([np.linalg.norm(spots[labels == k] - centres[k], axis=1).min(initial=np.inf)
                    for k in np.flatnonzero(seen)])
    slant = np.rad2deg(slants(handle, T, camera.centre)[seen])
    return Spots(frozen(slant), frozen(np.where(np.isinf(off), np.nan, off)), int((labels < 0).sum()))


def judge_search(recording: KnownRecording, find: Callable[[np.ndarray], ArrayLike],
                 windows: Sequence[Sequence[Window | None]] | None = None) -> Spots:
    """What a search is worth in all images of a recording.

    Parameters
    ----------
    recording : KnownRecording
    find : callable
        Takes an image, or the part of it in a window, and gives spots (n, 2) in its pixels.
    windows : sequence of sequence of Window or None, optional
        For each instant that of each camera; nothing is looked for where it is None. Whole images without it.
    """
    judged, whole = [], [Window(0, 0, *camera.size) for camera in recording.rig.cameras]
    for k, instant in enumerate(recording.instants):
        for camera, image, seen, window in zip(recording.rig.cameras, instant.images, instant.seen,
                                               whole if windows is None else windows[k], strict=True):
            uv = np.empty((0, 2)) if window is None else find(window.crop(image)) + np.array([window.u, window.v])
            judged.append(judge_spots(camera, recording.handle, instant, seen, uv))
    slant, errors, false = zip(*judged, strict=True)
    return Spots(frozen(np.concatenate(slant)), frozen(np.concatenate(errors)), sum(false))


def moving_windows(recording: KnownRecording, parameters: Parameters | None = None) -> list[list[Window | None]]:
    """The window around what moves, W_ROI, for each instant that of each camera (Sect. 4.1)."""
    p, found = parameters or Parameters(), []
    known: list[np.ndarray] = list(recording.empty)
    for instant in recording.instants:
        stepped = [background.step(*pair, p.background) for pair in zip(known, instant.images, strict=True)]
        known = [renewed for renewed, _ in stepped]
        found.append([moved.window and moved.window.grown(p.markers.diameter_px[0]).clipped(camera.size)
                      for (_, moved), camera in zip(stepped, recording.rig.cameras, strict=True)])
    return found


def in_the_gate(poses: Iterable[RigidTransform], rig: Rig, handle: Handle, gate_px: float) -> tuple[int, int]:
    """What the epipolar gate lets through if every spot is exactly the image of its marker's centre (Eq. 17).

    Parameters
    ----------
    poses : iterable of RigidTransform
        T_world_handle.
    rig : Rig
    handle : Handle
        Its markers count up to a slant of `SHOWN_DEG`.
    gate_px : float
        D_0.

    Returns
    -------
    wrong, right : int
        Pairs of two markers, and of twice the same one.
    """
    wrong = right = 0
    for T in poses:
        uv = [facing_pixels(handle, camera, T, SHOWN_DEG) for camera in rig.cameras]
        for i, j in rig.pairs:
            passing = epipolar_distances(rig.cameras[i], rig.cameras[j], uv[i], uv[j]) < gate_px  # NaN does not
            same = int(np.trace(passing))
            wrong, right = wrong + int(passing.sum()) - same, right + same
    return wrong, right
