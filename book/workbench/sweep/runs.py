"""Parameter sweeps: a notebook or a function at many settings of its parameters, and a tidy table
of what it gave.

The runs are computed one after the other or several at a time, and kept as they come; then table
and figure are made.
"""

from __future__ import annotations

import inspect
import json
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import AbstractContextManager, nullcontext
from datetime import UTC, datetime
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

import pandas as pd
from tqdm import tqdm

from trinolab.checks import as_whole

from ..provenance import (
    commit,
    hash_text,
    machine,
    made_from_function,
    made_from_notebook,
    versions,
)
from .agreement import check_agreement, chosen_settings, has_agreed, keep_agreed, key_of
from .cells import explained, plan_cells, rebinding_cells
from .engines import BATCH_S, Engine, as_finished, check_portable, kernels, processes
from .folder import Identity, SweepFolder
from .grid import Axis, Between, axes_of, runs
from .jobs import NotebookJob, check_kernel, notebook_job, run_both, run_job, runs_here
from .notebook import as_notebook, assignments, read_notebook, read_parameters
from .outcome import FAILED, LAST_COLUMNS, OK, Outcome, call, each, failed, table

NOTEBOOKS = Path(__file__).resolve().parents[3] / "notebooks"  # of a checkout
log = logging.getLogger("trinolab")

AHEAD = 64  # runs submitted ahead to an executor given by the caller


class Sweep(NamedTuple):
    """What is to be done.

    Attributes
    ----------
    name : str
        Of the notebook or function.
    run : callable
        Takes a setting and gives an `Outcome`; other processes can have it.
    names : list of str
        The parameters.
    settings : list of mapping
        From parameters to values, one per run.
    made_from : mapping
        A hash for each thing that a result depends on; empty if nothing is kept.
    grid : mapping
        How the settings were chosen, for the manifest.
    notebook : NotebookJob or None
        Of a notebook's sweep.
    cells : str
        When the cells of a notebook run, and why.
    verdicts : list of str
        The results that a notebook names as its verdicts: the figure begins with them.
    warnings : list of str
        What is doubtful about the sweep, in a line each.
    """

    name: str
    run: Callable[[Mapping[str, Any]], Outcome]
    names: list[str]
    settings: Sequence[Mapping[str, Any]]
    made_from: Mapping[str, str]
    grid: Mapping[str, Any]
    notebook: NotebookJob | None = None
    cells: str = ""
    verdicts: Sequence[str] = ()
    warnings: Sequence[str] = ()

    @property
    def kernels(self) -> str:
        """The name by which `jobs` knows what works for a notebook's sweep."""
        return "" if self.notebook is None else self.notebook.sweep


def of_function(
    function: Callable[..., Any],
    axes: Sequence[Axis | Between],
    sample: int | None = None,
    sample_seed: int = 0,
    yes: bool = False,
    kept: bool = False,
) -> Sweep:
    """The sweep of a function; ValueError if it does not take these arguments."""
    names = _names(axes)
    name = getattr(function, "__qualname__", type(function).__name__)
    _check_arguments(function, names, name)
    made_from = made_from_function(function) if kept else {}
    settings = runs(axes, sample, sample_seed, yes=yes)
    return Sweep(
        name,
        partial(call, function),
        names,
        settings,
        made_from,
        _described(axes, sample, sample_seed),
    )


def of_notebook(
    what: str | Path,
    axes: Sequence[Axis | Between],
    sample: int | None = None,
    sample_seed: int = 0,
    yes: bool = False,
    timeout_s: float | None = None,
    keep: bool = False,
    whole: bool = False,
) -> Sweep:
    """The sweep of a notebook; ValueError for a parameter that it lacks or of another type, and for
    tags that cannot hold. Notebooks that are kept are run whole.
    """
    path = find_notebook(what)
    names = _names(axes)
    defaults = read_parameters(path)
    settings = runs(
        axes,
        sample,
        sample_seed,
        [name for name, value in defaults.items() if type(value) is int],
        yes,
    )
    values = {name: {repr(one[name]): one[name] for one in settings} for name in names}
    for name in names:
        for value in values[name].values():
            assignments(defaults, {name: value}, path)
    check_kernel(path)
    notebook = read_notebook(path)
    varying = [name for name in names if len(values[name]) > 1]
    plan = None
    if not (whole or keep):
        try:
            plan = plan_cells(notebook, varying)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
    warned = [
        f"{name}: code cell {cell} binds it anew, so that its setting may not reach the results"
        for name in names
        for cell in rebinding_cells(notebook, name)[:1]
    ]
    if plan is not None and not runs_here(path):
        warned.append("its kernel is not this Python, or cannot be forked: the whole notebook runs")
        plan = None
    fixed = {name: settings[0][name] for name in names if name not in varying}
    job = notebook_job(path, timeout_s, keep, plan, fixed, varying)
    made_from = made_from_notebook(notebook, path.resolve().parent)
    made_from["the choice of cells"] = "all" if plan is None else hash_text(repr(plan))
    return Sweep(
        path.name,
        partial(run_job, job),
        names,
        settings,
        made_from,
        _described(axes, sample, sample_seed),
        job,
        explained(notebook, plan),
        list(notebook.metadata.get("trinolab", {}).get("verdicts", [])),
        warned,
    )


def find_notebook(what: str | Path) -> Path:
    """The file of a notebook: the path as it is, or a chapter's name. ValueError if there is
    none.
    """
    places = [
        Path(what),
        Path(f"{what}.ipynb"),
        Path("notebooks", f"{what}.ipynb"),
        NOTEBOOKS / f"{what}.ipynb",
    ]
    for path in places:
        if path.is_file():
            return path
    chapters = ", ".join(sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb")))
    where = (
        f"the chapters are {chapters}" if chapters else "the chapters are in the repository alone"
    )
    raise ValueError(f"{what}: no such notebook; {where}")


def compute(
    job: Sweep,
    engine: AbstractContextManager[Engine],
    out: str | Path | None = None,
    about: Mapping[str, Any] | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """Do what is not done yet, and return the table of all runs; see `sweep`. `about` goes into the
    manifest.
    """
    for line in job.warnings:
        log.warning("%s", line)
    with engine as where:
        if out is None:
            compare(job, where, progress)
            return _table(job, dict(_outcomes(job, where, {}, progress)))
        with SweepFolder(out, _identity(job), job.made_from, _about(job, about or {})) as folder:
            # meanwhile
            Thread(target=import_module, args=(f"{__package__}.figures",), daemon=True).start()
            try:
                if len(folder.done) < len(job.settings):
                    compare(job, where, progress)
                for number, outcome in _outcomes(job, where, dict(folder.done), progress):
                    folder.add(number, outcome)
                rows = _table(job, folder.done)
                folder.finish(rows, figure(rows))
            except KeyboardInterrupt:
                raise KeyboardInterrupt(_kept(folder, len(job.settings))) from None
            except ValueError as error:
                raise ValueError(f"{error}; {_kept(folder, len(job.settings))}") from None
    return rows


def compare(job: Sweep, engine: Engine, progress: bool | None = None) -> None:
    """Run two settings of a tagged notebook both ways, unless that was done before; ValueError
    where they differ. See `agreement`.
    """
    notebook = job.notebook
    if notebook is None or notebook.plan is None or has_agreed(key := _agreement_key(job)):
        return
    numbers = chosen_settings(job.settings, key)
    calls = [(number, run_both, notebook, job.settings[number]) for number in numbers]
    failing = False
    with tqdm(
        total=len(numbers),
        unit="run",
        desc="compared with the whole notebook",
        disable=None if progress is None else not progress,
    ) as bar:
        for _, future in as_finished(engine, calls):
            tagged, whole = received(future, 1)
            check_agreement(notebook.plan, tagged, whole)
            failing |= FAILED in (tagged.status, whole.status)
            bar.update()
    if not failing:
        settings = [dict(job.settings[number]) for number in numbers]
        keep_agreed(key, {"notebook": notebook.name, "settings": settings, "agree": True})


def _agreement_key(job: Sweep) -> str:
    notebook = job.notebook
    assert notebook is not None
    return key_of(as_notebook(notebook.text), job.made_from, notebook.varying)


def _table(job: Sweep, outcomes: Mapping[int, Outcome]) -> pd.DataFrame:
    """The table of all runs; parameters that change nothing are said."""
    rows = table(job.names, job.settings, outcomes)
    if job.verdicts:
        rows.attrs["verdicts"] = list(job.verdicts)
    for name in unchanging(rows):
        log.warning("%s: all its settings give equal results", name)
    return rows


def unchanging(rows: pd.DataFrame) -> list[str]:
    """The parameters of a sweep's table whose settings all give equal results."""
    names = rows.attrs["parameters"]
    results = [name for name in rows if name not in (*names, *LAST_COLUMNS)]
    good = rows[rows["status"] == OK]
    if not results or len(good) < 2:
        return []
    without_effect = []
    for name in names:
        others = [other for other in names if other != name and good[other].nunique() > 1]
        groups = [good] if not others else [part for _, part in good.groupby(others)]
        several = [part for part in groups if part[name].map(repr).nunique() > 1]
        if several and all(len(part[results].drop_duplicates()) == 1 for part in several):
            without_effect.append(name)
    return without_effect


def _outcomes(
    job: Sweep, engine: Engine, done: Mapping[int, Outcome], progress: bool | None
) -> Iterator[tuple[int, Outcome]]:
    """The number and the outcome of each run that is not done, in the order in which they are
    finished, with a progress bar: runs done, failed, remaining time.
    """
    total = len(job.settings)
    todo = (number for number in range(total) if number not in done)
    count_failed = sum(outcome.status == FAILED for outcome in done.values())
    off = None if progress is None else not progress
    with tqdm(total=total, initial=len(done), unit="run", disable=off) as bar:
        for number, outcome in _computed(job, engine, todo):
            count_failed += outcome.status == FAILED
            bar.set_postfix_str(f"{count_failed} failed", refresh=False)
            bar.update()
            yield number, outcome


def _computed(job: Sweep, engine: Engine, todo: Iterator[int]) -> Iterator[tuple[int, Outcome]]:
    """The same for these runs; several go to the engine together if they are short."""
    size = 1

    def batches() -> Iterator[tuple[Any, ...]]:
        while numbers := list(islice(todo, size)):
            yield numbers, each, job.run, [job.settings[number] for number in numbers]

    for numbers, future in as_finished(engine, batches()):
        results = received(future, len(numbers))
        yield from zip(numbers, results, strict=True)
        spent = max(sum(outcome.seconds for outcome in results) / len(results), 1e-4)
        size = max(1, int(engine.batch_s / spent))


def received(future: Future[Any], count: int) -> list[Outcome]:
    """What a future holds; runs that their engine could not compute have failed."""
    try:
        return future.result()
    except BrokenExecutor:
        raise ValueError("a worker process has ended abruptly, and with it the sweep") from None
    except CancelledError:
        raise ValueError("the cluster has given up runs, and with them the sweep") from None
    except Exception as error:
        return [failed(error, 0.0)] * count


def figure(rows: pd.DataFrame) -> bytes:
    """The figure of a sweep's table as a PNG file."""
    from .figures import as_png, plot_sweep  # loads matplotlib

    return as_png(plot_sweep(rows))


def _about(job: Sweep, more: Mapping[str, Any]) -> dict[str, Any]:
    """What the manifest says beside what the sweep is."""
    return {
        "values": job.grid,
        "verdicts": list(job.verdicts),
        **({} if job.notebook is None else {"cells": _cells_of_runs(job)}),
        **more,
        "versions": versions(),
        "commit": commit(),
        "machine": machine(),
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _cells_of_runs(job: Sweep) -> dict[str, Any]:
    """Which code cells each run executes, by their numbers from 1."""
    notebook = job.notebook
    assert notebook is not None
    if notebook.plan is None:
        return {"each run": "all, in a fresh kernel"}
    compared = chosen_settings(job.settings, _agreement_key(job))
    return {
        "once for all runs": list(notebook.plan.once),
        "each run": list(notebook.plan.each),
        "no run": list(notebook.plan.left_out),
        "runs compared with the whole notebook": compared,
    }


def _kept(folder: SweepFolder, total: int) -> str:
    return f"{folder.kept()} of {total} runs are kept in {folder.path}; the same command goes on"


def _identity(job: Sweep) -> Identity:
    settings = json.dumps([list(setting.items()) for setting in job.settings], default=repr)
    return Identity(job.name, list(job.names), hash_text(settings), len(job.settings))


def _described(
    axes: Sequence[Axis | Between], sample: int | None, sample_seed: int
) -> dict[str, Any]:
    """A grid for people to read."""
    values: dict[str, Any] = {}
    for axis in axes:
        if isinstance(axis, Between):
            values[axis.names[0]] = axis.interval._asdict()
        else:
            values |= {
                name: [setting[k] for setting in axis.settings] for k, name in enumerate(axis.names)
            }
    return values if sample is None else {**values, "sample": sample, "sample_seed": sample_seed}


def _names(axes: Sequence[Axis | Between]) -> list[str]:
    """The parameters; refuse those that are named like the columns which each table has."""
    names = [name for axis in axes for name in axis.names]
    if taken := [name for name in names if name in LAST_COLUMNS]:
        raise ValueError(f"{taken[0]}: cannot be swept, the table has a column of this name")
    return names


def _check_arguments(function: Callable[..., Any], names: Sequence[str], name: str) -> None:
    """Refuse a function that does not take these arguments."""
    try:
        signature = inspect.signature(function)
    except ValueError:  # one that tells nothing of its arguments
        return
    try:
        signature.bind(**dict.fromkeys(names))
    except TypeError as error:
        raise ValueError(
            f"{name}: {error}; it takes {', '.join(signature.parameters) or 'nothing'}"
        ) from None


def sweep(
    what: str | Path | Callable[..., Any],
    grid: Mapping[str, Any] | None = None,
    *,
    out: str | Path | None = None,
    sample: int | None = None,
    sample_seed: int = 0,
    workers: int = 1,
    executor: Executor | None = None,
    fresh_kernels: bool = False,
    progress: bool | None = None,
    yes: bool = False,
    whole: bool = False,
    **values: Any,
) -> pd.DataFrame:
    """Run a notebook or a function at every setting of a grid, and return a row for each run.

    Parameters
    ----------
    what : str, path or callable
        A notebook: a file, or the name of a chapter like ``"06_matching"``; its results are what it
        glues. Or a function, which gives a number, or several with names: a mapping, a dataclass, a
        named tuple.
    grid : mapping, optional
        Name -> values, for parameters whose names are those of options here.
    out : path, optional
        A folder in which every run is kept as soon as it is finished, with a table and a figure at
        the end. The same call goes on where it was stopped; what is finished is not run again,
        unless code or data have changed.
    sample : int, optional
        So many runs instead of all: a Latin hypercube of the values. Then a parameter may be a
        `grid.Interval`.
    sample_seed : int
        Of that draw.
    workers : int
        Processes at a time. One function runs in this process.
    executor : concurrent.futures.Executor, optional
        Computes the runs in place of processes of this computer; that of a Dask cluster is
        ``Client(address).get_executor(pure=False)``.
    fresh_kernels : bool
        The same as `whole`.
    progress : bool, optional
        Show a bar on standard error; without it, if that is a terminal.
    yes : bool
        A grid of more than `grid.MANY` runs is meant.
    whole : bool
        Run all cells of a notebook at each setting, in a fresh kernel. Otherwise its cells run by
        their tags (`cells`), and two settings are compared with the whole notebook (`agreement`);
        a notebook without tags runs whole.
    **values
        Name -> an iterable of values, or one value. Every parameter with every other; the last one
        changes fastest.

    Returns
    -------
    pandas.DataFrame
        Parameters, results, seconds, status, error; see `outcome.table`. A run that raises is a
        row, too.

    Raises
    ------
    ValueError
        Before anything runs: an empty grid, too many runs, a parameter that is not there or of
        another type, a folder of another sweep, tags that cannot hold. After the comparison: a
        glued number that differs from that of the whole notebook.
    KeyboardInterrupt
        Says how many runs are kept.
    """
    axes = axes_of({**(grid or {}), **values})
    workers = as_whole(workers, "workers", low=1)
    if callable(what):
        if workers > 1 and executor is None:
            check_portable(what)
        job = of_function(what, axes, sample, sample_seed, yes, out is not None)
    else:
        job = of_notebook(what, axes, sample, sample_seed, yes, whole=whole or fresh_kernels)
    several = min(workers, len(job.settings))
    local = processes(several) if callable(what) else kernels(several, job.kernels)
    engine = local if executor is None else nullcontext(Engine(executor, AHEAD, BATCH_S))
    return compute(job, engine, out, {"workers": workers}, progress)
