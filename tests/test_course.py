"""Exercises and their graders: every solution passes, every stub fails, every mistake is known."""

import json
import shutil
from itertools import combinations

import numpy as np
import pytest

from trinolab.cli import main
from trinolab.course import check
from trinolab.course.child import outcome, plain_value
from trinolab.course.exercise import KINDS, FunctionExercise, ValueExercise
from trinolab.course.exercises import CHAPTERS, exercise, of_chapter
from trinolab.course.grading import call_of, judge_outcomes, judge_values
from trinolab.course.plain import equal, plain
from trinolab.course.running import run_given

ALL = [one for chapter in CHAPTERS for one in of_chapter(chapter)]


def judged(asked, answer):
    """The verdict on an answer, in this process: the code is ours."""
    if isinstance(asked, ValueExercise):
        return judge_values(asked, plain_value(answer))
    return judge_outcomes(asked, [outcome(answer, case) for case in call_of(asked).cases])


def stub(*_):
    raise NotImplementedError


def test_every_solution_passes():
    assert [one.number for one in ALL if not judged(one, one.answer).right] == []


def test_every_stub_fails_and_is_told_so():
    for one in ALL:
        answer = stub if isinstance(one, FunctionExercise) else dict.fromkeys(one.asked, ...)
        verdict = judged(one, answer)
        assert not verdict.right, one.number
        assert "still to be" in verdict.says, verdict


def test_every_mistake_is_recognised():
    """Each one by its own words: no two of an exercise give the same."""
    for one in ALL:
        assert len(one.mistakes) >= 3, one.number
        for mistake in one.mistakes:
            answer = mistake.gives
            if isinstance(one, ValueExercise):
                assert set(answer) <= set(one.asked), one.number
                answer = one.answer | answer
            verdict = judged(one, answer)
            assert not verdict.right, (one.number, mistake.says)
            assert verdict.says == f"{mistake.says} Read chapter {mistake.read}.", one.number


def test_no_answer_is_told_apart_by_a_hair():
    """A wrong value lies well beyond the tolerance of the right one, and of another wrong one."""
    for one in ALL:
        if not isinstance(one, ValueExercise):
            continue
        for name, asked in one.asked.items():
            if isinstance(asked.value, str):
                assert asked.value in asked.choices, one.number
                continue
            wrong = [it.gives[name] for it in one.mistakes if name in it.gives]
            assert all(abs(value - asked.value) > 2 * asked.within for value in wrong), one.number


def test_exercises_are_whole():
    assert len({one.number for one in ALL}) == len(ALL)
    for chapter in CHAPTERS:
        exercises = of_chapter(chapter)
        assert [one.number for one in exercises] == [
            f"{chapter}.{k}" for k in range(1, len(exercises) + 1)
        ]
        for one in exercises:
            assert one.kind in KINDS
            assert one.points > 0
            for text in (mistake.says for mistake in one.mistakes):
                assert text.endswith((".", "?")), text


def test_the_function_of_a_notebook_is_checked_in_a_process_of_its_own():
    asked = exercise("04.2")
    assert check("04.2", asked.solution).right

    def wrong(observations, mean, variance, growth, noise):
        print("look")
        return [mean for _ in observations]

    assert str(check("04.2", wrong)).startswith("04.2 not yet: filter_number(")
    assert "to be a function, not a number" in str(check("04.2", 3.0))
    with pytest.raises(ValueError, match=r"there is no exercise '04\.99'"):
        check("04.99", wrong)


def changes(numbers):
    numbers[0] = 7
    return 7


def ends(numbers):
    import os

    os._exit(3)


def hangs(numbers):
    while True:
        pass


def waits(numbers):
    import time

    time.sleep(1e6)


def asks(numbers):
    return input("now? ")


def outcomes_of(function, **limits):
    from trinolab.course.child import Call

    given = {"function": function, "after": len}
    calls = [Call("function", [([1, 2],), ([3],)]), Call("after", [([1, 2],)])]
    found = run_given(given, calls, **limits)
    assert found.outcomes["after"][0]["returned"]["numbers"] == [2.0]
    return found.outcomes["function"]


def test_whatever_a_function_does_is_seen_and_the_next_one_is_tried():
    assert outcomes_of(ends) == [{"stuck": "ends Python (exit code 3)"}]
    assert outcomes_of(hangs, cpu_s=1.0)[0]["stuck"].startswith("does not end: it was stopped")
    assert outcomes_of(waits, wait_s=8.0)[0]["stuck"].startswith("does not end: it was stopped")
    assert outcomes_of(asks)[0]["raised"].startswith("EOFError")
    assert [one["changed"] for one in outcomes_of(changes)] == [[0], [0]]


def test_what_is_returned_is_compared_by_what_it_is():
    assert equal(plain([1, 2]), plain(np.array([1.0, 2.0])), 1e-9)
    assert equal(plain((np.eye(2), None)), plain([[[1, 0], [0, 1]], None]), 1e-9)
    assert equal(plain([np.nan, 1]), plain([np.nan, 1 + 1e-12]), 1e-9)
    assert not equal(plain([1, 2]), plain([[1, 2]]), 1e-9)
    assert not equal(plain(None), plain(0.0), 1e-9)
    assert plain(object()) == "a value of the type object"


def notebook(*sources):
    cells = [{"cell_type": "code", "source": source} for source in sources]
    return json.dumps({"cells": cells, "nbformat": 4, "nbformat_minor": 5, "metadata": {}})


RIGHT = "answer_04_1 = {'gain': 0.444, 'mean': 6.889, 'variance': 0.444}"


def test_a_notebook_is_checked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "04_kalman.ipynb"
    file.write_text(notebook("%matplotlib inline\n1 / 0", RIGHT, "def filter_number(*a): return 3"))
    assert main(["check", "04"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "04.1 right: gain, mean, variance are right."
    assert lines[1].startswith("04.2 not yet: filter_number(")
    assert lines[-1].startswith("2 of ")
    file.write_text(notebook("1 / 0"))
    assert main(["check", "04"]) == 1
    first = capsys.readouterr().out.splitlines()[0]
    assert first == (
        "04.1 not yet: answer_04_1 is not there; cell 1 raises ZeroDivisionError: division by zero."
    )


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["04"], "expected one file 04*.ipynb or 04*.py, found none"),
        (["99"], "expected one of"),
        (["04", "nowhere.ipynb"], "nowhere.ipynb: there is no such file"),
        (["04", "broken.ipynb"], "broken.ipynb: is no notebook that can be read"),
        ([], "expected a chapter, as in 04, or --all"),
        (["--all", "nowhere"], "nowhere: expected a folder"),
    ],
)
def test_a_mistake_of_the_caller_is_one_line(tmp_path, monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.ipynb").write_text("{")
    assert main(["check", *arguments]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said


def test_a_class_is_checked_once(tmp_path, capsys):
    for name, source in (("ada", RIGHT), ("bob", "answer_04_1 = {'gain': 0.5}")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "04_kalman.ipynb").write_text(notebook(source))
    assert main(["check", "--all", str(tmp_path)]) == 0
    rows = (tmp_path / "points.csv").read_text().splitlines()
    assert rows[0].startswith("student,04.1,04.2,")
    assert rows[1].startswith("ada,2,0,")
    assert rows[2].startswith("bob,0,0,")
    kept = tmp_path / ".checked.jsonl"
    before = kept.read_text()
    # nothing is checked again: what is kept is taken, here with other points
    kept.write_text(before.replace('"points": 2', '"points": 1'))
    shutil.copytree(tmp_path / "ada", tmp_path / "eve")
    assert main(["check", "--all", str(tmp_path)]) == 0
    rows = (tmp_path / "points.csv").read_text().splitlines()
    assert [row.split(",")[:2] for row in rows[1:]] == [["ada", "1"], ["bob", "0"], ["eve", "2"]]


def test_no_two_mistakes_of_an_exercise_say_the_same():
    for one in ALL:
        for a, b in combinations(one.mistakes, 2):
            assert a.says != b.says, one.number
