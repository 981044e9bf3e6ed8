"""The time of a sweep: chapters 3 and 6 by their tags compared with whole, the time beside the runs
of a short notebook compared with a papermill loop in the same run, a function, and a table of
10,000 rows that is opened and drawn.

    python tests/benchmarks/bench_sweep.py [--runs 10] [--tags]
"""

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "helpers"))

from makenotebook import glued, make_notebook
from nbformat.v4 import new_code_cell

from trinolab.files.images import unheard
from workbench.sweep.cells import code_cells
from workbench.sweep.engines import kernels, processes
from workbench.sweep.figures import as_png, plot_sweep
from workbench.sweep.folder import read_sweep
from workbench.sweep.grid import axes_of
from workbench.sweep.jobs import close_kernels, run_tagged, run_whole
from workbench.sweep.notebook import ONE_THREAD, as_notebook, read_notebook
from workbench.sweep.runs import compute, of_function, of_notebook

# chapter, parameter, values, the largest share of the whole run's processor time
TAGGED = [
    ("03_background", "update_rate", [0.005, 0.02, 0.05], 0.2),
    ("06_matching", "ncc_threshold", [0.4, 0.6, 0.8], 0.35),
]
FUNCTION_MS, OPEN_S = 1.0, 2.0
SHORT = """
import numpy as np
from trinolab.datasets import load_rig
from trinolab.metrics import geodesic_deg
total = sum(np.linalg.svd(np.random.default_rng(seed).normal(size=(60, 60)))[1][0] for _ in range(50))
"""
broken = []


def line(what: str, value: float, unit: str, limit: float | None = None) -> None:
    """Print a result, and whether it keeps to its limit."""
    kept = limit is None or value <= limit
    said = "" if limit is None else f"   limit {limit:g}: {'kept' if kept else 'BROKEN'}"
    print(f"{what:64s}{value:9.3f} {unit:8s}{said}", flush=True)
    broken.extend([] if kept else [what])


def seconds(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def processor_s() -> float:
    """Processor time of the kernels that have ended, s."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


TIMED = "import time\nfrom myst_nb import glue\nglue('processor_s', time.process_time())"


def measure_tags() -> None:
    """Processor time of whole runs, and of forks by tags, which glue their own."""
    for chapter, name, values, limit in TAGGED:
        job = of_notebook(chapter, axes_of({name: values})).notebook
        assert job is not None
        assert job.plan is not None
        notebook = as_notebook(job.text)
        notebook.cells.append(new_code_cell(TIMED))
        last = len(code_cells(notebook))
        plan = job.plan._replace(each=(*job.plan.each, last))
        timed = job._replace(text=json.dumps(notebook), plan=plan)
        tagged = [run_tagged(timed, {name: value}).results["processor_s"] for value in values]
        before = processor_s()
        for value in values:
            run_whole(job, {name: value})
        whole = (processor_s() - before) / len(values)
        close_kernels(job.sweep)
        line(f"{chapter} over {name}, whole: processor", whole, "s a run")
        line(f"{chapter} over {name}, by its tags: processor", float(np.median(tagged)), "s a run")
        share = float(np.median(tagged)) / whole
        line(f"{chapter} over {name}, by its tags divided by whole", share, "", limit)


def measure_short(root: Path, runs: int) -> None:
    """A short notebook, whole and by a tag, and a papermill loop over it."""
    import papermill

    whole = make_notebook(root / "whole.ipynb", SHORT, glued(total="total"))
    tagged = make_notebook(root / "tagged.ipynb", SHORT.partition("total")[0], glued(total="total"))
    content = read_notebook(tagged)
    content.cells[1].metadata["tags"] = ["once"]
    content.cells[2].source = f"total{SHORT.partition('total')[2]}{content.cells[2].source}"
    tagged.write_text(json.dumps(content))
    settings: list[Mapping[str, Any]] = [{"seed": seed} for seed in range(runs)]
    with unheard():  # its kernels talk
        loop = seconds(
            lambda: [
                papermill.execute_notebook(
                    whole, root / "papermill.ipynb", setting, progress_bar=False, cwd=root
                )
                for setting in settings
            ]
        )
    line("short notebook, a papermill loop", loop / runs, "s a run")
    for path in (whole, tagged):
        job = of_notebook(path, axes_of({"seed": range(runs)}))
        wall = seconds(
            lambda job=job, path=path: compute(job, kernels(2, job.kernels), root / path.stem)
        )
        line(f"short notebook, {path.stem}, two workers", wall / runs, "s a run")


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
        beyond = 1e3 * (wall - own / workers) / 1e4
        what = f"function, 10,000 runs, {workers} workers: beyond the function"
        line(what, beyond, "ms a run", FUNCTION_MS)
    opened = seconds(lambda: as_png(plot_sweep(read_sweep(folder))))
    line("10,000 rows: opened and drawn", opened, "s", OPEN_S)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--runs", type=int, default=10, help="of a short notebook (%(default)s)")
    parser.add_argument("--tags", action="store_true", help="only what is gained by tags")
    arguments = parser.parse_args()
    os.environ.update(ONE_THREAD)  # papermill's kernels as well
    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} cores, load {load:.1f} at the start")
    measure_tags()
    if not arguments.tags:
        with tempfile.TemporaryDirectory() as folder:
            measure_function(Path(folder))
            measure_short(Path(folder), arguments.runs)
    return int(bool(broken))


if __name__ == "__main__":
    raise SystemExit(main())
