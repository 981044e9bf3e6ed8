"""The exercises of the chapters, four and more a chapter.

Those that are answered with values are in ``data/exercises``, a file per chapter. Those for which a
function is written have a module a chapter: the solution, the cases on which an answer is tried, and
the usual mistakes as wrong functions, with the tuple `EXERCISES` at its end. Texts and hints stand in
the chapters.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module

from trinolab.datasets import data_path

from ..exercise import Exercise
from ..values import read_values

__all__ = ["CHAPTERS", "exercise", "of_chapter"]

# of each chapter the module, by the chapter's number
CHAPTERS = {
    "01": "structure",
    "02": "workspace",
    "03": "background",
    "04": "kalman",
    "05": "markers",
    "06": "matching",
    "07": "calibration",
    "08": "pose",
    "09": "table1",
    "10": "estimators",
    "11": "slave",
    "12": "feedback",
}


def exercise(number: str) -> Exercise:
    """Return the exercise of a number like ``04.2``; ValueError if there is none."""
    chapter, _, place = str(number).partition(".")
    chapter = chapter.zfill(2)  # 4.2 is 04.2
    if chapter not in CHAPTERS:
        raise ValueError(f"number: there is no chapter {chapter!r}; they are {', '.join(CHAPTERS)}")
    for one in of_chapter(chapter):
        if one.number == f"{chapter}.{place}":
            return one
    numbers = ", ".join(one.number for one in of_chapter(chapter))
    raise ValueError(f"number: there is no exercise {number!r}; chapter {chapter} has {numbers}")


@cache
def of_chapter(chapter: str) -> tuple[Exercise, ...]:
    """Return the exercises of a chapter, in their order; ValueError if there is no such chapter."""
    if chapter not in CHAPTERS:
        raise ValueError(f"chapter: expected one of {', '.join(CHAPTERS)}, got {chapter!r}")
    values = read_values(data_path("exercises", f"{chapter}.toml"))
    functions = import_module(f".{CHAPTERS[chapter]}", __name__).EXERCISES
    return tuple(sorted((*values, *functions), key=lambda one: one.number))
