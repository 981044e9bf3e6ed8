"""Run a student's code in a process of its own, and find out what became of it."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .child import Call, Work

__all__ = ["Found", "how", "run_file", "run_given", "whole_lines"]

CPU_S = 10.0  # a function, in all its cases
CELLS_S = 300.0  # a file: it may be a whole chapter, with the chapter's own cells
# A cell, or a function in a case, that waits and does not compute. A busy machine needs a multiple of
# a quiet one's time, to start as well.
WAIT_S = 300.0


@dataclass
class Found:
    """What a student's code did.

    Parameters
    ----------
    outcomes
        Of each function the outcomes of its cases, in their order, as `child.outcome` has them. A
        function that is not there has none. The last outcome of a function that never returned, or
        that ended Python, is ``{"stuck": ...}``, with the reason in words.
    values
        The values that are there, as plain data.
    raised
        What the cells of a notebook raised, or the file, by the place: ``"cell 3"``.
    stuck
        Why nothing of a file could be asked, in words; None if it could.
    """

    outcomes: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    raised: dict[str, str] = field(default_factory=dict)
    stuck: str | None = None


def run_given(
    given: Mapping[str, Any],
    calls: Sequence[Call] = (),
    cpu_s: float = CPU_S,
    wait_s: float = WAIT_S,
) -> Found:
    """Call functions of this process, a notebook's for instance, in another one.

    Raises ValueError where a function cannot be sent there.
    """
    import cloudpickle

    try:
        pickled = cloudpickle.dumps(dict(given))
    except Exception as error:  # an open file, a lock, a window that the function holds
        raise ValueError(
            f"{', '.join(given)} cannot be tried in a process of its own: it holds something that "
            f"belongs to this one ({error})"
        ) from None
    return _run(Work(pickled, None, calls, (), Path(), cpu_s, cpu_s), wait_s)


def run_file(
    file: Path,
    calls: Sequence[Call],
    values: Sequence[str],
    cells_s: float = CELLS_S,
    wait_s: float = WAIT_S,
) -> Found:
    """Run a notebook or a Python file, then call functions and read values that it has made."""
    return _run(Work(None, file.resolve(), calls, values, Path(), cells_s, CPU_S), wait_s)


def _run(work: Work, wait_s: float) -> Found:
    """Start a process, and another one for what is left where a function took the first one along."""
    outcomes = Found()
    while True:
        with tempfile.TemporaryDirectory(prefix="trinolab-check-") as folder:
            answers = Path(folder) / "answers.jsonl"
            answers.touch()
            work = work._replace(answers=answers)
            code = _exit_code(work, wait_s)
            lines = list(whole_lines(answers))
        stopped_in = _read(lines, outcomes)
        if any(line.get("done") for line in lines):
            return outcomes
        if stopped_in is None:
            places = [line["place"] for line in lines if "place" in line]
            where = places[-1] if places else "what was handed in"
            outcomes.stuck = f"{where} {how(code, work.cells_s, wait_s)}"
            return outcomes
        outcomes.outcomes[stopped_in].append({"stuck": how(code, work.cpu_s, wait_s)})
        names = [call.name for call in work.calls]
        work = work._replace(calls=work.calls[names.index(stopped_in) + 1 :], values=())
        if not work.calls:
            return outcomes


def _exit_code(work: Work, wait_s: float) -> int | None:
    """Let a process work. How it ended; None if it had to be stopped because it waited."""
    command = [sys.executable, "-m", "workbench.course.child"]
    quiet = subprocess.DEVNULL
    # a function of a module is found there as it is here
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, env=environment
    ) as process:
        assert process.stdin is not None
        try:
            with contextlib.suppress(BrokenPipeError), process.stdin:
                process.stdin.write(pickle.dumps(work))
            return _awaited(process, work.answers, wait_s)
        finally:
            process.kill()


def _awaited(process: subprocess.Popen, answers: Path, wait_s: float) -> int | None:
    """The exit code of a process; None if it says nothing more for so long."""
    answered = 0
    since = time.monotonic()
    while time.monotonic() - since <= (wait_s if answered else WAIT_S):
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.wait(timeout=0.1)
        size = answers.stat().st_size
        if size != answered:
            answered, since = size, time.monotonic()
    return None


def how(code: int | None, cpu_s: float, wait_s: float) -> str:
    """How a process ended, in words, that did not do all of its work."""
    if code is None:
        return f"does not end: it was stopped after {wait_s:g} s"
    if code == -24:  # SIGXCPU: the limit of the processor's time
        return f"does not end: it was stopped after {cpu_s:g} s of computing"
    if code == -9:
        return "was ended by the system: it may have asked for too much memory"
    return f"ends Python (exit code {code})"


def whole_lines(answers: Path) -> Iterator[dict[str, Any]]:
    """The lines that are whole and can be read."""
    for line in answers.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            content = json.loads(line)
        except ValueError:
            continue
        if isinstance(content, dict):
            yield content


def _read(lines: Sequence[dict[str, Any]], found: Found) -> str | None:
    """Take what the lines say; the name of the function that was running at the end, if one was."""
    running = None
    for line in lines:
        if "raised" in line and "place" in line:
            found.raised[line["place"]] = line["raised"]
        elif line.get("there") and "value" in line:
            found.values[line["value"]] = line["is_"]
        elif "began" in line:
            running = line["began"]
        elif line.get("there") and "function" in line:
            found.outcomes[line["function"]] = []
        elif "case" in line:
            found.outcomes[line["function"]].append(line)
            running = None
    return running
