"""What a sweep costs beside its runs: chapter 6 with reused kernels, one and two at a time; a
papermill loop in the same run; a function; a table of 10,000 rows that is opened and drawn.

The time of the cells is what the kernel says of each. Everything else is ours: starting and
resetting kernels, messages, rows, table and figure. And what is gained by running only those cells
on which the results depend: chapter 3 over alpha and chapter 6 over the NCC threshold, in a kernel
that has had a run before.

    python tests/benchmarks/bench_sweep.py [--runs 40] [--instants 4] [--slices]
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path

import nbformat
import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))

from makenotebook import glued, make_notebook

from trinolab.files.images import unheard
from workbench.sweep.engines import kernels, processes
from workbench.sweep.figures import as_png, plot_sweep
from workbench.sweep.folder import read_sweep
from workbench.sweep.grid import axes_of
from workbench.sweep.notebook import ONE_THREAD, read_notebook
from workbench.sweep.runs import compute, find_notebook, of_function, of_notebook
from workbench.sweep.slicing import slice_notebook
from workbench.sweep.warmkernel import (
    NotebookJob,
    close_kernels,
    notebook_job,
    open_kernels,
    run_job,
)

SLICED_S = 3.0
SLICED = [
    ("03_background", "update_rate", [0.005, 0.02, 0.05, 0.1]),
    ("06_matching", "ncc_threshold", [0.4, 0.6, 0.7, 0.8]),
]
OVERHEAD_S, SCALING, PAPERMILL, FUNCTION_MS, OPEN_S = 0.2, 1.7, 3.0, 1.0, 2.0
SHORT = """
import numpy as np
from trinolab.datasets import load_rig
from trinolab.metrics import geodesic_deg
total = sum(np.linalg.svd(np.random.default_rng(seed).normal(size=(60, 60)))[1][0] for _ in range(50))
"""
broken = []


def line(
    what: str, value: float, unit: str, limit: float | None = None, at_least: bool = False
) -> None:
    """Print a result, and whether it keeps to its limit."""
    kept = limit is None or (value >= limit if at_least else value <= limit)
    said = (
        ""
        if limit is None
        else f"   limit {'at least' if at_least else 'at most'} {limit:g}: "
        f"{'kept' if kept else 'BROKEN'}"
    )
    print(f"{what:64s}{value:9.3f} {unit:8s}{said}", flush=True)
    broken.extend([] if kept else [what])


def seconds(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def cells_of(folder: Path) -> list[tuple[float, float]]:
    """For each kept notebook, in the order of time, when its first cell began and how long its
    cells took, s.
    """
    found = []
    for path in (folder / "notebooks").iterdir():
        times = [
            cell.metadata["execution"]
            for cell in nbformat.read(path, as_version=4).cells
            if cell.metadata.get("execution")
        ]
        spans = [
            [
                datetime.fromisoformat(of[f"iopub.{name}"].replace("Z", "+00:00")).timestamp()
                for name in ("execute_input", "status.idle")
            ]
            for of in times
        ]
        found.append((spans[0][0], sum(last - first for first, last in spans)))
    return sorted(found)


def swept(
    path: Path, workers: int, root: Path, **values: object
) -> tuple[float, list[tuple[float, float]]]:
    """Wall time of a sweep, s, and what `cells_of` says of it."""
    job, folder = of_notebook(path, axes_of(values), keep=True), root / f"{path.stem}-{workers}"
    wall = seconds(lambda: compute(job, kernels(workers, job.kernels), folder))
    return wall, cells_of(folder)


def beyond(wall: float, workers: int, cells: list[tuple[float, float]]) -> float:
    """A worker's time for a run beyond its cells, s: starts of kernels, table, figure, and waiting
    for the end, too.
    """
    return (workers * wall - sum(spent for _, spent in cells)) / len(cells)


def looped(path: Path, root: Path, runs: list[dict[str, object]]) -> float:
    """Wall time of a loop over papermill, s."""
    import papermill

    with unheard():  # its kernels talk
        return seconds(
            lambda: [
                papermill.execute_notebook(
                    path, root / "papermill.ipynb", run, progress_bar=False, cwd=path.parent
                )
                for run in runs
            ]
        )


def measure_notebooks(root: Path, runs: int, instants: int) -> None:
    chapter, seeds = find_notebook("06_matching"), range(runs)
    # renders the recordings, if they are not there
    swept(chapter, 1, root / "first", instants=2, seed=0)
    (one, cells_one), (two, cells_two) = (
        swept(chapter, k, root, instants=instants, seed=seeds) for k in (1, 2)
    )
    line("06_matching, one worker: wall time", one / runs, "s a run")
    line("06_matching, two workers: wall time", two / runs, "s a run")
    line(
        "06_matching, one worker: beyond the cells",
        beyond(one, 1, cells_one),
        "s a run",
        OVERHEAD_S,
    )
    line("06_matching, two workers: of each beyond the cells", beyond(two, 2, cells_two), "s a run")
    starts, spent = np.transpose(cells_one)
    line(
        "06_matching, from run to run: median beyond the cells",
        float(np.median(np.diff(starts) - spent[:-1])),
        "s",
    )
    line("06_matching, two workers by one: throughput", one / two, "times", SCALING, True)
    few = [{"instants": instants, "seed": seed} for seed in range(min(runs, 5))]
    each = looped(chapter, root, few) / len(few)
    line("06_matching, a papermill loop by two workers: time", each * runs / two, "times")
    short = make_notebook(root / "short.ipynb", SHORT, glued(total="total"))
    wall, cells = swept(short, 2, root, seed=seeds)
    line("short notebook, its cells", sum(spent for _, spent in cells) / runs, "s a run", 1.0)
    line("short notebook, two workers: of each beyond the cells", beyond(wall, 2, cells), "s a run")
    loop = looped(short, root, [{"seed": seed} for seed in range(runs)])
    line(
        "short notebook, a papermill loop by two workers: time",
        loop / wall,
        "times",
        PAPERMILL,
        True,
    )


def processor_s() -> float:
    """Processor time of all kernels so far, s."""
    return sum(sum(psutil.Process(kernel.process_id).cpu_times()[:2]) for kernel in open_kernels())


def warm_runs(job: NotebookJob, name: str, values: Sequence[float]) -> tuple[float, float]:
    """Median wall time and processor time of a run, s; the first one only warms the kernel."""
    spent = []
    for value in values:
        before = processor_s()
        wall = seconds(lambda value=value: run_job(job, {name: value}))
        spent.append((wall, processor_s() - before))
    close_kernels(job.sweep)
    wall, processor = np.median(spent[1:], axis=0)
    return float(wall), float(processor)


def measure_slices() -> None:
    for chapter, name, values in SLICED:
        path = find_notebook(chapter)
        part = slice_notebook(read_notebook(path), [name])
        wall, processor = warm_runs(notebook_job(path, None, part=part), name, values)
        whole_wall, whole_processor = warm_runs(notebook_job(path, None), name, values)
        where = f"{chapter} over {name}"
        line(f"{where}, what the results need: wall time", wall, "s a run", SLICED_S)
        line(f"{where}, what the results need: processor", processor, "s a run")
        line(f"{where}, whole: wall time", whole_wall, "s a run")
        line(f"{where}, whole: processor", whole_processor, "s a run")
        line(f"{where}, whole by what is needed: processor", whole_processor / processor, "times")


def busy(a: float, b: float) -> dict[str, float]:
    """A short run: some tenths of a millisecond."""
    values = np.sin(a * np.arange(2000.0))
    return {"mean": float(values.mean()) + b, "most": float(values.max()) * b}


def measure_function(root: Path) -> None:
    axes = axes_of({"a": np.linspace(0, 1, 100), "b": np.linspace(0, 1, 100)})
    job = of_function(busy, axes, kept=True)
    for workers in (1, 2):
        folder = root / f"function-{workers}"
        wall = seconds(
            lambda folder=folder, workers=workers: compute(job, processes(workers), folder)
        )
        own = sum(
            json.loads(row)["seconds"] for row in (folder / "runs.jsonl").read_text().splitlines()
        )
        line(
            f"function, 10,000 runs, {workers} workers: beyond the function",
            1e3 * (wall - own / workers) / 1e4,
            "ms a run",
            FUNCTION_MS,
        )
    line(
        "10,000 rows: opened and drawn",
        seconds(lambda: as_png(plot_sweep(read_sweep(folder)))),
        "s",
        OPEN_S,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--runs", type=int, default=40, help="of each notebook (%(default)s)")
    parser.add_argument("--instants", type=int, default=4, help="of chapter 6 (%(default)s)")
    parser.add_argument("--slices", action="store_true", help="only what is gained by parts")
    arguments = parser.parse_args()
    os.environ.update(ONE_THREAD)  # papermill's kernels as well
    print(
        f"{arguments.runs} runs of a notebook; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the start"
    )
    measure_slices()
    if arguments.slices:
        return int(bool(broken))
    with tempfile.TemporaryDirectory() as folder:
        measure_function(Path(folder))
        measure_notebooks(Path(folder), arguments.runs, arguments.instants)
    return int(bool(broken))


if __name__ == "__main__":
    raise SystemExit(main())
