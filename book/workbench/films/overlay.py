"""What the tracker saw, drawn into the cameras' pictures: windows, markers with their numbers, the
pose's axes x (red), y (green) and z (blue).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.camera import Camera, Rig
from trinolab.files.outputs import check_target
from trinolab.files.recording import Frames, Recording
from trinolab.following.posetracker import Tracked
from trinolab.following.track import Watch
from trinolab.metrics import euler_deg
from trinolab.window import Window

from .video import Film

WIDTH = 640  # of a camera's picture, px
AXIS_MM = 25.0  # length of a drawn axis
INSET_SHARE = 0.4  # of a picture's sides that the enlarged window may take
MOST_ENLARGED = 3.0  # pixels of it for one of the image
LEAST_ENLARGED = 1.5  # of it against the picture
# Colours, each blue, green, red.
_WINDOW = (200, 200, 0)
_OUTLIER = (120, 120, 120)
_MARKER = (60, 220, 60)
_AXES = ((60, 60, 255), (60, 220, 60), (255, 120, 60))
STATUS_COLOURS = {
    "measured": (60, 220, 60),
    "ambiguous": (0, 200, 255),
    "predicted": (0, 140, 255),
    "lost": (60, 60, 255),
}


@contextmanager
def filmed(path: str | Path) -> Iterator[Watch]:
    """Film of a track: yields what `track.track_files` takes as `watch`.

    Parameters
    ----------
    path : path
        A .webm video (VP8), which appears whole or not at all.

    Raises
    ------
    ValueError
        As `Film`, and if the video's folder is missing.
    """
    check_target(path)
    with Film(path, fps=30.0) as film:

        def watch(recording: Recording, now: Frames, tracked: Tracked) -> None:
            film.fps = recording.rate  # is taken when the first picture comes
            film.add(picture(now.images, tracked, recording.rig, now.frame, now.t_s))

        yield watch


def picture(
    images: Sequence[np.ndarray],
    tracked: Tracked,
    rig: Rig,
    frame: int,
    t_s: float,
    width: int = WIDTH,
) -> np.ndarray:
    """All cameras' pictures side by side, with what was found.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
        Grey levels 0 to 255, one per camera.
    tracked : posetracker.Tracked
    rig : Rig
    frame, t_s
        Number and time (s) of the instant, for the caption.
    width : int
        Of each camera's picture, px.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Blue first; even sides.
    """
    views = []
    for c, camera in enumerate(rig.cameras):
        enlarged = inset(images[c], tracked, c, width)
        view = camera_view(
            images[c], camera, tracked, c, width, None if enlarged is not None else 0.4
        )
        if enlarged is not None:
            view[: enlarged.shape[0], width - enlarged.shape[1] :] = enlarged
        views.append(view)
    height = max(len(view) for view in views)
    together = np.hstack(
        [np.pad(view, ((0, height - len(view)), (0, 0), (0, 0))) for view in views]
    )
    pose = tracked.measurement.pose
    lines = [f"frame {frame}  {t_s:.3f} s  {pose.status}"]
    if (T := pose.T_world_handle) is not None:
        x, y, z = T.translation
        angles = ", ".join(f"{angle:.1f}" for angle in np.ravel(euler_deg(T)))
        lines.append(f"({x:.1f}, {y:.1f}, {z:.1f}) mm  ({angles}) deg")
    for line, bottom in zip(reversed(lines), (height - 12, height - 34), strict=False):
        colour = STATUS_COLOURS[pose.status]
        cv2.putText(
            together, line, (10, bottom), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2, cv2.LINE_AA
        )
    return together[: height // 2 * 2, : together.shape[1] // 2 * 2]


def camera_view(
    image: np.ndarray,
    camera: Camera,
    tracked: Tracked | None,
    c: int,
    width: int = WIDTH,
    numbers: float | None = 0.4,
    named: bool = True,
) -> np.ndarray:
    """One camera's picture, made smaller, with its window, markers and axes.

    Parameters
    ----------
    image : ndarray, shape (height, width)
        Grey levels 0 to 255.
    camera : Camera
    tracked : posetracker.Tracked or None
        None where nothing is known.
    c : int
        Which of the tracked cameras this is.
    width : int
        Of the picture, px.
    numbers : float or None
        OpenCV's scale of the markers' numbers; None leaves them out.
    named : bool
        Whether the camera's name is in the picture.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Blue first.
    """
    scale = width / image.shape[1]
    size = (width, max(round(image.shape[0] * scale), 1))
    view = cv2.cvtColor(_reduced(image.astype(np.uint8), size), cv2.COLOR_GRAY2BGR)
    if tracked is not None:
        frame = _Frame((0.0, 0.0), scale)
        _draw_window(view, tracked.windows[c], frame)
        _draw_markers(view, tracked, c, frame, numbers)
        if (T := tracked.measurement.pose.T_world_handle) is not None:
            _draw_axes(view, camera, T, frame)
    if named:
        at, grey = (10, 22), (230, 230, 230)
        cv2.putText(view, camera.name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.6, grey, 1, cv2.LINE_AA)
    return view


def _reduced(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """An image made smaller: halved by means of four pixels while it is twice as large, which takes
    a thirtieth of the time of the means over parts of pixels, then between pixels.
    """
    high, wide = image.shape
    while wide >= 2 * size[0] and wide % 2 == high % 2 == 0:
        wide, high = wide // 2, high // 2
        image = cv2.resize(image, (wide, high), interpolation=cv2.INTER_AREA)
    return cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)


def inset(image: np.ndarray, tracked: Tracked, c: int, width: int = WIDTH) -> np.ndarray | None:
    """What is in a camera's window, enlarged, with the markers' numbers.

    None without a window, or with one so large that it would gain little.

    Parameters
    ----------
    image, tracked, c, width
        As for `camera_view`, into whose picture it fits.
    """
    window = tracked.windows[c]
    if window is None:
        return None
    whole = width / image.shape[1]
    room = INSET_SHARE * whole * min(image.shape[1] / window.width, image.shape[0] / window.height)
    scale = min(room, MOST_ENLARGED)
    if scale < LEAST_ENLARGED * whole:
        return None
    size = (max(round(window.width * scale), 1), max(round(window.height * scale), 1))
    cut = window.crop(image).astype(np.uint8)
    view = cv2.cvtColor(cv2.resize(cut, size, interpolation=cv2.INTER_LINEAR), cv2.COLOR_GRAY2BGR)
    _draw_markers(view, tracked, c, _Frame((window.u, window.v), scale), 0.45)
    cv2.rectangle(view, (0, 0), (size[0] - 1, size[1] - 1), _WINDOW, 1)
    return view


class _Frame(NamedTuple):
    """Where a picture lies in its camera's image: the pixel of its upper left corner, and its pixels
    for one of the image's.
    """

    corner: tuple[float, float]
    scale: float

    def pixel(self, uv: Sequence[float] | np.ndarray) -> tuple[int, int]:
        """A pixel of the image as one of the picture."""
        u, v = (
            (float(x) - start + 0.5) * self.scale - 0.5
            for x, start in zip(uv, self.corner, strict=True)
        )
        return round(u), round(v)


def _draw_window(view: np.ndarray, window: Window | None, frame: _Frame) -> None:
    if window is not None:
        first = frame.pixel((window.u, window.v))
        last = frame.pixel((window.u + window.width - 1, window.v + window.height - 1))
        cv2.rectangle(view, first, last, _WINDOW, 1)


def _draw_markers(
    view: np.ndarray, tracked: Tracked, c: int, frame: _Frame, numbers: float | None
) -> None:
    """The markers with their numbers, into a picture."""
    markers = tracked.measurement.markers[c]
    known = np.isfinite(markers.uv).all(axis=1)
    middle = markers.uv[known].mean(axis=0) if known.any() else np.zeros(2)
    for uv, label in zip(markers.uv[known], tracked.measurement.labels[c][known], strict=True):
        at = frame.pixel(uv)
        cv2.circle(view, at, 6, _OUTLIER if label < 0 else _MARKER, 1, cv2.LINE_AA)
        if label >= 0 and numbers is not None:
            # away from the other markers
            _write_beside(view, str(label), at, uv - middle, 15, numbers, _MARKER)


def _write_beside(
    view: np.ndarray,
    words: str,
    at: tuple[int, int],
    direction: np.ndarray,
    distance: float,
    size: float,
    colour: tuple[int, int, int],
) -> None:
    """Words around a pixel so many pixels from another one in some direction."""
    away = distance * direction / max(float(np.linalg.norm(direction)), 1e-9)
    (wide, high), _ = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    left_edge = round(at[0] + away[0] - wide / 2)
    bottom = round(at[1] + away[1] + high / 2)
    cv2.putText(
        view, words, (left_edge, bottom), cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA
    )


def _draw_axes(
    view: np.ndarray, camera: Camera, T_world_handle: RigidTransform, frame: _Frame
) -> None:
    """The handle's axes, each with its letter."""
    ends = camera.project(T_world_handle.apply(AXIS_MM * np.vstack([np.zeros(3), np.eye(3)])))
    if not (np.isfinite(ends).all() and np.abs(ends).max() < 1e5):
        return
    start = frame.pixel(ends[0])
    for end, colour, letter in zip(ends[1:], _AXES, "xyz", strict=True):
        tip = frame.pixel(end)
        cv2.arrowedLine(view, start, tip, colour, 2, cv2.LINE_AA, tipLength=0.15)
        _write_beside(view, letter, tip, np.subtract(tip, start), 10, 0.45, colour)
