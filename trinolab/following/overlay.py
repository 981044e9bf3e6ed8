"""What the tracker saw, drawn into the cameras' pictures: windows, markers with their numbers, the
pose's axes.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig
from .posetracker import Tracked

WIDTH = 640  # of a camera's picture, px
AXIS_MM = 25.0  # length of a drawn axis
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
    views = [
        camera_view(images[c], camera, tracked, c, width) for c, camera in enumerate(rig.cameras)
    ]
    height = max(len(view) for view in views)
    together = np.hstack(
        [np.pad(view, ((0, height - len(view)), (0, 0), (0, 0))) for view in views]
    )
    pose = tracked.measurement.pose
    caption = f"frame {frame}  {t_s:.3f} s  {pose.status}"
    if pose.T_world_handle is not None:
        x, y, z = pose.T_world_handle.translation
        caption += f"  ({x:.1f}, {y:.1f}, {z:.1f}) mm"
    colour = STATUS_COLOURS[pose.status]
    cv2.putText(
        together, caption, (10, height - 12), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2, cv2.LINE_AA
    )
    return together[: height // 2 * 2, : together.shape[1] // 2 * 2]


def camera_view(
    image: np.ndarray,
    camera: Camera,
    tracked: Tracked | None,
    c: int,
    width: int = WIDTH,
    numbers: float | None = 0.4,
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
    cv2.putText(
        view, camera.name, (10, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (230, 230, 230), 1, cv2.LINE_AA
    )
    return view


def _draw(
    view: np.ndarray, camera: Camera, tracked: Tracked, c: int, scale: float, numbers: float | None
) -> None:
    """Window, markers with their numbers, and axes, into a smaller picture."""
    if (window := tracked.windows[c]) is not None:
        first = _pixel((window.u, window.v), scale)
        last = _pixel((window.u + window.width - 1, window.v + window.height - 1), scale)
        cv2.rectangle(view, first, last, _WINDOW, 1)
    found = tracked.measurement.found[c]
    for uv, label in zip(found.uv, tracked.measurement.labels[c], strict=True):
        if np.isfinite(uv).all():
            cv2.circle(
                view, _pixel(uv, scale), 6, _OUTLIER if label < 0 else _MARKER, 1, cv2.LINE_AA
            )
            if label >= 0 and numbers is not None:
                at = _pixel(uv + 10 / scale, scale)
                cv2.putText(
                    view, str(label), at, cv2.FONT_HERSHEY_SIMPLEX, numbers, _MARKER, 1, cv2.LINE_AA
                )
    if (T := tracked.measurement.pose.T_world_handle) is not None:
        _draw_axes(view, camera, T, scale)


def _draw_axes(
    view: np.ndarray, camera: Camera, T_world_handle: RigidTransform, scale: float
) -> None:
    ends = camera.project(T_world_handle.apply(AXIS_MM * np.vstack([np.zeros(3), np.eye(3)])))
    if np.isfinite(ends).all() and np.abs(ends).max() < 1e5:
        for end, colour in zip(ends[1:], _AXES, strict=True):
            cv2.arrowedLine(
                view,
                _pixel(ends[0], scale),
                _pixel(end, scale),
                colour,
                2,
                cv2.LINE_AA,
                tipLength=0.15,
            )


def _pixel(uv: Sequence[float] | np.ndarray, scale: float) -> tuple[int, int]:
    """A pixel of the camera's image as one of the smaller picture."""
    return round((float(uv[0]) + 0.5) * scale - 0.5), round((float(uv[1]) + 0.5) * scale - 0.5)
