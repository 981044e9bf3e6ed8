"""The time of a sweep: chapters 3 and 6 by their tags compared with whole, the time beside the runs of a
function, and a table of 10,000 rows that is opened and drawn.

    python tests/benchmarks/bench_sweep.py
"""

import json
import resource
import tempfile
import time
from pathlib import Path

import clock
import numpy as np
from nbformat.v4 import new_code_cell

from workbench.sweep.cells import code_cells
from workbench.sweep.engines import processes
from workbench.sweep.figures import as_png, plot_sweep
from workbench.sweep.folder import read_sweep
from workbench.sweep.grid import axes_of
from workbench.sweep.jobs import close_kernels, run_tagged, run_whole
from workbench.sweep.notebook import as_notebook
from workbench.sweep.runs import compute, of_function, of_notebook

# chapter, parameter, values, the largest share of the whole run's processor time
TAGGED = [
    ("03_background", "update_rate", [0.005, 0.02, 0.05], 0.2),
    ("06_matching", "ncc_threshold", [0.4, 0.6, 0.8], 0.35),
]
FUNCTION_MS, OPEN_S = 1.0, 2.0
TIMED = "import time\nfrom myst_nb import glue\nglue('processor_s', time.process_time())"


def seconds(function, *arguments):
    start = time.perf_counter()
    function(*arguments)
    return time.perf_counter() - start


def processor_s():
    """Processor time of the kernels that have ended."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def measure_tags(chapter, name, values, limit):
    """Processor time of whole runs, and of forks by tags, which glue their own."""
    job = of_notebook(chapter, axes_of({name: values})).notebook
    notebook = as_notebook(job.text)
    notebook.cells.append(new_code_cell(TIMED))
    plan = job.plan._replace(each=(*job.plan.each, len(code_cells(notebook))))
    by_tags = job._replace(text=json.dumps(notebook), plan=plan)
    tagged = [run_tagged(by_tags, {name: value}).results["processor_s"] for value in values]
    before = processor_s()
    for value in values:
        run_whole(job, {name: value})
    whole = (processor_s() - before) / len(values)
    close_kernels(job.sweep)
    clock.line(f"{chapter} over {name}, whole", whole, "s a run")
    clock.line(f"{chapter} over {name}, by its tags", tagged, "s a run")
    clock.line(f"{chapter}, by its tags divided by whole", np.median(tagged) / whole, "", limit)


def busy(a, b):
    """A short run: some tenths of a millisecond."""
    values = np.sin(a * np.arange(2000.0))
    return {"mean": float(values.mean()) + b, "most": float(values.max()) * b}


def measure_function(root):
    axes = axes_of({"a": np.linspace(0, 1, 100), "b": np.linspace(0, 1, 100)})
    job = of_function(busy, axes, kept=True)
    for workers in (1, 2):
        folder = root / f"function-{workers}"
        wall = seconds(compute, job, processes(workers), folder)
        rows = (folder / "runs.jsonl").read_text().splitlines()
        own = sum(json.loads(row)["seconds"] for row in rows)
        what = f"function, {workers} workers: beyond the function"
        clock.line(what, 1e3 * (wall - own / workers) / len(rows), "ms a run", FUNCTION_MS)
    opened = seconds(lambda: as_png(plot_sweep(read_sweep(folder))))
    clock.line("10,000 rows: opened and drawn", opened, "s", OPEN_S)


def main() -> int:
    for chapter in TAGGED:
        measure_tags(*chapter)
    with tempfile.TemporaryDirectory() as folder:
        measure_function(Path(folder))
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
