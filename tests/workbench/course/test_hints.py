"""Hints help, and none of them is the solution."""

import re

import pytest
from chapters import LESSONS

from workbench.course.exercise import FunctionExercise
from workbench.course.exercises import CHAPTERS, of_chapter
from workbench.course.texts import HINTS, read_texts

TOLD = [one for path in LESSONS for one in read_texts(path)]
ASKED = {one.number: one for chapter in CHAPTERS for one in of_chapter(chapter)}
QUOTED = re.compile(r"`([^`\n]+)`|\$([^$]+)\$")
# what makes a formula or a piece of code of a name: an operator, a call with arguments, a fraction
WORKS = re.compile(r"[=+*/@^<>]|\w\(.*\w.*\)|\[.*[:,].*\]|\\(frac|sqrt|cdot|operatorname)")


def bare(text):
    """Without spaces, and without what only spaces a formula."""
    return re.sub(r"\s|\\[,;!]|\\,", "", text)


def quoted(hint):
    """The formulas and pieces of code in a hint that say how a thing is computed."""
    parts = (bare(code or formula) for code, formula in QUOTED.findall(hint))
    return [part for part in parts if len(part) >= 8 and WORKS.search(part)]


def given_away(one):
    """What the second hint has of the solution; the first may name what to call."""
    solution, statement = bare(one.solution), bare(one.statement)
    parts = [part for hint in one.hints[1:] for part in quoted(hint)]
    return [part for part in parts if part in solution and part not in statement]


@pytest.mark.parametrize("one", TOLD, ids=lambda one: one.number)
def test_no_hint_has_a_formula_or_a_line_of_the_solution(one):
    assert len(one.hints) == len(HINTS)
    assert given_away(one) == []


@pytest.mark.parametrize("one", TOLD, ids=lambda one: one.number)
def test_a_hint_stays_short_beside_a_solution_in_code(one):
    """Who tells a program in words needs as many of them as the program has names."""
    asked = ASKED[one.number]
    if not isinstance(asked, FunctionExercise):
        return
    code = "\n".join(line for line in one.solution.splitlines() if line.startswith("    "))
    names = set(re.findall(r"[a-zA-Z_]{2,}", code)) - set(re.findall(r"\w+", one.statement))
    for hint in one.hints[1:]:
        in_code = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", hint))))
        assert len(in_code & names) <= 2, (one.number, sorted(in_code & names))


def test_a_given_away_line_is_seen():
    """Hints as they must not be: the solution's formula in other spaces, and its code."""
    one = TOLD[0]._replace(
        statement="Find it.",
        solution="    K = P @ H.T @ inv(S)\n\n$f^2 = B_{33} - c_x^2$",
        hints=("Think.", "Take `P @ H.T @ inv(S)`.", "Use $f^2 = B_{33}\\, - c_x^2$."),
    )
    assert given_away(one) == ["P@H.T@inv(S)", "f^2=B_{33}-c_x^2"]
