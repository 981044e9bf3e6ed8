"""What the benchmarks share: one thread, processor time, which other programs do not lengthen, and lines
of medians beside what they may be at most.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import cv2
import numpy as np

cv2.setNumThreads(1)
_broken: list[str] = []


def timed(function: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """What a function returns, and its processor time, ms."""
    start = time.process_time()
    found = function(*arguments)
    return found, 1e3 * (time.process_time() - start)


@contextmanager
def clocked(module: Any, *names: str) -> Iterator[dict[str, float]]:
    """Processor time, ms, that functions of a module take in all."""
    spent, originals = dict.fromkeys(names, 0.0), {name: getattr(module, name) for name in names}

    def clock(name: str) -> Callable[..., Any]:
        @wraps(originals[name])
        def measured(*arguments: Any, **options: Any) -> Any:
            found, ms = timed(lambda: originals[name](*arguments, **options))
            spent[name] += ms
            return found

        return measured

    for name in names:
        setattr(module, name, clock(name))
    try:
        yield spent
    finally:
        for name, function in originals.items():
            setattr(module, name, function)


def line(
    what: str, values: Any, unit: str = "ms", limit: float | None = None, more: str = ""
) -> float:
    """Print the median and the largest of some values, and whether the median keeps to its limit."""
    median = float(np.median(values))
    said = "" if limit is None else f"  limit {limit:g}: {'kept' if median <= limit else 'BROKEN'}"
    if limit is not None and median > limit:
        _broken.append(what)
    print(f"{what:58}{median:10.3f}{np.max(values):10.3f} {unit}{said}  {more}", flush=True)
    return median


def exit_code() -> int:
    """Whether a limit is broken."""
    return int(bool(_broken))
