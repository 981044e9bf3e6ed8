"""What the tracker saw, drawn into the cameras' pictures: windows, markers with their numbers, the pose's axes."""

from __future__ import annotations

import html
from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from .camera import Camera, Rig
from .posetracker import Tracked
from .quiet import unheard

WIDTH = 640  # of a camera's picture, px
AXIS_MM = 25.0
CUT_OFF = "cannot be written as a whole (is the disk full?)"
_WINDOW, _STRANGER, _MARKER = (200, 200, 0), (120, 120, 120), (60, 220, 60)  # blue, green, red
_AXES = ((60, 60, 255), (60, 220, 60), (255, 120, 60))
STATUS_COLOURS = {  # blue, green, red
    "measured": (60, 220, 60), "ambiguous": (0, 200, 255), "predicted": (0, 140, 255), "lost": (60, 60, 255),
}


def picture(images: Sequence[np.ndarray], tracked: Tracked, rig: Rig, frame: int, t_s: float,
            width: int = WIDTH) -> np.ndarray:
    """All cameras' pictures side by side, with what was found.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
        Grey levels 0 to 255, one a camera.
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
    views = [camera_view(images[c], camera, tracked, c, width) for c, camera in enumerate(rig.cameras)]
    height = max(len(view) for view in views)
    together = np.hstack([np.pad(view, ((0, height - len(view)), (0, 0), (0, 0))) for view in views])
    pose = tracked.measurement.pose
    caption = f"frame {frame}  {t_s:.3f} s  {pose.status}"
    if pose.T_world_handle is not None:
        x, y, z = pose.T_world_handle.translation
        caption += f"  ({x:.1f}, {y:.1f}, {z:.1f}) mm"
    colour = STATUS_COLOURS[pose.status]
    cv2.putText(together, caption, (10, height - 12), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2, cv2.LINE_AA)
    return together[:height // 2 * 2, :together.shape[1] // 2 * 2]


def camera_view(image: np.ndarray, camera: Camera, tracked: Tracked | None, c: int, width: int = WIDTH,
                numbers: float | None = 0.4) -> np.ndarray:
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

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Blue first.
    """
    scale = width / image.shape[1]
    size = (width, max(round(image.shape[0] * scale), 1))
    small = cv2.resize(image.astype(np.uint8), size, interpolation=cv2.INTER_AREA)
    view = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    if tracked is not None:
        _draw(view, camera, tracked, c, scale, numbers)
    cv2.putText(view, camera.name, (10, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (230, 230, 230), 1, cv2.LINE_AA)
    return view


def _draw(view: np.ndarray, camera: Camera, tracked: Tracked, c: int, scale: float,
          numbers: float | None) -> None:
    """Window, markers with their numbers, and axes, into a smaller picture."""
    if (window := tracked.windows[c]) is not None:
        corners = [(_pixel((u, v), scale)) for u, v in ((window.u, window.v),
                                                        (window.u + window.width - 1, window.v + window.height - 1))]
        cv2.rectangle(view, corners[0], corners[1], _WINDOW, 1)
    found, labels = tracked.measurement.found[c], tracked.measurement.labels[c]
    for uv, label in zip(found.uv, labels, strict=True):
        if np.isfinite(uv).all():
            cv2.circle(view, _pixel(uv, scale), 6, _STRANGER if label < 0 else _MARKER, 1, cv2.LINE_AA)
            if label >= 0 and numbers is not None:
                at = _pixel(uv + 10 / scale, scale)
                cv2.putText(view, str(label), at, cv2.FONT_HERSHEY_SIMPLEX, numbers, _MARKER, 1, cv2.LINE_AA)
    if (T := tracked.measurement.pose.T_world_handle) is not None:
        _draw_axes(view, camera, T, scale)


class Film:
    """A VP9 video that takes its name when it is whole; a context manager.

    Raises
    ------
    ValueError
        If the video cannot be written, or not as a whole.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        self.path, self.fps = Path(path), fps
        if self.path.suffix.lower() != ".webm":
            raise ValueError(f"{path}: expected a name that ends in .webm")
        self._partial = self.path.with_name(f".{self.path.stem}.partial{self.path.suffix}")
        self._writer: cv2.VideoWriter | None = None

    def __enter__(self) -> Film:
        return self

    def add(self, image: np.ndarray) -> None:
        """One more picture, (height, width, 3); all of one size."""
        if self._writer is None:
            code = cv2.VideoWriter.fourcc(*"VP90")
            with unheard():  # OpenCV finds the codec's name unusual
                self._writer = cv2.VideoWriter(str(self._partial), code, self.fps, (image.shape[1], image.shape[0]))
            if not self._writer.isOpened():
                raise ValueError(f"{self.path}: cannot be written as a VP9 video")
        with unheard() as said:
            self._writer.write(image)
            said.seek(0)
            if b"Failed to write" in said.read():
                raise ValueError(f"{self.path}: {CUT_OFF}")

    def __exit__(self, kind: object, *_: object) -> None:
        if self._writer is not None:
            self._writer.release()
        if self._partial.exists():
            whole = kind is None and _is_whole(self._partial)
            if whole:
                self._partial.replace(self.path)
            else:
                self._partial.unlink()
            if kind is None and not whole:
                raise ValueError(f"{self.path}: {CUT_OFF}")


def _is_whole(path: Path) -> bool:
    """Whether a WebM file is as long as it says; a writer on a full disk goes on without a word."""
    with path.open("rb") as file:
        head = file.read(256)
    begin = head.find(b"\x18\x53\x80\x67") + 12  # the segment's name and its length, 4 and 8 bytes
    length = int.from_bytes(head[begin - 8:begin]) & (1 << 56) - 1
    return begin > 11 and begin + length == path.stat().st_size


class PageVideo:
    """A film for a notebook: it holds all of itself, so that the page plays it without a network.

    Where a page cannot play it, as in a PDF, the still stands there.

    Parameters
    ----------
    path : path
        A .webm video.
    text : str
        What it shows, for readers who do not see it.
    still : ndarray, shape (height, width, 3)
        One of its pictures.
    """

    def __init__(self, path: str | Path, text: str, still: np.ndarray) -> None:
        self.data, self.text, self.still = Path(path).read_bytes(), text, still

    def _repr_mimebundle_(self, **_: object) -> dict[str, str]:
        data, png = b64encode(self.data).decode(), b64encode(cv2.imencode(".png", self.still)[1].tobytes()).decode()
        page = (f'<video controls muted loop playsinline style="width: 100%" aria-label="{html.escape(self.text)}">'
                f'<source type="video/webm" src="data:video/webm;base64,{data}">{html.escape(self.text)}</video>')
        return {"text/html": page, "image/png": png, "text/plain": self.text}


def _draw_axes(view: np.ndarray, camera: Camera, T_world_handle: RigidTransform, scale: float) -> None:
    ends = camera.project(T_world_handle.apply(AXIS_MM * np.vstack([np.zeros(3), np.eye(3)])))
    if np.isfinite(ends).all() and np.abs(ends).max() < 1e5:
        for end, colour in zip(ends[1:], _AXES, strict=True):
            cv2.arrowedLine(view, _pixel(ends[0], scale), _pixel(end, scale), colour, 2, cv2.LINE_AA, tipLength=0.15)


def _pixel(uv: Sequence[float] | np.ndarray, scale: float) -> tuple[int, int]:
    """A pixel of the camera's image as one of the smaller picture."""
    return round((float(uv[0]) + 0.5) * scale - 0.5), round((float(uv[1]) + 0.5) * scale - 0.5)
