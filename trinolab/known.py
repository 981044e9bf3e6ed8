"""Instants of the standard recordings with what is truly in them, and spots held against it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from . import background
from .arm import true_visibility
from .camera import Camera, Rig
from .checks import Array, as_points, frozen
from .filming import Job
from .handle import Handle, facing_pixels, read_handle, slants
from .matching import epipolar_distances
from .parameters import Parameters
from .recording import Instant, list_instants, read_instant
from .rendering import scripted
from .rigfile import read_rig
from .standard import standard_recording
from .trials import true_labels
from .window import Window

SHOWN_DEG = 80.0  # markers turned further away hardly ever give a spot


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
        What each camera truly sees, see `arm.true_visibility`.
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
