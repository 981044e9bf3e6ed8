"""What holds for every exercise: its solution passes in each of its forms, what is handed out fails,
each usual mistake is known by its own words, a slip of the pen is not taken for right, and the chapter
tells the same exercise and gives nothing away.
"""

import difflib
import re
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from chapters import LESSONS, NOTEBOOKS
from mutants import HARMLESS, mutants, survives
from solutions import ALL, FUNCTIONS, TEXTS, broken, code_in, judged, made_by

from workbench.course.child import outcome
from workbench.course.editions import exercises_of
from workbench.course.exercise import KINDS, FunctionExercise, ValueExercise
from workbench.course.exercises import CHAPTERS, exercise, of_chapter
from workbench.course.grading import call_of
from workbench.course.stubs import body_of, head_of, solved, stub
from workbench.course.texts import HINTS
from workbench.sweep.notebook import read_notebook

VALUES = [one for one in ALL if isinstance(one, ValueExercise)]
REPAIRS = [one for one in ALL if one.kind == "repair"]


def of_each(exercises):
    return pytest.mark.parametrize("asked", exercises, ids=lambda one: one.number)


@cache
def cells(chapter, kind):
    """The texts of a chapter's cells of a kind: of its lesson and of its studies."""
    paths = [path for path in NOTEBOOKS if path.stem.startswith(chapter)]
    return [
        cell.source
        for path in paths
        for cell in read_notebook(path).cells
        if cell.cell_type == kind
    ]


def test_exercises_are_whole():
    assert len(ALL) >= 48
    assert len(REPAIRS) == 6
    for chapter, path in zip(CHAPTERS, LESSONS, strict=True):
        asked = of_chapter(chapter)
        assert len(exercises_of(chapter, read_notebook(path), path.name)) == len(asked)
        assert [one.number for one in asked] == [f"{chapter}.{k}" for k in range(1, len(asked) + 1)]
        assert {one.kind for one in asked} >= set(KINDS[:4])
        assert all(one.points > 0 for one in asked)
        assert "".join(cells(chapter, "markdown")).count(":nonumber:") >= len(asked)
    with pytest.raises(ValueError, match=r"there is no chapter '13'; they are 01, 02, .*, 12$"):
        exercise("13.1")


@of_each(ALL)
def test_the_solution_passes_by_itself_and_what_is_handed_out_fails(asked):
    """Whatever a solution needs of its module comes with it."""
    assert judged(asked, made_by(solved(asked), asked.name)).right
    says = judged(asked, made_by(stub(asked), asked.name)).says
    assert "still to be" in says
    assert ("repaired" in says) == (asked in REPAIRS)


@of_each(FUNCTIONS)
def test_the_code_in_the_text_passes(asked):
    verdict = judged(asked, made_by(code_in(TEXTS[asked.number].solution), asked.name))
    assert verdict.right, verdict
    assert "prints" not in verdict.says


@pytest.mark.parametrize("number", ["03.3", "04.2", "04.3", "08.4", "09.3", "09.4", "11.2"])
def test_single_precision_is_right(number):
    def single(value):
        if isinstance(value, tuple):
            return tuple(map(single, value))
        return np.asarray(value, dtype=np.float32)

    asked = exercise(number)
    assert judged(asked, lambda *arguments: single(asked.solution(*arguments))).right


def plainly(heading):
    """A heading without the signs of its formulas, as a shell can show it."""
    return heading.replace("$", "").replace("\\", "")


@of_each(ALL)
def test_every_mistake_is_recognised_by_its_own_words(asked):
    assert len(asked.mistakes) >= 3
    for one, other in combinations(asked.mistakes, 2):
        assert one.says != other.says
    for k, mistake in enumerate(asked.mistakes):
        answer, among = mistake.gives, asked
        if asked in VALUES:
            assert set(answer) <= set(asked.asked)
            answer = asked.answer | answer
        else:  # the first that gives the same counts, whatever comes behind it
            among = replace(asked, mistakes=asked.mistakes[: k + 1])
        verdict = judged(among, answer)
        assert not verdict.right, mistake.says
        assert mistake.says.endswith((".", "?"))
        assert verdict.says == f"{mistake.says} Read chapter {mistake.read}.".replace("?.", "?")
        number, _, heading = mistake.read.partition(", ")
        text = "\n".join(cells(number.zfill(2), "markdown"))
        headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
        assert plainly(heading) in map(plainly, headings), mistake.read


@of_each(VALUES)
def test_no_answer_is_told_apart_by_a_hair(asked):
    """A wrong value lies well beyond the tolerance of the right one."""
    for name, one in asked.asked.items():
        if isinstance(one.value, str):
            assert one.value in one.choices
            continue
        wrong = [mistake.gives[name] for mistake in asked.mistakes if name in mistake.gives]
        assert all(abs(value - one.value) > 2 * one.within for value in wrong)


# values that the text says in words, as a fraction, or quotes from the chapter's own cells
IN_OTHER_WORDS = {
    *(("06.6", "wrong"), ("06.6", "missing"), ("08.6", "of_four"), ("08.9", "standard_errors")),
    *(("10.1", "bias"), ("10.1", "scatter"), ("10.4", "nees"), ("11.4", "wander_mm")),
    *(("10.6", "pair_wins"), ("11.4", "delay_ms"), ("11.8", "strokes"), ("12.5", "best_share")),
}


@of_each(VALUES)
def test_the_solution_s_text_has_the_values(asked):
    """Each within its tolerance, or to the digits that stand there, if these are two or more."""
    lines = TEXTS[asked.number].solution.splitlines()
    prose = "\n".join(line for line in lines if not line.startswith("    "))
    typed = []
    for whole, decimals in re.findall(r"(\d[\d,]*)(?:\.(\d+))?", prose):
        digits = whole.replace(",", "")
        half = 0.5 * 10.0 ** -len(decimals) if len((digits + decimals).lstrip("0")) > 1 else 0.0
        typed.append((float(f"{digits}.{decimals}"), 1.0001 * half))
    missing = {
        (asked.number, name)
        for name, one in asked.asked.items()
        if not isinstance(one.value, str)
        and not any(abs(x - abs(one.value)) <= max(one.within, half, 1e-9) for x, half in typed)
    }
    assert missing == {place for place in IN_OTHER_WORDS if place[0] == asked.number}


@of_each(FUNCTIONS)
def test_a_slip_of_the_pen_is_refused(asked):
    """A sample of what `make verify` does."""
    every = 12 if asked.number in ("05.3", "12.3") else 5  # these compute for long
    made = mutants(asked)
    assert {words for number, words in HARMLESS if number == asked.number} <= {
        words for words, _ in made
    }
    left = {words for words, text in made[::every] if survives(asked, text)}
    assert {words for words in left if (asked.number, words) not in HARMLESS} == set()


@of_each(ALL)
def test_the_statement_names_what_is_asked_for(asked):
    """The names of the values and their choices, the function's name and its arguments."""
    statement = " ".join(TEXTS[asked.number].statement.split())
    assert f'check("{asked.number}", ' in statement
    if isinstance(asked, FunctionExercise):
        code = asked.solution.__code__
        arguments = ", ".join(code.co_varnames[: code.co_argcount])
        assert f"`{asked.name}({arguments})`" in statement
        return
    for name, one in asked.asked.items():
        assert f'"{name}": ...' in statement
        for choice in one.choices:
            assert f'"{choice}"' in statement


@of_each(REPAIRS)
def test_what_is_to_be_repaired_runs_stands_in_the_chapter_and_is_mended_in_one_line(asked):
    found = [outcome(broken(asked.number), case) for case in call_of(asked).cases]
    assert not any("raised" in one for one in found)
    head, *body = code_in(TEXTS[asked.number].statement).splitlines()
    assert head in stub(asked)
    assert "\n".join(body) == body_of(asked.broken)
    before, after = (body_of(one).splitlines() for one in (asked.broken, asked.solution))
    assert sum(line.startswith("- ") for line in difflib.ndiff(before, after)) == 1


QUOTED = re.compile(r"`([^`\n]+)`|\$([^$]+)\$")
# what makes a formula or a piece of code of a name: an operator, a call with arguments, a fraction
WORKS = re.compile(r"[=+*/@^<>]|\w\(.*\w.*\)|\[.*[:,].*\]|\\(frac|sqrt|cdot|operatorname)")


def bare(text):
    """Without spaces, and without what only spaces a formula."""
    return re.sub(r"\s|\\[,;!]|\\,", "", text)


def given_away(solution, statement, hint):
    """The formulas and pieces of code of a solution that a hint has, and the statement has not."""
    parts = [bare(code or formula) for code, formula in QUOTED.findall(hint)]
    parts = [part for part in parts if len(part) >= 8 and WORKS.search(part)]
    return [part for part in parts if part in bare(solution) and part not in bare(statement)]


@of_each(ALL)
def test_no_hint_but_the_first_gives_the_solution_away(asked):
    """Neither a formula nor a line of it, nor more than two of the names in its code."""
    text = TEXTS[asked.number]
    assert len(text.hints) == len(HINTS)
    code = code_in(text.solution) if isinstance(asked, FunctionExercise) else ""
    names = set(re.findall(r"[a-zA-Z_]{2,}", code)) - set(re.findall(r"\w+", text.statement))
    for hint in text.hints[1:]:
        assert given_away(text.solution, text.statement, hint) == []
        words = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", hint))))
        assert len(words & names) <= 2


def test_a_given_away_line_is_seen():
    """The solution's formula in other spaces, and its code."""
    solution = "    K = P @ H.T @ inv(S)\n\n$f^2 = B_{33} - c_x^2$"
    hint = "Take `P @ H.T @ inv(S)` and $f^2 = B_{33}\\, - c_x^2$."
    assert given_away(solution, "Find it.", hint) == ["P@H.T@inv(S)", "f^2=B_{33}-c_x^2"]


def test_an_exercise_without_a_docstring_cannot_be_handed_out():
    def without(a, b):
        return a + b

    with pytest.raises(ValueError, match="without: expected a docstring, which students get"):
        head_of(without)
