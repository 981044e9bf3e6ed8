"""How a session stands, in words and as a bar: the strip of the operator's monitor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from .checks import as_array, as_number
from .overlay import STATUS_COLOURS

NOTHING = "--"
PLAIN = (240, 240, 240)
TEXT_PX = 14  # of the letters, or more
Colour = tuple[int, int, int]  # blue, green, red
_FONT, _LINE, _NAME = cv2.FONT_HERSHEY_SIMPLEX, (150, 145, 140), (190, 185, 180)
_GOOD, _WARN, _BAD, _FORCE = (STATUS_COLOURS["measured"], STATUS_COLOURS["ambiguous"], (100, 120, 255), (233, 180, 86))


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

    Raises
    ------
    ValueError
        Names the field of another kind, or the bar's end that is not positive.
    """

    t_s: float
    status: str
    clutch_closed: bool | None = None
    hold: str | None = None
    limits: tuple[str, ...] = ()
    force_n: float = np.nan
    full_n: float = 20.0

    def __post_init__(self) -> None:
        for name in ("t_s", "force_n"):
            object.__setattr__(self, name, float(as_array(getattr(self, name), name, (), finite=False)))
        as_number(self.full_n, "full_n", low=0.0, open_low=True)
        for name, right, wanted in (
                ("status", isinstance(self.status, str), "a word"),
                ("clutch_closed", isinstance(self.clutch_closed, bool | np.bool_ | None), "true, false or None"),
                ("hold", isinstance(self.hold, str | None), "a reason or None"),
                ("limits", _are_words(self.limits), "names of limits")):
            if not right:
                raise ValueError(f"{name}: expected {wanted}, got {getattr(self, name)!r}")


def draw_strip(panel: np.ndarray, readings: Readings) -> None:
    """Write the readings, a line each with the force as a bar below, into a picture (height, width, 3), blue first."""
    px = max(TEXT_PX, round(0.05 * panel.shape[0]))
    rows, left = np.linspace(0.03, 0.77, 6) * panel.shape[0], 16
    middle = left + 6 * px
    for top, (name, words, colour) in zip(rows.astype(int), _lines(readings), strict=True):
        write(panel, name, (left, top + px // 2), px, _NAME, middle - px)
        if colour is not None:
            tag(panel, words, (middle, top), px, colour)
        else:
            write(panel, words, (middle, top + px // 2), px, PLAIN, panel.shape[1] - px)
    _bar(panel[int(rows[-1]) + 2 * px + 6:, left:-left], readings.force_n, readings.full_n)


def write(view: np.ndarray, words: str, corner: tuple[int, int], px: int, colour: Colour, right: int) -> None:
    """A line of words in letters of `px`, from its upper left corner (u, v) to the column `right` at most."""
    fitted = _fitted(words, px, right - corner[0])
    cv2.putText(view, fitted, (corner[0], corner[1] + px), _FONT, _scale(px), colour, 1, cv2.LINE_AA)


def tag(panel: np.ndarray, words: str, corner: tuple[int, int], px: int, colour: Colour,
        ink: Colour = (0, 0, 0)) -> None:
    """Words on a coloured field, twice as high as the letters, from its upper left corner."""
    right = panel.shape[1] - px
    fitted = _fitted(words, px, right - corner[0] - px)
    cv2.rectangle(panel, corner, (corner[0] + _wide(fitted, px) + px, corner[1] + 2 * px), colour, -1)
    write(panel, fitted, (corner[0] + px // 2, corner[1] + px // 2), px, ink, right)


def _lines(r: Readings) -> list[tuple[str, str, Colour | None]]:
    """Name, words and colour of each line; without a colour it is plain."""
    clutch = NOTHING if r.clutch_closed is None else "CLOSED: coupled" if r.clutch_closed else "OPEN: not coupled"
    status = r.status if r.status != "lost" else "LOST: no pose"
    over = "over" if r.force_n > r.full_n else "of"
    force = "no reading" if np.isnan(r.force_n) else f"{r.force_n:.1f} N {over} {r.full_n:g} N"
    return [
        ("time", NOTHING if np.isnan(r.t_s) else f"{r.t_s:.2f} s", None),
        ("pose", status or NOTHING, STATUS_COLOURS.get(r.status, _LINE)),
        ("clutch", clutch, _GOOD if r.clutch_closed else _LINE),
        ("hold", "no" if r.hold is None else f"HOLD: {r.hold or 'no reason given'}", None if r.hold is None else _BAD),
        ("limits", ", ".join(r.limits) if r.limits else "none", _WARN if r.limits else None),
        ("force", force, None),
    ]


def _bar(room: np.ndarray, force_n: float, full_n: float) -> None:
    """A bar with a mark at each quarter; crossed out where there is no force to show."""
    height, end = max(room.shape[0] - 14, 6), room.shape[1] - 1
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
