"""What the pages get of exercises and sweeps, and what the session does with it, without a browser."""

import json
import math
import re
import sys
import types

import pytest

from workbench.browser import exercises, sweeps
from workbench.browser.guest import answers, door, session, sweeping
from workbench.course.exercises import CHAPTERS, exercise, of_chapter
from workbench.course.stubs import solved
from workbench.pages.build import chapters
from workbench.sweep.outcome import FAILED, NO_NUMBER, OK

KALMAN = next(path for path in chapters() if path.stem == "04_kalman")
PARTS = {
    "chapter": "toy",
    "parameter": "a",
    "defaults": {"a": 1.0},
    "verdicts": ["words"],
    "once": {
        "1": "from myst_nb import glue\nimport math\ntaken = []\ndef twice(x):\n    return 2 * x * scale",
        "2": "a = 1.0\ndel a",
        "3": "glue('before', 7)",
    },
    "each": {
        "4": "scale = 10\ntaken.append(a)\nglue('result', twice(a))\nglue('taken', len(taken))",
        "5": "glue('root', math.sqrt(a) if a >= 0 else math.nan)\nglue('words', 'of no number')\n"
        "glue('odd', [a]) if a == 3 else None\nassert a != 4, 'four'",
    },
}


@pytest.fixture
def page(monkeypatch):
    """The other side of the door, in Python: what is handed out."""
    outputs = []

    def call(frame):
        header, _ = door._unpack(frame)
        outputs.append(json.loads(json.dumps(header["output"], allow_nan=False)))
        return door._pack({}, [])

    monkeypatch.setattr(door, "_call", call)
    monkeypatch.setattr(session, "namespace", {"__name__": "__main__"})
    return outputs


@pytest.fixture
def toy(page, monkeypatch, tmp_path):
    """A session that has prepared the sweep of a small chapter."""
    monkeypatch.setitem(sys.modules, "myst_nb", types.ModuleType("myst_nb"))
    for name in ("_sweep", "_glued"):
        monkeypatch.setattr(sweeping, name, {})
    monkeypatch.setattr(sweeping, "_state", None)
    monkeypatch.setattr(sweeping, "SWEEP", tmp_path / "sweep.json")
    monkeypatch.setattr(sweeping, "ROWS", tmp_path / "rows.json")
    sweeping.SWEEP.write_text(json.dumps(PARTS))
    sweeping.prepare()
    return page


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_each_exercise_of_a_chapter_has_its_beginning_and_no_solution(chapter):
    path = next(path for path in chapters() if path.stem.startswith(f"{chapter}_"))
    rows = exercises.exercises_of(path)
    assert [row["number"] for row in rows] == [one.number for one in of_chapter(chapter)]
    for row in rows:
        assert row["check"] == f'check("{row["number"]}", {row["name"]})'
        assert row["name"] in row["source"]
        # a repair's solution may be the first part of what is handed out, but for a line's end
        assert f"{solved(exercise(row['number']))}\n" not in f"{row['source']}\n"


def test_a_page_gets_its_exercises_and_one_without_the_place_of_one_is_refused():
    rows = exercises.exercises_of(KALMAN)
    places = "".join(f'<div id="{row["label"]}"></div>' for row in rows)
    page = exercises.with_exercises(f"<head></head>{places}", rows)
    (data,) = re.findall(r'id="browser-exercises">(.*?)</script>', page)
    assert json.loads(data) == rows
    with pytest.raises(ValueError, match=r"exercise 04\.1: ex-kalman-gain is not on"):
        exercises.with_exercises("<head></head>", rows)
    study = next(path for path in chapters() if path.stem == "05b_centroid")
    assert exercises.exercises_of(study) == []
    assert exercises.with_exercises("<head></head>", []) == "<head></head>"


def test_a_value_is_graded_and_its_verdict_handed_out(page):
    session.namespace["answer_04_1"] = exercise("04.1").answer
    answers.grade("04.1", "answer_04_1")
    answers.grade("04.1", "not_there")
    right, missing = page
    assert (right["type"], right["right"]) == ("verdict", True)
    assert right["text"] == "04.1 right: gain, mean, variance are right."
    assert not missing["right"]
    assert missing["text"] == "04.1 not yet: answer_04_1 is still to be filled in."


@pytest.mark.slow
@pytest.mark.parametrize("stem", sweeps.SWEEPS)
def test_a_chapter_is_cut_into_what_runs_once_and_each_time(stem):
    part = sweeps.part_of(next(path for path in chapters() if path.stem == stem))
    parameter = sweeps.SWEEPS[stem].parameter
    assert any(f"\ndel {parameter}" in source for source in part["once"].values())
    assert not set(part["once"]) & set(part["each"])
    assert "glue(" in "".join(part["each"].values())
    assert part["defaults"][parameter] in sweeps.SWEEPS[stem].values


@pytest.mark.slow
def test_runs_of_another_version_have_another_key():
    path = next(path for path in chapters() if path.stem == "06_matching")
    keys = [
        re.search(r'"made_from": "(\w+)"', sweeps.with_sweep("<head></head>", path, version))[1]
        for version in ("one", "one", "other")
    ]
    assert keys[0] == keys[1]
    assert keys[1] != keys[2]
    assert sweeps.with_sweep("<head></head>", KALMAN, "one") == "<head></head>"


@pytest.mark.parametrize("more", [{}, {"6": "some = (k for k in range(3))"}])
def test_each_run_begins_with_what_ran_once(toy, more):
    """Copies of it; what cannot be copied runs again."""
    sweeping.SWEEP.write_text(json.dumps({**PARTS, "once": {**PARTS["once"], **more}}))
    sweeping.prepare()
    for value in (2, 0.5, 2):
        sweeping.run(value)
    first, second, third = (output["results"] for output in toy)
    words = {"words": "of no number"}
    assert first == {"before": 7, "result": 40, "taken": 1, "root": math.sqrt(2), **words}
    assert second == {"before": 7, "result": 10.0, "taken": 1, "root": math.sqrt(0.5), **words}
    assert third == first
    assert {output["status"] for output in toy} == {OK}


def test_a_run_that_raises_has_failed_and_the_next_is_as_if_nothing_were(toy):
    for value in (4, 3, -1.0):
        sweeping.run(value)
    four, three, negative = toy
    assert (four["status"], four["error"]) == (FAILED, "AssertionError: four (code cell 5)")
    assert (three["status"], three["error"]) == (NO_NUMBER, "odd is no number: [3]")
    assert negative["results"]["root"] is None  # JSON has no NaN
    with pytest.raises(ValueError, match="a: expected float"):
        sweeping.run("text")


@pytest.mark.slow
def test_the_runs_are_drawn_and_listed(toy):
    for value in (1.0, 2.0, -1.0):
        sweeping.run(value)
    rows = [
        {"value": value, "outcome": {name: it for name, it in one.items() if name != "type"}}
        for value, one in zip((1.0, 2.0, -1.0), toy, strict=True)
    ]
    sweeping.ROWS.write_text(json.dumps({"parameter": "a", "rows": rows}))
    sweeping.draw()
    head, *lines = toy[-1]["csv"].splitlines()
    assert head == "a,before,result,taken,root,words,seconds,status,error"
    assert [line.split(",")[2] for line in lines] == ["20.0", "40.0", "-20.0"]
    assert lines[2].split(",")[4] == ""
    assert toy[-1]["alt"].startswith("Curves over a of result, root")
    assert toy[-1]["png"].startswith("iVBOR")
    assert toy[-1]["table"].count("<tr") == 4
