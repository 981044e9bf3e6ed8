"""The process in which a student's code runs: ``python -m workbench.course.child``.

It reads a `Work` from its standard input and reports what the code has made on its standard output, a
line of JSON each: plain data, never a pickle. The code may end this process, never return, or write
lines of its own. It decides no points: whoever started the process compares the values in the report
with the right ones, and those are nowhere in this process.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import io
import json
import os
import pickle
import signal
import sys
from collections.abc import Callable, Sequence
from typing import IO, Any, NamedTuple

import numpy as np

from .plain import plain

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

# Set while a file is checked as a whole: the checks in it need not be made then.
BEING_CHECKED = "TRINOLAB_BEING_CHECKED"
MEMORY = 2 * 2**30  # bytes that a process may hold
FILE = 64 * 2**20  # bytes of a file that it writes


class Call(NamedTuple):
    """A function of the student's, by name, and the lists of arguments on which it is tried."""

    name: str
    cases: Sequence[tuple]


class Work(NamedTuple):
    """Where a student's functions and values come from, and what is asked of them.

    Parameters
    ----------
    given
        Functions by name, pickled by cloudpickle; or None.
    cells
        Else what makes them: the place of each piece of code, as in ``"cell 3"``, and its text.
    calls
        The functions to call.
    values
        The names of the values to report.
    cells_s
        The processor time of all cells, s; the process ends after it.
    cpu_s, wait_s
        The processor time and the time by the clock of a function in all its cases, s.
    """

    given: bytes | None
    cells: Sequence[tuple[str, str]]
    calls: Sequence[Call]
    values: Sequence[str]
    cells_s: float
    cpu_s: float
    wait_s: float


def main() -> None:
    """Do the work that standard input names."""
    work: Work = pickle.load(sys.stdin.buffer)
    report = os.fdopen(os.dup(1), "w", encoding="utf-8")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    sys.stdin = io.StringIO()
    _limit_memory_and_files()
    _limit_time(work.cells_s)
    namespace = _namespace(work, report)
    for name in work.values:
        if name in namespace:
            _say(report, "value", name, plain_value(namespace[name]))
    for name, cases in work.calls:
        function = namespace.get(name)
        if callable(function):
            _say(report, "at", name)
            _limit_time(work.cpu_s, work.wait_s)
            for case in cases:
                _say(report, "case", name, outcome(function, case))
    _say(report, "end")
    os._exit(0)  # whatever the code has left to be done at the end


def _limit_memory_and_files() -> None:
    for name, most in (("DATA", MEMORY), ("FSIZE", FILE)):
        with contextlib.suppress(
            AttributeError, ValueError, OSError
        ):  # no such limit, or a lower one
            resource.setrlimit(getattr(resource, f"RLIMIT_{name}"), (most, most))


def _limit_time(cpu_s: float, wait_s: float = 0.0) -> None:
    """End this process when it has computed, or waited, for so much longer; 0 for no limit. Windows
    has no such limits: there only whoever started the process ends it.
    """
    if resource is None:
        return
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    with contextlib.suppress(ValueError):  # a lower limit holds already
        limit = int(sum(os.times()[:2]) + cpu_s) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (limit, most))
    signal.setitimer(signal.ITIMER_REAL, wait_s)


def _namespace(work: Work, report: IO[str]) -> dict[str, Any]:
    if work.given is not None:
        return pickle.loads(work.given)
    os.environ["MPLBACKEND"] = "Agg"  # nobody sees the figures
    sys.path.insert(0, os.getcwd())
    return executed(work.cells, report)


def executed(cells: Sequence[tuple[str, str]], report: IO[str]) -> dict[str, Any]:
    """Run pieces of code, each with its place; go on after one that raises."""
    os.environ[BEING_CHECKED] = "1"
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for place, source in cells:
        _say(report, "at", place)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            try:
                exec(compile(_without_magic(source), f"<{place}>", "exec"), namespace)
            except (Exception, SystemExit, KeyboardInterrupt) as error:
                _say(report, "raised", place, _named(error))
    return namespace


def _without_magic(source: str) -> str:
    """A cell without IPython's commands. What Python can read has none: a line of it that begins
    with % is part of a text, or of an expression.
    """
    try:
        ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        lines = source.splitlines()
        plain_lines = ["" if line.lstrip().startswith(("%", "!", "?")) else line for line in lines]
        return "\n".join(plain_lines)
    return source


def plain_value(value: Any) -> Any:
    """A student's value as plain data: a mapping stays one, whatever is in it becomes plain. True and
    False are words, since whoever is asked for "yes" or "no" may mean them.
    """
    if isinstance(value, dict):
        return {"mapping": {str(name): _word_or_plain(item) for name, item in value.items()}}
    return plain(value)


def _word_or_plain(item: Any) -> Any:
    if isinstance(item, bool | np.bool_):
        return "yes" if item else "no"
    return plain(item)


def outcome(function: Callable[..., Any], case: tuple) -> dict[str, Any]:
    """What a function does with its arguments: what it returns or raises, whether it prints, and
    which arguments it changes, counted from 0.
    """
    arguments = copy.deepcopy(case)
    printed = io.StringIO()
    warned = io.StringIO()  # a warning of NumPy's is nothing that the function prints
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(warned):
            returned = plain(function(*arguments))
    except (Exception, SystemExit, KeyboardInterrupt) as error:
        return {"raised": _named(error), "printed": bool(printed.getvalue()), "changed": []}
    changed = [k for k, pair in enumerate(zip(case, arguments, strict=True)) if _differ(*pair)]
    return {"returned": returned, "printed": bool(printed.getvalue()), "changed": changed}


def _differ(before: Any, after: Any) -> bool:
    return json.dumps(plain(before)) != json.dumps(plain(after))


def _named(error: BaseException) -> str:
    """An error's type and the first line of what it says."""
    message = str(error)[:1000].strip()
    first = message.splitlines()[0] if message else ""
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


def _say(report: IO[str], *line: Any) -> None:
    print(json.dumps(line), file=report, flush=True)


if __name__ == "__main__":
    main()
