"""Run a student's code in a process of its own, and find out what became of it.

The process is asked one thing at a time, and what it answers is looked at here: a right result is
never sent there. An answer that does not come is none.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import queue
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trinolab.datasets import data_path
from trinolab.files import fetch

from .child import BEING_CHECKED, Call, Request, Work, outcome
from .confined import MEMORY
from .plain import checked_plain

CPU_S = 10.0  # a function, in all its cases
CELLS_S = 300.0  # a file: it may be a whole chapter, with the chapter's own cells
# A function, in all its cases, that waits and does not compute: a busy machine needs a multiple of a
# quiet one's time. Where no limit of the processor's time is kept it is stopped sooner.
WAIT_S = 60.0 if os.name == "posix" else 20.0
ENOUGH_S = 300.0  # a file, with all that is asked of it, however often it has to be started
ANSWER = 32 * 2**20  # bytes of a line
ANSWERS = 128 * 2**20  # bytes of all that a process says
PROCESSES = 16  # at once
LOOK_S = 0.1  # how often memory and processes are looked at
COPIED, COPIED_FILES = 64 * 2**20, 200  # bytes and number of the files beside the one that is run
# Python in a browser has none: there a function runs in the session that asks, and nothing but that
# session's end stops it. Such a verdict is not for marks, and says so.
HAS_PROCESSES = sys.platform not in ("emscripten", "wasi")
EXERCISES = Path(__file__).resolve().parent / "exercises"
# of this process's environment: what Python and its libraries need
HANDED_ON = [
    "PATH",
    "LANG",
    "LC_ALL",
    "LC_CTYPE",
    "TZ",
    "SYSTEMROOT",
    "WINDIR",
    "NUMBER_OF_PROCESSORS",
    "TRINOLAB_DATA",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "LD_LIBRARY_PATH",
    "VIRTUAL_ENV",
]


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
    missing
        What this system did not keep from the code, in words.
    """

    outcomes: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    raised: dict[str, str] = field(default_factory=dict)
    stuck: str | None = None
    missing: tuple[str, ...] = ()


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
    command = [sys.executable, "-m", "workbench.course.child"]
    # a function of a module is found there as it is here
    environment = {**os.environ, "PYTHONPATH": _python_path()}
    work = Work(pickled, (), cpu_s)

    def start() -> _Process:
        return _Process(command, environment, None, work)

    return _run(start, calls, (), cpu_s, wait_s, ENOUGH_S, cpu_s)


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
    wait_s: float = WAIT_S,
    enough_s: float = ENOUGH_S,
) -> Found:
    """Run the code of a notebook or a Python file, then call functions and read values that it has
    made. It runs confined, in a folder of its own.

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
    cells_s, wait_s, enough_s
        How long the cells may compute, a function may wait, and all of it may take, s.
    """
    with tempfile.TemporaryDirectory(
        prefix="trinolab-check-", ignore_cleanup_errors=True
    ) as folder:
        own = Path(folder).resolve()
        if beside is not None:
            _copy(beside, own)
        hidden = [EXERCISES, data_path("exercises").resolve()]
        packages = [EXERCISES.parents[1], Path(fetch.__file__).resolve().parents[1], data_path()]
        if os.environ.get(fetch.VARIABLE):
            packages.append(Path(os.environ[fetch.VARIABLE]))
        paths = json.dumps([str(own), [*map(str, hidden)], [*map(str, packages)]])
        command = [sys.executable, "-P", "-m", "workbench.course.confined", paths]
        environment = {name: os.environ[name] for name in HANDED_ON if name in os.environ}
        for name in ("HOME", "TMPDIR", "TEMP", "TMP", "USERPROFILE"):
            environment[name] = str(own)
        environment |= {
            "PYTHONPATH": _python_path(),
            "PYTHONDONTWRITEBYTECODE": "1",
            BEING_CHECKED: "1",
        }
        work = Work(None, tuple(cells), cells_s)

        def start() -> _Process:
            return _Process(command, environment, own, work)

        return _run(start, calls, values, CPU_S, wait_s, enough_s, cells_s)


def _python_path() -> str:
    return os.pathsep.join(str(Path(name).resolve()) for name in sys.path if name)


def _copy(folder: Path, own: Path) -> None:
    """Copy what lies beside a file, but neither links nor what is hidden, nor more than a little."""
    room, files = COPIED, COPIED_FILES
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "_")))
        there = own / Path(place).relative_to(folder)
        for name in sorted(names):
            path = Path(place, name)
            if name.startswith(".") or path.is_symlink() or not path.is_file():
                continue
            size = path.stat().st_size
            if size > room or not files:
                continue
            room, files = room - size, files - 1
            with contextlib.suppress(OSError):
                there.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, there / name)
        if not files:
            return


class _Process:
    """A process that is asked one thing after the other, and what it has said."""

    def __init__(
        self, command: Sequence[str], environment: Mapping[str, str], own: Path | None, work: Work
    ) -> None:
        quiet = subprocess.DEVNULL
        self.killed_because: str | None = None
        self._silent = False  # nothing more can come
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=quiet,
            env=environment,
            cwd=own,
            start_new_session=os.name == "posix",
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._said: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._to_send: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._threads = [
            threading.Thread(target=target, daemon=True) for target in (self._listen, self._send)
        ]
        for thread in self._threads:
            thread.start()
        self._to_send.put(pickle.dumps(work))

    def _listen(self) -> None:
        """Put what it says into the queue, and None when nothing more can come."""
        stream = self._process.stdout
        assert stream is not None
        room = ANSWERS
        with contextlib.suppress(OSError, ValueError):
            while line := stream.readline(ANSWER):
                room -= len(line)
                if room < 0 or len(line) >= ANSWER:
                    self.killed_because = "output"
                    break
                if not line.endswith(b"\n"):  # it has ended within a line
                    break
                with contextlib.suppress(ValueError, RecursionError):
                    content = json.loads(line)
                    if isinstance(content, dict):
                        self._said.put(content)
        self._said.put(None)

    def _send(self) -> None:
        stream = self._process.stdin
        assert stream is not None
        with contextlib.suppress(OSError, ValueError):
            while (text := self._to_send.get()) is not None:
                stream.write(text)
                stream.flush()
        with contextlib.suppress(OSError, ValueError):
            stream.close()

    def said(self, until: float) -> dict[str, Any] | None:
        """The next line; None if there is no other one, or the time is over."""
        while not self._silent:
            left = until - time.monotonic()
            if left <= 0:
                self.killed_because = "time"
                return None
            try:
                line = self._said.get(timeout=min(LOOK_S, left))
                self._silent = line is None
                return line
            except queue.Empty:
                if self._takes_too_much():
                    return None
        return None

    def ask(self, what: str, name: str, until: float, **more: Any) -> dict[str, Any] | None:
        """What it answers; None if it does not."""
        request = Request(secrets.token_hex(8), what, name, **more)
        self._to_send.put(pickle.dumps(request))
        while (line := self.said(until)) is not None:
            if line.get("id") == request.id:
                return line
        return None

    def _takes_too_much(self) -> bool:
        """Whether it has more memory or processes than it may, of Linux."""
        if not sys.platform.startswith("linux"):
            return False
        family = _family(self._process.pid)
        if len(family) > PROCESSES:
            self.killed_because = "processes"
        elif sum(family.values()) > MEMORY:
            self.killed_because = "memory"
        return self.killed_because is not None

    def end(self) -> int | None:
        """End it with all that it has started; how it had ended by itself, None if it had not."""
        code = None
        if self.killed_because is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = self._process.wait(timeout=5.0)
        self.kill()
        return code if code is None or code <= 128 or os.name != "posix" else 128 - code

    def kill(self) -> None:
        """End it with all that it has started; once more does nothing."""
        if not self._threads:
            return
        self._to_send.put(None)
        family = _family(self._process.pid) if sys.platform.startswith("linux") else {}
        self._process.kill()
        if os.name == "posix":
            with contextlib.suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)
        for pid in family:
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        self._process.wait()
        for thread in self._threads:
            thread.join(timeout=5.0)
        self._threads = []
        assert self._process.stdout is not None
        self._process.stdout.close()


def _family(first: int) -> dict[int, int]:
    """The processes that descend from one, each with the bytes that it holds; of Linux."""
    parents, held = {}, {}
    page = os.sysconf("SC_PAGE_SIZE")
    for folder in os.scandir("/proc"):
        if folder.name.isdigit():
            with contextlib.suppress(OSError, ValueError, IndexError):
                stat = Path(folder.path, "stat").read_text(encoding="utf-8", errors="replace")
                numbers = stat.rpartition(")")[2].split()
                parents[int(folder.name)] = int(numbers[1])
                held[int(folder.name)] = page * int(numbers[21])
    family = {first}
    while more := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= more
    return {pid: held.get(pid, 0) for pid in family}


def _run(
    start: Any,
    calls: Sequence[Call],
    values: Sequence[str],
    cpu_s: float,
    wait_s: float,
    enough_s: float,
    cells_s: float,
) -> Found:
    """Start a process, and another one for what is left where a function took the first one along."""
    found = Found()
    enough = time.monotonic() + enough_s
    left = list(calls)
    while True:
        process = start()
        try:
            why = _begun(process, found, enough)
            if why is not None:
                code = process.end()
                found.stuck = f"{why} {how(code, cells_s, enough_s, process.killed_because)}"
                return found
            for name in values:
                line = process.ask("value", name, enough)
                if line is not None and line.get("there") is True:
                    found.values[name] = checked_plain(line.get("is_"))
            values = ()
            stopped = _asked(process, left, found, cpu_s, wait_s, enough)
            if stopped is None:
                return found
            code = process.end()
            says = how(code, cpu_s, wait_s, process.killed_because)
            found.outcomes.setdefault(stopped, []).append({"stuck": says})
        finally:
            process.kill()
        left = left[[call.name for call in left].index(stopped) + 1 :]
        if not left:
            return found
        if time.monotonic() >= enough:
            found.stuck = f"the whole file was stopped after {enough_s:g} s"
            return found


def _begun(process: _Process, found: Found, enough: float) -> str | None:
    """Wait until the cells have run; where it was if they have not."""
    place = "what was handed in"
    while (line := process.said(enough)) is not None:
        if line.get("here") is True and isinstance(line.get("missing"), list):
            found.missing = tuple(map(str, line["missing"]))
        if line.get("ready") is True:
            return None
        if isinstance(line.get("place"), str):
            place = line["place"]
            if isinstance(line.get("raised"), str):
                found.raised[place] = line["raised"]
    return place


def _asked(
    process: _Process,
    calls: Sequence[Call],
    found: Found,
    cpu_s: float,
    wait_s: float,
    enough: float,
) -> str | None:
    """Call the functions; the name of the one that did not come back."""
    for call in calls:
        until = min(enough, time.monotonic() + wait_s)
        line = process.ask("function", call.name, until, cpu_s=cpu_s)
        if line is None:
            return call.name
        if line.get("there") is not True:
            continue
        outcomes = found.outcomes[call.name] = []
        for case in call.cases:
            line = process.ask("case", call.name, until, case=case)
            if line is None:
                return call.name
            outcomes.append(_outcome(line))
    return None


def _outcome(line: Mapping[str, Any]) -> dict[str, Any]:
    """What a process says of a case, whatever it says."""
    changed = line.get("changed")
    places = changed if isinstance(changed, list) else []
    about = {
        "printed": line.get("printed") is True,
        "changed": [k for k in places if isinstance(k, int) and 0 <= k < 20],
    }
    if "raised" in line:
        return {"raised": str(line["raised"]), **about}
    return {"returned": checked_plain(line.get("returned")), **about}


def how(code: int | None, cpu_s: float, wait_s: float, because: str | None = None) -> str:
    """How a process ended, in words, that did not do all of its work."""
    if because == "memory" or code == -9:
        return "was ended by the system: it may have asked for too much memory"
    if because == "output":
        return "was ended: it has written more than the grader reads"
    if because == "processes":
        return f"was ended: it has started more than {PROCESSES} processes"
    if code is None:
        return f"does not end: it was stopped after {wait_s:g} s"
    if code in (-24, 128 + 24):  # SIGXCPU: the limit of the processor's time
        return f"does not end: it was stopped after {cpu_s:g} s of computing"
    return f"ends Python (exit code {code})"
