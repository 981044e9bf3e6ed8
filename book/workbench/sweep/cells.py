"""Which cells of a notebook a sweep runs once, which at each setting, and which not at all.

The author tags them: ``once`` for a cell that runs once for all settings, ``figure`` for a cell
that a sweep does not need. Every other cell runs at each setting. For example, where ``a`` is
swept::

    images = read_images()              # tagged once
    show(images)                        # tagged figure
    sizes = [image.size * a for image in images]
    glue("mean", np.mean(sizes))

One rule decides whether the tags can hold: each cell must read each name from the same cell as in
the whole notebook. Objects that are changed in place bind no name; `agreement` finds those.
"""

from __future__ import annotations

import ast
import dis
from collections.abc import Collection, Iterable, Mapping, Sequence
from types import CodeType
from typing import Any, NamedTuple

ONCE = "once"
FIGURE = "figure"
PARAMETERS = "parameters"
INJECTED = "injected-parameters"

SETTING = 0  # stands for the values of a setting among the numbers of cells
IMPORTED = -1  # an import binds the same object in whichever cell it stands


class Plan(NamedTuple):
    """When the code cells of a notebook run in a sweep, by their numbers from 1.

    Attributes
    ----------
    once, each, left_out : tuple of int
        Cells that run once, cells that run at each setting, cells that do not run.
    """

    once: tuple[int, ...]
    each: tuple[int, ...]
    left_out: tuple[int, ...]


class Names(NamedTuple):
    """The names that a cell reads before it binds them, those that it binds, and those among them
    that only an import binds.
    """

    reads: frozenset[str]
    binds: frozenset[str]
    imports: frozenset[str]


def code_cells(notebook: Any) -> list[Any]:
    """The code cells of a notebook, in order, without injected parameters."""
    return [
        cell
        for cell in notebook.cells
        if cell.cell_type == "code" and INJECTED not in tags_of(cell)
    ]


def parameters_cell(notebook: Any) -> int:
    """The number of the code cell tagged ``parameters``; 0 if there is none."""
    cells = enumerate(code_cells(notebook), 1)
    return next((number for number, cell in cells if PARAMETERS in tags_of(cell)), 0)


def tags_of(cell: Any) -> list[str]:
    """The tags of a cell."""
    return list(cell.metadata.get("tags", []))


def plan_cells(notebook: Any, varying: Collection[str]) -> Plan | None:
    """The plan that the tags of a notebook state; None for a notebook without tags.

    Parameters
    ----------
    notebook : nbformat.NotebookNode
    varying : collection of str
        The parameters with more than one value.

    Raises
    ------
    ValueError
        For tags that cannot hold: the message has the numbers of both cells and the name.
    """
    cells = code_cells(notebook)
    tags = {number: tags_of(cell) for number, cell in enumerate(cells, 1)}
    if not any({ONCE, FIGURE}.intersection(some) for some in tags.values()):
        return None
    for number, some in tags.items():
        if len(both := {ONCE, FIGURE, PARAMETERS}.intersection(some)) > 1:
            raise ValueError(f"code cell {number} is tagged {' and '.join(sorted(both))}")
    plan = Plan(
        tuple(number for number, some in tags.items() if {ONCE, PARAMETERS}.intersection(some)),
        tuple(
            number
            for number, some in tags.items()
            if not {ONCE, FIGURE, PARAMETERS}.intersection(some)
        ),
        tuple(number for number, some in tags.items() if FIGURE in some),
    )
    names = {number: names_of(cell.source) for number, cell in enumerate(cells, 1)}
    _check(plan, names, parameters_cell(notebook), frozenset(varying))
    return plan


def rebinding_cells(notebook: Any, name: str) -> list[int]:
    """The numbers of the code cells that bind a parameter anew."""
    return [
        number
        for number, cell in enumerate(code_cells(notebook), 1)
        if PARAMETERS not in tags_of(cell) and name in names_of(cell.source).binds
    ]


def explained(notebook: Any, plan: Plan | None) -> str:
    """A line for each code cell: when it runs, and why."""
    lines = []
    for number, cell in enumerate(code_cells(notebook), 1):
        first = next((line for line in cell.source.splitlines() if line.strip()), "")
        lines.append(f"{number:3}  {_reason(number, plan, tags_of(cell)):56}  {first[:40]}")
    return "\n".join(lines)


def _reason(number: int, plan: Plan | None, tags: Sequence[str]) -> str:
    if plan is None:
        return "at each setting: the whole notebook runs"
    if PARAMETERS in tags:
        return "once, then the setting's values: tagged parameters"
    if number in plan.once:
        return "once: tagged once"
    return "not run: tagged figure" if number in plan.left_out else "at each setting: no tag"


# whether the tags can hold


def _check(
    plan: Plan, names: Mapping[int, Names], parameters: int, varying: frozenset[str]
) -> None:
    """Refuse a cell that would read a name from another cell than in the whole notebook."""
    names = {SETTING: Names(frozenset(), varying, frozenset()), **names}
    whole = sorted(set(names) - {SETTING})
    whole.insert(parameters, SETTING)
    sweep = [*plan.once, SETTING, *plan.each]
    of_whole = _binders(whole, names)
    for (cell, name), binder in _binders(sweep, names).items():
        expected = of_whole[cell, name]
        # bound by no cell before: a builtin, or a function reads it when it is called
        if binder != expected is not None:
            raise ValueError(_contradiction(plan, cell, name, expected, binder))


def _binders(order: Iterable[int], names: Mapping[int, Names]) -> dict[tuple[int, str], int | None]:
    """For each cell and each name that it reads, the last cell before it that binds the name."""
    latest: dict[str, int] = {}
    binders: dict[tuple[int, str], int | None] = {}
    for cell in order:
        binders |= {(cell, name): latest.get(name) for name in names[cell].reads}
        latest |= dict.fromkeys(names[cell].binds, cell)
        latest |= dict.fromkeys(names[cell].imports, IMPORTED)
    return binders


def _contradiction(plan: Plan, cell: int, name: str, expected: int, binder: int | None) -> str:
    reader = f"code cell {cell} is tagged once and" if cell in plan.once else f"code cell {cell}"
    way_out = "remove the tag, or run all cells (--whole, whole=True)"
    if expected == SETTING:
        return f"{reader} reads {name}, which is swept; {way_out}"
    if expected == IMPORTED:
        return f"{reader} reads {name}, which only a cell tagged figure imports; {way_out}"
    if expected in plan.left_out:
        return f"code cell {expected} is tagged figure and binds {name}, which code cell {cell} reads; {way_out}"
    if binder is None:
        return f"{reader} reads {name}, which code cell {expected} binds at each setting; {way_out}"
    other = "a setting" if binder == SETTING else f"code cell {binder}"
    return (
        f"{reader} reads {name} of code cell {expected}, but as tagged that of {other}; "
        f"use two names, or run all cells (--whole, whole=True)"
    )


# the names in a cell


def names_of(source: str) -> Names:
    """The names in the text of a cell, as Python compiles it.

    What a function reads when it is called counts as read by the cell that defines it. Names in
    texts, such as those of ``DataFrame.query``, are not seen.
    """
    tree = _as_python(source)
    code: CodeType = compile(tree, "cell", "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
    reads, binds = set[str](), set[str]()
    for step in dis.get_instructions(code):
        if step.opname == "LOAD_NAME" and step.argval not in binds:
            reads.add(step.argval)
        elif step.opname in ("STORE_NAME", "STORE_GLOBAL"):
            binds.add(step.argval)
    for inner in _inner(code):
        own = set[str]()
        for step in dis.get_instructions(inner):
            if step.opname in ("LOAD_GLOBAL", "LOAD_NAME") and step.argval not in own | binds:
                reads.add(step.argval)
            elif step.opname == "STORE_NAME":  # in the body of a class
                own.add(step.argval)
            elif step.opname == "STORE_GLOBAL":
                binds.add(step.argval)
    return Names(frozenset(reads), frozenset(binds), frozenset(_imported(tree) & binds))


def _inner(code: CodeType) -> list[CodeType]:
    """The code of all functions, classes and comprehensions in some code."""
    inner = [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return inner + [deeper for one in inner for deeper in _inner(one)]


def _imported(tree: ast.Module) -> set[str]:
    """The names that are bound by imports and by nothing else."""
    imported, others = set[str](), set[str]()
    for node in ast.walk(tree):
        match node:
            case ast.alias(name=name, asname=alias):
                imported.add(alias or name.partition(".")[0])
            case ast.Name(id=name, ctx=ast.Store()):
                others.add(name)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                others.add(name)
    return imported - others


def _as_python(source: str) -> ast.Module:
    """A cell as Python; IPython's own syntax is translated, and a cell in another language is
    empty.
    """
    from IPython.core.inputtransformer2 import TransformerManager

    first, _, rest = source.lstrip().partition("\n")
    text = rest if first.startswith("%%") else source  # %%time and %%capture run Python
    try:
        return ast.parse(TransformerManager().transform_cell(text))
    except SyntaxError:
        return ast.parse("")
