"""The operator's monitor: what the cameras see, what the slave does, and how the session stands, in
one picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from trinolab.camera import Camera
from trinolab.checks import as_array, as_image, as_number
from trinolab.following.posetracker import Tracked
from trinolab.lens import as_size

from ..films.overlay import STATUS_COLOURS, camera_view

NOTHING = "--"
PLAIN = (240, 240, 240)
TEXT_PX = 14  # of the letters, or more
Colour = tuple[int, int, int]  # blue, green, red
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_LINE = (150, 145, 140)
_NAME = (190, 185, 180)
_GOOD = STATUS_COLOURS["measured"]
_WARN = STATUS_COLOURS["ambiguous"]
_BAD = (100, 120, 255)
_FORCE = (233, 180, 86)
SIZE = 1280, 720  # px
SMALLEST = 960, 540
CAMERAS_HIGH, SLAVE_WIDE = 0.45, 0.56  # shares of the height and of the width
# blue, green, red
_BACK = (28, 24, 20)
_EMPTY = (56, 50, 46)
_CROSS = (80, 75, 70)


@dataclass(frozen=True)
class Readings:
    """What the strip shows; what is missing is shown as missing.

    Attributes
    ----------
    t_s : float
        Time of the instant, s; NaN if unknown.
    status : str
        Of the pose: ``measured``, ``ambiguous``, ``predicted``, ``lost``, or another word.
    clutch_closed : bool or None
        Whether the slave is coupled to the handle; None if unknown.
    hold : str or None
        Why the slave is held where it is; None if it is not.
    limits : tuple of str
        Names of the limits that are reached.
    force_n : float
        Magnitude of the force at the slave's tool, N; NaN if unknown.
    full_n : float
        Force at the end of the bar, N.
    scale : float
        Of the slave's distances to the handle's; NaN if it is not to be shown.
    """

    t_s: float
    status: str
    clutch_closed: bool | None = None
    hold: str | None = None
    limits: tuple[str, ...] = ()
    force_n: float = np.nan
    full_n: float = 20.0
    scale: float = np.nan

    def __post_init__(self) -> None:
        for name in ("t_s", "force_n", "scale"):
            object.__setattr__(
                self, name, float(as_array(getattr(self, name), name, (), finite=False))
            )
        as_number(self.full_n, "full_n", low=0.0, open_low=True)
        for name, right, wanted in (
            ("status", isinstance(self.status, str), "a word"),
            (
                "clutch_closed",
                isinstance(self.clutch_closed, bool | np.bool_ | None),
                "true, false or None",
            ),
            ("hold", isinstance(self.hold, str | None), "a reason or None"),
            ("limits", _are_words(self.limits), "names of limits"),
        ):
            if not right:
                raise ValueError(f"{name}: expected {wanted}, got {getattr(self, name)!r}")


def draw_strip(panel: np.ndarray, readings: Readings) -> None:
    """Write the readings, a line each with the force as a bar below, into a picture (height, width,
    3), blue first.
    """
    px = max(TEXT_PX, round(0.05 * panel.shape[0]))
    rows = np.linspace(0.03, 0.77, 6) * panel.shape[0]
    left_edge = 16
    middle = left_edge + 6 * px
    for top, (name, words, colour) in zip(rows.astype(int), _lines(readings), strict=True):
        write(panel, name, (left_edge, top + px // 2), px, _NAME, middle - px)
        if colour is not None:
            tag(panel, words, (middle, top), px, colour)
        else:
            write(panel, words, (middle, top + px // 2), px, PLAIN, panel.shape[1] - px)
    _bar(
        panel[int(rows[-1]) + 2 * px + 6 :, left_edge:-left_edge], readings.force_n, readings.full_n
    )


def write(
    view: np.ndarray, words: str, corner: tuple[int, int], px: int, colour: Colour, right: int
) -> None:
    """A line of words in letters of `px`, from its upper left corner (u, v) to the column `right`
    at most.
    """
    fitted = _fitted(words, px, right - corner[0])
    cv2.putText(
        view, fitted, (corner[0], corner[1] + px), _FONT, _scale(px), colour, 1, cv2.LINE_AA
    )


def tag(
    panel: np.ndarray,
    words: str,
    corner: tuple[int, int],
    px: int,
    colour: Colour,
    ink: Colour = (0, 0, 0),
) -> None:
    """Words on a coloured field, twice as high as the letters, from its upper left corner."""
    right = panel.shape[1] - px
    fitted = _fitted(words, px, right - corner[0] - px)
    cv2.rectangle(
        panel, corner, (corner[0] + _wide(fitted, px) + px, corner[1] + 2 * px), colour, -1
    )
    write(panel, fitted, (corner[0] + px // 2, corner[1] + px // 2), px, ink, right)


def _lines(r: Readings) -> list[tuple[str, str, Colour | None]]:
    """Name, words and colour of each line; without a colour it is plain."""
    clutch = (
        NOTHING
        if r.clutch_closed is None
        else "CLOSED: coupled"
        if r.clutch_closed
        else "OPEN: not coupled"
    )
    if r.clutch_closed and not np.isnan(r.scale):
        clutch = f"{clutch}, scale {r.scale:g}"
    status = r.status if r.status != "lost" else "LOST: no pose"
    over = "over" if r.force_n > r.full_n else "of"
    force = "no reading" if np.isnan(r.force_n) else f"{r.force_n:.1f} N {over} {r.full_n:g} N"
    return [
        ("time", NOTHING if np.isnan(r.t_s) else f"{r.t_s:.2f} s", None),
        ("pose", status or NOTHING, STATUS_COLOURS.get(r.status, _LINE)),
        ("clutch", clutch, _GOOD if r.clutch_closed else _LINE),
        (
            "hold",
            "no" if r.hold is None else f"HOLD: {r.hold or 'no reason given'}",
            None if r.hold is None else _BAD,
        ),
        ("limits", ", ".join(r.limits) if r.limits else "none", _WARN if r.limits else None),
        ("force", force, None),
    ]


def _bar(room: np.ndarray, force_n: float, full_n: float) -> None:
    """A bar with a mark at each quarter; crossed out where there is no force to show."""
    height = max(room.shape[0] - 14, 6)
    end = room.shape[1] - 1
    if np.isnan(force_n):
        for u in range(0, end, 12):
            cv2.line(room, (u, height), (min(u + 12, end), 0), _LINE, 1, cv2.LINE_AA)
    else:
        filled = round(end * min(abs(force_n) / full_n, 1.0))
        cv2.rectangle(room, (0, 0), (filled, height), _BAD if force_n > full_n else _FORCE, -1)
    cv2.rectangle(room, (0, 0), (end, height), PLAIN, 1)
    for quarter in range(1, 4):
        cv2.line(room, (end * quarter // 4, height - 6), (end * quarter // 4, height), PLAIN, 1)


def _fitted(words: str, px: int, wide: int) -> str:
    """Words as the font has them, cut where they are too wide."""
    plain = " ".join(words.encode("ascii", "replace").decode().split())
    cuts = (plain[:k].rstrip() + ".." for k in range(len(plain) - 1, -1, -1))
    return next((cut for cut in (plain, *cuts) if _wide(cut, px) <= wide), "")


def _wide(words: str, px: int) -> int:
    return int(cv2.getTextSize(words, _FONT, _scale(px), 1)[0][0])


def _scale(px: int) -> float:
    return float(cv2.getFontScaleFromHeight(_FONT, px, 1))


def _are_words(value: Any) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(word, str) for word in value)


def monitor_picture(
    images: Sequence[ArrayLike | None],
    tracked: Tracked | None,
    cameras: Sequence[Camera],
    slave: np.ndarray | None,
    readings: Readings,
    size: tuple[int, int] = SIZE,
) -> np.ndarray:
    """One picture of the monitor: the cameras' views above, the slave's view and the strip below.

    Parameters
    ----------
    images : sequence of array_like, shape (height, width), or None
        Grey levels 0 to 255, one per camera; None for a camera without an image.
    tracked : posetracker.Tracked or None
        The same instant's track; None where there is none.
    cameras : sequence of Camera
        One or more, as ``rig.cameras``.
    slave : ndarray of uint8, shape (height, width, 3), or None
        The surveillance camera's picture, red first; it is shown without a change of size if it has
        that of `slave_size`. None if there is none.
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
        If there is not one image, and one tracked view, for each camera, an image or the slave's is
        none of that kind, or the size is too small or odd.
    """
    pictures = _as_images(images, cameras, tracked)
    if not isinstance(readings, Readings):
        raise ValueError(f"readings: expected Readings, got {type(readings).__name__}")
    (width, height) = _as_monitor(size)
    (slave_width, _) = slave_size(size)
    canvas = np.full((height, width, 3), _BACK, np.uint8)
    top = round(CAMERAS_HIGH * height)
    edges = np.linspace(0, width, len(cameras) + 1).round().astype(int)
    for c, camera in enumerate(cameras):
        cell = canvas[:top, edges[c] : edges[c + 1]]
        _put(cell, _camera(pictures[c], camera, tracked, c, (cell.shape[1] - 4, top - 4)))
    _put(canvas[top:, :slave_width], _slave(slave, slave_size(size)))
    draw_strip(canvas[top:, slave_width:], readings)
    return np.ascontiguousarray(canvas[..., ::-1])


def slave_size(size: tuple[int, int] = SIZE) -> tuple[int, int]:
    """Width and height, px, that a monitor of some size has for the slave's view."""
    width, height = _as_monitor(size)
    return round(SLAVE_WIDE * width), height - round(CAMERAS_HIGH * height)


def blue_first(picture: np.ndarray) -> np.ndarray:
    """A picture, shape (height, width, 3), with red first as `video.Film` and `video.PageVideo`
    take it.
    """
    return np.ascontiguousarray(picture[..., ::-1])


def _camera(
    image: np.ndarray | None, camera: Camera, tracked: Tracked | None, c: int, room: tuple[int, int]
) -> np.ndarray:
    """One camera's view as large as there is room for it."""
    width = max(int(min(room[0], room[1] * camera.size[0] / camera.size[1])), 1)
    if image is None:
        return _absent(
            f"{camera.name}: no image", (width, round(width * camera.size[1] / camera.size[0]))
        )
    view = camera_view(image, camera, tracked, c, width, numbers=None)[: room[1]]
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
        raise ValueError(
            f"slave: expected a picture of shape (height, width, 3), uint8, got {image.dtype} "
            f"{image.shape}"
        )
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
    top = (cell.shape[0] - view.shape[0]) // 2
    margin = (cell.shape[1] - view.shape[1]) // 2
    cell[top : top + view.shape[0], margin : margin + view.shape[1]] = view


def _as_monitor(size: Any) -> tuple[int, int]:
    width, height = as_size(size)
    if width < SMALLEST[0] or height < SMALLEST[1] or width % 2 or height % 2:
        raise ValueError(
            f"size: expected even sides of {SMALLEST[0]} x {SMALLEST[1]} px or more, "
            f"got {width} x {height}"
        )
    return width, height


def _as_images(
    images: Sequence[ArrayLike | None], cameras: Sequence[Camera], tracked: Tracked | None
) -> list[np.ndarray | None]:
    """The images, each checked; they and the track are those of the cameras."""
    if not len(cameras):
        raise ValueError("cameras: expected one or more, got none")
    for name, one_each in (
        ("images", images),
        ("tracked", tracked.windows if tracked is not None else cameras),
    ):
        if len(one_each) != len(cameras):
            raise ValueError(
                f"{name}: expected {len(cameras)}, one per camera, got {len(one_each)}"
            )
    return [
        None if image is None else as_image(image, f"images[{c}]", cameras[c].size, highest=255)
        for c, image in enumerate(images)
    ]
