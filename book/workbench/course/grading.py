"""Judge an answer: right, which of the usual mistakes, or what else is wrong with it."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from . import running
from .child import BEING_CHECKED, Call, outcome, plain_value
from .exercise import Asked, Exercise, FunctionExercise, Mistake, ValueExercise
from .plain import (
    MOST_SHOWN,
    described,
    equal,
    is_array,
    plain,
    printable,
    same_form,
    shown,
    wrong_numbers,
)
from .predictions import is_predicted, keep_guess

SEED = 0  # of the cases


class Verdict(NamedTuple):
    """What is said of an answer."""

    number: str
    right: bool
    points: int
    of: int
    says: str

    def __str__(self) -> str:
        text = f"{self.number} {'right' if self.right else 'not yet'}: {self.says}"
        return text if running.HAS_PROCESSES else f"{text} (Practice, not for marks.)"

    def __repr__(self) -> str:
        return str(self)


def check(number: str, answer: Any) -> Verdict:
    """Check an answer to an exercise, offline.

    The function runs in a process of its own. One that hangs, raises, prints or changes its
    arguments gets a line that says so.

    Parameters
    ----------
    number
        Of the exercise, as in ``"04.2"``.
    answer
        Your function, or a mapping from the names that the exercise gives to your values.

    Returns
    -------
    Verdict
        Whether it is right, or else which mistake it is and where to read. A notebook shows it.
    """
    if BEING_CHECKED in os.environ:  # where the exercises cannot be read
        return Verdict(str(number), False, 0, 0, "the whole file is being checked.")
    from .exercises import exercise

    asked = exercise(number)
    if isinstance(asked, ValueExercise):
        values = plain_value(answer)
        return judge_values(asked, values, _kept_guess(asked, values))
    assert isinstance(asked, FunctionExercise)
    if not callable(answer):
        return _not_yet(asked, f"{asked.name} is to be a function, not {described(plain(answer))}.")
    try:
        outcome_of_run = running.run_given({asked.name: answer}, [call_of(asked)])
    except ValueError as error:  # it cannot be sent to another process
        return _not_yet(asked, f"{error}.")
    if outcome_of_run.stuck:
        return _not_yet(asked, f"{outcome_of_run.stuck}.")
    return judge_outcomes(asked, outcome_of_run.outcomes[asked.name])


def _kept_guess(asked: ValueExercise, answer: Any) -> Mapping[str, Any] | None:
    """The first guess to an exercise that asks for a prediction, beside the notebook; that of this
    answer if it is the first whole one.
    """
    if not is_predicted(asked) or not isinstance(answer, dict) or "mapping" not in answer:
        return None
    given = answer["mapping"]
    words = {name: given.get(name) for name, one in asked.asked.items() if one.choices}
    if not all(
        isinstance(word, str) and _word(word) in map(_word, asked.asked[name].choices)
        for name, word in words.items()
    ):
        return None
    numbers = [given.get(name) for name, one in asked.asked.items() if not one.choices]
    before = all(value is None or _is_dots(value) for value in numbers)
    return keep_guess(asked.number, words, before, Path())


def call_of(asked: FunctionExercise) -> Call:
    """The function of an exercise and the cases on which it is tried."""
    return Call(asked.name, asked.cases(np.random.default_rng(SEED)))


def judge_outcomes(asked: FunctionExercise, outcomes: Sequence[Mapping[str, Any]]) -> Verdict:
    """Judge what a function did in its cases.

    Parameters
    ----------
    asked
        The exercise.
    outcomes
        As `running.Found` has them.
    """
    cases = call_of(asked).cases
    expected = [outcome(asked.solution, case) for case in cases]
    if stuck := next((one["stuck"] for one in outcomes if "stuck" in one), None):
        return _not_yet(asked, f"{asked.name} {stuck}.")
    if len(outcomes) != len(cases):
        says = f"{asked.name} has answered in {len(outcomes)} of {len(cases)} cases."
        return _not_yet(asked, says)
    wrong = [k for k, one in enumerate(outcomes) if not _same(one, expected[k], asked.within)]
    if not wrong:
        return _right(asked, outcomes)
    if _is_unrepaired(asked, outcomes, cases):
        says = f"{asked.name} is still to be repaired: it does what it did when you got it."
        return _not_yet(asked, says)
    if mistake := _recognised(asked, outcomes, cases, wrong):
        return _not_yet(asked, f"{mistake.says} Read chapter {mistake.read}.")
    first = wrong[0]
    says = _difference(asked, cases[first], outcomes[first], expected[first])
    if len(wrong) < len(cases):
        says += f" {len(cases) - len(wrong)} of {len(cases)} cases are right."
    return _not_yet(asked, says)


def _right(asked: FunctionExercise, outcomes: Sequence[Mapping[str, Any]]) -> Verdict:
    changed = next((one["changed"] for one in outcomes if one["changed"]), None)
    if changed:
        name = asked.solution.__code__.co_varnames[changed[0]]
        says = f"the result is right, but {asked.name} changes its argument {name}: work on a copy."
        return _not_yet(asked, says)
    says = f"{asked.name} agrees with the solution in {len(outcomes)} of {len(outcomes)} cases."
    if any(one["printed"] for one in outcomes):
        says += " It prints something, too; to return the result is enough."
    return Verdict(asked.number, True, asked.points, asked.points, says)


def _same(one: Mapping[str, Any], other: Mapping[str, Any], within: float) -> bool:
    if "raised" in one or "raised" in other:
        kinds = [str(it.get("raised", "")).partition(":")[0] for it in (one, other)]
        return kinds[0] == kinds[1]
    return equal(one["returned"], other["returned"], within)


def _is_unrepaired(
    asked: FunctionExercise, outcomes: Sequence[Mapping[str, Any]], cases: Sequence[tuple]
) -> bool:
    """Whether the function gives what the broken one gives."""
    if asked.broken is None:
        return False
    given = [outcome(asked.broken, case) for case in cases]
    return all(_same(*pair, asked.within) for pair in zip(outcomes, given, strict=True))


def _recognised(
    asked: FunctionExercise,
    outcomes: Sequence[Mapping[str, Any]],
    cases: Sequence[tuple],
    wrong: Sequence[int],
) -> Mistake | None:
    """The mistake that gives the same in all cases, or else in all but one: who makes a usual mistake
    may have missed a corner case as well. Two wrong results have to be the same.
    """
    nearly = None
    for mistake in asked.mistakes:
        assert callable(mistake.gives)
        given = [outcome(mistake.gives, case) for case in cases]
        same = [_same(*pair, asked.within) for pair in zip(outcomes, given, strict=True)]
        if all(same):
            return mistake
        if sum(same) == len(cases) - 1 and sum(same[k] for k in wrong) >= 2:
            nearly = nearly or mistake
    return nearly


def _difference(
    asked: FunctionExercise, case: tuple, got: Mapping[str, Any], wanted: Mapping[str, Any]
) -> str:
    """What is wrong in a case, in one line."""
    call = f"{asked.name}({', '.join(_brief(plain(argument)) for argument in case)})"
    if "raised" in got:
        if got["raised"].startswith("NotImplementedError"):
            return f"{asked.name} is still to be written."
        return f"{call} raises {got['raised']}."
    if "raised" in wanted:
        return f"{call} is to raise {wanted['raised'].partition(':')[0]}."
    a, b = got["returned"], wanted["returned"]
    if a is None:
        if is_array(b) and not np.isfinite(b["numbers"]).any():
            return f"{call} returns None; {shown(b)} is asked for."
        return f"{asked.name} returns None: does it end in `return`?"
    if not same_form(a, b):
        return f"{call} returns {described(a)}; {described(b)} is asked for."
    return f"{call} returns {_numbers_apart(a, b, asked.within)}"


def _numbers_apart(a: Any, b: Any, within: float) -> str:
    """What is wrong with a result that has the form which is asked for. Of many numbers the first
    wrong one is shown, with its place.
    """
    if isinstance(b, list):
        place, pair = next(
            (k, pair)
            for k, pair in enumerate(zip(a, b, strict=True), start=1)
            if not equal(*pair, within)
        )
        return f"{len(b)} things; number {place} is {_numbers_apart(*pair, within)}"
    if is_array(b) and len(b["numbers"]) > MOST_SHOWN:
        places = np.argwhere(wrong_numbers(a, b, within))
        at = tuple(map(int, places[0]))
        number, right = (float(np.reshape(one["numbers"], b["shape"])[at]) for one in (a, b))
        off = abs(number - right)
        text = f"off by {off:.2g}" if off <= 1e-4 * abs(right) else f"{number:.6g}"
        return (
            f"{described(b)}, of which {len(places)} of {len(b['numbers'])} numbers are wrong: at "
            f"{list(at)} it is {text}; {right:.6g} is right."
        )
    if shown(a) == shown(b):
        return f"{shown(a)}, which is off by up to {_largest_difference(a, b):.2g}."
    return f"{shown(a)}; {shown(b)} is right."


def _brief(argument: Any) -> str:
    """An argument in a line with others: of many numbers only how many there are."""
    if is_array(argument):
        return described(argument) if len(argument["numbers"]) > MOST_SHOWN else shown(argument)
    text = shown(argument)
    return text if len(text) <= 80 else f"{text[:76]} ..."


def _largest_difference(one: Any, other: Any) -> float:
    """Between two plain values that look alike in few characters."""
    if not is_array(one):
        return 0.0
    return float(np.nanmax(np.abs(np.subtract(one["numbers"], other["numbers"])), initial=0.0))


def judge_values(
    asked: ValueExercise, answer: Any, guess: Mapping[str, Any] | None = None
) -> Verdict:
    """Judge a mapping of values, as plain data.

    Parameters
    ----------
    asked
        The exercise.
    answer
        As `child.plain_value` has it.
    guess
        The first guess, as `predictions` keeps it.
    """
    names = ", ".join(asked.asked)
    if answer is None or _is_dots(answer):
        return _not_yet(asked, f"{asked.name} is still to be filled in.")
    if not (isinstance(answer, dict) and "mapping" in answer):
        form = ", ".join(f'"{name}": ...' for name in asked.asked)
        return _not_yet(asked, f"expected {{{form}}}.")
    given = answer["mapping"]
    if unknown := [name for name in given if name not in asked.asked]:
        return _not_yet(asked, f"{unknown[0]} is not asked for; the names are {names}.")
    empty = [name for name in asked.asked if given.get(name) is None or _is_dots(given[name])]
    if empty:
        says = f"{', '.join(empty)} is still to be filled in."
        return _not_yet(asked, f"{_of_guess(guess)} {says}".strip())
    wrong = [name for name, one in asked.asked.items() if not _fits(given[name], one)]
    if not wrong:
        says = f"{names} {'is' if len(asked.asked) == 1 else 'are'} right."
        return Verdict(asked.number, True, asked.points, asked.points, _with_guess(says, guess))
    mistake = _mistake_of(asked, given, wrong)
    explained = f"{mistake.says} Read chapter {mistake.read}." if mistake else ""
    if _is_own_guess(asked, given, wrong, guess):
        names = ", ".join(wrong)
        says = f"{names} has come out otherwise than predicted, and the prediction counts."
        whole = _with_guess(f"{says} {explained}".strip(), guess).replace("?.", "?")
        return Verdict(asked.number, True, asked.points, asked.points, printable(whole))
    if mistake:
        return _not_yet(asked, explained)
    says = _wrong_value(wrong[0], given[wrong[0]], asked.asked[wrong[0]])
    if rest := [name for name in asked.asked if name not in wrong]:
        says += f" Right so far: {', '.join(rest)}."
    return _not_yet(asked, says)


def _mistake_of(
    asked: ValueExercise, given: Mapping[str, Any], wrong: Sequence[str]
) -> Mistake | None:
    """The mistake that explains most of the values that are wrong."""
    best, most = None, 0
    for mistake in asked.mistakes:
        assert isinstance(mistake.gives, Mapping)
        made = [
            _fits(given[name], _as_asked(value, asked.asked[name]))
            for name, value in mistake.gives.items()
        ]
        explains = len(set(mistake.gives) & set(wrong)) if all(made) else 0
        if explains > most:
            best, most = mistake, explains
    return best


def _is_own_guess(
    asked: ValueExercise,
    given: Mapping[str, Any],
    wrong: Sequence[str],
    guess: Mapping[str, Any] | None,
) -> bool:
    """Whether all that is wrong is a prediction that was made before the numbers stood there."""
    if guess is None or not guess["before"] or not is_predicted(asked):
        return False
    return all(
        asked.asked[name].choices
        and isinstance(given[name], str)
        and _word(given[name]) in map(_word, asked.asked[name].choices)
        and _word(given[name]) == _word(guess["words"].get(name, ""))
        for name in wrong
    )


def _of_guess(guess: Mapping[str, Any] | None) -> str:
    """What is kept of a prediction, in words."""
    if guess is None:
        return ""
    words = ", ".join(f"{name} = {word}" for name, word in guess["words"].items())
    when = "" if guess["before"] else ", beside the numbers"
    return f"Your prediction is kept, of {guess['at']}{when}: {words}."


def _with_guess(says: str, guess: Mapping[str, Any] | None) -> str:
    return f"{says} {_of_guess(guess)}".strip()


def _is_dots(value: Any) -> bool:
    return isinstance(value, str) and value in ("", "...", "a value of the type ellipsis")


def _as_asked(value: float | str, right: Asked) -> Asked:
    """A wrong value, with the tolerance of the right one as a share of its size."""
    if isinstance(value, str) or isinstance(right.value, str):
        return Asked(value, choices=right.choices)
    if not right.value:
        return Asked(value, right.unit, right.within)
    share = right.within / abs(right.value)
    return Asked(value, right.unit, max(share * abs(value), 1e-12))


def _fits(value: Any, asked: Asked) -> bool:
    if isinstance(asked.value, str):
        return isinstance(value, str) and _word(value) == _word(asked.value)
    if not is_array(value) or len(value["numbers"]) != 1:
        return False
    return abs(value["numbers"][0] - asked.value) <= asked.within


def _word(text: str) -> tuple[str, ...]:
    """A choice, whatever its letters' case, and whatever the order of its parts."""
    parts = re.split(r",|\band\b", text.lower())
    return tuple(sorted(part.strip() for part in parts if part.strip()))


def _wrong_value(name: str, value: Any, asked: Asked) -> str:
    """What is wrong with a value, without the right one."""
    if asked.choices:
        if not isinstance(value, str) or _word(value) not in map(_word, asked.choices):
            return f"{name} is one of {', '.join(map(repr, asked.choices))}."
        return f"{name} is not {value.strip()!r}. Which step leads to your choice?"
    if not is_array(value) or len(value["numbers"]) != 1:
        return f"{name} is to be a number, not {described(value)}."
    unit = f" {asked.unit}" if asked.unit else ""
    return f"{name} is not {value['numbers'][0]:.6g}{unit}."


def _not_yet(asked: Exercise, says: str) -> Verdict:
    # a heading to read may be a question
    return Verdict(asked.number, False, 0, asked.points, printable(says.replace("?.", "?")))
