"""What an exercise is: what is asked, its solution, and the usual mistakes with what they give.

There are two forms. In one a student writes a function, or repairs one that is broken; in the
other a student answers with values: numbers, or words to choose from. A mistake is known by what it
gives, so that it is recognised in code of any style.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

WITHIN = 1e-6  # a part in a million: single precision is enough
KINDS = ("pencil", "write", "predict", "project", "repair", "recording", "design")
"""What is done: by hand; a function; a guess and a run; half a page; a function that is broken; numbers
from a real recording; a design that has no single right answer.
"""


@dataclass(frozen=True)
class Mistake:
    """A usual mistake.

    Parameters
    ----------
    says
        Which mistake it is, as a whole sentence to the student.
    read
        Where to read: the chapter's number and heading, as in ``4, Predict``, formulas as in a shell:
        ``T`` for ``$T$``.
    gives
        What who makes it hands in: a function with the arguments of the solution, or some of the
        values asked for, by name.
    """

    says: str
    read: str
    gives: Callable[..., Any] | Mapping[str, float | str]


@dataclass(frozen=True)
class Asked:
    """A value that is asked for.

    Parameters
    ----------
    value
        The right one: a number, or one of the `choices`.
    unit
        Of a number.
    within
        How far an answer may be from a number that is right.
    choices
        The words to choose from; empty for a number.
    """

    value: float | str
    unit: str = ""
    within: float = 0.0
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Exercise:
    """What both forms have.

    Parameters
    ----------
    number
        Chapter and place in it, as in ``04.2``.
    kind
        One of `KINDS`.
    title, label
        As in the chapter: ``{exercise} title`` and its ``:label:``.
    points
        What a right answer is worth.
    mistakes
        Those that are recognised.
    """

    number: str
    kind: str
    title: str
    label: str
    points: int
    mistakes: tuple[Mistake, ...]

    @property
    def name(self) -> str:
        """What a student hands in is called so."""
        raise NotImplementedError

    @property
    def answer(self) -> Any:
        """What a student hands in who has it right."""
        raise NotImplementedError


@dataclass(frozen=True)
class FunctionExercise(Exercise):
    """A function is to be written, or to be repaired.

    Parameters
    ----------
    solution
        A right one. Its name, arguments and docstring are what a student gets.
    cases
        Makes the lists of arguments on which the function is tried.
    within
        How far a number may be from that of the solution, as a share of the largest of the result.
    broken
        What a student gets to repair; None where the function is to be written.
    """

    solution: Callable[..., Any]
    cases: Callable[[np.random.Generator], Sequence[tuple]]
    within: float = WITHIN
    broken: Callable[..., Any] | None = None

    @property
    def name(self) -> str:
        """The function's name."""
        return self.solution.__name__

    @property
    def answer(self) -> Callable[..., Any]:
        """What a student hands in who has it right."""
        return self.solution


class FunctionExerciseMaker:
    """Puts a `FunctionExercise` together from functions that it decorates: the solution, the cases, and
    wrong functions, each with the sentence that is said of it as its docstring.

    Parameters
    ----------
    number, title, label, points, within
        As in `FunctionExercise`.
    """

    def __init__(
        self, number: str, title: str, label: str, points: int, within: float = WITHIN
    ) -> None:
        self._number, self._title, self._label, self._points = number, title, label, points
        self._within = within
        self._broken: Callable[..., Any] | None = None
        self._solution: Callable[..., Any] | None = None
        self._cases: Callable[[np.random.Generator], Sequence[tuple]] | None = None
        self._mistakes: list[Mistake] = []

    def solution(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """This function is right."""
        self._solution = function
        return function

    def cases(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """This function makes the cases."""
        self._cases = function
        return function

    def broken(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """This function is what a student gets to repair."""
        self._broken = function
        return function

    def mistake(self, read: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
        """This function is a usual mistake; the first paragraph of its docstring says which."""

        def keep(function: Callable[..., Any]) -> Callable[..., Any]:
            sentence = (function.__doc__ or "").partition("\n\n")[0]
            self.known_mistake(" ".join(sentence.split()), read, function)
            return function

        return keep

    def known_mistake(self, says: str, read: str, gives: Callable[..., Any]) -> None:
        """A usual mistake whose function comes from elsewhere."""
        self._mistakes.append(Mistake(says, read, gives))

    def made(self) -> FunctionExercise:
        """The exercise."""
        if self._solution is None or self._cases is None:
            raise ValueError(f"{self._number}: expected a solution and cases")
        return FunctionExercise(
            number=self._number,
            kind="repair" if self._broken else "write",
            title=self._title,
            label=self._label,
            points=self._points,
            mistakes=tuple(self._mistakes),
            solution=self._solution,
            cases=self._cases,
            within=self._within,
            broken=self._broken,
        )


@dataclass(frozen=True)
class ValueExercise(Exercise):
    """Values are asked for.

    Parameters
    ----------
    asked
        By name.
    """

    asked: Mapping[str, Asked] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The name of the variable that holds a student's answer."""
        return f"answer_{self.number.replace('.', '_')}"

    @property
    def answer(self) -> dict[str, float | str]:
        """What a student hands in who has it right."""
        return {name: one.value for name, one in self.asked.items()}
