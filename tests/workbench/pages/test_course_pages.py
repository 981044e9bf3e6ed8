"""The teacher's guide shows the chapters and what the graders know."""

import re

import pytest
from chapters import LESSONS, STUDIES
from pages import table_of

from workbench.course.exercises import CHAPTERS, of_chapter
from workbench.pages.course import reading_minutes
from workbench.pages.template import escaped
from workbench.sweep.notebook import read_notebook

WITH_A_STUDY = [path for path in LESSONS if path.stem[:2] in {study.stem[:2] for study in STUDIES}]


WORDS_A_MINUTE = 130  # of a text with formulas
LINES_A_MINUTE = 12  # of code: five seconds per line
FOLDED = {"hide-input", "hide-cell", "remove-input", "remove-cell"}


def test_every_known_mistake_is_listed(page):
    text = page("teaching/chapters")
    for chapter in CHAPTERS:
        for one in of_chapter(chapter):
            assert f"* - {one.number} {one.kind}" in text
            listed = text.split(f"* - {one.number} ")[1].split("* - ")[0]
            assert listed.count("\n    (") + 1 == len(one.mistakes), one.number
            assert listed.count(escaped(one.mistakes[-1].says)) == 1, one.number


def test_the_table_adds_up(page):
    rows = table_of(page("teaching/index"), "chapters")
    numbers = [[int(cell) for cell in row[1:]] for row in rows]
    assert len(numbers) == len(CHAPTERS) + 1
    assert numbers[-1] == [sum(column) for column in zip(*numbers[:-1], strict=True)]
    assert numbers[3][0] == 40, "chapter 4 says 40 minutes"


def measured_minutes(path):
    """How long a lesson takes to read, by its words and unfolded lines of code up to its exercises."""
    words, lines = 0, 0
    for cell in read_notebook(path).cells:
        if cell.cell_type == "markdown":
            text, exercises, _ = cell.source.partition("## Exercises")
            unfolded = re.sub(r"^(```+|:::+)\{dropdown\}.*?^\1$", "", text, flags=re.M | re.S)
            words += len(unfolded.split())
            if exercises:
                break
        elif not FOLDED & set(cell.metadata.get("tags", [])):
            lines += sum(bool(line.strip()) for line in cell.source.splitlines())
    return words / WORDS_A_MINUTE + lines / LINES_A_MINUTE


@pytest.mark.parametrize("path", WITH_A_STUDY, ids=lambda path: path.stem)
def test_a_lesson_takes_the_minutes_that_its_card_says(path):
    said = reading_minutes(path)
    measured = measured_minutes(path)
    assert said <= 45
    assert abs(measured - said) <= 5, f"{path.stem}: {measured:.0f} minutes by words and lines"


def test_each_open_design_has_a_rubric_with_levels(page):
    rows = table_of(page("teaching/rubrics"), "designs")
    designs = [one for chapter in CHAPTERS for one in of_chapter(chapter) if one.kind == "design"]
    assert len(designs) == 6
    for one in designs:
        levels = [row for row in rows if row[0].startswith(one.number)]
        points = [int(row[1]) for row in levels]
        assert points == sorted(points, reverse=True)
        assert points[0] == one.points
        assert len(set(points)) == len(levels) >= 4
