"""What the grader says to answers: wrong in two ways, of another kind, right but not all of it."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from workbench.course import check, running
from workbench.course.child import BEING_CHECKED, Call, outcome, plain_value
from workbench.course.exercises import exercise
from workbench.course.grading import call_of, judge_outcomes, judge_values
from workbench.course.plain import plain, shown

FILTER = exercise("04.2")
lock = threading.Lock()  # what cannot be sent to another process


def judged(asked, function):
    """The verdict on a function, in this process: the code is ours."""
    return judge_outcomes(asked, [outcome(function, case) for case in call_of(asked).cases])


def says_of(answer, number="03.1"):
    """What is said of values."""
    return judge_values(exercise(number), plain_value(answer)).says


def talks_and_changes(observations, mean, variance, growth, noise):
    print("a mean")
    observations[0] = 99.0
    return [mean]


def raises(*_):
    raise IndexError("list index out of range")


@pytest.mark.slow
@pytest.mark.parametrize(
    "answer",
    [FILTER.solution, FILTER.mistakes[0].gives, talks_and_changes, raises, 3.0, lock.acquire],
)
def test_without_processes_the_verdict_is_the_same(monkeypatch, answer):
    """As in a browser, where the function runs in the session that asks."""
    in_a_process = check("04.2", answer)
    in_a_process_text = repr(in_a_process)
    monkeypatch.setattr(running, "HAS_PROCESSES", False)
    monkeypatch.setattr(running, "_run", None)  # nothing is started
    here = check("04.2", answer)
    assert here == in_a_process
    assert "marks" not in in_a_process_text
    assert repr(here) == f"{in_a_process_text} (Practice, not for marks.)"


def test_without_processes_a_function_changes_nothing_of_the_session(monkeypatch):
    monkeypatch.setattr(running, "HAS_PROCESSES", False)
    session = {"calls": [], "__name__": "__main__"}
    exec("def filter_number(*_):\n    calls.append(1)\n    return len(calls)", session)
    found = running.run_given(
        {"filter_number": session["filter_number"]}, [Call("filter_number", [(), ()])]
    )
    assert [one["returned"]["numbers"] for one in found.outcomes["filter_number"]] == [[1.0], [2.0]]
    assert session["calls"] == []


def test_a_usual_mistake_is_recognised_although_a_corner_case_fails_too():
    asked = exercise("04.2")
    usual = asked.mistakes[0]
    cases = call_of(asked).cases

    def with_corners(lost):
        found = [outcome(usual.gives, case) for case in cases]
        for k in lost:
            found[k] = {
                "raised": "IndexError: list index out of range",
                "printed": False,
                "changed": [],
            }
        return judge_outcomes(asked, found).says

    assert with_corners([1]) == f"{usual.says} Read chapter {usual.read}."
    assert "raises IndexError" in with_corners([0, 1])


def test_who_changes_an_argument_is_told_which_and_has_no_point():
    def in_place(observations, mean, variance, growth, noise):
        means = FILTER.solution(observations, mean, variance, growth, noise)
        observations[0] = 99.0
        return means

    verdict = judged(FILTER, in_place)
    assert (verdict.right, verdict.points) == (False, 0)
    assert verdict.says == (
        "the result is right, but filter_number changes its argument observations: work on a copy."
    )


def test_who_prints_has_all_points_and_is_told_so():
    def talks(*arguments):
        print("a mean")
        return FILTER.solution(*arguments)

    verdict = judged(FILTER, talks)
    assert (verdict.right, verdict.points) == (True, FILTER.points)
    assert verdict.says == (
        "filter_number agrees with the solution in 6 of 6 cases. It prints something, too; to "
        "return the result is enough."
    )


def test_a_notebook_shows_the_verdict_as_a_line():
    verdict = judged(FILTER, FILTER.solution)
    assert repr(verdict) == ("04.2 right: filter_number agrees with the solution in 6 of 6 cases.")


def test_a_function_without_return_is_asked_for_one():
    assert judged(FILTER, lambda *_: None).says == (
        "filter_number returns None: does it end in `return`?"
    )


def test_what_was_stuck_in_one_case_is_said_whatever_the_others_gave():
    outcomes = [outcome(FILTER.solution, case) for case in call_of(FILTER).cases[:-1]]
    outcomes.append({"stuck": "ends Python (exit code 3)"})
    assert judge_outcomes(FILTER, outcomes).says == "filter_number ends Python (exit code 3)."


def test_a_case_that_alone_is_wrong_is_shown_with_how_many_are_right():
    def one_off(observations, *others):
        means = FILTER.solution(observations, *others)
        first = call_of(FILTER).cases[0][0]
        same = np.array_equal(observations, first, equal_nan=True)
        return [*means[:-1], means[-1] + 1.0] if same else means

    says = judged(FILTER, one_off).says
    assert says.startswith("filter_number(")
    assert says.endswith(" 5 of 6 cases are right.")


def test_an_argument_of_few_numbers_is_shown_and_one_of_many_by_its_shape():
    asked = exercise("03.3")
    frames, times, background, _ = call_of(asked).cases[0]
    assert [np.size(one) for one in (frames, times, background)] == [72, 6, 12]
    call = judged(asked, lambda *_: "words").says.partition(" returns ")[0]
    assert call.startswith("background_after(an array of the shape (6, 3, 4), [0.0333333, ")
    rows = ", ".join(f"[{', '.join(f'{grey:.6g}' for grey in row)}]" for row in background)
    assert f"[{rows}]" in call


def test_another_number_of_things_is_said_in_words():
    assert "returns a number; an array of the shape (" in judged(FILTER, lambda *_: 1.0).says


def test_a_column_of_wrong_numbers_is_told_the_numbers_and_not_the_form():
    """A column is right where its numbers are."""

    def column(*arguments):
        return 2 * np.array(FILTER.solution(*arguments))[:, None]

    says = judged(FILTER, column).says
    assert "is asked for" not in says
    assert says.endswith("is right.")


def test_of_many_numbers_the_first_wrong_one_is_shown_also_where_it_is_nan():
    asked = exercise("11.3")

    def nan_while_lost(hand, *others):
        places = asked.solution(hand, *others)
        places[np.isnan(hand).any(axis=1)] = np.nan
        return places

    says = judged(asked, nan_while_lost).says
    assert "an array of the shape (10, 3), of which 6 of 30 numbers are wrong: at [2, 0] it" in says
    assert "it is nan; " in says


def test_what_rounding_leaves_is_shown_as_nothing():
    assert shown(plain([1.0, 1e-17, -0.0, 2817.7])) == "[1, 0, 0, 2817.7]"


def test_an_error_that_is_asked_for_is_named_where_none_is_raised():
    """No exercise asks for one yet; the grader reads what its solution does."""

    def strict(observations):
        """Refuses what is empty."""
        if not observations:
            raise ValueError("observations: none")
        return sum(observations)

    asked = replace(FILTER, solution=strict, cases=lambda rng: [([],), ([1.0],)], mistakes=())
    assert judged(asked, sum).says == ("strict([]) is to raise ValueError. 1 of 2 cases are right.")

    def refuses_otherwise(observations):
        if not observations:
            raise ValueError("I want some")
        return sum(observations)

    assert judged(asked, refuses_otherwise).right


def test_the_check_of_a_cell_waits_while_the_whole_file_is_checked(monkeypatch):
    monkeypatch.setenv(BEING_CHECKED, "1")
    assert str(check("04.2", FILTER.solution)) == ("04.2 not yet: the whole file is being checked.")


def test_values_are_checked_where_they_are():
    asked = exercise("04.1")
    verdict = check("04.1", asked.answer)
    assert (verdict.right, verdict.points) == (True, asked.points)
    assert verdict.says == "gain, mean, variance are right."


def test_one_value_alone_is_right_in_the_singular():
    assert says_of({"wrong": 0.0625}, "06.1") == "wrong is right."


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"everywhere": "perhaps"}, "everywhere is one of 'yes', 'no'."),
        ({"everywhere": 1.0}, "everywhere is one of 'yes', 'no'."),
        ({"everywhere": None}, "everywhere is still to be filled in."),
        ({"lowest": ""}, "lowest is still to be filled in."),
        ({"lowest": 17.0}, "lowest is not 17."),
        ({"lowest": [16.5, 16.5]}, "lowest is to be a number, not an array of the shape (2,)."),
        ({"lowest": True}, "lowest is to be a number, not the text 'yes'."),
        ({"lowest": np.nan}, "lowest is not nan."),
    ],
)
def test_a_value_that_is_none_of_the_asked_for_is_said_without_the_right_one(given, says):
    found = says_of(exercise("03.1").answer | given)
    assert found.startswith(says)
    assert "16.5" not in found


def test_a_word_is_read_whatever_its_case_and_the_wrong_one_asks_back():
    right = exercise("01.2").answer
    assert says_of(right | {"background": " Neither "}, "01.2").endswith("are right.")
    assert says_of(right | {"background": "Both"}, "01.2").startswith(
        "background is not 'Both'. Which step leads to your choice?"
    )


def test_a_wrong_number_is_said_with_the_unit_that_is_asked_for():
    right = exercise("03.5").answer
    assert says_of(right | {"rod_s": 5.0}, "03.5").startswith("rod_s is not 5 s.")
