"""What the grader says of answers: wrong in two ways, of another kind, right in another form."""

import threading
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from solutions import judged

from workbench.course import check, running
from workbench.course.child import BEING_CHECKED, Call, outcome
from workbench.course.exercises import exercise
from workbench.course.grading import call_of, judge_outcomes
from workbench.course.plain import MOST_NUMBERS, described, equal, plain, shown

FILTER, STEP = exercise("04.2"), exercise("04.3")
lock = threading.Lock()  # what cannot be sent to another process


def in_place(observations, *others):
    means = FILTER.solution(observations, *others)
    observations[0] = 99.0
    return means


def talks(*arguments):
    print("a mean")
    return FILTER.solution(*arguments)


def raises(*_):
    raise IndexError("list index out of range")


def one_off(observations, *others):
    means = FILTER.solution(observations, *others)
    same = np.array_equal(observations, call_of(FILTER).cases[0][0], equal_nan=True)
    return [*means[:-1], means[-1] + 1.0] if same else means


def column_of_doubles(*arguments):
    return 2 * np.array(FILTER.solution(*arguments))[:, None]


def nearly(*arguments):
    X, P = STEP.solution(*arguments)
    P = P.copy()
    P[2, 2] += 1e-5
    return X, P


def nan_while_lost(hand, *others):
    places = exercise("11.3").solution(hand, *others)
    places[np.isnan(hand).any(axis=1)] = np.nan
    return places


def none_for_nan(*arguments):
    point = exercise("08.3").solution(*arguments)
    return None if np.isnan(point).any() else point


def column(*arguments):
    X, P = STEP.solution(*arguments)
    return X[:, None], P


def doubled_column(*arguments):
    X, P = STEP.solution(*arguments)
    return 2 * X[:, None], P


def mixed(*arguments):
    scale, strokes = exercise("11.2").solution(*arguments)
    return [np.array([scale]), strokes]


ALL_SIX = "filter_number agrees with the solution in 6 of 6 cases."


@pytest.mark.parametrize(
    ("number", "function", "right", "words"),
    [
        ("04.2", FILTER.solution, True, [ALL_SIX]),
        ("04.2", talks, True, [ALL_SIX, "It prints something, too"]),
        ("04.2", in_place, False, ["is right, but", "changes its argument observations: work on"]),
        ("04.2", raises, False, ["filter_number([", "raises IndexError: list index out of range."]),
        ("04.2", lambda *_: None, False, ["returns None: does it end in `return`?"]),
        ("04.2", lambda *_: 1.0, False, ["returns a number; an array of the shape ("]),
        ("04.2", one_off, False, ["filter_number(", " 5 of 6 cases are right."]),
        ("04.2", column_of_doubles, False, ["]; [", "is right."]),
        ("04.3", nearly, False, ["number 2 is an array of the shape (6, 6), of which 1 of 36"]),
        ("04.3", nearly, False, ["2 things;", "at [2, 2] it is off by 1e-05"]),
        ("04.3", doubled_column, False, ["returns 2 things; number 1 is [["]),
        ("11.3", nan_while_lost, False, ["(10, 3), of which 6 of 30", "at [2, 0] it is nan; "]),
        ("08.3", none_for_nan, False, ["returns None; [nan, nan, nan] is asked for."]),
        ("04.3", column, True, []),
        ("11.2", mixed, True, []),
        ("08.4", lambda *them: exercise("08.4").solution(*them).T, False, []),
    ],
)
def test_what_is_said_of_a_function(number, function, right, words):
    verdict = judged(exercise(number), function)
    assert verdict.right is right
    assert verdict.points == (verdict.of if right else 0)
    assert all(word in verdict.says for word in words), verdict


def test_an_argument_of_few_numbers_is_shown_and_one_of_many_by_its_shape():
    asked = exercise("03.3")
    frames, times, background, _ = call_of(asked).cases[0]
    assert [np.size(one) for one in (frames, times, background)] == [72, 6, 12]
    call = judged(asked, lambda *_: "words").says.partition(" returns ")[0]
    assert call.startswith("background_after(an array of the shape (6, 3, 4), [0.0333333, ")
    rows = ", ".join(f"[{', '.join(f'{grey:.6g}' for grey in row)}]" for row in background)
    assert f"[{rows}]" in call


def test_a_usual_mistake_is_recognised_although_a_corner_case_fails_too():
    usual = FILTER.mistakes[0]

    def says_without(lost):
        found = [outcome(usual.gives, case) for case in call_of(FILTER).cases]
        for k in lost:
            found[k] = {"raised": "IndexError: out of range", "printed": False, "changed": []}
        return judge_outcomes(FILTER, found).says

    assert says_without([1]) == f"{usual.says} Read chapter {usual.read}."
    assert "raises IndexError" in says_without([0, 1])


def test_what_ended_before_all_cases_were_answered_has_no_point():
    """Judged is what was answered, in all cases."""
    outcomes = [outcome(FILTER.solution, case) for case in call_of(FILTER).cases]
    for count in (0, 1, 5):
        verdict = judge_outcomes(FILTER, outcomes[:count])
        assert not verdict.right
        assert verdict.says == f"filter_number has answered in {count} of 6 cases."
    stuck = [*outcomes[:-1], {"stuck": "ends Python (exit code 3)"}]
    assert judge_outcomes(FILTER, stuck).says == "filter_number ends Python (exit code 3)."


def test_an_error_that_is_asked_for_is_named_where_none_is_raised():
    """No exercise asks for one yet; the grader reads what its solution does."""

    def strict(observations):
        """Refuses what is empty."""
        if not observations:
            raise ValueError("observations: none")
        return sum(observations)

    def refuses_otherwise(observations):
        if not observations:
            raise ValueError("I want some")
        return sum(observations)

    asked = replace(FILTER, solution=strict, cases=lambda rng: [([],), ([1.0],)], mistakes=())
    assert judged(asked, sum).says == ("strict([]) is to raise ValueError. 1 of 2 cases are right.")
    assert judged(asked, refuses_otherwise).right


# How an answer is checked


@pytest.mark.slow
@pytest.mark.parametrize("answer", [in_place, 3.0, lock.acquire])
def test_without_processes_the_verdict_is_the_same(monkeypatch, answer):
    """As in a browser, where the function runs in the session that asks."""
    in_a_process = check("4.2", answer)
    assert not in_a_process.right
    in_a_process_text = repr(in_a_process)
    assert in_a_process_text.startswith("04.2 not yet: ")
    monkeypatch.setattr(running, "HAS_PROCESSES", False)
    monkeypatch.setattr(running, "_run", None)  # nothing is started
    here = check("04.2", answer)
    assert here == in_a_process
    assert repr(here) == f"{in_a_process_text} (Practice, not for marks.)"


def test_without_processes_a_function_changes_nothing_of_the_session(monkeypatch):
    monkeypatch.setattr(running, "HAS_PROCESSES", False)
    session = {"calls": [], "__name__": "__main__"}
    exec("def filter_number(*_):\n    calls.append(1)\n    return len(calls)", session)
    given = {"filter_number": session["filter_number"]}
    found = running.run_given(given, [Call("filter_number", [(), ()])])
    assert [one["returned"]["numbers"] for one in found.outcomes["filter_number"]] == [[1.0], [2.0]]
    assert session["calls"] == []


def test_a_check_of_what_is_no_function_or_no_exercise(monkeypatch):
    assert "to be a function, not a number" in str(check("04.2", 3.0))
    assert "cannot be tried in a process of its own" in str(check("04.2", lambda *_: lock))
    with pytest.raises(ValueError, match=r"there is no exercise '04\.99'"):
        check("04.99", FILTER.solution)
    monkeypatch.setenv(BEING_CHECKED, "1")
    assert str(check("04.2", FILTER.solution)) == ("04.2 not yet: the whole file is being checked.")


# Values


@pytest.mark.parametrize(
    ("number", "given", "says"),
    [
        ("03.1", {"everywhere": "perhaps"}, "everywhere is one of 'yes', 'no'."),
        ("03.1", {"everywhere": 1.0}, "everywhere is one of 'yes', 'no'."),
        ("03.1", {"everywhere": None}, "everywhere is still to be filled in."),
        ("03.1", {"lowest": ""}, "lowest is still to be filled in."),
        ("03.1", {"lowest": 17.0}, "lowest is not 17. Right so far: highest"),
        ("03.1", {"lowest": [16.5, 16.5]}, "lowest is to be a number, not an array of the shape"),
        ("03.1", {"lowest": True}, "lowest is to be a number, not the text 'yes'."),
        ("03.1", {"lowest": np.nan}, "lowest is not nan."),
        ("03.5", {"rod_s": 5.0}, "rod_s is not 5 s."),
        ("04.1", {"Gain": 1}, "Gain is not asked for; the names are gain, mean, variance"),
        ("01.2", {"background": "Both"}, "background is not 'Both'. Which step leads to your"),
        ("04.1", {"variance": 0.8}, "This is the variance before"),
        ("04.1", {"gain": 0.8, "mean": 6.8, "variance": 0.8}, "All of this starts from the first"),
        ("02.1", {"inside": False}, ""),
        ("11.1", {"exchanged": "left and right"}, ""),
    ],
)
def test_a_wrong_value_is_said_without_the_right_one(number, given, says):
    asked = exercise(number)
    verdict = judged(asked, asked.answer | given)
    assert (verdict.right, verdict.points) == (False, 0)
    assert verdict.says.startswith(says)
    assert not any(f" {asked.answer.get(name)}" in verdict.says for name in given)


@pytest.mark.parametrize(
    ("number", "given"),
    [
        ("04.1", {}),
        ("04.1", {"gain": Fraction(4, 9), "variance": np.array([4 / 9]), "mean": [[62 / 9]]}),
        ("02.1", {"inside": True}),
        ("02.1", {"inside": np.True_}),
        ("01.2", {"background": " Neither "}),
        ("11.1", {"exchanged": "near and away, left and right"}),
        ("11.1", {"exchanged": "Left and right, near and away"}),
    ],
)
def test_values_are_right_in_every_form(number, given):
    asked = exercise(number)
    verdict = check(number, asked.answer | given)
    assert (verdict.right, verdict.points) == (True, asked.points)
    assert verdict.says == f"{', '.join(asked.asked)} are right."


def test_what_is_no_mapping_of_values():
    asked = exercise("04.1")
    assert judged(asked, 0.4).says == 'expected {"gain": ..., "mean": ..., "variance": ...}.'
    assert judged(asked, ...).says == "answer_04_1 is still to be filled in."
    assert judged(exercise("06.1"), {"wrong": 0.0625}).says == "wrong is right."


# Plain data


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ([1, 2], np.array([1.0, 2.0]), True),
        ((np.eye(2), None), [[[1, 0], [0, 1]], None], True),
        ([np.nan, 1], [np.nan, 1 + 1e-12], True),
        ([], np.zeros((0, 2)), True),
        ([1e-12, 0.0], [0.0, 0.0], True),
        ([1, 2], [[1], [2]], True),
        (3, [[3.0]], True),
        ([1, 2], [[1, 2], [1, 2]], False),
        ([[1, 2], [3, 4]], [1, 2, 3, 4], False),
        (None, 0.0, False),
        (Rotation.from_rotvec([0, 0, 1.0]), Rotation.from_rotvec([0, 0, 1.0]).as_matrix(), True),
        (RigidTransform.from_translation([1, 2, 3]), np.eye(4), False),
        (RigidTransform.identity(), np.eye(4), True),
    ],
)
def test_what_is_returned_is_compared_by_what_it_is(one, other, same):
    assert equal(plain(one), plain(other), 1e-9) is same


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "None"),
        (True, "a number"),
        ([[1, 2], [3, 4]], "an array of the shape (2, 2)"),
        ((1.0, None), "2 things: a number, None"),
        ({1}, "a value of the type set"),
        ("left", "the text 'left'"),
        (np.zeros(MOST_NUMBERS), "an array of the shape (100000,)"),
        (np.zeros(MOST_NUMBERS + 1), "an array of 100001 numbers"),
    ],
)
def test_what_is_returned_is_named_by_its_kind(value, words):
    assert described(plain(value)) == words


def test_what_rounding_leaves_is_shown_as_nothing():
    assert shown(plain([1.0, 1e-17, -0.0, 2817.7])) == "[1, 0, 0, 2817.7]"
