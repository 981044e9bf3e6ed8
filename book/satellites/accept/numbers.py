"""The form of an answer: numbers with n, seed and interval, figures, and what has to be said."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from trinolab.checks import Array
from workbench.intervals import (
    NONE,
    Interval,
    by_bootstrap,
    highest_share,
    of_quantile,
    of_series,
    of_share,
    rms,
)

OWN = "own bench"  # images drawn by the model that is fitted
SIMULATED = "simulated arm"
CLOCK = "this computer's clock"
LARGEST = "largest"


@dataclass(frozen=True)
class Number:
    """One line of the sheet.

    Attributes
    ----------
    test : str
        A1 to A7.
    what, statistic, unit : str
    value : float
    low, high : float
        Of the interval of 95 %; NaN where it has none.
    interval : str
        Its method.
    n : int
        What was counted: poses, instants, pairs, ...
    seed : int or None
        Of what was drawn; None for a recording.
    source : str
        What the images, or the times, come from: `OWN`, a recording, ...
    note : str
    """

    test: str
    what: str
    statistic: str
    value: float
    unit: str
    n: int
    seed: int | None = None
    source: str = OWN
    low: float = np.nan
    high: float = np.nan
    interval: str = ""
    note: str = ""

    def within(self, interval: Interval) -> Number:
        """The same with an interval."""
        return replace(self, low=interval.low, high=interval.high, interval=interval.how)


class Picture(NamedTuple):
    """A figure of the sheet: its name, what it shows for those who cannot see it, and its PNG
    file.
    """

    name: str
    alt: str
    png: bytes


@dataclass
class Answer:
    """What a test found.

    Attributes
    ----------
    numbers : list of Number
    pictures : list of Picture
    notes : list of str
        Sentences for the reader of the sheet.
    """

    numbers: list[Number] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


STATISTICS = ("mean", "rms", "median", "95 %", LARGEST)


def distribution(
    test: str,
    what: str,
    values: Array,
    unit: str,
    seed: int | None,
    source: str = OWN,
    statistics: Sequence[str] = STATISTICS,
    together: int = 1,
) -> list[Number]:
    """Mean, rms, median, 95 %, 99 % and the largest of values (n,), or some of these, each with
    its interval; none for no value.

    Of instants that follow one another, `together` of them depend on each other.
    """
    n = len(values)
    if together > 1:
        return _of_instants(test, what, values, unit, seed, source, statistics, together)
    if n == 0:
        return []

    def line(statistic: str, value: float, interval: Interval, note: str = "") -> Number:
        number = Number(test, what, statistic, float(value), unit, n, seed, source, note=note)
        return number.within(interval)

    # of n values drawn alike, so much of all others lies below the largest, 95 % sure
    below = 100 * 0.05 ** (1 / n)
    largest = f"at least {below:.4g} % of all lie below it, 95 % sure"
    computed = {
        "mean": lambda: line("mean", values.mean(), by_bootstrap(values, np.mean)),
        "rms": lambda: line("rms", rms(values), by_bootstrap(values, rms)),
        "median": lambda: line("median", np.median(values), of_quantile(values, 0.5)),
        "95 %": lambda: line("95 %", np.quantile(values, 0.95), of_quantile(values, 0.95)),
        "99 %": lambda: line("99 %", np.quantile(values, 0.99), of_quantile(values, 0.99)),
        LARGEST: lambda: line(LARGEST, values.max(), NONE, largest),
    }
    return [computed[name]() for name in statistics]


def _of_instants(
    test: str,
    what: str,
    values: Array,
    unit: str,
    seed: int | None,
    source: str,
    statistics: Sequence[str],
    together: int,
) -> list[Number]:
    """`distribution` of instants that depend on each other."""
    computed: dict[str, Callable[[Array], float]] = {
        "mean": lambda rows: float(np.mean(rows)),
        "rms": rms,
        "median": lambda rows: float(np.median(rows)),
        "95 %": lambda rows: float(np.quantile(rows, 0.95)),
        "99 %": lambda rows: float(np.quantile(rows, 0.99)),
    }
    numbers = []
    for name in statistics if len(values) else ():
        number = Number(test, what, name, float(values.max()), unit, len(values), seed, source)
        if name in computed:
            number = replace(number, value=computed[name](values))
            number = number.within(of_series(values, computed[name], together))
        numbers.append(number)
    return numbers


def share(
    test: str,
    what: str,
    count: int,
    n: int,
    seed: int | None,
    source: str = OWN,
    note: str = "",
    together: int = 1,
) -> Number:
    """A share in per cent with Wilson's interval; of instants that follow one another, `together`
    count as one.
    """
    interval = of_share(count, n, together)
    number = Number(test, what, "share", 100 * count / n, "%", n, seed, source, note=note)
    return number.within(Interval(100 * interval.low, 100 * interval.high, interval.how))


def far_count(test: str, count: int, n: int, seed: int | None, source: str = OWN) -> Number:
    """How many poses were called measured and are far off, and how large their share may be."""
    most = 100 * highest_share(count, n)
    return Number(
        test,
        "called measured, off by more than 2 mm or 5 deg",
        "count",
        float(count),
        "poses",
        n,
        seed,
        source,
        note=f"a share of at most {most:.2g} %, 95 % sure",
    )


def as_table(numbers: list[Number]) -> pd.DataFrame:
    """A row a number, with the columns of `Number`."""
    return pd.DataFrame([asdict(number) for number in numbers])[[*Number.__dataclass_fields__]]
