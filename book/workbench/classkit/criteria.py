"""What a good set-up shows, why the limits are where they are, and what to do where it is not met.

Each limit comes from something that the book has measured; `Criterion.why` says from what.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

__all__ = [
    "AGREE",
    "ANGLE",
    "APART",
    "COLUMNS",
    "CONTRAST",
    "COST",
    "FLICKER",
    "FOCUS",
    "FOUND",
    "GOOD",
    "NOISE",
    "NOT_MEASURED",
    "NOT_USABLE",
    "PART",
    "RANGE",
    "SIZE",
    "SMEAR",
    "STEPS",
    "USABLE",
    "WHITE",
    "WHITE_PIXELS",
    "Criterion",
    "of_cameras",
    "overall",
    "row",
]

GOOD, USABLE, NOT_USABLE, NOT_MEASURED = "good", "usable", "not usable", "not measured"
COLUMNS = ("what", "value", "measured", "wanted", "verdict", "do", "why")


class Criterion(NamedTuple):
    """One row of the table before anything is measured.

    Attributes
    ----------
    what : str
    unit : str
        Of the value, as it stands behind the number.
    good, usable : float
        Limits of the verdicts; the value should be small if `good` is the smaller one.
    do : str
        What to do where it is not good.
    why : str
        Where the limits come from.
    """

    what: str
    unit: str
    good: float
    usable: float
    do: str
    why: str

    @property
    def wanted(self) -> str:
        """The limits in words."""
        word = "at most" if self.good < self.usable else "at least"
        unit = f" {self.unit}" if self.unit else ""
        return f"{word} {self.good:g}{unit} (usable: {self.usable:g})"

    def verdict(self, value: float) -> str:
        """Good, usable, not usable; not measured for NaN."""
        if np.isnan(value):
            return NOT_MEASURED
        sign = 1 if self.good < self.usable else -1
        if sign * value <= sign * self.good:
            return GOOD
        return USABLE if sign * value <= sign * self.usable else NOT_USABLE


RANGE = Criterion(
    "range of greys",
    "grey levels",
    80,
    40,
    "more light, or a longer exposure; a lens cap, a wrong camera?",
    "a board's corners need the contrast that markers need (chapter 5)",
)
CONTRAST = Criterion(
    "markers' contrast",
    "grey levels",
    60,
    30,
    "more light on the rod (a lamp beside each camera), gain up, then exposure up; a darker ground",
    "65 levels cost a factor of 1.5 (chapter 10's table of faults, half contrast); the finder stops at 20 "
    "(chapter 5)",
)
NOISE = Criterion(
    "contrast by noise",
    "",
    16,
    8,
    "more light, and less gain",
    "the gallery's sweep of the noise: at 16 the error is three times the usual one, at 8 six times, below "
    "poses are missing",
)
WHITE = Criterion(
    "markers cut off at white",
    "% of their middles",
    5,
    100,
    "shorten the exposure until the markers are at 200 to 240; turn a lamp that shines in them",
    "a centre that is cut off says nothing of the shading; stripes of highlights lose every seventh pose "
    "(chapter 10's table of faults)",
)
WHITE_PIXELS = Criterion(
    "pixels cut off at white",
    "% of the image",
    1,
    10,
    "shorten the exposure; keep lamps and windows out of the image",
    "a target's white squares must not be cut off, or their corners move (chapter 7)",
)
FLICKER = Criterion(
    "light over time",
    "% up and down",
    3,
    10,
    "fix exposure, gain and white balance by hand; exposure a multiple of 10 ms (50 Hz) or 8.3 ms (60 Hz)",
    "15 grey levels, the threshold T of chapter 3, are 10 % of a background of 150",
)
FOCUS = Criterion(
    "blur of the edges",
    "px",
    1.3,
    2.5,
    "focus by hand on the rod, autofocus off, clean the lens; more light allows a smaller aperture",
    "the gallery's sweep of the blur: 1.5 px double the error, 3 px make it nine times as large; on markers of "
    "7 px a blur of 3 px leaves no pose, and this measure shows four fifths of the blur",
)
SMEAR = Criterion(
    "smear at 300 mm/s",
    "of a marker",
    0.33,
    0.67,
    "shorten the exposure, and make up for it by light; or move slowly",
    "the sweep of the speed (chapter 9): a third of a marker costs a seventh more, two thirds lose every fifth "
    "pose of the paper's method, four thirds two of three",
)
SIZE = Criterion(
    "markers' size",
    "px",
    6.0,
    4.5,
    "larger markers (trinolab kit --marker), nearer, or more pixels",
    "the finder stops at 4 px (chapter 5); the table of webcams on the lab sheet",
)
STEPS = Criterion(
    "frames missing or repeated",
    "%",
    1.0,
    10.0,
    "fewer pixels or frames a second, each camera at a USB port of its own, no other program",
    "the pose is predicted for 0.3 s (chapter 4): ten frames",
)
APART = Criterion(
    "cameras apart in time",
    "ms",
    0.33,
    15.0,
    "a common trigger, or more frames a second; without one move slowly, or measure a rod at rest",
    "a hand at 300 mm/s moves 0.1 mm in 0.33 ms, one at 20 mm/s 0.3 mm in 15 ms; 5 ms at 330 mm/s cost 2.5 mm "
    "(chapter 10's table of faults)",
)
ANGLE = Criterion(
    "angle between two cameras",
    "deg",
    10.0,
    5.0,
    "move the cameras apart: a third of the distance to the rod is good",
    "the gallery's sweep of the baseline: 10 deg are the paper's 99 mm, at 5 deg the error is 1.8 times, at "
    "2.6 deg 3 times as large",
)
COST = Criterion(
    "what the calibration costs",
    "mm",
    0.31,
    1.0,
    "more views, tilted more, all over the image and at the rod's place; then trinolab refine",
    "0.31 mm is the paper's whole error (chapter 7: how good must a calibration be?)",
)
AGREE = Criterion(
    "cameras contradict each other",
    "px",
    0.5,
    2.0,
    "calibrate again: a camera was moved; or the markers do not lie where the handle file says",
    "0.1 px and 0.005 deg of error in the rig, 0.5 px here, cost 0.1 mm; three times that 0.6 mm, and every "
    "third pose (chapter 10's table of faults)",
)
PART = Criterion(
    "each camera takes part",
    "% of the poses",
    80.0,
    40.0,
    "this camera was moved, is late, or does not see the rod: look at its image, calibrate again",
    "a rig that is off by 0.3 px and 0.02 deg loses every third pose (chapter 10's table of faults)",
)
FOUND = Criterion(
    "found by two or more cameras",
    "% of the instants",
    95.0,
    75.0,
    "the rows above say why; else: is the rod in all images, is it the right handle file?",
    "the data sheet has 99 % of the instants at which it is possible",
)


def row(
    criterion: Criterion, value: float, measured: str, problem: str = ""
) -> dict[str, str | float]:
    """A row of the table.

    Parameters
    ----------
    criterion : Criterion
    value : float
        NaN where it could not be measured.
    measured : str
        The value in words, or why there is none.
    problem : str
        What to do in this case, instead of what to do usually.
    """
    verdict = criterion.verdict(value)
    do = "" if verdict == GOOD else problem or criterion.do
    return dict(
        zip(
            COLUMNS,
            (criterion.what, value, measured, criterion.wanted, verdict, do, criterion.why),
            strict=True,
        )
    )


def overall(table: pd.DataFrame) -> str:
    """The worst verdict; what was not measured does not count."""
    found = set(table["verdict"])
    return next((one for one in (NOT_USABLE, USABLE) if one in found), GOOD)


def of_cameras(
    criterion: Criterion,
    names: Sequence[str],
    values: ArrayLike,
    digits: int = 0,
    notes: Sequence[str] = (),
) -> dict[str, str | float]:
    """A row of a value a camera: the worst one counts; NaN where a camera has none. A note a camera
    may stand behind its value.
    """
    numbers = np.asarray(values, float)
    if not np.isfinite(numbers).any():
        return row(criterion, np.nan, "nothing to measure it by")
    worst = np.nanmax(numbers) if criterion.good < criterion.usable else np.nanmin(numbers)
    said = [
        f"{name} {value:.{digits}f}{note}" if np.isfinite(value) else f"{name} -"
        for name, value, note in zip(names, numbers, notes or [""] * len(names), strict=True)
    ]
    unit = f" {criterion.unit}" if criterion.unit else ""
    return row(criterion, float(worst), ", ".join(said) + unit)
