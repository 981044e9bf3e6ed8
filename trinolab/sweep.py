"""Parameter sweeps: the same function at many settings of its arguments, and a tidy table of what it gave."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future
from typing import Any

import pandas as pd
from tqdm import tqdm

from .checks import as_whole
from .engines import Engine, as_finished, check_portable, processes
from .grids import axes_of, runs
from .outcome import FAILED, LAST_COLUMNS, Outcome, call, failed, table

Settings = Sequence[Mapping[str, Any]]


def sweep(what: Callable[..., Any], grid: Mapping[str, Any] | None = None, *, sample: int | None = None,
          sample_seed: int = 0, workers: int = 1, progress: bool | None = None, yes: bool = False,
          **values: Any) -> pd.DataFrame:
    """Run a function at every setting of a grid, and return a row for each run.

    Parameters
    ----------
    what : callable
        Gives a number, or several with names: a mapping, a dataclass, a named tuple.
    grid : mapping, optional
        Name -> values, for parameters whose names are those of options here.
    sample : int, optional
        So many runs instead of all: a Latin hypercube of the values. Then a parameter may be a `grids.Interval`.
    sample_seed : int
        Of that draw.
    workers : int
        Processes at a time; with 1 everything runs in this one.
    progress : bool, optional
        Show a bar on standard error; without it, if that is a terminal.
    yes : bool
        A grid of more than `grids.MANY` runs is meant.
    **values
        Name -> an iterable of values, or one value. Every parameter with every other; the last one changes fastest.

    Returns
    -------
    pandas.DataFrame
        Parameters, results, seconds, status, error; see `outcome.table`. A run that raises is a row, too.

    Raises
    ------
    ValueError
        For an empty grid, too many runs, a parameter that the function does not have; before anything runs.
    """
    axes = axes_of({**(grid or {}), **values})
    names = [name for axis in axes for name in axis.names]
    _check_names(names)
    _check_function(what, names, as_whole(workers, "workers", low=1))
    settings = runs(axes, sample, sample_seed, yes=yes)
    with processes(min(workers, len(settings))) as engine:
        calls = ((k, call, what, arguments) for k, arguments in enumerate(settings))
        return table(names, settings, dict(shown(outcomes(engine, calls), len(settings), progress)))


def outcomes(engine: Engine, calls: Iterator[tuple[Any, ...]]) -> Iterator[tuple[int, Outcome]]:
    """The number and the outcome of each run, in the order in which they are finished."""
    for number, future in as_finished(engine, calls):
        yield number, _outcome(future)


def shown(found: Iterator[tuple[int, Outcome]], total: int, progress: bool | None, initial: int = 0
          ) -> Iterator[tuple[int, Outcome]]:
    """The same outcomes, and a progress bar: runs done, failed, remaining time."""
    lost = 0
    with tqdm(total=total, initial=initial, unit="run", disable=None if progress is None else not progress) as bar:
        for number, outcome in found:
            lost += outcome.status == FAILED
            bar.set_postfix_str(f"{lost} failed", refresh=False)
            bar.update()
            yield number, outcome


def _outcome(future: Future[Any]) -> Outcome:
    """What a future holds; a run that its engine could not compute has failed."""
    try:
        return future.result()
    except BrokenExecutor:
        raise ValueError("a worker process has ended abruptly, and with it the sweep") from None
    except Exception as error:
        return failed(error, float("nan"))


def _check_names(names: Sequence[str]) -> None:
    """Refuse parameters that are named like the columns which each table has."""
    if taken := [name for name in names if name in LAST_COLUMNS]:
        raise ValueError(f"{taken[0]}: cannot be swept, the table has a column of this name")


def _check_function(function: Callable[..., Any], names: Sequence[str], workers: int) -> None:
    """Refuse what is no function, does not take these arguments, or cannot go to other processes."""
    if not callable(function):
        raise ValueError(f"what: expected a function, got {function!r}")
    try:
        inspect.signature(function).bind(**dict.fromkeys(names))
    except TypeError as error:
        raise ValueError(f"{getattr(function, '__qualname__', function)}: {error}; it takes "
                         f"{', '.join(inspect.signature(function).parameters) or 'nothing'}") from None
    except ValueError:  # a function that tells nothing of its arguments
        pass
    if workers > 1:
        check_portable(function)
