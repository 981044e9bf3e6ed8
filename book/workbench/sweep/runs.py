"""Parameter sweeps: a notebook or a function at many settings of its parameters, and a tidy table
of what it gave.

The runs are computed one after the other or several at a time, and kept as they come; then table
and figure are made.
"""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import AbstractContextManager, nullcontext, suppress
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
from .engines import BATCH_S, Engine, as_finished, check_portable, kernels, processes
from .folder import Identity, SweepFolder
from .grid import Axis, Between, axes_of, runs
from .notebook import assignments, read_notebook, read_parameters
from .outcome import FAILED, LAST_COLUMNS, Outcome, as_plain_number, call, each, failed, table
from .slicing import explained, slice_notebook
from .warmkernel import check_kernel, notebook_job, run_job

__all__ = [
    "Sweep",
    "compute",
    "figure",
    "find_notebook",
    "of_function",
    "of_notebook",
    "received",
    "shown",
    "sweep",
]

NOTEBOOKS = Path(__file__).resolve().parents[3] / "notebooks"  # of a checkout
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
        From parameters to values, one a run.
    made_from : mapping
        A hash for each thing that a result depends on; empty if nothing is kept.
    grid : mapping
        How the settings were chosen, for the manifest.
    kernels : str
        By this name `warmkernel` knows the kernels of a notebook's sweep.
    cells : str
        Which cells of a notebook run, and why; empty if it is run whole.
    """

    name: str
    run: Callable[[Mapping[str, Any]], Outcome]
    names: list[str]
    settings: Sequence[Mapping[str, Any]]
    made_from: Mapping[str, str]
    grid: Mapping[str, Any]
    kernels: str = ""
    cells: str = ""


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
    fresh: bool = False,
    keep: bool = False,
    whole: bool = False,
) -> Sweep:
    """The sweep of a notebook; ValueError for a parameter that it lacks or of another type, a
    result that is a text. Notebooks that are kept are run whole.
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
    for name in names:
        for value in {repr(setting[name]): setting[name] for setting in settings}.values():
            assignments(defaults, {name: value}, path)
    check_kernel(path)
    _check_results(notebook := read_notebook(path), path)
    part = None if whole or keep else slice_notebook(notebook, names)
    job = notebook_job(path, timeout_s, fresh, keep, part)
    made_from = made_from_notebook(notebook, path.resolve().parent)
    if whole:
        made_from["the choice of cells"] = "all"
    grid = _described(axes, sample, sample_seed)
    return Sweep(
        path.name,
        partial(run_job, job),
        names,
        settings,
        made_from,
        grid,
        job.sweep,
        "" if part is None else explained(notebook, part),
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
    with engine as where:
        if out is None:
            return table(job.names, job.settings, dict(_outcomes(job, where, {}, progress)))
        with SweepFolder(out, _identity(job), job.made_from, _about(job, about or {})) as folder:
            # meanwhile
            Thread(target=import_module, args=(f"{__package__}.figures",), daemon=True).start()
            try:
                for number, outcome in _outcomes(job, where, dict(folder.done), progress):
                    folder.add(number, outcome)
                rows = table(job.names, job.settings, folder.done)
                folder.finish(rows, figure(rows))
            except KeyboardInterrupt:
                raise KeyboardInterrupt(_kept(folder, len(job.settings))) from None
            except ValueError as error:
                raise ValueError(f"{error}; {_kept(folder, len(job.settings))}") from None
    return rows


def shown(
    found: Iterator[tuple[int, Outcome]],
    total: int,
    progress: bool | None,
    lost: int = 0,
    initial: int = 0,
) -> Iterator[tuple[int, Outcome]]:
    """The same outcomes, and a progress bar: runs done, failed, remaining time."""
    with tqdm(
        total=total, initial=initial, unit="run", disable=None if progress is None else not progress
    ) as bar:
        for number, outcome in found:
            lost += outcome.status == FAILED
            bar.set_postfix_str(f"{lost} failed", refresh=False)
            bar.update()
            yield number, outcome


def _outcomes(
    job: Sweep, engine: Engine, done: Mapping[int, Outcome], progress: bool | None
) -> Iterator[tuple[int, Outcome]]:
    """The number and the outcome of each run that is not done, in the order in which they are
    finished.
    """
    todo = (number for number in range(len(job.settings)) if number not in done)
    lost = sum(outcome.status == FAILED for outcome in done.values())
    return shown(_computed(job, engine, todo), len(job.settings), progress, lost, len(done))


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


def figure(found: pd.DataFrame) -> bytes:
    from .figures import as_png, plot_sweep  # loads matplotlib

    return as_png(plot_sweep(found))


def _about(job: Sweep, more: Mapping[str, Any]) -> dict[str, Any]:
    """What the manifest says beside what the sweep is."""
    return {
        "values": job.grid,
        **more,
        "versions": versions(),
        "commit": commit(),
        "machine": machine(),
        "begun": datetime.now(UTC).isoformat(timespec="seconds"),
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


def _check_results(notebook: Any, path: Path) -> None:
    """Refuse a notebook that glues a literal which is no number; what a computation gives is known
    when it has run.
    """
    for cell in notebook.cells:
        with suppress(SyntaxError):  # IPython's own syntax
            for node in ast.walk(ast.parse(cell.source if cell.cell_type == "code" else "")):
                match node:
                    case ast.Call(
                        func=ast.Name(id="glue") | ast.Attribute(attr="glue"),
                        args=[name, value, *_],
                    ):
                        _check_literal(value, f"{path}: {ast.unparse(name)}")


def _check_literal(value: ast.expr, where: str) -> None:
    try:
        literal = ast.literal_eval(value)
    except ValueError:  # something that is computed
        return
    if as_plain_number(literal) is None:
        raise ValueError(f"{where} is no number: {literal!r}; the results of a sweep are numbers")


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
        Start a kernel for each run of a notebook; otherwise one is used again, see `kernelstate`.
    progress : bool, optional
        Show a bar on standard error; without it, if that is a terminal.
    yes : bool
        A grid of more than `grid.MANY` runs is meant.
    whole : bool
        Run every cell of a notebook. Otherwise only the statements on which its results depend, and
        those that no swept parameter reaches once in each kernel (`slicing`): the numbers are the
        same, but figures are not drawn, and what a cell asserts is not checked.
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
        another type, a folder of another sweep.
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
        job = of_notebook(what, axes, sample, sample_seed, yes, fresh=fresh_kernels, whole=whole)
    several = min(workers, len(job.settings))
    local = processes(several) if callable(what) else kernels(several, job.kernels)
    engine = local if executor is None else nullcontext(Engine(executor, AHEAD, BATCH_S))
    return compute(job, engine, out, {"workers": workers}, progress)
