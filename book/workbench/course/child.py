"""The process in which a student's code runs: ``python -m workbench.course.child``.

It reads a `Work` from its standard input, then one `Request` after the other, and answers each by a
line of JSON on its standard output. A student's code may end this process, print, write lines of its
own, or never return: whoever started it sees that from outside. What comes back is plain data and
never a pickle, and the right results are nowhere in this process.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import io
import json
import os
import pickle
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import IO, Any, NamedTuple

import numpy as np

from .plain import plain

# Set while a file is checked as a whole: the checks in it need not be made then.
BEING_CHECKED = "TRINOLAB_BEING_CHECKED"


class Call(NamedTuple):
    """A function of the student's, by name, and the lists of arguments on which it is tried."""

    name: str
    cases: Sequence[tuple]


class Work(NamedTuple):
    """What is there to be asked.

    Parameters
    ----------
    given
        Functions and values by name, pickled by cloudpickle; or None.
    cells
        Else what makes them: the place of each piece of code, as in ``"cell 3"``, and its text.
    cells_s
        The time of the processor that the cells may take, s; after it the process is ended.
    """

    given: bytes | None
    cells: Sequence[tuple[str, str]]
    cells_s: float


class Request(NamedTuple):
    """What is asked of the process.

    Parameters
    ----------
    id
        Comes back with the answer.
    what
        ``value`` for a value, ``function`` for whether there is one and for the time of the
        processor that it may take in all its cases; ``case`` for what it does in one.
    name
        Of the value or the function.
    cpu_s
        That time, s.
    case
        The arguments.
    """

    id: str
    what: str
    name: str
    cpu_s: float = 0.0
    case: tuple = ()


def main(missing: Sequence[str] = ()) -> None:
    """Do the work that standard input names, and answer what it asks.

    Parameters
    ----------
    missing
        What is not kept from the student's code.
    """
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    sys.stdin = io.StringIO()
    work: Work = pickle.load(requests)
    _limit(work.cells_s)
    _say(answers, here=True, missing=list(missing))
    namespace = _namespace(work, answers)
    _say(answers, ready=True)
    while True:
        try:
            request: Request = pickle.load(requests)
        except EOFError:
            return
        _say(answers, id=request.id, **_answer(request, namespace))


def _answer(request: Request, namespace: dict[str, Any]) -> dict[str, Any]:
    there = namespace.get(request.name)
    if request.what == "value":
        return {"there": request.name in namespace, "is_": plain_value(there)}
    if request.what == "function":
        _limit(request.cpu_s)
        return {"there": callable(there)}
    assert callable(there)  # or else nobody asks for a case
    return outcome(there, request.case)


def _limit(cpu_s: float) -> None:
    """End this process when it computes for so much longer."""
    used = sum(os.times()[:2])
    try:
        import resource
    except ImportError:  # Windows
        _watch(used + cpu_s)
        return
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    limit = int(used + cpu_s) + 1
    if most != resource.RLIM_INFINITY:
        limit = min(limit, most)
    resource.setrlimit(resource.RLIMIT_CPU, (limit, most))


OUT_OF_TIME = 128 + 24  # as a shell names a process that SIGXCPU has ended
_until = [float("inf")]


def _watch(until: float) -> None:
    """End this process when it has computed for so long, where the system does not."""

    def look() -> None:
        while sum(os.times()[:2]) < _until[0]:
            time.sleep(0.2)
        os._exit(OUT_OF_TIME)

    first = _until[0] == float("inf")
    _until[0] = until
    if first:
        threading.Thread(target=look, daemon=True).start()


def _namespace(work: Work, answers: IO[str]) -> dict[str, Any]:
    if work.given is not None:
        return pickle.loads(work.given)
    os.environ["MPLBACKEND"] = "Agg"  # nobody sees the figures
    sys.path.insert(0, os.getcwd())
    return executed(work.cells, answers)


def executed(cells: Sequence[tuple[str, str]], answers: IO[str]) -> dict[str, Any]:
    """Run pieces of code, each with its place; go on after one that raises."""
    os.environ[BEING_CHECKED] = "1"
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for place, source in cells:
        _say(answers, place=place)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            try:
                exec(compile(_without_magic(source), f"<{place}>", "exec"), namespace)
            except (Exception, SystemExit, KeyboardInterrupt) as error:
                _say(answers, place=place, raised=_named(error))
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


def _say(answers: IO[str], **line: Any) -> None:
    print(json.dumps(line), file=answers, flush=True)


if __name__ == "__main__":
    main()
