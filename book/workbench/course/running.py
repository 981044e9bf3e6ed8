"""Run a student's code in a process of its own, and find out what became of it."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from . import sandbox
from .child import BEING_CHECKED, MEMORY, Call, Work, outcome
from .plain import checked_plain

# Python in a browser has none: there a function runs in the session that asks, and nothing but that
# session's end stops it. Such a verdict is not for marks, and says so.
HAS_PROCESSES = sys.platform not in ("emscripten", "wasi")
if HAS_PROCESSES:
    import psutil

CPU_S = 10.0  # a function, in all its cases
CELLS_S = 300.0  # a file: it may be a whole chapter, with the chapter's own cells
# A function, in all its cases, that waits and does not compute: a busy machine needs a multiple of a
# quiet one's time.
WAIT_S = 60.0
ENOUGH_S = 300.0  # a file, with all that is asked of it, however often it has to be started
REPORT = 32 * 2**20  # bytes that are read of what a process says
PROCESSES = 16  # at once
LOOK_S = 0.1  # how often memory and processes are looked at
COPIED, COPIED_FILES = 64 * 2**20, 200  # bytes and number of the files beside the one that is run
TIME_UP, OUT_OF_CPU, KILLED = 14, 24, 9  # the signals SIGALRM, SIGXCPU, SIGKILL
# of this process's environment: what Python and its libraries need
HANDED_ON = (
    "PATH",
    "LANG",
    "LC_ALL",
    "LC_CTYPE",
    "TZ",
    "SYSTEMROOT",
    "TRINOLAB_DATA",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "LD_LIBRARY_PATH",
)


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
        Why nothing more of a file could be asked, in words; None if it could.
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
    if not HAS_PROCESSES:
        return _run_here(pickle.loads(pickled), calls)
    # a function of a module is found there as it is here
    environment = {**os.environ, "PYTHONPATH": _python_path()}
    command = [sys.executable, "-m", "workbench.course.child"]
    work = Work(pickled, (), calls, (), cpu_s, cpu_s, wait_s)
    return _run(command, work, wait_s * len(calls), env=environment)


def _run_here(copies: Mapping[str, Any], calls: Sequence[Call]) -> Found:
    """Call copies of functions in this process, as `child` does in its own."""
    found = Found()
    for name, cases in calls:
        found.outcomes[name] = [_outcome(outcome(copies[name], case)) for case in cases]
    return found


def run_file(
    cells: Sequence[tuple[str, str]],
    calls: Sequence[Call],
    values: Sequence[str],
    beside: Path | None = None,
    cells_s: float = CELLS_S,
    enough_s: float = ENOUGH_S,
) -> Found:
    """Run the code of a notebook or a Python file, then call functions and read values that it has
    made. It runs in a folder of its own, inside ``bwrap`` where that works.

    Parameters
    ----------
    cells
        The places of the pieces of code, and their texts.
    calls
        The functions to call.
    values
        The names of the values.
    beside
        A folder whose files the code finds in its own; they are copied, so that it changes none.
    cells_s, enough_s
        How long the cells may compute, and all of it may take, s.
    """
    with tempfile.TemporaryDirectory(
        prefix="trinolab-check-", ignore_cleanup_errors=True
    ) as folder:
        own = Path(folder).resolve()
        if beside is not None:
            _copy(beside, own)
        environment = {name: os.environ[name] for name in HANDED_ON if name in os.environ}
        environment |= dict.fromkeys(("HOME", "TMPDIR", "TEMP", "TMP", "USERPROFILE"), str(own))
        environment |= {
            "PYTHONPATH": _python_path(),
            "PYTHONDONTWRITEBYTECODE": "1",
            BEING_CHECKED: "1",
        }
        command = [sys.executable, "-P", "-m", "workbench.course.child"]
        if sandbox.works():
            command = sandbox.inside(command, own)
        work = Work(None, tuple(cells), calls, values, cells_s, CPU_S, WAIT_S)
        return _run(command, work, enough_s, env=environment, cwd=own)


def _python_path() -> str:
    return os.pathsep.join(str(Path(name).resolve()) for name in sys.path if name)


def _copy(folder: Path, own: Path) -> None:
    """Copy what lies beside a file, no more than a little."""
    room = COPIED
    for path in islice(_beside(folder), COPIED_FILES):
        with contextlib.suppress(OSError):
            size = path.stat().st_size
            if size <= room:
                room -= size
                target = own / path.relative_to(folder)
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)


def _beside(folder: Path) -> Iterator[Path]:
    """The files in a folder and below it, but neither links nor what is hidden."""
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "_")))
        for name in sorted(names):
            path = Path(place, name)
            if not name.startswith(".") and path.is_file() and not path.is_symlink():
                yield path


def _run(command: Sequence[str], work: Work, enough_s: float, **where: Any) -> Found:
    """Start a process, and another one for what is left where a function took the first one along."""
    found = Found()
    until = time.monotonic() + enough_s
    while True:
        report, ended = _reported(command, work, until, **where)
        at = _take(report, work, found)
        if at is None:
            return found
        names = [call.name for call in work.calls]
        says = how(ended, work.cpu_s if at in names else work.cells_s, work.wait_s, enough_s)
        if at not in names:
            found.stuck = f"{at} {says}"
            return found
        found.outcomes.setdefault(at, []).append({"stuck": says})
        left = work.calls[names.index(at) + 1 :]
        if not left:
            return found
        if time.monotonic() >= until:
            found.stuck = f"the whole file was stopped after {enough_s:g} s"
            return found
        work = work._replace(calls=left, values=())


def _reported(
    command: Sequence[str], work: Work, until: float, **where: Any
) -> tuple[list[Any], int | str]:
    """Run a process; the lines that it has written, and its exit code or why it was ended."""
    with tempfile.TemporaryFile() as asked, tempfile.TemporaryFile() as said:
        asked.write(pickle.dumps(work))
        asked.seek(0)
        process = subprocess.Popen(
            command,
            stdin=asked,
            stdout=said,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            **where,
        )
        try:
            ended = _watched(process, until)
        finally:
            _kill(process)
        said.seek(0)
        return list(_lines(said.read(REPORT))), ended


def _watched(process: subprocess.Popen, until: float) -> int | str:
    """Wait for a process; its exit code, or why it has to be ended."""
    while time.monotonic() < until:
        with contextlib.suppress(subprocess.TimeoutExpired):
            code = process.wait(timeout=LOOK_S)
            is_signal = 128 < code < 192  # as `bwrap` names it
            return 128 - code if is_signal else code
        with contextlib.suppress(psutil.NoSuchProcess):
            first = psutil.Process(process.pid)
            family = [first, *first.children(recursive=True)]
            if len(family) > PROCESSES:
                return "processes"
            if sum(map(_memory, family)) > MEMORY:
                return "memory"
    return "time"


def _memory(process: Any) -> int:
    with contextlib.suppress(psutil.Error):
        return process.memory_info().rss
    return 0


def _kill(process: subprocess.Popen) -> None:
    """End a process and its group; with ``bwrap`` all that it has started ends."""
    process.kill()
    if os.name == "posix":
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _lines(text: bytes) -> Iterator[Any]:
    """The whole lines of JSON in a report."""
    for line in text.split(b"\n")[:-1]:
        with contextlib.suppress(ValueError, RecursionError):
            yield json.loads(line)


def _take(report: Sequence[Any], work: Work, found: Found) -> str | None:
    """Add what a process says to what is found, whatever it says; where it was when it ended, None
    if it has done its work.
    """
    at = "what was handed in"
    names = {call.name for call in work.calls}
    for line in report:
        match line:
            case ["at", str(at)]:
                if at in names:
                    found.outcomes[at] = []
            case ["raised", str(place), str(error)]:
                found.raised[place] = error
            case ["value", str(name), value] if name in work.values:
                found.values[name] = checked_plain(value)
            case ["case", str(name), dict(did)] if name in found.outcomes:
                found.outcomes[name].append(_outcome(did))
            case ["end"]:
                return None
    return at


def _outcome(did: Mapping[str, Any]) -> dict[str, Any]:
    """What a process says of a case, whatever it says."""
    changed = did.get("changed")
    places = changed if isinstance(changed, list) else []
    about = {
        "printed": did.get("printed") is True,
        "changed": [k for k in places if isinstance(k, int) and 0 <= k < 20],
    }
    if "raised" in did:
        return {"raised": str(did["raised"]), **about}
    return {"returned": checked_plain(did.get("returned")), **about}


def how(ended: int | str, cpu_s: float, wait_s: float, enough_s: float) -> str:
    """Describe how a process ended that did not do all of its work: by its exit code or by why it was
    ended.
    """
    if ended == "processes":
        return f"was ended: it has started more than {PROCESSES} processes"
    if ended in ("memory", -KILLED):
        return "was ended by the system: it may have asked for too much memory"
    if ended in ("time", -TIME_UP):
        seconds = enough_s if ended == "time" else wait_s
        return f"does not end: it was stopped after {seconds:g} s"
    if ended == -OUT_OF_CPU:
        return f"does not end: it was stopped after {cpu_s:g} s of computing"
    return f"ends Python (exit code {ended})"
