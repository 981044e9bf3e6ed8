"""The exercises' solutions: their texts in the chapters, their values, and what the grader says of an
answer.
"""

import textwrap

from chapters import LESSONS

from workbench.course.child import outcome, plain_value
from workbench.course.exercise import ValueExercise
from workbench.course.exercises import CHAPTERS, exercise, of_chapter
from workbench.course.grading import call_of, judge_outcomes, judge_values
from workbench.course.stubs import stub
from workbench.course.texts import read_texts

ALL = [one for chapter in CHAPTERS for one in of_chapter(chapter)]
FUNCTIONS = [one for one in ALL if not isinstance(one, ValueExercise)]
TEXTS = {one.number: one for path in LESSONS for one in read_texts(path)}


def judged(asked, answer):
    """The verdict on an answer, in this process: the code is ours."""
    if isinstance(asked, ValueExercise):
        return judge_values(asked, plain_value(answer))
    return judge_outcomes(asked, [outcome(answer, case) for case in call_of(asked).cases])


def code_in(text):
    """The indented lines of a statement or of a solution."""
    lines = [line for line in text.splitlines() if line.startswith("    ") or not line.strip()]
    return textwrap.dedent("\n".join(lines)).strip("\n")


def made_by(code, name):
    """What code makes under a name."""
    namespace = {}
    exec(code, namespace)
    return namespace[name]


def broken(number):
    """What a student gets to repair."""
    return made_by(stub(exercise(number)), exercise(number).name)


def says(number: str, *sentences: str) -> None:
    """The solution has each of these, to the digit."""
    text = " ".join(TEXTS[number].solution.split())
    for sentence in sentences:
        assert sentence in text, sentence


def agrees(number: str, share: float = 1 / 3, **values) -> None:
    """The values that are asked for are these, within a share of their tolerance."""
    asked = exercise(number).asked
    for name, value in values.items():
        if isinstance(value, str):
            assert value == asked[name].value, name
        else:
            off = abs(value - asked[name].value)
            assert off <= max(share * asked[name].within, 1e-9), (name, value)
