"""The course: exercises that answer, and what a teacher hands out and collects.

`exercise` says what an exercise is, `exercises` has those of the chapters. `grading` judges an
answer; the code of a student runs in a process of its own (`running`, `child`) and comes back as
plain data (`plain`). `submissions` goes through files and class lists.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .grading import Verdict

__all__ = ["check"]


def check(number: str, answer: Any) -> Verdict:
    """Check an answer to an exercise; see `grading.check`."""
    from . import grading

    return grading.check(number, answer)
