"""Parts of the teacher's guide: the table of the chapters, and for each its exercises with the wrong
answers that the grader knows.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from trinolab.files.outputs import write_whole

from ..course.editions import chapter_file, exercises_of, self_contained
from ..course.exam import exam
from ..course.exercise import Exercise
from ..course.exercises import CHAPTERS, of_chapter
from ..course.plan import objectives, planned
from ..course.texts import ExerciseText
from ..sweep.notebook import read_notebook
from .claims_pages import escaped, list_table


def write_pages(folder: Path) -> None:
    """Write all parts, from the chapters and from the modules of exercises."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "chapters.md", chapters_table() + "\n")
    write_whole(folder / "objectives.md", objectives_table() + "\n")
    write_whole(folder / "projects.md", projects_table() + "\n")
    write_whole(folder / "designs.md", designs_table() + "\n")
    for seed, version in enumerate("ab"):
        write_whole(folder / f"exam_{version}.md", exam(seed, solutions=True))
    for chapter in CHAPTERS:
        write_whole(folder / f"{chapter}.md", exercises_list(chapter) + "\n")


def chapters_table() -> str:
    """A row per chapter: what it is called, how long one reads, how many exercises, their points."""
    rows = []
    minutes, number, points = 0, 0, 0
    for chapter in CHAPTERS:
        path = chapter_file(chapter)
        exercises = of_chapter(chapter)
        rows.append(
            (
                f"{{doc}}`/notebooks/{path.stem}`",
                str(reading_minutes(path)),
                str(len(exercises)),
                str(sum(one.points for one in exercises)),
            )
        )
        minutes += reading_minutes(path)
        number += len(exercises)
        points += sum(one.points for one in exercises)
    rows.append(("together", str(minutes), str(number), str(points)))
    head = ("chapter", "minutes to read", "exercises", "points")
    return list_table(head, rows, "55 15 15 15", "chapters", raw=True)


def reading_minutes(path: Path) -> int:
    """How long a chapter takes to read, by its own card."""
    text = "\n".join(cell.source for cell in read_notebook(path).cells)
    match = re.search(r"\*\*Time:\*\* (\d+) minutes", text)
    if match is None:
        raise ValueError(f"{path}: its card says no time: expected **Time:** 35 minutes")
    return int(match[1])


def exercises_list(chapter: str) -> str:
    """A row per exercise: its points, its minutes, and what the grader says to each wrong answer that it
    knows.
    """
    rows = [
        (
            f"{one.number} {one.kind}: {escaped(one.title)}",
            str(one.points),
            str(planned()[one.number].minutes),
            mistakes(one),
        )
        for one in of_chapter(chapter)
    ]
    return list_table(
        (
            "exercise",
            "points",
            "minutes",
            "wrong answers that are recognised, and what is said to them",
        ),
        rows,
        "25 8 8 59",
        "exercises",
        raw=True,
    )


def objectives_table() -> str:
    """A row an objective: what it says, and the exercises that serve it, the longest ones last."""
    rows = []
    for key, says in objectives().items():
        serving = [number for number, one in planned().items() if key in one.objectives]
        serving.sort(key=lambda number: (planned()[number].minutes, number))
        minutes = sum(planned()[number].minutes for number in serving)
        rows.append((f"*{key}*", escaped(says), ", ".join(serving), str(minutes)))
    head = ("objective", "at the end a student can", "exercises", "minutes")
    return list_table(head, rows, "12 40 38 10", "objectives", raw=True)


def projects_table() -> str:
    """A row a project of the chapters: what a full answer has, by its solution."""
    rows = []
    for path, one, text in _of_kind("project"):
        found = re.search(r"^A full answer (?:has )?(.+)$", text.solution, re.MULTILINE)
        if found is None:
            raise ValueError(f"{path}: {one.number}: its solution has no full answer")
        rows.append((f"{one.number} {escaped(one.title)}", self_contained(found[1])))
    return list_table(("project", "a full answer has"), rows, "22 78", "projects", raw=True)


def designs_table() -> str:
    """A row a level of each open design of the chapters: its points, and what is there."""
    rows = []
    for path, one, text in _of_kind("design"):
        levels = re.findall(r"^\| (\d) \| (.+) \|$", text.statement, re.MULTILINE)
        if not levels or int(levels[0][0]) != one.points:
            raise ValueError(f"{path}: {one.number}: its rubric has no level of all points")
        rows += [
            (f"{one.number} {escaped(one.title)}", points, self_contained(design))
            for points, design in levels
        ]
    head = ("open design", "points", "a design that")
    return list_table(head, rows, "22 8 70", "designs", raw=True)


def _of_kind(kind: str) -> Iterator[tuple[Path, Exercise, ExerciseText]]:
    """The exercises of a kind: the chapter's file, the exercise, and what stands there of it."""
    for chapter in CHAPTERS:
        path = chapter_file(chapter)
        for one, text in exercises_of(chapter, read_notebook(path), path.name):
            if one.kind == kind:
                yield path, one, text


def mistakes(one: Exercise) -> str:
    """What is said to the usual mistakes, each in a line of its own within a table's cell."""
    said = [f"({k}) {escaped(it.says)}" for k, it in enumerate(one.mistakes, start=1)]
    return "\n\n".join(said)
