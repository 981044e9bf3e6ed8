"""The plan of the course knows each exercise, and each objective is served."""

import pytest

from workbench.course import plan
from workbench.course.exercises import CHAPTERS, of_chapter
from workbench.pages import course_pages


def test_each_exercise_is_planned_and_each_objective_served():
    planned = plan.planned()
    assert list(planned) == [one.number for chapter in CHAPTERS for one in of_chapter(chapter)]
    served = {key for one in planned.values() for key in one.objectives}
    assert served == set(plan.objectives())
    assert all(5 <= one.minutes <= 180 for one in planned.values())
    kinds = {one.number: one.kind for chapter in CHAPTERS for one in of_chapter(chapter)}
    assert all(
        "code" in one.objectives for number, one in planned.items() if kinds[number] == "write"
    )


def test_an_exercise_that_is_not_there_is_named(monkeypatch, tmp_path):
    (tmp_path / "course.toml").write_text(
        '[objective]\ncode = "Write."\n[exercise]\n"01.9" = { minutes = 5, objectives = ["code"] }\n'
    )
    monkeypatch.setattr(plan, "data_path", lambda *names: tmp_path.joinpath(*names))
    with pytest.raises(ValueError, match=r"do not agree on 01\.1, .*01\.9"):
        plan.planned.__wrapped__()


def test_the_map_names_the_exercises_of_each_objective():
    rows = course_pages.objectives_table().split("* - *")[1:]
    assert len(rows) == len(plan.objectives())
    for key, row in zip(plan.objectives(), rows, strict=True):
        assert row.startswith(f"{key}*")
        wanted = {number for number, one in plan.planned().items() if key in one.objectives}
        cell = row.split("\n  - ")[2]
        assert set(cell.strip().split(", ")) == wanted
