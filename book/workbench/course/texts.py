"""What a chapter tells of its exercises: statement, two hints and solution of each.

In a chapter's markdown an exercise is four blocks in this order, and this module reads them::

    ```{exercise} 4.2 Write it yourself: a filter of one number
    :label: ex-kalman-write
    ...
    ```{hint} First hint to 4.2
    ...
    ```{hint} Second hint to 4.2
    ...
    ```{solution} ex-kalman-write
    ...

The first hint asks a question, and the second names the idea. Neither of
them is the solution.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..sweep.notebook import read_notebook

# how a title begins, and the kind that it names
KIND_OF = {
    "Pencil": "pencil",
    "Write it yourself": "write",
    "Change and predict": "predict",
    "Project": "project",
    "Repair": "repair",
    "Real recording": "recording",
    "Open design": "design",
}
HINTS = ("First", "Second")
OPENING = re.compile(r"^(`{3,})\{(exercise|hint|solution)\} *(.*)$")
OPTION = re.compile(r"^:([\w-]+): *(.*)$")
TITLE = re.compile(rf"^(\d+)\.(\d+) ({'|'.join(KIND_OF)}): (.+)$")


class Block(NamedTuple):
    """A block of a chapter: an exercise, a hint or a solution.

    Parameters
    ----------
    kind
        ``exercise``, ``hint`` or ``solution``.
    argument
        What stands behind the kind: a title, or an exercise's label.
    options
        By name, as ``label``.
    body
        Its text.
    first, last
        The lines of the cell that it takes, from 0; the last one is its fence.
    """

    kind: str
    argument: str
    options: dict[str, str]
    body: str
    first: int
    last: int


class ExerciseText(NamedTuple):
    """An exercise as its chapter tells it.

    Parameters
    ----------
    number
        As in ``04.2``.
    kind
        One of `exercise.KINDS`.
    title
        What stands behind the kind, with a capital letter.
    label
        Of the block.
    statement, hints, solution
        In the chapter's markdown; the hints are two.
    """

    number: str
    kind: str
    title: str
    label: str
    statement: str
    hints: tuple[str, ...]
    solution: str


def read_texts(path: str | Path) -> tuple[ExerciseText, ...]:
    """Return the exercises of a chapter, in their order.

    Raises
    ------
    ValueError
        The chapter has none, or one of them has not the form above: which one, and what it lacks.
    """
    return texts_of(read_notebook(path), str(path))


def texts_of(notebook: Any, name: str) -> tuple[ExerciseText, ...]:
    """Return the exercises of a notebook that is open; see `read_texts`."""
    cells = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    all_blocks = [block for cell in cells for block in blocks(cell, name)]
    starts = [k for k, block in enumerate(all_blocks) if block.kind == "exercise"]
    if not starts or starts[0] > 0:
        raise ValueError(
            f"{name}: expected an {{exercise}} before any hint or solution, found none"
        )
    groups = [all_blocks[a:b] for a, b in zip(starts, [*starts[1:], len(all_blocks)], strict=True)]
    return tuple(_exercise(group, name) for group in groups)


def blocks(text: str, name: str) -> list[Block]:
    """Return the exercises, hints and solutions in a cell's text.

    Raises
    ------
    ValueError
        One of them has no end.
    """
    lines = text.splitlines()
    blocks_found: list[Block] = []
    k = 0
    while k < len(lines):
        opening = OPENING.match(lines[k])
        if opening:
            fence, kind, argument = opening.groups()
            last = next((m for m in range(k + 1, len(lines)) if lines[m].strip() == fence), None)
            if last is None:
                raise ValueError(f"{name}: {{{kind}}} {argument}: its closing {fence} is not there")
            blocks_found.append(_block(kind, argument, lines, k, last))
            k = last
        k += 1
    return blocks_found


def _block(kind: str, argument: str, lines: Sequence[str], first: int, last: int) -> Block:
    options = {}
    start = first + 1
    while start < last and (option := OPTION.match(lines[start])):
        options[option[1]] = option[2].strip()
        start += 1
    body = "\n".join(lines[start:last]).strip("\n")
    return Block(kind, argument.strip(), options, body, first, last)


def _exercise(group: Sequence[Block], name: str) -> ExerciseText:
    """An exercise of its five blocks; ValueError if they are others."""
    head = group[0]
    title = TITLE.match(head.argument)
    if title is None:
        raise ValueError(
            f"{name}: {head.argument!r}: expected a title as in '4.2 Pencil: a second observation', "
            f"with one of {', '.join(KIND_OF)}"
        )
    number_in_title = f"{title[1]}.{title[2]}"
    label = head.options.get("label", "")
    expected = [
        ("exercise", head.argument),
        *(("hint", f"{which} hint to {number_in_title}") for which in HINTS),
        ("solution", label),
    ]
    if [(block.kind, block.argument) for block in group] != expected:
        present = (
            ", ".join(f"{{{block.kind}}} {block.argument}" for block in group[1:]) or "nothing"
        )
        wanted = ", ".join(f"{{{kind}}} {argument}" for kind, argument in expected[1:])
        raise ValueError(
            f"{name}: exercise {number_in_title}: expected {wanted} after it, found {present}"
        )
    if empty := next((block.kind for block in group if not block.body.strip()), None):
        raise ValueError(f"{name}: exercise {number_in_title}: its {empty} is empty")
    return ExerciseText(
        number=f"{int(title[1]):02d}.{title[2]}",
        kind=KIND_OF[title[3]],
        title=title[4][0].upper() + title[4][1:],
        label=label,
        statement=head.body,
        hints=tuple(block.body for block in group[1:-1]),
        solution=group[-1].body,
    )


def without_solutions(text: str, name: str) -> str:
    """Return a cell's text without its blocks of solutions."""
    lines = text.splitlines()
    for block in reversed(blocks(text, name)):
        if block.kind == "solution":
            # the empty line behind goes with it
            behind = block.last + 1
            behind += behind < len(lines) and not lines[behind].strip()
            del lines[block.first : behind]
    return "\n".join(lines).rstrip("\n")
