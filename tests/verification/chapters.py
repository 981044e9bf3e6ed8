"""Every chapter in full size at both ends of its parameters' ranges; the tests do the same in a small
size, and look at the chapters as they stand.
"""

import time

from chapterruns import check_results, false_sentences, settings
from chapters import NOTEBOOKS

from workbench.sweep.notebook import read_parameters, run_notebook


def report(arguments) -> bool:
    """Whether no sentence contradicts its numbers."""
    print("chapters: run at both ends of their parameters' ranges in full size")
    wrong = 0
    for path in NOTEBOOKS:
        name = path.stem
        for parameters in settings(path).values():
            begin = time.perf_counter()
            run = run_notebook(path, parameters)
            check_results(name, run.results)
            false = false_sentences(
                name, run.notebook, read_parameters(path) | parameters, run.results
            )
            print(f"{name:20s}{time.perf_counter() - begin:6.0f} s  {parameters}", flush=True)
            print("".join(f"  {one}\n" for one in false), end="", flush=True)
            wrong += len(false)
    return not wrong
