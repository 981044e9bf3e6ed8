"""The operator's monitor: what the cameras see, what the slave does, and how the session stands, in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .camera import Camera
from .checks import as_image
from .lens import as_size
from .overlay import camera_view
from .posetracker import Tracked
from .readings import PLAIN, TEXT_PX, Readings, draw_strip, tag, write

SIZE = 1280, 720  # px
SMALLEST = 960, 540
CAMERAS_HIGH, SLAVE_WIDE = 0.45, 0.56  # shares of the height and of the width
_BACK, _EMPTY, _CROSS = (28, 24, 20), (56, 50, 46), (80, 75, 70)  # blue, green, red


def monitor_picture(images: Sequence[ArrayLike | None], tracked: Tracked | None, cameras: Sequence[Camera],
                    slave: np.ndarray | None, readings: Readings, size: tuple[int, int] = SIZE) -> np.ndarray:
    """One picture of the monitor: the cameras' views above, the slave's view and the strip below.

    Parameters
    ----------
    images : sequence of array_like, shape (height, width), or None
        Grey levels 0 to 255, one a camera; None for a camera without an image.
    tracked : posetracker.Tracked or None
        The same instant's track; None where there is none.
    cameras : sequence of Camera
        One or more, as ``rig.cameras``.
    slave : ndarray of uint8, shape (height, width, 3), or None
        The surveillance camera's picture, red first; it is shown without a change of size if it has that of
        `slave_size`. None if there is none.
    readings : Readings
    size : (int, int)
        Width and height, px, even; 960 x 540 or more.

    Returns
    -------
    ndarray of uint8, shape (height, width, 3)
        Red first; see `blue_first` for a film.

    Raises
    ------
    ValueError
        If there is not one image, and one tracked view, for each camera, an image or the slave's is none of that kind,
        or the size is too small or odd.
    """
    shown = _as_images(images, cameras, tracked)
    if not isinstance(readings, Readings):
        raise ValueError(f"readings: expected Readings, got {type(readings).__name__}")
    (width, height), (slave_width, _) = _as_monitor(size), slave_size(size)
    canvas = np.full((height, width, 3), _BACK, np.uint8)
    top = round(CAMERAS_HIGH * height)
    edges = np.linspace(0, width, len(cameras) + 1).round().astype(int)
    for c, camera in enumerate(cameras):
        cell = canvas[:top, edges[c]:edges[c + 1]]
        _put(cell, _camera(shown[c], camera, tracked, c, (cell.shape[1] - 4, top - 4)))
    _put(canvas[top:, :slave_width], _slave(slave, slave_size(size)))
    draw_strip(canvas[top:, slave_width:], readings)
    return np.ascontiguousarray(canvas[..., ::-1])


def slave_size(size: tuple[int, int] = SIZE) -> tuple[int, int]:
    """Width and height, px, that a monitor of some size has for the slave's view."""
    width, height = _as_monitor(size)
    return round(SLAVE_WIDE * width), height - round(CAMERAS_HIGH * height)


def blue_first(picture: np.ndarray) -> np.ndarray:
    """A picture, shape (height, width, 3), with red first as `overlay.Film` and `overlay.PageVideo` take it."""
    return np.ascontiguousarray(picture[..., ::-1])


def _camera(image: np.ndarray | None, camera: Camera, tracked: Tracked | None, c: int,
            room: tuple[int, int]) -> np.ndarray:
    """One camera's view as large as there is room for it."""
    width = max(int(min(room[0], room[1] * camera.size[0] / camera.size[1])), 1)
    if image is None:
        return _absent(f"{camera.name}: no image", (width, round(width * camera.size[1] / camera.size[0])))
    view = camera_view(image, camera, tracked, c, width, numbers=None)[:room[1]]
    count = None if tracked is None else np.count_nonzero(tracked.measurement.labels[c] >= 0)
    words = "not tracked" if count is None else "1 marker" if count == 1 else f"{count} markers"
    words = f"{camera.name}: {words}"  # again, on a field of its own: the image may be bright
    tag(view, words, (0, len(view) - 2 * TEXT_PX - 1), TEXT_PX, _EMPTY, PLAIN)
    return view


def _slave(picture: np.ndarray | None, room: tuple[int, int]) -> np.ndarray:
    if picture is None:
        return _absent("slave: no picture", (room[0] - 4, room[1] - 4))
    image = np.asarray(picture)
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or image.size == 0:
        raise ValueError(f"slave: expected a picture of shape (height, width, 3), uint8, got {image.dtype} "
                         f"{image.shape}")
    scale = min(room[0] / image.shape[1], room[1] / image.shape[0])
    size = [max(int(side * scale + 1e-9), 1) for side in image.shape[1::-1]]
    return np.asarray(cv2.resize(image[..., ::-1], size, interpolation=cv2.INTER_AREA))


def _absent(words: str, size: tuple[int, int]) -> np.ndarray:
    """What stands for a picture that is missing: its name, on a cross."""
    width, height = size
    view = np.full((max(height, 1), width, 3), _EMPTY, np.uint8)
    for ends in (((0, 0), (width, height)), ((width, 0), (0, height))):
        cv2.line(view, *ends, _CROSS, 1, cv2.LINE_AA)
    write(view, words, (10, 8), TEXT_PX + 3, PLAIN, width - 10)
    return view


def _put(cell: np.ndarray, view: np.ndarray) -> None:
    """A picture into the middle of a cell that is as large or larger."""
    top, left = (cell.shape[0] - view.shape[0]) // 2, (cell.shape[1] - view.shape[1]) // 2
    cell[top:top + view.shape[0], left:left + view.shape[1]] = view


def _as_monitor(size: Any) -> tuple[int, int]:
    width, height = as_size(size)
    if width < SMALLEST[0] or height < SMALLEST[1] or width % 2 or height % 2:
        raise ValueError(f"size: expected even sides of {SMALLEST[0]} x {SMALLEST[1]} px or more, "
                         f"got {width} x {height}")
    return width, height


def _as_images(images: Sequence[ArrayLike | None], cameras: Sequence[Camera],
               tracked: Tracked | None) -> list[np.ndarray | None]:
    """The images, each checked; they and the track are those of the cameras."""
    if not len(cameras):
        raise ValueError("cameras: expected one or more, got none")
    for name, one_each in (("images", images), ("tracked", tracked.windows if tracked is not None else cameras)):
        if len(one_each) != len(cameras):
            raise ValueError(f"{name}: expected {len(cameras)}, one a camera, got {len(one_each)}")
    return [None if image is None else as_image(image, f"images[{c}]", cameras[c].size, highest=255)
            for c, image in enumerate(images)]
