"""An answer is right in whatever form it is: single precision, columns, fractions, True for "yes"."""

from fractions import Fraction

import numpy as np
import pytest

from workbench.course.child import outcome, plain_value
from workbench.course.exercises import exercise
from workbench.course.grading import call_of, judge_outcomes, judge_values


def single(value):
    if isinstance(value, tuple):
        return tuple(map(single, value))
    return np.asarray(value, dtype=np.float32)


@pytest.mark.parametrize("number", ["03.3", "04.2", "04.3", "08.4", "09.3", "09.4", "11.2"])
def test_single_precision_is_right(number):
    asked = exercise(number)
    found = [outcome(lambda *a: single(asked.solution(*a)), case) for case in call_of(asked).cases]
    assert judge_outcomes(asked, found).right


def test_columns_are_right_and_a_transposed_matrix_is_not():
    step = exercise("04.3")

    def column(*arguments):
        X, P = step.solution(*arguments)
        return X[:, None], P

    def turned(*arguments):
        R = exercise("08.4").solution(*arguments)
        return R.T

    assert judge_outcomes(step, [outcome(column, case) for case in call_of(step).cases]).right
    fit = exercise("08.4")
    assert not judge_outcomes(fit, [outcome(turned, case) for case in call_of(fit).cases]).right


def test_one_of_two_numbers_may_be_an_array_of_one():
    asked = exercise("11.2")

    def mixed(*arguments):
        scale, strokes = asked.solution(*arguments)
        return [np.array([scale]), strokes]

    assert judge_outcomes(asked, [outcome(mixed, case) for case in call_of(asked).cases]).right


def says(number, **given):
    return judge_values(exercise(number), plain_value(exercise(number).answer | given))


def test_values_are_right_in_every_form():
    assert says("04.1", gain=Fraction(4, 9), variance=np.array([4 / 9]), mean=[[62 / 9]]).right
    assert says("02.1", inside=True).right
    assert says("02.1", inside=np.True_).right
    assert not says("02.1", inside=False).right
    for words in ("near and away, left and right", "Left and right, near and away"):
        assert says("11.1", exchanged=words).right
    assert not says("11.1", exchanged="left and right").right


def test_who_starts_from_the_first_guess_in_everything_is_told_so():
    verdict = says("04.1", gain=0.8, mean=6.8, variance=0.8)
    assert verdict.says.startswith("All of this starts from the first guess again.")
    assert says("04.1", variance=0.8).says.startswith("This is the variance before")


def test_none_in_place_of_nan_is_named():
    asked = exercise("08.3")

    def none(*arguments):
        point = asked.solution(*arguments)
        return None if np.isnan(point).any() else point

    verdict = judge_outcomes(asked, [outcome(none, case) for case in call_of(asked).cases])
    assert "returns None; [nan, nan, nan] is asked for." in verdict.says
    assert "does it end in" not in verdict.says
