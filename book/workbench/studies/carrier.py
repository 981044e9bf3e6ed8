"""What the studies that make tables have in common: runs over a grid, draws that are kept, and how a
mean stands in a row.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from trinolab.files.journal import Journal

from ..intervals import Interval
from ..sweep import sweep
from ..sweep.outcome import OK


def all_runs(
    what: str,
    trial: Callable[..., Mapping[str, Any]] | str,
    grid: Mapping[str, Sequence],
    kept: Path | None,
    workers: int,
    yes: bool = False,
) -> pd.DataFrame:
    """A row for each cell of a grid, of a trial that succeeds in every one; see `sweep.runs.sweep`.

    Raises
    ------
    ValueError
        Names `what` fails, in how many cells, and how the first one does.
    """
    runs = sweep(trial, grid, out=kept, workers=workers, yes=yes)
    failed = runs[runs["status"] != OK]
    if len(failed):
        raise ValueError(
            f"{what}: {len(failed)} of {len(runs)} runs failed; the first: {failed['error'].iloc[0]}"
        )
    return runs


def kept_draws(
    path: Path, about: Mapping[str, Any], count: int, draw: Callable[[int], Any], title: str
) -> list[Any]:
    """The first `count` draws, those in the file taken up and the others added to it, a line each.

    Parameters
    ----------
    path : Path
        Another process that has it is a ValueError.
    about : mapping
        Decides what is drawn; a file of something else begins anew.
    count : int
    draw : callable
        From the number of a draw to what JSON can hold, a mapping.
    title : str
        Of the progress bar.
    """
    with Journal(path, f"{json.dumps(about)}\n", _is_mapping) as lines:
        begin = len(lines.lines()[:count])
        for k in tqdm(range(begin, count), title, count, initial=begin, unit="draw", disable=None):
            lines.add_line(json.dumps(draw(k)))
        return [json.loads(line) for line in lines.lines()[:count]]


def columns_of_mean(name: str, values: Sequence[float], interval: Interval) -> dict[str, float]:
    """The mean of values, NaN of none, with the ends of its interval as ``..._low``, ``..._high``."""
    mean = float(np.mean(values)) if len(values) else np.nan
    return {name: mean, f"{name}_low": interval.low, f"{name}_high": interval.high}


def _is_mapping(_: int, line: str) -> bool:
    try:
        return isinstance(json.loads(line), dict)
    except ValueError:
        return False
