"""Numbers of the teacher's guide: the chapters with their exercises, and for each the wrong answers that
the grader knows.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..course.editions import chapter_file, exercises_of, self_contained
from ..course.exercise import Exercise
from ..course.exercises import CHAPTERS, of_chapter
from ..course.plan import objectives, planned
from ..course.texts import ExerciseText
from ..sweep.notebook import read_notebook


def course() -> dict[str, Any]:
    """The chapters, the objectives, the projects and the open designs."""
    return {
        "chapters": {chapter: chapter_numbers(chapter) for chapter in CHAPTERS},
        "objectives": [objective(key, says) for key, says in objectives().items()],
        "projects": [
            {"number": one.number, "title": one.title, "answer": full_answer(path, text)}
            for path, one, text in _of_kind("project")
        ],
        "designs": [
            {"number": one.number, "title": one.title, "levels": levels(path, one, text)}
            for path, one, text in _of_kind("design")
        ],
    }


def chapter_numbers(chapter: str) -> dict[str, Any]:
    """Page, reading time and exercises of a chapter."""
    path = chapter_file(chapter)
    exercises = [
        {
            "number": one.number,
            "kind": one.kind,
            "title": one.title,
            "points": one.points,
            "minutes": planned()[one.number].minutes,
            "mistakes": [mistake.says for mistake in one.mistakes],
        }
        for one in of_chapter(chapter)
    ]
    return {"page": path.stem, "minutes": reading_minutes(path), "exercises": exercises}


def reading_minutes(path: Path) -> int:
    """Minutes that a chapter takes to read, from its own card."""
    text = "\n".join(cell.source for cell in read_notebook(path).cells)
    match = re.search(r"\*\*Time:\*\* (\d+) minutes", text)
    if match is None:
        raise ValueError(f"{path}: its card says no time: expected **Time:** 35 minutes")
    return int(match[1])


def objective(key: str, says: str) -> dict[str, Any]:
    """An objective and the exercises that serve it, the longest ones last."""
    minutes = {number: one.minutes for number, one in planned().items() if key in one.objectives}
    serving = sorted(minutes, key=lambda number: (minutes[number], number))
    return {"key": key, "says": says, "exercises": serving, "minutes": sum(minutes.values())}


def full_answer(path: Path, text: ExerciseText) -> str:
    """Contents of a full answer to a project, from its solution."""
    found = re.search(r"^A full answer (?:has )?(.+)$", text.solution, re.MULTILINE)
    if found is None:
        raise ValueError(f"{path}: {text.number}: its solution has no full answer")
    return self_contained(found[1])


def levels(path: Path, one: Exercise, text: ExerciseText) -> list[tuple[str, str]]:
    """Points and description of each level of an open design."""
    found = re.findall(r"^\| (\d) \| (.+) \|$", text.statement, re.MULTILINE)
    if not found or int(found[0][0]) != one.points:
        raise ValueError(f"{path}: {one.number}: its rubric has no level of all points")
    return [(points, self_contained(design)) for points, design in found]


def _of_kind(kind: str) -> Iterator[tuple[Path, Exercise, ExerciseText]]:
    """The exercises of a kind: the chapter's file, the exercise, and what stands there of it."""
    for chapter in CHAPTERS:
        path = chapter_file(chapter)
        for one, text in exercises_of(chapter, read_notebook(path), path.name):
            if one.kind == kind:
                yield path, one, text
