"""Who has read a chapter has not yet solved its exercises: a solution in code is no cell of it."""

import difflib
import re
from functools import cache

import pytest
from chapters import LESSONS

from workbench.course.texts import read_texts
from workbench.sweep.notebook import read_notebook

# solutions that follow a cell on purpose: what differs from it is the exercise
FOLLOWS = {
    "04.3": "the chapter's step has the paper's misprints, and the exercise asks for the step without",
    "07.3": "the chapter's start with five unknowns, of which square pixels leave four",
}
WRITTEN = [(path, one) for path in LESSONS for one in read_texts(path) if one.kind == "write"]


def statements(code):
    """The lines of a code that do something: no head, no import, no return, no comment."""
    lines = (re.sub(r"\s*#.*", "", line.strip()) for line in code.splitlines())
    return [
        line for line in lines if line and not line.startswith(("import", "from", "def ", "return"))
    ]


@cache
def lines_of_cells(path):
    """All lines of the chapter's cells."""
    cells = read_notebook(path).cells
    return {line for cell in cells if cell.cell_type == "code" for line in statements(cell.source)}


def share_copied(solution, cells):
    """The share of a solution's lines that stand nearly the same in the cells."""
    code = "\n".join(line for line in solution.splitlines() if line.startswith("    "))
    own = statements(code)
    copied = [any(alike(line, other) for other in cells) for line in own]
    return sum(copied) / max(len(own), 1)


def alike(one, other):
    """Whether three quarters of two lines are the same, letter by letter."""
    if abs(len(one) - len(other)) > 0.4 * len(one):
        return False
    matcher = difflib.SequenceMatcher(None, one, other)
    return matcher.quick_ratio() > 0.75 and matcher.ratio() > 0.75


@pytest.mark.parametrize(("path", "one"), WRITTEN, ids=lambda it: getattr(it, "number", ""))
def test_a_solution_is_no_cell_of_its_chapter(path, one):
    share = share_copied(one.solution, lines_of_cells(path))
    if one.number in FOLLOWS:
        assert share > 0.6, "it is no copy any more: take it from the list"
    else:
        assert share <= 0.6, f"{share:.0%} of its lines"


def test_a_copy_is_seen():
    cell = "for frame in frames:\n    B = alpha * frame + (1 - alpha) * B\n"
    line = "B = alpha * frame + (1 - alpha) * B"
    solution = f"    def f(frames, B, alpha):\n        for frame in frames:\n            {line}\n"
    assert share_copied(solution, set(statements(cell))) == 1
    assert share_copied(solution, {"rate = np.where(moving, slow, alpha)"}) == 0
