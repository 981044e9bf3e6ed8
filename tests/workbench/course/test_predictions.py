"""A first guess is kept before the run, and a wrong one counts as the teacher's guide says."""

import json

import pytest

from workbench.course import check
from workbench.course.child import plain_value
from workbench.course.exercises import exercise
from workbench.course.grading import judge_values
from workbench.course.predictions import KEPT, first_guesses

ASKED = exercise("02.4")
WORDS = {"volume": "smaller", "stays": "the errors"}
NUMBERS = {name: value for name, value in ASKED.answer.items() if name not in WORDS}
DOTS = dict.fromkeys(NUMBERS, ...)


@pytest.fixture(autouse=True)
def beside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_prediction_is_kept_before_the_run_and_nothing_is_said_of_it(tmp_path):
    verdict = check("02.4", DOTS | WORDS)
    assert not verdict.right
    assert "Your prediction is kept, of 20" in verdict.says
    assert "volume = smaller" in verdict.says
    assert "larger" not in verdict.says
    kept = first_guesses(tmp_path)["02.4"]
    assert (kept["words"], kept["before"]) == (WORDS, True)
    check("02.4", DOTS | WORDS | {"volume": "larger"})
    assert first_guesses(tmp_path)["02.4"] == kept
    # the run came out otherwise: all points, and the reason
    verdict = check("02.4", NUMBERS | WORDS)
    assert (verdict.right, verdict.points) == (True, 3)
    assert "volume has come out otherwise than predicted, and" in verdict.says
    assert "Axes that are more parallel meet farther away" in verdict.says
    # another wrong word than the one that was predicted, or a wrong number, is wrong
    assert not check("02.4", NUMBERS | WORDS | {"volume": "the same"}).right
    assert not check("02.4", NUMBERS | WORDS | {"poses": 5.0}).right
    assert check("02.4", ASKED.answer).right


def test_a_guess_beside_the_numbers_or_none_or_half_of_one_is_no_prediction(tmp_path):
    assert not judge_values(ASKED, plain_value(NUMBERS | WORDS)).right
    check("02.4", {"volume": "larger", "stays": ...})
    check("02.4", {"volume": "perhaps", "stays": "the errors"})
    assert first_guesses(tmp_path) == {}
    for _ in range(2):
        assert not check("02.4", NUMBERS | WORDS).right
    assert first_guesses(tmp_path)["02.4"]["before"] is False


def test_what_is_no_file_of_guesses_counts_for_nothing(tmp_path):
    good = {"words": WORDS, "at": "2026-01-01T00:00:00", "before": True}
    for text in ("", "[", "4", '{"02.4": 3}', '{"02.4": {"words": {"a": 1}}}', "[" * 50_000):
        (tmp_path / KEPT).write_text(text)
        assert first_guesses(tmp_path) == {}
    (tmp_path / KEPT).write_text(json.dumps({"02.4": good, "03.5": 1}))
    assert first_guesses(tmp_path) == {"02.4": good}
