"""Seconds from opening a chapter's page to its first results in Chromium: ``python
tests/benchmarks/bench_browser.py``, after ``make browser``.

Wall time depends on what else the machine does, so the time of the processor that Chromium took
stands beside it, and the load. A first opening loads the runtime from the host, a second one finds it
in the browser.
"""

import os
import tempfile
import time
from pathlib import Path

import numpy as np

from workbench.browser.numbers import serving, wait_until_idle
from workbench.browser.site import SITE
from workbench.pages.browser import Browser

PAGE = "notebooks/04_kalman.html"
CELLS = {"a sum by hand (cell 4)": 3, "imports and a figure (cell 1)": 0}
TIMES = 3


def processor_s(pid: int) -> float:
    """What a process and all that it has started took of the processor."""
    ticks = os.sysconf("SC_CLK_TCK")
    parents, used = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            numbers = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        parents[int(folder.name)] = int(numbers[1])
        used[int(folder.name)] = (int(numbers[11]) + int(numbers[12])) / ticks
    family = {pid}
    while more := {one for one, parent in parents.items() if parent in family} - family:
        family |= more
    return sum(used[one] for one in family if one in used)


def opened(browser: Browser, address: str) -> list[tuple[float, float]]:
    """Wall and processor time from the opening of the page to the result of each of `CELLS`."""
    start, before = time.monotonic(), processor_s(browser._process.pid)
    times = []
    browser.open(f"{address}/{PAGE}")
    for number in CELLS.values():
        browser.evaluate(f"void book.run([book.cells[{number}]])")
        wait_until_idle(browser)
        times.append((time.monotonic() - start, processor_s(browser._process.pid) - before))
    return times


def main() -> None:
    results: dict[str, list] = {"first": [], "again": []}
    with serving(SITE) as address:
        for _ in range(TIMES):
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                browser = Browser(Path(folder))
                try:
                    for which in results.values():
                        which.append(opened(browser, address))
                finally:
                    browser.close()
    print(f"n = {TIMES}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"{'s from opening, median':42}{'wall':>8}{'processor':>11}")
    for opening, of_all in results.items():
        for k, cell in enumerate(CELLS):
            wall, processor = np.median([of_one[k] for of_one in of_all], axis=0)
            print(f"{opening + ': ' + cell:42}{wall:8.1f}{processor:11.1f}")


if __name__ == "__main__":
    main()
