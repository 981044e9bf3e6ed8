"""The process in which a student's code runs: ``python -m workbench.course.child``.

It reads a `Work` from its standard input and writes a line of JSON for each thing that it did to the
file that the work names. A student's code may end this process, print, or never return: whoever
started it sees that from outside. What comes back is plain data and never a pickle.
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
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

from .plain import plain

__all__ = [
    "BEING_CHECKED",
    "Call",
    "Work",
    "cells_of",
    "executed",
    "main",
    "outcome",
    "plain_value",
]

# Set while a file is checked as a whole: the checks in it need not be made then.
BEING_CHECKED = "TRINOLAB_BEING_CHECKED"


class Call(NamedTuple):
    """A function of the student's, by name, and the lists of arguments on which it is tried."""

    name: str
    cases: Sequence[tuple]


class Work(NamedTuple):
    """What is to be done.

    Parameters
    ----------
    given
        Functions and values by name, pickled by cloudpickle; or None.
    file
        Else the notebook or the Python file that makes them; or None.
    calls
        The functions to call.
    values
        The names of the values to return.
    answers
        The file that gets the lines.
    cells_s
        The time of the processor that the file may take, s; after it the process is ended.
    cpu_s
        The time that each function may take in all its cases, s.
    """

    given: bytes | None
    file: Path | None
    calls: Sequence[Call]
    values: Sequence[str]
    answers: Path
    cells_s: float
    cpu_s: float


def main() -> None:
    """Do the work that standard input names."""
    work: Work = pickle.load(sys.stdin.buffer)
    sys.stdin = io.StringIO()
    with work.answers.open("a", encoding="utf-8") as answers:
        _limit(work.cells_s)
        namespace = _namespace(work, answers)
        _say(answers, here=True)  # what it waits for from now on, it waits for itself
        for name in work.values:
            _say(answers, value=name, there=name in namespace, is_=plain_value(namespace.get(name)))
        for call in work.calls:
            function = namespace.get(call.name)
            _say(answers, function=call.name, there=callable(function))
            if callable(function):
                _limit(work.cpu_s)
                for k, case in enumerate(call.cases):
                    _say(answers, began=call.name, case=k)
                    _say(answers, function=call.name, case=k, **outcome(function, case))
        _say(answers, done=True)


def _limit(cpu_s: float) -> None:
    """End this process when it computes for so much longer; on Windows nothing does."""
    with contextlib.suppress(ImportError):
        import resource

        used = sum(os.times()[:2])
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        limit = int(used + cpu_s) + 1
        if most != resource.RLIM_INFINITY:
            limit = min(limit, most)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, most))


def _namespace(work: Work, answers: IO[str]) -> dict[str, Any]:
    if work.given is not None:
        return pickle.loads(work.given)
    assert work.file is not None
    os.environ["MPLBACKEND"] = "Agg"  # nobody sees the figures
    os.chdir(work.file.parent)
    sys.path.insert(0, str(work.file.parent))
    return executed(work.file, answers)


def executed(file: Path, answers: IO[str]) -> dict[str, Any]:
    """Run a notebook's cells, or a file; go on after a cell that raises."""
    os.environ[BEING_CHECKED] = "1"
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for number, source in enumerate(cells_of(file), start=1):
        place = f"cell {number}" if file.suffix == ".ipynb" else file.name
        _say(answers, place=place)
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            try:
                exec(compile(source, f"<{place}>", "exec"), namespace)
            except (Exception, SystemExit, KeyboardInterrupt) as error:
                _say(answers, place=place, raised=_named(error))
    return namespace


def cells_of(file: Path) -> list[str]:
    if file.suffix != ".ipynb":
        return [file.read_text(encoding="utf-8")]
    cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    return [_without_magic(source) for source in sources]


def _without_magic(source: str) -> str:
    """A cell without IPython's commands. What Python can read has none: a line of it that begins
    with % is part of a text, or of an expression.
    """
    try:
        ast.parse(source)
    except (SyntaxError, ValueError):
        lines = source.splitlines()
        plain_lines = ["" if line.lstrip().startswith(("%", "!", "?")) else line for line in lines]
        return "\n".join(plain_lines)
    return source


def plain_value(value: Any) -> Any:
    """A student's value as plain data: a mapping stays one, whatever is in it becomes plain."""
    if isinstance(value, dict):
        return {"mapping": {str(name): plain(item) for name, item in value.items()}}
    return plain(value)


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
    message = str(error).strip()
    first = message.splitlines()[0] if message else ""
    return f"{type(error).__name__}: {first}" if first else type(error).__name__


def _say(answers: IO[str], **line: Any) -> None:
    print(json.dumps(line), file=answers, flush=True)


if __name__ == "__main__":
    main()
