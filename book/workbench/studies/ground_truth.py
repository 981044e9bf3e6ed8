"""Recordings of the simulated bench in memory, with what is truly in them, and spots and pixels
held against it.

A shadow is not what moves; it lies on the background. Chapters 1 and 3 to 6.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab import background
from trinolab.background import BackgroundParameters, Detection, step
from trinolab.bench.hand import true_visibility
from trinolab.bench.layer import over
from trinolab.bench.rendering import scripted, standard_recording
from trinolab.bench.scenario import Job
from trinolab.bench.scene import scaled, smeared
from trinolab.camera import Camera, Rig
from trinolab.checks import Array, as_array, as_number, as_points, as_whole, frozen
from trinolab.files.images import read_grey
from trinolab.files.recording import list_instants, open_folder, read_instants
from trinolab.handle import Handle, slants
from trinolab.markers import MarkerParameters
from trinolab.measurement import whole_images
from trinolab.window import Window

from .claim_trials import true_labels


class Instant(NamedTuple):
    """One instant of a recording, and the truth.

    Attributes
    ----------
    frame : int
    t_s : float
    images : tuple of ndarray, shape (height, width)
        Grey, one per camera.
    T_world_handle : RigidTransform or None
        None where there is no handle.
    seen : ndarray of bool, shape (cameras, markers)
        What each camera truly sees, see `hand.true_visibility`; a covered camera sees nothing.
    """

    frame: int
    t_s: float
    images: tuple[np.ndarray, ...]
    T_world_handle: RigidTransform | None
    seen: np.ndarray


class Recorded(NamedTuple):
    """What the cameras of a rig took together, and the truth.

    Attributes
    ----------
    rig : Rig
        With as many pixels as the images.
    handle : Handle
    empty : tuple of ndarray, shape (height, width)
        Each camera's image of the empty scene, in the light of the first instant.
    instants : list of Instant
    job : Job
        From which the recording was rendered: who moves, and in what light.
    """

    rig: Rig
    handle: Handle
    empty: tuple[np.ndarray, ...]
    instants: list[Instant]
    job: Job

    @property
    def times_s(self) -> Array:
        """Of the instants, s, shape (n,)."""
        return np.array([now.t_s for now in self.instants])

    @property
    def poses(self) -> list[RigidTransform | None]:
        """T_world_handle at each instant."""
        return [now.T_world_handle for now in self.instants]

    def images_of(self, camera: int) -> list[np.ndarray]:
        """One camera's images, n of them."""
        return [now.images[camera] for now in self.instants]


def read_recording(
    name: str, frames: Iterable[int] | None = None, seconds: float = 2.0, every: int = 1
) -> Recorded:
    """Read a standard recording, seed 0, or some of its frames, with the truth; it is rendered if
    it is not there yet.

    Parameters
    ----------
    name : {"calm", "hard"}
    frames : iterable of int, optional
        The instants to read, in this order; all by default.
    seconds : float
        Length of the recording, at 30 frames per second.
    every : int
        Rows and columns from one that is kept to the next; a divisor of the image's sides. The
        cameras of the rig that is returned have as many pixels.

    Raises
    ------
    ValueError
        As `standard_recording`, or if the recording has no such frame, or `every` does not divide
        the image.
    """
    folder = standard_recording(name, seconds=seconds, progress=False)
    recording, handle = open_folder(folder)
    thin = (slice(None, None, as_whole(every, "every", 1, 64)),) * 2
    cameras = tuple(scaled(camera, 1 / every) for camera in recording.rig.cameras)
    rig = replace(recording.rig, cameras=cameras)
    chosen = range(recording.length) if frames is None else [int(k) for k in frames]
    if outside := [k for k in chosen if not 0 <= k < recording.length]:
        raise ValueError(f"frames: expected frames 0 to {recording.length - 1}, got {outside[0]}")
    job = scripted(name, rig, handle, 0, seconds)
    listed = list_instants(folder / "images", recording.rig)
    empty = [
        read_grey(folder / "background" / f"{camera.name}.png", camera.size)
        for camera in recording.rig.cameras
    ]
    taken = zip(chosen, read_instants([listed[k] for k in chosen], recording.rig), strict=True)
    # copies, so that the whole images are not kept
    return Recorded(
        rig,
        handle,
        tuple(image[thin].copy() for image in empty),
        [instant_of(job, k, tuple(image[thin].copy() for image in images)) for k, images in taken],
        job,
    )


def instant_of(job: Job, frame: int, images: tuple[np.ndarray, ...]) -> Instant:
    """An instant with its truth, from the script."""
    shot = job.shots[frame]
    seen = np.zeros((len(job.rig.cameras), len(job.handle.marker_centres)), bool)
    if (T := shot.T_world_handle) is not None:
        for k, camera in enumerate(job.rig.cameras):
            if shot.gains[k] > 0:
                seen[k] = true_visibility(camera, job.handle, T, shot.arm)
    return Instant(frame, float(job.times_s[frame]), images, T, seen)


class Regions(NamedTuple):
    """Pixels of which it is clear what they show, bool (height, width): the moving, and the
    background.
    """

    inside: np.ndarray
    outside: np.ndarray


class Wrong(NamedTuple):
    """Shares of the background that count as moving, and of the moving that does not; NaN where
    there is none.
    """

    false: float
    missed: float


class Watched(NamedTuple):
    """What `background.step` made of n frames: shares as in `Wrong`, shape (n,), windows, last
    background.
    """

    false: Array
    missed: Array
    windows: list[Window | None]
    background: np.ndarray


def moving(recording: Recorded, camera: int, seam_px: int) -> list[Regions]:
    """What truly moves in each of one camera's images: handle, hand and forearm; see `regions` for
    the seam.
    """
    return [regions(cover(recording.job, now.frame, camera), seam_px) for now in recording.instants]


def cover(job: Job, frame: int, index: int) -> Array:
    """The share of each pixel that handle, hand and forearm cover while a camera's shutter is open,
    (height, width).
    """
    camera, shot = job.rig.cameras[index], job.shots[frame]
    nothing = np.zeros(camera.size[::-1])
    if shot.T_world_handle is None:
        return nothing
    layer = smeared(
        camera, job.handle, shot.T_world_handle, job.bench, shot.velocity, shot.turn_rate, shot.arm
    )
    return over(layer._replace(light=layer.cover), nothing)


def regions(covered: ArrayLike, seam_px: int = 3) -> Regions:
    """Leave out the seam: pixels less than `seam_px` columns and rows from an outline, which blur
    mixes.

    Raises ValueError if `covered` is no image of shares, or `seam_px` is negative.
    """
    share = as_array(covered, "covered", (None, None))
    side = 2 * int(as_number(seam_px, "seam_px", 0, 1000)) + 1
    square = np.ones((side, side), np.uint8)
    inside, touched = ((share > low).view(np.uint8) for low in (0.999, 0.0))
    return Regions(cv2.erode(inside, square).astype(bool), cv2.dilate(touched, square) == 0)


def wrong(detection: Detection, truth: Regions) -> Wrong:
    """Hold a detection against the truth."""
    moved, inside, outside = detection.mask, *truth
    return Wrong(
        float(moved[outside].mean()) if outside.any() else np.nan,
        float(1 - moved[inside].mean()) if inside.any() else np.nan,
    )


def watch(
    frames: Sequence[ArrayLike],
    background: ArrayLike,
    truths: Sequence[Regions],
    parameters: BackgroundParameters | None = None,
) -> Watched:
    """Take `background.step` from frame to frame, and hold each against the truth.

    Parameters
    ----------
    frames : sequence of array_like, shape (height, width)
    background : array_like, shape (height, width)
        Before the first of them.
    truths : sequence of Regions
        One a frame, see `moving`.
    parameters : BackgroundParameters, optional

    Raises
    ------
    ValueError
        If there are not as many truths as frames, or a frame or the background is not what `step`
        takes.
    """
    shares = []
    windows = []
    state = np.asarray(background)
    for frame, truth in zip(frames, truths, strict=True):
        state, detection = step(state, frame, parameters)
        shares.append(wrong(detection, truth))
        windows.append(detection.window)
    false, missed = np.array(shares).reshape(-1, 2).T
    return Watched(false, missed, windows, state)


def _seen_pixels(recording: Recorded, instant: Instant, camera: int) -> Array:
    """Where the centres of the markers are that one camera truly sees, px, shape (k, 2)."""
    if instant.T_world_handle is None:
        return np.empty((0, 2))
    centres = recording.handle.marker_centres[instant.seen[camera]]
    return recording.rig.cameras[camera].project(instant.T_world_handle.apply(centres))


def held(windows: Sequence[Window | None], recording: Recorded, camera: int) -> np.ndarray:
    """Whether the window of each instant holds all markers that the camera truly sees, bool
    (n,).
    """
    judged = []
    for window, now in zip(windows, recording.instants, strict=True):
        uv = _seen_pixels(recording, now, camera)
        judged.append(len(uv) == 0 or (window is not None and bool(window.contains(uv).all())))
    return np.array(judged)


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


def judge_spots(
    camera: Camera, handle: Handle, instant: Instant, seen: np.ndarray, uv: ArrayLike
) -> Spots:
    """Hold the spots found in one image against the truth.

    Parameters
    ----------
    camera : Camera
    handle : Handle
    instant : Instant
    seen : ndarray of bool, shape (markers,)
        The camera's row of `Instant.seen`.
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
    labels = true_labels(camera, handle, T, spots)
    centres = camera.project(T.apply(handle.marker_centres))
    off = np.array(
        [
            np.linalg.norm(spots[labels == k] - centres[k], axis=1).min(initial=np.inf)
            for k in np.flatnonzero(seen)
        ]
    )
    slant = np.rad2deg(slants(handle, T, camera.centre)[seen])
    return Spots(
        frozen(slant), frozen(np.where(np.isinf(off), np.nan, off)), int((labels < 0).sum())
    )


def judge_search(
    recording: Recorded,
    find: Callable[[np.ndarray], ArrayLike],
    windows: Sequence[Sequence[Window | None]] | None = None,
) -> Spots:
    """What a search is worth in all images of a recording.

    Parameters
    ----------
    recording : Recorded
    find : callable
        Takes an image, or the part of it in a window, and gives spots (n, 2) in its pixels.
    windows : sequence of sequence of Window or None, optional
        For each instant that of each camera; nothing is looked for where it is None. Whole images
        without it.
    """
    judged = []
    whole = whole_images(recording.rig)
    for k, instant in enumerate(recording.instants):
        for camera, image, seen, window in zip(
            recording.rig.cameras,
            instant.images,
            instant.seen,
            whole if windows is None else windows[k],
            strict=True,
        ):
            uv = (
                np.empty((0, 2))
                if window is None
                else find(window.crop(image)) + np.array([window.u, window.v])
            )
            judged.append(judge_spots(camera, recording.handle, instant, seen, uv))
    slant, errors, false = zip(*judged, strict=True)
    return Spots(frozen(np.concatenate(slant)), frozen(np.concatenate(errors)), sum(false))


def moving_windows(recording: Recorded) -> list[list[Window | None]]:
    """The window around what moves, W_ROI, for each instant that of each camera (Sect. 4.1)."""
    beside_px = MarkerParameters().diameter_px[0]
    windows = []
    known: list[np.ndarray] = list(recording.empty)
    for instant in recording.instants:
        stepped = [background.step(*pair) for pair in zip(known, instant.images, strict=True)]
        known = [renewed for renewed, _ in stepped]
        windows.append(
            [
                moved.window and moved.window.grown(beside_px).clipped(camera.size)
                for (_, moved), camera in zip(stepped, recording.rig.cameras, strict=True)
            ]
        )
    return windows
