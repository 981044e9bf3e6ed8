"""A run's time, predicted in its first line and measured in its last one, and its progress by area."""

import os
import resource
import time
from collections import Counter

# Processor time of each area's tests, in units of `unit_s`; the last line of a run measures it.
COSTS = {
    "tests/trinolab": 830,
    "tests/workbench": 1220,
    "tests/repository": 500,
    "tests/tables": 55,
    "book/satellites/accept": 175,
    "book/satellites/bags": 85,
    "book/satellites/classkit": 110,
    "book/satellites/live": 310,
    "book/satellites/second": 40,
}


def unit_s():
    """Processor time of ten singular value decompositions of a matrix (300, 300), s."""
    import numpy as np

    matrix = np.random.default_rng(0).standard_normal((300, 300))
    times = []
    for _ in range(5):
        begin = time.process_time()
        np.linalg.svd(matrix)
        times.append(time.process_time() - begin)
    return 10 * min(times)


def area_of(name):
    """The area of a test's file, or of a folder within one."""
    return next((area for area in COSTS if name.startswith(area)), "other tests")


def expected(paths):
    """Units that the tests of files and folders are likely to take; 0 for a part of an area."""
    if not all(any(area.startswith(path.rstrip("/")) for area in COSTS) for path in paths):
        return 0
    return sum(cost for area, cost in COSTS.items() if any(area.startswith(p) for p in paths))


class Progress:
    """Hooks of the process that leads a run."""

    def __init__(self, config):
        self.config = config
        self.unit_s = unit_s()
        self.left = Counter()  # tests that have not ended, by area
        self.outcomes = {}
        units = expected(config.args)
        if units:
            seconds = units * self.unit_s
            cores = os.cpu_count()
            print(
                f"about {seconds:.0f} s of processor, {seconds / cores:.0f} s on {cores} free cores "
                f"({units:,} units of {self.unit_s:.2f} s)"
            )

    def pytest_xdist_node_collection_finished(self, ids):
        """Count the tests of each area, once."""
        if not self.left:
            self._begin(ids)

    def pytest_collection_finish(self, session):
        """Count them, without other processes."""
        self._begin(item.nodeid for item in session.items)

    def _begin(self, names):
        self.left = Counter(map(area_of, names))
        self.count = self.left.total()
        self.tenths_left = 9

    def pytest_report_teststatus(self, report):
        """No letter for a test that passes."""
        return ("passed", "", "PASSED") if report.passed and report.when == "call" else None

    def pytest_runtest_logreport(self, report):
        """A line for an area whose last test has ended, and for each tenth of all tests."""
        area = area_of(report.nodeid)
        outcomes = self.outcomes.setdefault(area, Counter())
        if report.when == "call" or not report.passed:
            outcomes[report.outcome] += 1
        if report.when == "teardown":
            self.left[area] -= 1
            tenths = 10 * self.left.total() // self.count
            if not self.left[area]:
                counts = ", ".join(f"{count:,} {outcome}" for outcome, count in outcomes.items())
                self._write(f"{area}: {counts}")
            if tenths < self.tenths_left:
                self._write(f"{100 - 10 * tenths} % of the tests")
                self.tenths_left = tenths

    def _write(self, line):
        reporter = self.config.pluginmanager.get_plugin("terminalreporter")
        reporter.ensure_newline()
        reporter.write_line(line)

    def pytest_unconfigure(self):
        """The last lines: what was left out, and how long the run took."""
        if self.config.option.markexpr == "not heavy":
            print("heavy tests were left out; to have them: make verify")
        used = [
            sum(resource.getrusage(who)[:2])
            for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        ]
        print(f"processor time: {sum(used):.0f} s, {sum(used) / self.unit_s:,.0f} units")
