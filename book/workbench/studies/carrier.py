"""What makes a shipped table: a trial over a grid, in processes that share the work, with runs that are
kept, draws, and means with their intervals.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd

from trinolab.checks import Array
from trinolab.files.outputs import check_targets, write_table
from trinolab.files.shipped import data_path

from ..intervals import Interval, of_mean
from ..sweep import sweep
from ..sweep.outcome import LAST_COLUMNS, OK

Row = Mapping[str, Any]
COUNT = ":rows"  # of a run


@dataclass(frozen=True)
class Table:
    """A shipped table: a trial over a grid, and what is made of its rows.

    Attributes
    ----------
    name : str
        Of the file, without ``.csv``.
    trial : callable or str
        Gives a row, or several, at one setting of the grid. A notebook's name: its glued results.
    grids : sequence of mapping
        Each maps the trial's parameters to their values; the last one changes fastest.
    by : tuple of str
        The columns that identify a row. A setting that is not among them is not in the table.
    columns : tuple of str
        What the table has of all columns; everything without it.
    draws : int
        Runs of each setting, which are given their number as `draw`; 0 for a trial that draws
        nothing.
    summary : callable, optional
        From the rows of all draws that agree in `by` to the other columns; without it each row of a
        trial is one of the table's.
    again : mapping
        The setting that a test makes again, with all its draws.
    """

    name: str
    trial: Callable[..., Row | Sequence[Row]] | str
    grids: Sequence[Mapping[str, Sequence]]
    by: tuple[str, ...]
    columns: tuple[str, ...] = ()
    draws: int = 0
    summary: Callable[[pd.DataFrame], Row] | None = None
    again: Mapping[str, Any] = field(default_factory=dict)

    def make(
        self, draws: int | None = None, workers: int = 1, kept: Path | None = None
    ) -> pd.DataFrame:
        """Compute the table.

        Parameters
        ----------
        draws : int, optional
            In place of the table's own number.
        workers : int
            Processes.
        kept : path, optional
            Folder that keeps finished runs, see `sweep.runs.sweep`.

        Raises
        ------
        ValueError
            If a run fails.
        """
        numbers = range(draws or self.draws)
        trial = self.trial if isinstance(self.trial, str) else _Rows(self.trial)
        rows: list[Row] = []
        for k, grid in enumerate(self.grids):
            folder = kept and kept / self.name / str(k)
            drawn = {"draw": grid.get("draw", numbers)} if self.draws else {}
            runs = all_runs(self.name, trial, {**grid, **drawn}, folder, workers, yes=True)
            found = runs.drop(columns=list(LAST_COLUMNS)).to_dict("records")
            rows += [row for run in found for row in _rows_of(run, self.by)]
        table = pd.DataFrame(rows)
        if self.summary is not None:
            groups = table.groupby(list(self.by), sort=False)
            table = pd.DataFrame(
                [
                    {**dict(zip(self.by, values, strict=True)), **self.summary(part)}
                    for values, part in groups
                ]
            )
        return table[list(self.columns)] if self.columns else table

    def make_again(self) -> pd.DataFrame:
        """The rows of the one setting that a test makes again."""
        grids = [
            {
                name: [value for value in values if self.again.get(name, value) == value]
                for name, values in grid.items()
            }
            for grid in self.grids
        ]
        return replace(self, grids=[grid for grid in grids if all(grid.values())]).make()


class _Rows:
    """A trial whose rows stand side by side, as a sweep keeps them."""

    def __init__(self, trial: Callable[..., Row | Sequence[Row]]) -> None:
        self.__wrapped__ = trial
        self.__qualname__ = getattr(trial, "__qualname__", type(trial).__name__)

    def __call__(self, **setting: Any) -> Row:
        found = self.__wrapped__(**setting)
        rows = [found] if isinstance(found, Mapping) else found
        flat = {f"{k}:{name}": value for k, row in enumerate(rows) for name, value in row.items()}
        return {COUNT: len(rows), **flat}


def _rows_of(run: dict[str, Any], by: Sequence[str]) -> list[dict[str, Any]]:
    """The rows of one run of a sweep's table, each with those of its settings that are in `by`."""
    if COUNT not in run:
        return [run]
    setting = {name: run[name] for name in run if name in by}
    rows = [dict(setting) for _ in range(int(run[COUNT]))]
    for name in run:
        number, _, column = name.partition(":")
        if number.isdecimal() and int(number) < len(rows):
            rows[int(number)][column] = run[name]
    return rows


def make_tables(
    tables: Sequence[Table],
    out: Path,
    kept: Path,
    names: Sequence[str] = (),
    draws: int | None = None,
    workers: int = 1,
) -> None:
    """Write some tables, or all without `names`: at the end, since data that change make finished
    runs stale. What was kept of them is deleted then.

    Raises
    ------
    ValueError
        For an unknown name, or a file that cannot be written; if a run fails.
    """
    by_name = {table.name: table for table in tables}
    if unknown := [name for name in names if name not in by_name]:
        raise ValueError(f"name: expected one of {', '.join(by_name)}, got {unknown[0]!r}")
    chosen = list(dict.fromkeys(names)) or list(by_name)
    paths = [out / f"{name}.csv" for name in chosen]
    check_targets(paths)
    made = []
    for name in chosen:
        print(name, file=sys.stderr)
        made.append(by_name[name].make(draws, workers, kept))
    for name, path, table in zip(chosen, paths, made, strict=True):
        write_table(table, path)
        shutil.rmtree(kept / name)


def script(name: str) -> ModuleType:
    """A module of ``data/tables``, which a checkout has and an installed package has not.

    Raises
    ------
    ValueError
        If it is not there.
    """
    folder = data_path() / "tables"
    if not (folder / f"{name}.py").is_file():
        raise ValueError(
            f"{name}: its script is in data/tables of the repository, not in an installed package"
        )
    if str(folder) not in sys.path:  # worker processes find it there, too
        sys.path.append(str(folder))
    return import_module(name)


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


def means(
    rows: pd.DataFrame, names: Sequence[str], interval: Callable[[Array], Interval] = of_mean
) -> dict[str, float]:
    """`columns_of_mean` of some columns, of the rows that have a value."""
    found: dict[str, float] = {}
    for name in names:
        values = rows[name].dropna().to_numpy()
        found |= columns_of_mean(name, values, interval(values))
    return found


def columns_of_mean(name: str, values: Sequence[float], interval: Interval) -> dict[str, float]:
    """The mean of values, NaN of none, with the ends of its interval as ``..._low``, ``..._high``."""
    mean = float(np.mean(values)) if len(values) else np.nan
    return {name: mean, f"{name}_low": interval.low, f"{name}_high": interval.high}
