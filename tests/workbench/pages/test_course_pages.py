"""The parts of the teacher's guide that come from the chapters and the graders."""

import re

import pytest
from chapters import LESSONS, STUDIES

from workbench.course.exercises import CHAPTERS, of_chapter
from workbench.pages import course_pages
from workbench.sweep.notebook import read_notebook

WORDS_A_MINUTE = 130  # of a text with formulas
LINES_A_MINUTE = 12  # of code: five seconds per line
FOLDED = {"hide-input", "hide-cell", "remove-input", "remove-cell"}
WITH_A_STUDY = [path for path in LESSONS if path.stem[:2] in {study.stem[:2] for study in STUDIES}]


def test_every_known_mistake_is_listed():
    for chapter in CHAPTERS:
        page = course_pages.exercises_list(chapter)
        for one in of_chapter(chapter):
            assert f"* - {one.number} {one.kind}" in page
            listed = page.split(f"* - {one.number} ")[1].split("* - ")[0]
            assert listed.count("\n    (") + 1 == len(one.mistakes), one.number
            assert listed.count(course_pages.escaped(one.mistakes[-1].says)) == 1, one.number


def test_the_table_adds_up():
    rows = [row.split("\n  - ") for row in course_pages.chapters_table().split("* - ")[2:]]
    numbers = [[int(cell.rstrip("`\n")) for cell in row[1:]] for row in rows]
    assert len(numbers) == len(CHAPTERS) + 1
    assert numbers[-1] == [sum(column) for column in zip(*numbers[:-1], strict=True)]
    assert numbers[3][0] == 40, "chapter 4 says 40 minutes"


def measured_minutes(path):
    """How long a lesson takes to read, by its words and lines of code up to its exercises.

    A page of text with formulas is read at `WORDS_A_MINUTE`, and code that is not folded at
    `LINES_A_MINUTE`.
    """
    words, lines = 0, 0
    for cell in read_notebook(path).cells:
        if cell.cell_type == "markdown":
            text, exercises, _ = cell.source.partition("## Exercises")
            words += len(
                re.sub(r"^(```+|:::+)\{dropdown\}.*?^\1$", "", text, flags=re.M | re.S).split()
            )
            if exercises:
                break
        elif not FOLDED & set(cell.metadata.get("tags", [])):
            lines += sum(bool(line.strip()) for line in cell.source.splitlines())
    return words / WORDS_A_MINUTE + lines / LINES_A_MINUTE


@pytest.mark.parametrize("path", WITH_A_STUDY, ids=lambda path: path.stem)
def test_a_lesson_takes_the_minutes_that_its_card_says(path):
    said = course_pages.reading_minutes(path)
    measured = measured_minutes(path)
    assert said <= 45
    assert abs(measured - said) <= 5, f"{path.stem}: {measured:.0f} minutes by words and lines"


def test_each_open_design_has_a_rubric_with_levels():
    rows = [row.split("\n  - ") for row in course_pages.designs_table().split("* - ")[2:]]
    designs = [one for chapter in CHAPTERS for one in of_chapter(chapter) if one.kind == "design"]
    assert len(designs) == 6
    for one in designs:
        levels = [row for row in rows if row[0].startswith(one.number)]
        points = [int(row[1]) for row in levels]
        assert points == sorted(points, reverse=True)
        assert points[0] == one.points
        assert len(set(points)) == len(levels) >= 4
