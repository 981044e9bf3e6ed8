"""A pointing task of the tool, its log, and how fast and how accurate it was done (beyond the
paper).

The tool is brought from rest onto a target of a width at a distance, and the operator says when it
is there: the one-directional tapping test of ISO 9241-411:2012 (before: ISO 9241-9:2000), after
Fitts 1954, DOI 10.1037/h0055392. A log has a row per trial, whoever the operator is, a person or a
model (`operators`), so that both are judged alike.

A log is a CSV file with these columns:

``task``
    Number of the trial, from 0.
``operator``
    Who did it: a name.
``scale``, ``delay_s``
    Tool : handle, and what was added to the way from the hand to the picture, s.
``distance_mm``, ``width_mm``
    Of the target, at the tool.
``start_s``, ``end_s``
    When the target appeared, and when the operator said that the tool is there.
``error_mm``
    Where the tool was then, from the target's middle, along the line from the start; positive
    beyond.
``moves``
    How often the hand set out, where that is known; 0 otherwise.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from trinolab.checks import Array
from trinolab.files.inputs import read_csv
from trinolab.files.outputs import write_whole

COLUMNS = (
    "task",
    "operator",
    "scale",
    "delay_s",
    "distance_mm",
    "width_mm",
    "start_s",
    "end_s",
    "error_mm",
    "moves",
)
DISTANCES_MM = (40.0, 80.0, 160.0)
WIDTHS_MM = (5.0, 10.0, 20.0)
SPREAD = 4.133  # standard deviations that hold 96 % of a normal distribution


class Performance(NamedTuple):
    """How well a task was done, over all its trials.

    Attributes
    ----------
    throughput_bit_s : float
        Effective index of difficulty over movement time, the mean over the conditions; NaN if none
        has two trials with different ends.
    movement_s : float
        Mean movement time, s.
    error_share : float
        Share of the trials that ended beside the target.
    moves : float
        Mean number of times that the hand set out.
    n : int
        Trials.
    """

    throughput_bit_s: float
    movement_s: float
    error_share: float
    moves: float
    n: int


def conditions(repeats: int = 10) -> Array:
    """Distance and width of each trial, mm, shape (n, 2): every pair of them, `repeats` times."""
    return np.repeat(list(product(DISTANCES_MM, WIDTHS_MM)), repeats, axis=0)


def difficulty(distance_mm: Array | float, width_mm: Array | float) -> Array:
    """Index of difficulty, bit: log2(distance / width + 1), the Shannon form of ISO 9241-411."""
    return np.log2(np.asarray(distance_mm, float) / np.asarray(width_mm, float) + 1)


def performance(log: pd.DataFrame) -> Performance:
    """Throughput, movement time and errors of a log (Soukoreff and MacKenzie 2004, DOI
    10.1016/j.ijhcs.2004.09.001).

    The effective width of a condition is 4.133 standard deviations of the ends, the effective
    distance the mean of the distances that were covered; the throughput is the mean over the
    conditions of log2(effective distance / effective width + 1) / mean movement time.
    """
    rates = [_throughput(trials) for _, trials in log.groupby(["distance_mm", "width_mm"])]
    known = [rate for rate in rates if np.isfinite(rate)]
    missed = log["error_mm"].abs() > log["width_mm"] / 2
    return Performance(
        float(np.mean(known)) if known else np.nan,
        float((log["end_s"] - log["start_s"]).mean()),
        float(missed.mean()),
        float(log["moves"].mean()),
        len(log),
    )


def _throughput(trials: pd.DataFrame) -> float:
    """Of one condition, bit/s."""
    if len(trials) < 2 or trials["error_mm"].nunique() < 2:
        return np.nan
    width = SPREAD * float(trials["error_mm"].std(ddof=1))
    distance = float((trials["distance_mm"] + trials["error_mm"]).mean())
    time = float((trials["end_s"] - trials["start_s"]).mean())
    return float(difficulty(max(distance, 0.0), width)) / time


def write_log(log: pd.DataFrame, path: str | Path) -> None:
    """Write a log, whole or not at all. Raises ValueError where the file cannot be written, or a
    column is missing.
    """
    text = _checked(log, "log").to_csv(index=False, float_format="%.6f", lineterminator="\n")
    write_whole(path, text)


def read_log(path: str | Path) -> pd.DataFrame:
    """Read a log.

    Raises
    ------
    ValueError
        Names the file: unreadable, a column is missing, a number is none, a target has no width, a
        trial ends before it begins.
    """
    return _checked(read_csv(path), str(path))


def _checked(log: pd.DataFrame, where: str) -> pd.DataFrame:
    """The columns of a log, if they are there and hold what they should."""
    if missing := [name for name in COLUMNS if name not in log.columns]:
        raise ValueError(f"{where}: column '{missing[0]}' is missing")
    for name in COLUMNS:
        if name == "operator":
            continue
        if not (
            pd.api.types.is_numeric_dtype(log[name]) and np.isfinite(log[name].astype(float)).all()
        ):
            raise ValueError(f"{where}: {name}: expected finite numbers")
    for name in ("scale", "distance_mm", "width_mm"):
        if (log[name] <= 0).any():
            raise ValueError(f"{where}: {name}: expected numbers above 0, got {log[name].min():g}")
    if (log["end_s"] < log["start_s"]).any():
        raise ValueError(f"{where}: end_s: expected no time before start_s")
    return log[list(COLUMNS)]
