"""Run a student's code in a process of its own, and find out what became of it."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .child import Call, Work

CPU_S = 10.0
# For code that waits and does not compute. A busy machine needs a multiple of a quiet one's time.
WAIT_S = 300.0


@dataclass
class Found:
    """What a student's code did.

    Parameters
    ----------
    outcomes
        Of each function the outcomes of its cases, in their order, as `child.outcome` has them. A
        function that is not there has none. The last outcome of a function that never returned is
        ``{"stuck": ...}``, of one that ended Python ``{"gone": ...}``.
    values
        The values that are there, as plain data.
    cells
        What the cells of a notebook raised, by number.
    stuck
        Why nothing of a file could be asked, in words; None if it could.
    """

    outcomes: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    cells: dict[int, str] = field(default_factory=dict)
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
    return _run(pickled, None, calls, (), cpu_s, wait_s)


def run_file(
    file: Path,
    calls: Sequence[Call],
    values: Sequence[str],
    cpu_s: float = CPU_S,
    wait_s: float = WAIT_S,
) -> Found:
    """Run a notebook or a Python file, then call functions and read values that it has made."""
    return _run(None, file.resolve(), calls, values, cpu_s, wait_s)


def _run(
    given: bytes | None,
    file: Path | None,
    calls: Sequence[Call],
    values: Sequence[str],
    cpu_s: float,
    wait_s: float,
) -> Found:
    """Start a process, and another one for what is left where a function took the first one along."""
    found = Found()
    left = list(calls)
    while True:
        with tempfile.TemporaryDirectory(prefix="trinolab-check-") as folder:
            answers = Path(folder) / "answers.jsonl"
            answers.touch()
            work = Work(given, file, left, values, answers, cpu_s)
            how = _ended(work, wait_s)
            lines = list(_lines(answers))
        stopped_in = _read(lines, found)
        if any(line.get("done") for line in lines):
            return found
        if stopped_in is None:
            cell = max((line["cell"] for line in lines if "cell" in line), default=None)
            where = "what was handed in" if cell is None or file is None else f"cell {cell}"
            found.stuck = f"{where} {how}"
            return found
        found.outcomes[stopped_in].append({"stuck": how})
        left = left[[call.name for call in left].index(stopped_in) + 1 :]
        values = ()
        if not left:
            return found


def _ended(work: Work, wait_s: float) -> str:
    """Let a process work; how it ended, for the case that it did not finish."""
    command = [sys.executable, "-m", "trinolab.course.child"]
    quiet = subprocess.DEVNULL
    # a function of a module is found there as it is here
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, env=environment
    ) as process:
        try:
            process.communicate(pickle.dumps(work), timeout=wait_s)
        except subprocess.TimeoutExpired:
            process.kill()
            return f"does not end: it was stopped after {wait_s:g} s"
        except BaseException:
            process.kill()
            raise
    if process.returncode in (-24, -9):  # the limit of the processor's time
        return f"does not end: it was stopped after {work.cpu_s:g} s of computing"
    return f"ends Python (exit code {process.returncode})"


def _lines(answers: Path) -> Iterator[dict[str, Any]]:
    """The lines that are whole and can be read."""
    for line in answers.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            found = json.loads(line)
        except ValueError:
            continue
        if isinstance(found, dict):
            yield found


def _read(lines: Sequence[dict[str, Any]], found: Found) -> str | None:
    """Take what the lines say; the name of the function that was running at the end, if one was."""
    running = None
    for line in lines:
        if "raised" in line and "cell" in line:
            found.cells[line["cell"]] = line["raised"]
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
