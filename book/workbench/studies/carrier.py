"""What makes a shipped table: a trial over a grid, in processes that share the work, with runs that are
kept, draws, and means with their intervals. The parts of the data sheet and the films of
`instant_times` are runs of the same kind.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from trinolab.checks import Array
from trinolab.files.journal import Journal
from trinolab.files.outputs import check_targets, write_table
from trinolab.files.shipped import data_path

from ..intervals import Interval, of_mean
from ..provenance import hash_text, made_from_function
from ..sweep import sweep
from ..sweep.engines import as_finished, processes
from ..sweep.outcome import LAST_COLUMNS, OK

Row = Mapping[str, Any]


def results_of(
    what: str,
    function: Callable[..., Any],
    settings: Sequence[Mapping[str, Any]],
    workers: int = 1,
    kept: Path | None = None,
    made_from: Any = None,
) -> list[Any]:
    """Results of a function at several settings, in their order. A bar shows the progress on a
    terminal.

    Parameters
    ----------
    what : str
        The name of the work, for a reader.
    function : callable
        Its results are numbers, texts, and lists and mappings of them.
    settings : sequence of mapping
        Arguments by name.
    workers : int
        Processes.
    kept : path, optional
        File that keeps finished results, a line each: the same call goes on with them.
    made_from : optional
        What the results depend on beside their settings, as JSON can hold it; by default the code
        that the function imports, and the data. Results that were made from something else are
        dropped.

    Raises
    ------
    ValueError
        If a worker process ends abruptly, or the file cannot be written.
    KeyboardInterrupt
        Says how many results are kept.
    """
    keys = [_as_json(setting) for setting in settings]
    found: dict[str, Any] = {}
    with ExitStack() as opened:
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            head = hash_text(_as_json(made_from or made_from_function(function)))
            lines = opened.enter_context(
                Journal(kept, f"# {head}\n", lambda _, line: _result(line) is not None)
            )
            found = dict(filter(None, map(_result, lines.lines())))
        todo = {key: s for key, s in zip(keys, settings, strict=True) if key not in found}
        bar = opened.enter_context(tqdm(total=len(todo), unit="run", desc=what, disable=None))
        engine = opened.enter_context(processes(min(workers, max(len(todo), 1))))
        calls = ((key, partial(function, **setting)) for key, setting in todo.items())
        try:
            for key, future in as_finished(engine, calls):
                result = _as_json(future.result())
                found[key] = json.loads(result)
                if kept is not None:
                    lines.add_line(f"[{json.dumps(key)}, {result}]")
                bar.update()
        except BrokenExecutor:
            raise ValueError("a worker process has ended abruptly") from None
        except KeyboardInterrupt:
            if kept is None:
                raise
            done = sum(key in found for key in keys)
            raise KeyboardInterrupt(
                f"{done} of {len(keys)} runs are kept in {kept}; the same command goes on"
            ) from None
    return [found[key] for key in keys]


def _as_json(value: Any) -> str:
    return json.dumps(value, default=lambda number: number.item())  # NumPy's


def _result(line: str) -> tuple[str, Any] | None:
    """The setting and the result of a line; None for a damaged one."""
    try:
        key, result = json.loads(line)
    except (ValueError, TypeError):
        return None
    return str(key), result


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
            Folder that keeps finished runs.
        """
        drawn = {"draw": range(draws or self.draws)} if self.draws else {}
        folder = kept and kept / self.name
        rows: list[Row] = []
        if isinstance(self.trial, str):
            for k, grid in enumerate(self.grids):
                runs = all_runs(self.name, self.trial, grid, folder and folder / str(k), workers)
                rows += runs.drop(columns=list(LAST_COLUMNS)).to_dict("records")
        else:
            grids = [{**grid, **drawn, **grid} for grid in self.grids]
            settings = [
                dict(zip(grid, values, strict=True))
                for grid in grids
                for values in product(*grid.values())
            ]
            results = results_of(
                self.name, self.trial, settings, workers, folder and folder / "runs.jsonl"
            )
            for setting, result in zip(settings, results, strict=True):
                mine = {name: value for name, value in setting.items() if name in self.by}
                found = [result] if isinstance(result, Mapping) else result
                rows += [{**mine, **row} for row in found]
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
        For an unknown name, or a file that cannot be written.
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
) -> pd.DataFrame:
    """A row for each cell of a grid, of a trial that succeeds in every one; see `sweep.runs.sweep`.

    Raises
    ------
    ValueError
        Names `what` fails, in how many cells, and how the first one does.
    """
    runs = sweep(trial, grid, out=kept, workers=workers)
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
