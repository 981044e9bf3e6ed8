"""Which statements of a notebook a sweep runs, and which of them only once.

What a notebook glues depends on some of its statements alone. The others, figures, printed tables
and checks by ``assert``, are left out. Of those that remain some depend on a parameter that is
swept: they run each time. The others run once in each kernel, and each run begins with a copy of
what they have left. For example, where ``a`` is swept::

    a, b = 1.0, 2.0
    images = read_images()              # once
    figure = show(images)               # left out
    sizes = [image.size * a for image in images]
    assert min(sizes) > 0               # left out
    for size in sizes:
        print(size)                     # left out
    glue("images", len(images))         # once
    glue("mean", np.mean(sizes))

`dataflow` says what each statement does. What that cannot say is kept: a cell with a magic, and all
before it; a cell tagged ``sweep-always``; a call whose value nobody takes, but for printing and
drawing.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from typing import Any, NamedTuple

from .dataflow import ANY, OUTSIDE, RANDOM, RESULTS, Effects, Flow, Thing

__all__ = ["ALWAYS", "CellUse", "Slice", "explained", "slice_notebook"]

ALWAYS = "sweep-always"  # the tag of a cell that is kept, and runs each time
NEVER_ONCE = {ANY, OUTSIDE, RANDOM}
Live = set[str | Thing]


class CellUse(NamedTuple):
    """What becomes of a code cell: how many statements it has, how many run once, how many each
    time; and what these read that varies.
    """

    statements: int
    once: int
    each: int
    varying: list[str]


class Slice(NamedTuple):
    """The parts of a notebook that a sweep runs. Each has all cells, in which stands what is left
    of them, so that a cell keeps its number.

    Attributes
    ----------
    needed : nbformat.NotebookNode
        All that the results need.
    once : nbformat.NotebookNode or None
        What of it no swept parameter reaches. None if that cannot be told.
    each : nbformat.NotebookNode
        The rest.
    held : list of str
        The names that `once` binds and `each` needs.
    cells : list of CellUse
        One a code cell.
    """

    needed: Any
    once: Any
    each: Any
    held: list[str]
    cells: list[CellUse]


class _Cell(NamedTuple):
    """A code cell: its number in the notebook, its statements, those of them that are kept; None
    for what is no Python.
    """

    place: int
    all: list[ast.stmt] | None
    statements: list[ast.stmt] | None
    always: bool
    parameters: bool


def slice_notebook(notebook: Any, swept: Collection[str]) -> Slice | None:
    """Take a notebook apart.

    Parameters
    ----------
    notebook : nbformat.NotebookNode
    swept : collection of str
        The parameters that change from run to run.

    Returns
    -------
    Slice or None
        None if it glues nothing that could be seen.
    """
    cells = [
        _as_cell(index, cell)
        for index, cell in enumerate(notebook.cells)
        if cell.cell_type == "code"
    ]
    flow = Flow()
    effects = [_effects(flow, cell) for cell in cells]
    if not any(RESULTS in some.changes for some in effects):
        return None
    kept = _needed_cells(cells, effects, flow)
    parts = _split(kept, set(swept))
    uses = [
        CellUse(
            len(cell.all or []) or 1,
            len(once.statements or []),
            1 if each.statements is None else len(each.statements),
            sorted(varying),
        )
        for cell, once, each, varying in zip(cells, *parts[:3], strict=True)
    ]
    needed, once, each = (_with_cells(notebook, part) for part in (kept, *parts[:2]))
    return Slice(needed, once if parts.told else None, each, sorted(parts.held), uses)


def explained(notebook: Any, part: Slice) -> str:
    """A line for each code cell: whether it runs, and why."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    lines = []
    for number, (cell, use) in enumerate(zip(code, part.cells, strict=True), 1):
        first = next((line for line in cell.source.splitlines() if line.strip()), "")
        lines.append(f"{number:3}  {_said(use, part.once is not None):58}  {first[:40]}")
    return "\n".join(lines)


def _said(use: CellUse, told: bool) -> str:
    if not use.once + use.each:
        return "left out: no result needs it"
    if not told:
        return "each time"
    reads = f": reads {', '.join(use.varying[:4])}" if use.varying else ""
    if not use.once:
        return f"each time{reads}"
    return f"once, and in part each time{reads}" if use.each else "once"


def _as_cell(index: int, cell: Any) -> _Cell:
    tags = cell.metadata.get("tags", [])
    try:
        statements: list[ast.stmt] | None = ast.parse(cell.source).body
    except SyntaxError:  # IPython's own syntax
        statements = None
    return _Cell(index, statements, statements, ALWAYS in tags, "parameters" in tags)


def _effects(flow: Flow, cell: _Cell) -> Effects:
    if cell.statements is None:
        return Effects({ANY}, set(), {ANY})
    return flow.block(cell.statements)


# what is needed


def _needed_cells(cells: Sequence[_Cell], effects: Sequence[Effects], flow: Flow) -> list[_Cell]:
    """What the results need of each cell."""
    live: Live = {RESULTS, OUTSIDE}
    kept: list[_Cell] = []
    for cell, of_cell in zip(reversed(cells), reversed(effects), strict=True):
        if cell.statements is None or cell.always or cell.parameters:
            kept.append(cell)
            live = live - of_cell.binds | of_cell.reads
            continue
        statements, live = _needed(cell.statements, live, flow)
        kept.append(cell._replace(statements=statements))
    return kept[::-1]


def _needed(statements: Sequence[ast.stmt], live: Live, flow: Flow) -> tuple[list[ast.stmt], Live]:
    """The statements that give what is needed after them, and what is needed before them."""
    kept: list[ast.stmt] = []
    for statement in reversed(statements):
        effects = flow.effects[statement]
        if not _gives(effects, live):
            continue
        if isinstance(statement, ast.If):
            part, live = _needed_of_if(statement, live, flow)
        elif isinstance(statement, ast.For) and not statement.orelse and not _jumps(statement):
            part, live = _needed_of_loop(statement, live, flow)
        else:
            part, live = statement, live - effects.binds | effects.reads
        kept.append(part)
    return kept[::-1], live


def _needed_of_if(node: ast.If, live: Live, flow: Flow) -> tuple[ast.stmt, Live]:
    body, before_body = _needed(node.body, live, flow)
    orelse, before_else = _needed(node.orelse, live, flow)
    part = ast.If(node.test, body or [ast.Pass()], orelse)
    same = body == node.body and orelse == node.orelse
    before = before_body | before_else | flow.headers[node].reads
    return (node if same else ast.copy_location(part, node)), before


def _needed_of_loop(node: ast.For, live: Live, flow: Flow) -> tuple[ast.stmt, Live]:
    """A turn needs what the next one needs."""
    header = flow.headers[node]
    again = set(live)
    while True:
        body, before = _needed(node.body, again, flow)
        before = before - header.binds | header.reads
        if before <= again:
            break
        again |= before
    part = ast.For(node.target, node.iter, body or [ast.Pass()], [])
    return (node if body == node.body else ast.copy_location(part, node)), again


def _gives(effects: Effects, needed: Live) -> bool:
    writes = effects.writes
    return bool(writes & needed) or ANY in writes or (ANY in needed and bool(writes))


def _jumps(loop: ast.For) -> bool:
    """Whether a turn may be left early: then each statement of it decides on the others."""
    return any(isinstance(node, (ast.Break, ast.Continue, ast.Return)) for node in ast.walk(loop))


# what runs once


class _Parts(NamedTuple):
    """What of each cell runs once, what each time and what that reads which varies; the names that
    the first binds and the second needs; whether the text tells all of this.
    """

    once: list[_Cell]
    each: list[_Cell]
    varying: list[set[str]]
    held: set[str]
    told: bool


def _split(cells: Sequence[_Cell], swept: set[str]) -> _Parts:
    """What runs once reads nothing that varies; and all of it can run first."""
    flow = Flow()
    effects: dict[ast.stmt, Effects] = {}
    drawing: set[ast.stmt] = set()
    every = [statement for cell in cells for statement in cell.statements or []]
    for statement in every:
        effects[statement] = flow.block([statement])
        if flow.draws(effects[statement]):
            drawing.add(statement)
    needed_after = _needed_after(every, effects)
    varying = _Varying(set(swept), set())
    bound: set[str] = set()
    parts = _Parts([], [], [], set(), True)
    for cell in cells:
        once: list[ast.stmt] = []
        each: list[ast.stmt] = []
        why: set[str] = set()
        for statement in cell.statements or []:
            done = effects[statement]
            parts = parts._replace(told=parts.told and ANY not in done.writes)
            if cell.parameters:  # stands in both
                once.append(statement)
                each.append(statement)
            elif (
                cell.always
                or statement in drawing
                # results stay in their order
                or (RESULTS in done.writes and any(RESULTS in effects[one].writes for one in each))
                or not varying.may_go_before(done, needed_after[statement])
            ):
                each.append(statement)
                why |= {name for name in done.reads & varying.written if isinstance(name, str)}
                varying.written.update(done.writes - {RESULTS})
                varying.read.update(done.reads)
            else:
                once.append(statement)
                bound |= {name for name in done.writes if isinstance(name, str)}
        parts = parts._replace(told=parts.told and cell.statements is not None)
        parts.once.append(cell._replace(statements=once))
        parts.each.append(cell._replace(statements=None if cell.statements is None else each))
        parts.varying.append(why)
    return parts._replace(held={name for name in varying.read & bound if isinstance(name, str)})


class _Varying(NamedTuple):
    """What the statements so far that run each time have written and read."""

    written: Live
    read: Live

    def may_go_before(self, effects: Effects, needed_after: Live) -> bool:
        """Whether a statement does the same if it goes before all of these, and they do, too."""
        writes = effects.writes - {RESULTS}
        if writes & NEVER_ONCE or self.written & NEVER_ONCE or effects.reads & self.written:
            return False
        if writes & self.read:
            return False
        # a loop's variable may be that of another loop, if nobody asks for it afterwards
        both = writes & self.written
        return not both & needed_after and all(isinstance(name, str) for name in both)


def _needed_after(
    statements: Sequence[ast.stmt], effects: Mapping[ast.stmt, Effects]
) -> dict[ast.stmt, Live]:
    """What is read after each statement as it was then."""
    live: Live = set()
    after = {}
    for statement in reversed(statements):
        after[statement] = live
        live = live - effects[statement].binds | effects[statement].reads
    return after


def _with_cells(notebook: Any, cells: Sequence[_Cell]) -> Any:
    """A copy of a notebook with these statements in its cells."""
    part = deepcopy(notebook)
    for cell in cells:
        if cell.statements is not None and cell.statements != cell.all:
            part.cells[cell.place].source = ast.unparse(ast.Module(cell.statements, []))
    return part
