"""Parameter sweeps: a notebook or a function at many settings of its parameters, and a tidy table of what it gave."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pandas as pd

from .checks import as_whole
from .engines import BATCH_S, Engine, check_portable, kernels, processes
from .grids import axes_of
from .sweepfolder import read_sweep
from .sweeping import compute, of_function, of_notebook

__all__ = ["read_sweep", "sweep"]
AHEAD = 64  # runs that an executor which nobody knows is given before one of them is finished


def sweep(what: str | Path | Callable[..., Any], grid: Mapping[str, Any] | None = None, *,
          out: str | Path | None = None, sample: int | None = None, sample_seed: int = 0, workers: int = 1,
          executor: Executor | None = None, fresh_kernels: bool = False, progress: bool | None = None,
          yes: bool = False, **values: Any) -> pd.DataFrame:
    """Run a notebook or a function at every setting of a grid, and return a row for each run.

    Parameters
    ----------
    what : str, path or callable
        A notebook: a file, or the name of a chapter like ``"06_matching"``; its results are what it glues. Or a
        function, which gives a number, or several with names: a mapping, a dataclass, a named tuple.
    grid : mapping, optional
        Name -> values, for parameters whose names are those of options here.
    out : path, optional
        A folder in which every run is kept as soon as it is finished, with a table and a figure at the end. The same
        call goes on where it was stopped; what is finished is not run again, unless code or data have changed.
    sample : int, optional
        So many runs instead of all: a Latin hypercube of the values. Then a parameter may be a `grids.Interval`.
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
        Before anything runs: an empty grid, too many runs, a parameter that is not there or of another type, a folder
        of another sweep.
    KeyboardInterrupt
        Says how many runs are kept.
    """
    axes, workers = axes_of({**(grid or {}), **values}), as_whole(workers, "workers", low=1)
    if callable(what):
        if workers > 1 and executor is None:
            check_portable(what)
        job = of_function(what, axes, sample, sample_seed, yes, out is not None)
    else:
        job = of_notebook(what, axes, sample, sample_seed, yes, fresh=fresh_kernels)
    several = min(workers, len(job.settings))
    local = processes(several) if callable(what) else kernels(several, job.kernels)
    engine = local if executor is None else nullcontext(Engine(executor, AHEAD, BATCH_S))
    return compute(job, engine, out, {"workers": workers}, progress)
