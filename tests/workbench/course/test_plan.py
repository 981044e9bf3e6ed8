"""The plan of the course knows each exercise, and each objective is served; the plans for teachers agree
with it and with each other.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from workbench.course import plan
from workbench.course.exercises import CHAPTERS, of_chapter
from workbench.pages.course import objective


def test_each_exercise_is_planned_and_each_objective_served():
    planned = plan.planned()
    exercises = [one for chapter in CHAPTERS for one in of_chapter(chapter)]
    assert list(planned) == [one.number for one in exercises]
    served = {key for one in planned.values() for key in one.objectives}
    assert served == set(plan.objectives())
    assert all(5 <= one.minutes <= 180 for one in planned.values())
    assert all("code" in planned[one.number].objectives for one in exercises if one.kind == "write")


def test_an_exercise_that_is_not_there_is_named(monkeypatch, tmp_path):
    (tmp_path / "course.toml").write_text(
        '[objective]\ncode = "Write."\n[exercise]\n"01.9" = { minutes = 5, objectives = ["code"] }\n'
    )
    monkeypatch.setattr(plan, "data_path", lambda *names: tmp_path.joinpath(*names))
    with pytest.raises(ValueError, match=r"do not agree on 01\.1, .*01\.9"):
        plan.planned.__wrapped__()


def test_the_map_names_the_exercises_of_each_objective():
    planned = plan.planned()
    for key, says in plan.objectives().items():
        row = objective(key, says)
        assert set(row["exercises"]) == {no for no, one in planned.items() if key in one.objectives}
        minutes = [planned[number].minutes for number in row["exercises"]]
        assert minutes == sorted(minutes)
        assert row["minutes"] == sum(minutes)


TEACHING = Path(__file__).resolve().parents[3] / "book" / "teaching"
MINUTES = re.compile(r"^> (\d+) to (\d+)\. ", re.MULTILINE)


def teaching(name):
    return (TEACHING / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_lecture_and_lab_fit_their_times_and_the_slides_announce_the_lab(chapter):
    text = teaching("chapters.md").partition(f"\n## {int(chapter)} ")[2].partition("**They must")[0]
    (lecture,) = re.findall(r"a lecture of (?:the )?(\d+)", text)
    (lab_minutes,) = re.findall(r"a\s+lab of (\d+)", text)
    slides = teaching(f"slides/{chapter}.md")
    first, *others = slides.split("\n---\n")
    assert f" {lecture} minutes" in first
    now = 0
    for slide in others:
        times = MINUTES.findall(slide)
        if not times:
            assert "\n> In reserve" in slide
            continue
        ((begin, end),) = times
        assert now == int(begin) < int(end)
        now = int(end) + 5 * ("five minutes of break" in slide)
    assert now == int(lecture)

    planned = plan.planned()
    (row,) = re.findall(rf"^\| {int(chapter)} \| .*", teaching("plans.md"), re.MULTILINE)
    *_, lab, _, _ = row.split("|")
    numbers = re.findall(r"`(\d\d\.\d)`", lab)
    assert all(number.startswith(chapter) for number in numbers)
    installed = 30 if "install (30)" in lab else 0
    needed = installed + sum(planned[number].minutes for number in numbers)
    assert needed <= int(lab_minutes) <= 90
    if chapter not in ("03", "12"):  # the third's end with what is begun in the lecture
        announced = slides.rpartition("Lab: ")[2].partition(" Home")[0]
        assert re.findall(r"\d\d\.\d", announced) == numbers


def test_the_two_days_leave_no_hour_twice():
    """What begins at a time has ended before the next one begins."""
    table = teaching("plans.md").partition("## Two days")[2].partition("\n\nLeft out")[0]
    rows = [row.split("|")[1:4] for row in table.splitlines() if re.match(r"\| *\d", row)]
    for day in (1, 2):
        free = 0
        for row in rows:
            cell = row[day] if ":" in row[day][:7] else row[0]
            hour, minute = re.search(r"(\d+):(\d+)", cell).groups()
            begin = 60 * int(hour) + int(minute)
            assert begin >= free, row
            free = begin + sum(map(int, re.findall(r"(?<=[ (])(\d+)\)", row[day])))


def test_the_lesson_s_table_of_rates():
    """How long lamp and rod count as moving."""
    rows = re.findall(
        r"^\| (0\.\d+) \| (\d+) \| (\d+) frames, ([\d.]+) s \| (\d+) frames, ([\d.]+) s \|$",
        teaching("plans.md"),
        re.MULTILINE,
    )
    assert len(rows) == 4
    for alpha, memory, *cells in rows:
        assert float(memory) == 1 / float(alpha)
        for frames, seconds, jump in ((*cells[:2], 22.5), (*cells[2:], 45.0)):
            # a jump counts until it has faded to T = 15
            left = jump * (1 - float(alpha)) ** np.arange(1000)
            assert int(frames) == np.argmax(left <= 15)
            assert seconds == f"{int(frames) / 30:.1f}"
