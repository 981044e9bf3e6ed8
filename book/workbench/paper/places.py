"""Where an equation is: its functions with file and line, its tests, its chapter. What `trinolab eq`
prints.
"""

from __future__ import annotations

import ast
from pathlib import Path

import trinolab

from .ledger import Entry, load_ledger


def equation(number: int) -> Entry:
    """The ledger's entry of an equation. ValueError if the paper has none of that number."""
    for entry in load_ledger():
        if entry.no == str(number):
            return entry
    raise ValueError(f"the paper has the equations 1 to 27, got {number}")


def list_lines() -> list[str]:
    """A line for each equation: its number, and the functions that compute it."""
    return [
        f"{entry.no:>2s}  {', '.join(_short(name) for name in entry.functions)}"
        for entry in load_ledger()
        if entry.no.isdigit()
    ]


def place_lines(entry: Entry) -> list[str]:
    """What is to be known of one equation, as lines for a terminal."""
    lines = [f"{entry.name}, Sect. {entry.section}: {entry.status}"]
    lines += [f"function  {_short(name)}  {_file_and_line(name)}" for name in entry.functions]
    lines += [f"test      {test}" for test in entry.tests]
    return [*lines, f"chapter   notebooks/{entry.chapter}.ipynb"]


def _short(name: str) -> str:
    return name.removeprefix("trinolab.")


def _file_and_line(name: str) -> str:
    """The place of a function or a class, read from its module's text: importing it would load SciPy."""
    *folders, module, attribute = name.split(".")
    root = Path(trinolab.__file__).resolve().parents[1]
    path = root.joinpath(*folders, f"{module}.py")
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == attribute:
            line = min([node.lineno, *(one.lineno for one in node.decorator_list)])
            return f"{path.relative_to(root).as_posix()}:{line}"
    raise ValueError(f"{name}: the ledger names what is not there")
