"""The code that an exercise begins with, and the code that solves it, as text for a notebook."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import textwrap
from collections.abc import Callable, Iterable
from functools import cache

from .exercise import Asked, Exercise, FunctionExercise, ValueExercise

WIDTH = 88  # of the code in a notebook


def stub(asked: Exercise) -> str:
    """Return what a student gets: the function without its body, or with the one that is broken, or
    the names without values.
    """
    if isinstance(asked, ValueExercise):
        return _values(asked, dict.fromkeys(asked.asked, "..."))
    assert isinstance(asked, FunctionExercise)
    head = head_of(asked.solution)
    if asked.broken is not None:
        imports = _imports(asked.solution, [asked.broken.__name__])
        return _joined([*imports, f"{head}\n{body_of(asked.broken)}"])
    return _joined(
        [*_imports(asked.solution, [asked.name]), f"{head}\n    raise NotImplementedError"]
    )


def solved(asked: Exercise) -> str:
    """Return a right answer, as it runs by itself."""
    if isinstance(asked, ValueExercise):
        return _values(asked, {name: _written(one) for name, one in asked.asked.items()})
    assert isinstance(asked, FunctionExercise)
    parts = _parts(asked.solution)
    needed = _needed(parts, [asked.name])
    own = [text for name, text in parts.items() if name in needed]
    return _joined([*_imports(asked.solution, needed), *own])


def checked(asked: Exercise) -> str:
    """Return the line that checks an answer."""
    return f'check("{asked.number}", {asked.name})'


def _values(asked: ValueExercise, values: dict[str, str]) -> str:
    lines = [f"{asked.name} = {{"]
    for name, one in asked.asked.items():
        if one.choices:
            words = "one of " + ", ".join(f'"{word}"' for word in one.choices)
            lines += textwrap.wrap(
                words, WIDTH, initial_indent="    # ", subsequent_indent="    # "
            )
        unit = f"  # {one.unit}" if one.unit else ""
        lines.append(f'    "{name}": {values[name]},{unit}')
    return "\n".join([*lines, "}"])


def _written(one: Asked) -> str:
    """A right value with no more digits than its tolerance asks for."""
    if isinstance(one.value, str):
        return f'"{one.value}"'
    texts = (f"{one.value:.{digits}g}" for digits in range(3, 16))
    enough = (text for text in texts if abs(float(text) - one.value) <= one.within / 10)
    return next(enough, repr(one.value))


def head_of(function: Callable) -> str:
    """A function's line and its docstring."""
    lines, whole = _whole(function)
    return "\n".join(lines[whole.lineno - 1 : whole.body[0].end_lineno])


def body_of(function: Callable) -> str:
    """A function's lines behind its docstring."""
    lines, whole = _whole(function)
    return "\n".join(lines[whole.body[0].end_lineno : whole.end_lineno])


def _whole(function: Callable) -> tuple[list[str], ast.FunctionDef]:
    """A function's lines, and what they say."""
    source = textwrap.dedent(inspect.getsource(function))
    (whole,) = ast.parse(source).body
    assert isinstance(whole, ast.FunctionDef)
    if ast.get_docstring(whole) is None:
        raise ValueError(f"{function.__name__}: expected a docstring, which students get")
    return source.splitlines(), whole


@cache
def _module(function: Callable) -> tuple[str, ast.Module, str]:
    """The source of a function's module, what it says, and its package."""
    module = inspect.getmodule(function)
    assert module is not None
    source = inspect.getsource(module)
    return source, ast.parse(source), module.__package__ or ""


@cache
def _parts(function: Callable) -> dict[str, str]:
    """The source of each function and constant of a function's module, by name."""
    source, whole, _ = _module(function)
    lines = source.splitlines()
    parts = {}
    for node in whole.body:
        text = "\n".join(lines[node.lineno - 1 : node.end_lineno])
        if isinstance(node, ast.FunctionDef):
            parts[node.name] = text
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            parts[node.targets[0].id] = text
    return parts


def _needed(parts: dict[str, str], names: Iterable[str]) -> set[str]:
    """Those names, and all of the module that they need."""
    needed: set[str] = set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed.add(name)
            waiting += _used(parts[name]) & set(parts)
    return needed


def _used(source: str) -> set[str]:
    return {node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)}


def _imports(function: Callable, names: Iterable[str]) -> list[str]:
    """The imports of a function's module that these parts of it need, as one text; none if there
    are none.
    """
    _, whole, package = _module(function)
    parts = _parts(function)
    used = set().union(*(_used(parts[name]) for name in names))
    lines = []
    for node in whole.body:
        if not isinstance(node, ast.Import | ast.ImportFrom):
            continue
        aliases = [alias for alias in node.names if _bound(alias) in used]
        if not aliases:
            continue
        if isinstance(node, ast.Import):
            lines.append(ast.unparse(ast.Import(aliases)))
        else:
            name = "." * node.level + (node.module or "")
            name = importlib.util.resolve_name(name, package)
            lines.append(ast.unparse(ast.ImportFrom(name, aliases, 0)))
    return ["\n".join(lines)] if lines else []


def _bound(alias: ast.alias) -> str:
    return (alias.asname or alias.name).partition(".")[0]


def _joined(parts: list[str]) -> str:
    return "\n\n\n".join(parts)
