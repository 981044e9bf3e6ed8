"""What a good set-up shows, why the limits are where they are, and what to do where it is not met.

Each limit comes from something that the book has measured; `Criterion.why` says from what. They stand in
``data/criteria.toml``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from trinolab.datasets import data_path
from trinolab.files.inputs import get, read_toml

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


def _read() -> dict[str, Criterion]:
    """The criteria of ``data/criteria.toml``, by their names there."""
    path = data_path("criteria.toml")
    return {
        name: Criterion(*(get(table, field, f"{path}: {name}") for field in Criterion._fields))
        for name, table in read_toml(path).items()
    }


_CRITERIA = _read()
RANGE = _CRITERIA["range"]
CONTRAST = _CRITERIA["contrast"]
NOISE = _CRITERIA["noise"]
WHITE = _CRITERIA["white"]
WHITE_PIXELS = _CRITERIA["white_pixels"]
FLICKER = _CRITERIA["flicker"]
FOCUS = _CRITERIA["focus"]
SMEAR = _CRITERIA["smear"]
SIZE = _CRITERIA["size"]
STEPS = _CRITERIA["steps"]
APART = _CRITERIA["apart"]
ANGLE = _CRITERIA["angle"]
COST = _CRITERIA["cost"]
AGREE = _CRITERIA["agree"]
PART = _CRITERIA["part"]
FOUND = _CRITERIA["found"]


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
    verdicts = set(table["verdict"])
    return next((one for one in (NOT_USABLE, USABLE) if one in verdicts), GOOD)


def of_cameras(
    criterion: Criterion,
    names: Sequence[str],
    values: ArrayLike,
    digits: int = 0,
    notes: Sequence[str] = (),
) -> dict[str, str | float]:
    """A row of a value per camera: the worst one counts; NaN where a camera has none. A note per camera
    may stand behind its value.
    """
    numbers = np.asarray(values, float)
    if not np.isfinite(numbers).any():
        return row(criterion, np.nan, "nothing to measure it by")
    worst = np.nanmax(numbers) if criterion.good < criterion.usable else np.nanmin(numbers)
    texts = [
        f"{name} {value:.{digits}f}{note}" if np.isfinite(value) else f"{name} -"
        for name, value, note in zip(names, numbers, notes or [""] * len(names), strict=True)
    ]
    unit = f" {criterion.unit}" if criterion.unit else ""
    return row(criterion, float(worst), ", ".join(texts) + unit)
