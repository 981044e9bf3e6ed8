"""What the course is for, and for each exercise its objectives and minutes: ``data/course.toml``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from trinolab.datasets import data_path
from trinolab.files.inputs import get, read_toml

from .exercises import CHAPTERS, of_chapter


@dataclass(frozen=True)
class Planned:
    """An exercise as a part of the course.

    Attributes
    ----------
    minutes
        That a pair of students needs, by the authors' estimate.
    objectives
        The keys of those that it serves.
    """

    minutes: int
    objectives: tuple[str, ...]


@cache
def objectives() -> dict[str, str]:
    """The objectives of the course: key -> what a student can do at its end."""
    path = data_path("course.toml")
    return dict(get(read_toml(path), "objective", str(path)))


@cache
def planned() -> dict[str, Planned]:
    """The exercises' numbers, in their order, with what the plan says of each.

    Raises
    ------
    ValueError
        The plan lacks an exercise, has one that there is not, or names an unknown objective.
    """
    path = data_path("course.toml")
    rows = get(read_toml(path), "exercise", str(path))
    numbers = [one.number for chapter in CHAPTERS for one in of_chapter(chapter)]
    if odd := sorted(set(rows) ^ set(numbers)):
        raise ValueError(f"{path}: the plan and the exercises do not agree on {', '.join(odd)}")
    plan = {
        number: Planned(
            get(rows[number], "minutes", f"{path}: {number}"),
            tuple(get(rows[number], "objectives", f"{path}: {number}")),
        )
        for number in numbers
    }
    for number, one in plan.items():
        if unknown := sorted(set(one.objectives) - set(objectives())):
            raise ValueError(f"{path}: {number}: no such objective: {', '.join(unknown)}")
    return plan
