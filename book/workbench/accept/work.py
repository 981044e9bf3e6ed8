"""The parts of the tests, measured by two processes, and kept as they come."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
from tqdm import tqdm

from trinolab.files.journal import Journal
from trinolab.files.rigs import read_handle, read_rig

from ..sweep.engines import as_finished, processes
from . import arm, availability, combined, latency, moving, pointer, rest, static
from .arm import Noise
from .setup import Setup

TESTS = {
    test.NAME: test
    for test in (combined, rest, static, moving, pointer, latency, availability, arm)
}
# The longest parts first, so that both processes end at the same time.
RENDERED = ("A6", "A5", "A3", "A1", "A4", "A0", "A2")


class Part(NamedTuple):
    """A part of a test: its name, its number, and for the arm the noise that leads it."""

    test: str
    number: int
    noise: Noise | None = None

    @property
    def key(self) -> str:
        """By which it is kept."""
        return json.dumps([self.test, self.number, *(self.noise or ())])


class Source(NamedTuple):
    """From what every process makes the same `Setup`."""

    rig: str
    handle: str
    poses: int
    seed: int


class Found(NamedTuple):
    """What a part gave: rows for its test, and the processor time that it took, s."""

    rows: Any
    cpu_s: float


@lru_cache(maxsize=2)
def setup_of(source: Source) -> Setup:
    """The setup of files, a size and a seed. ValueError names the file that does not serve."""
    return Setup(read_rig(source.rig), read_handle(source.handle), source.poses, source.seed)


def measured(source: Source, part: Part) -> Found:
    """Do one part; called in any process."""
    cv2.setNumThreads(1)
    setup = setup_of(source)
    begin = time.process_time()
    if part.noise is not None:
        rows: Any = arm.run(setup, part.number, part.noise)
    else:
        rows = TESTS[part.test].run(setup, part.number)
    return Found(rows, time.process_time() - begin)


class Checkpoint(Journal):
    """Finished parts, a line each."""

    def __init__(self, path: Path, made_from: str) -> None:
        super().__init__(
            path, f"# trinolab accept {made_from}\n", lambda _, line: bool(_read(line))
        )

    def found(self) -> dict[str, Found]:
        """What each finished part gave, by its key."""
        return dict(pair for line in self.lines() if (pair := _read(line)))

    def add(self, key: str, found: Found) -> None:
        """One more part, see `add_line`."""
        self.add_line(json.dumps([key, found.rows, round(found.cpu_s, 3)]))


def _read(line: str) -> tuple[str, Found] | None:
    """A finished part; None for a damaged line."""
    try:
        key, rows, cpu_s = json.loads(line)
        return str(key), Found(rows, float(cpu_s))
    except (ValueError, TypeError):
        return None


def do(
    source: Source, parts: Sequence[Part], kept: Checkpoint, workers: int, progress: bool, what: str
) -> Mapping[str, Found]:
    """Do what is not kept yet, and return what all parts gave, by their keys."""
    answers = kept.found()
    todo = [part for part in parts if part.key not in answers]
    with tqdm(
        total=len(parts),
        initial=len(parts) - len(todo),
        unit="part",
        desc=what,
        disable=None if progress else True,
    ) as bar:
        for part, one in _computed(source, todo, min(workers, max(len(todo), 1))):
            kept.add(part.key, one)
            answers[part.key] = one
            bar.update()
    return answers


def _computed(source: Source, todo: Sequence[Part], workers: int) -> Iterator[tuple[Part, Found]]:
    if not todo:
        return
    with processes(workers) as engine:
        calls = ((part, measured, source, part) for part in todo)
        for part, future in as_finished(engine, calls):
            try:
                yield part, future.result()
            except BrokenExecutor:
                raise ValueError("a worker process has ended abruptly") from None
