"""A sample of what `make verify` does to the solutions: a slip of the pen is not taken for right."""

import pytest
from mutants import HARMLESS, exercises, mutants, survives

EVERY = 5  # one of so many
FUNCTIONS = {one.number: one for one in exercises()}


@pytest.mark.parametrize("number", FUNCTIONS)
def test_a_slip_of_the_pen_is_refused(number):
    asked = FUNCTIONS[number]
    every = 12 if number in ("05.3", "12.3") else EVERY  # these compute for long
    sample = list(mutants(asked))[::every]
    assert sample
    left = {words for words, function in sample if survives(asked, function)}
    assert {words for words in left if (number, words) not in HARMLESS} == set()


def test_what_is_named_as_harmless_has_a_reason_and_is_made():
    made = {(number, words) for number, one in FUNCTIONS.items() for words, _ in mutants(one)}
    assert len(made) >= 200
    assert set(HARMLESS) <= made
    assert all(HARMLESS.values())
