"""Seconds from opening a chapter's page to its first results in Chromium: ``python
tests/benchmarks/bench_browser.py``, after ``make browser``.

Wall time depends on what else the machine does, so the time of the processor that Chromium took
stands beside it. A first opening loads the runtime from the host, a second one finds it in the browser.
"""

import tempfile
import time
from pathlib import Path

import clock
import psutil

from workbench.browser.numbers import serving, wait_until_idle
from workbench.browser.site import SITE
from workbench.pages.browser import Browser

PAGE = "notebooks/04_kalman.html"
CELLS = {"a sum by hand (cell 4)": 3, "imports and a figure (cell 1)": 0}
TIMES = 3


def processor_s():
    """What the processes of the browser took of the processor."""
    started = psutil.Process().children(recursive=True)
    return sum(sum(one.cpu_times()[:2]) for one in started)


def opened(browser, address):
    """Wall and processor time from the opening of the page to the result of each of `CELLS`."""
    start, before = time.monotonic(), processor_s()
    browser.open(f"{address}/{PAGE}")
    for number in CELLS.values():
        browser.evaluate(f"void book.run([book.cells[{number}]])")
        wait_until_idle(browser)
        yield time.monotonic() - start, processor_s() - before


def main() -> int:
    found = {(opening, cell): [] for opening in ("first", "again") for cell in CELLS}
    with serving(SITE) as address:
        for _ in range(TIMES):
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                browser = Browser(Path(folder))
                try:
                    times = [*opened(browser, address), *opened(browser, address)]
                finally:
                    browser.close()
            for of_one, both in zip(found.values(), times, strict=True):
                of_one.append(both)
    for (opening, cell), both in found.items():
        wall, processor = zip(*both, strict=True)
        clock.line(f"{opening}: {cell}, wall", wall, "s")
        clock.line(f"{opening}: {cell}, processor", processor, "s")
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
