"""The tests of a sheet and their parts, which processes share."""

from __future__ import annotations

import time
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2

from trinolab.files.rigs import read_handle, read_rig
from workbench.provenance import code_hash, hash_text
from workbench.studies.carrier import results_of

from . import arm, availability, combined, latency, moving, pointer, rest, static
from .arm import Noise
from .setup import Setup

TESTS = {
    test.NAME: test
    for test in (combined, rest, static, moving, pointer, latency, availability, arm)
}
# The longest parts first, so that both processes end at the same time.
RENDERED = ("A6", "A5", "A3", "A1", "A4", "A0", "A2")


class Source(NamedTuple):
    """From what every process makes the same `Setup`."""

    rig: str
    handle: str
    poses: int
    seed: int

    @property
    def made_from(self) -> list[Any]:
        """What the parts of a sheet depend on: contents of the files, size, seed and code."""
        contents = [Path(path).read_text(encoding="utf-8") for path in (self.rig, self.handle)]
        hashes = [hash_text(text) for text in contents]
        return [*hashes, self.poses, self.seed, code_hash("satellites.accept.work")]


class Found(NamedTuple):
    """Rows of each part by its test, and the processor time of all of them, s."""

    rows: dict[str, list[Any]]
    cpu_s: float


@lru_cache(maxsize=2)
def setup_of(source: Source) -> Setup:
    """The setup of files, a size and a seed. ValueError names the file that does not serve."""
    return Setup(read_rig(source.rig), read_handle(source.handle), source.poses, source.seed)


def measured(source: Source, test: str, part: int, noise: Noise | None = None) -> list[Any]:
    """The rows of one part, and the processor time that it took, s; called in any process."""
    cv2.setNumThreads(1)
    setup = setup_of(source)
    begin = time.process_time()
    if noise is not None:
        rows: Any = arm.run(setup, part, noise)
    else:
        rows = TESTS[test].run(setup, part)
    return [rows, time.process_time() - begin]


def all_measured(
    source: Source,
    counts: dict[str, int],
    kept: Path,
    workers: int,
    noise: Noise | None = None,
) -> Found:
    """All parts of some tests, given the number of each one's parts; the arm is led by `noise`."""
    settings: list[dict[str, Any]] = [
        {"source": source, "test": test, "part": part, "noise": noise}
        for test, count in counts.items()
        for part in range(count)
    ]
    results = results_of("tests", measured, settings, workers, kept, source.made_from)
    rows: dict[str, list[Any]] = {test: [] for test in counts}
    for setting, (of_part, _) in zip(settings, results, strict=True):
        rows[setting["test"]].append(of_part)
    return Found(rows, sum(cpu_s for _, cpu_s in results))
