"""Every chapter in full size with other parameters than its own; the tests do the same in a small
size.
"""

import time
from pathlib import Path

from chapterruns import OTHER_PARAMETERS, check_results

from workbench.sweep.notebook import run_notebook

ROOT = Path(__file__).resolve().parents[2]


def report(arguments) -> None:
    print("chapters: run with other parameters in full size")
    for name, parameters in OTHER_PARAMETERS.items():
        begin = time.perf_counter()
        check_results(name, run_notebook(ROOT / "notebooks" / f"{name}.ipynb", parameters))
        print(f"{name:20s}{time.perf_counter() - begin:6.0f} s  {parameters}", flush=True)
