"""The plan of the course knows each exercise, and each objective is served."""

import re
from pathlib import Path

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


TEACHING = Path(__file__).resolve().parents[3] / "book" / "teaching"
MINUTES = re.compile(r"^> (\d+) to (\d+)\. ", re.MULTILINE)


def teaching(name):
    return (TEACHING / name).read_text(encoding="utf-8")


def of_lecture(chapter):
    """What the notes to a chapter say of its lecture and of its lab, min."""
    text = teaching("chapters.md").partition(f"\n## {int(chapter)} ")[2].partition("**They must")[0]
    (lecture,) = re.findall(r"a lecture of (?:the )?(\d+)", text)
    (lab,) = re.findall(r"a\s+lab of (\d+)", text)
    return int(lecture), int(lab)


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_the_minutes_of_the_slides_add_up_to_the_lecture(chapter):
    first, *slides = teaching(f"slides/{chapter}.md").split("\n---\n")
    lecture, _ = of_lecture(chapter)
    assert f" {lecture} minutes" in first
    now = 0
    for slide in slides:
        times = MINUTES.findall(slide)
        if not times:
            assert "\n> In reserve" in slide
            continue
        ((begin, end),) = times
        assert int(begin) == now
        assert int(end) > int(begin)
        now = int(end) + 5 * ("five minutes of break" in slide)
    assert now == lecture


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_the_lab_of_a_week_fits_its_time_and_the_slides_announce_it(chapter):
    planned = plan.planned()
    (row,) = re.findall(rf"^\| {int(chapter)} \| .*", teaching("plans.md"), re.MULTILINE)
    *_, lab, _, _ = row.split("|")
    numbers = re.findall(r"`(\d\d\.\d)`", lab)
    assert all(number.startswith(chapter) for number in numbers)
    _, minutes = of_lecture(chapter)
    installed = 30 if "install (30)" in lab else 0
    assert installed + sum(planned[number].minutes for number in numbers) <= minutes <= 90
    if chapter != "03":  # its slides end with the exercise that is begun in the lecture
        announced = teaching(f"slides/{chapter}.md").rpartition("Lab: ")[2].partition(" Home")[0]
        assert re.findall(r"\d\d\.\d", announced) == numbers or chapter == "12"


def test_the_two_days_leave_no_hour_twice():
    """What begins at a time has ended before the next one begins."""
    table = teaching("plans.md").partition("## Two days")[2].partition("\n\nLeft out")[0]
    rows = [row.split("|")[1:4] for row in table.splitlines() if re.match(r"\| *\d", row)]
    for day in (1, 2):
        free = 0
        for row in rows:
            hour, minute = re.findall(r"(\d+):(\d+)", row[day] if ":" in row[day][:7] else row[0])[
                0
            ]
            begin = 60 * int(hour) + int(minute)
            assert begin >= free, row
            free = begin + sum(map(int, re.findall(r"(?<=[ (])(\d+)\)", row[day])))


def test_the_lesson_by_the_minute_has_no_gap():
    text = teaching("plans.md").partition("### Minute by minute")[2]
    times = re.findall(r"^\| (\d+)-(\d+) \|", text, re.MULTILINE)
    assert [begin for begin, _ in times] == ["0", *(end for _, end in times[:-1])]
    assert times[-1][1] == "90"


def test_the_slides_name_hand_outs_that_are_there():
    """By their numbers, and each of the hand-outs is named by its own lecture."""
    chapters = re.findall(r"^## (\d)\. .*\(chapter (\d+)\)", teaching("handouts.md"), re.MULTILINE)
    named = {
        (number, str(int(chapter)))
        for chapter in CHAPTERS
        for number in re.findall(r"[Hh]and-out (\d)", teaching(f"slides/{chapter}.md"))
    }
    assert named == set(chapters)
