"""Notebooks as functions: read a chapter's parameters, run it with others, and take the numbers
that it stands for.

A notebook says what may be swept in the one code cell tagged ``parameters``; what it glues with
``myst_nb.glue`` is its result. The same call that puts a number into the text so puts it into a
table.
"""

from __future__ import annotations

import ast
import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trinolab.files import limits

from .exact import glued_name, value_of

# nbclient and nbformat belong to the extra "book": they are imported where they are used, so that
# the package imports without them.

ONE_THREAD = {
    name: "1"
    for name in (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "OPENCV_FOR_THREADS_NUM",
    )
}

"""Environment of a process that is one of several: without it each starts a thread a core."""


# The paper's letters, as `book/notation.md` has them, and what they are called in the chapters.
LETTERS = {
    "alpha": "update_rate",
    "T": "difference_threshold",
    "lambda": "surplus",
    "D_0": "epipolar_gate_px",
    "varepsilon_0": "ncc_threshold",
    "epsilon_0": "ncc_threshold",
    "epsilon": "ncc_threshold",
}

UNATTENDED = "TRINOLAB_UNATTENDED"

"""Set in a kernel that nobody watches: what would need a hand, such as a slider, shows a figure
instead.
"""


@dataclass(frozen=True)
class NotebookRun:
    """One execution of a notebook.

    Attributes
    ----------
    notebook : nbformat.NotebookNode
        The executed copy, with outputs.
    results : dict
        What was glued, by name: Python numbers, strings, lists ...; the plain text of what is none
        of these.
    seconds : float
        Wall time, the start of the kernel included.
    """

    notebook: Any
    results: dict[str, Any]
    seconds: float


def read_parameters(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the parameters of a notebook and their default values, without executing anything.

    Parameters
    ----------
    path : path-like
        The notebook, a file of nbformat 4.

    Returns
    -------
    dict
        Name -> default, in the order of the cell.

    Raises
    ------
    ValueError
        The file is missing or no notebook; it has no code cell tagged ``parameters``, or more than
        one; the cell holds anything but assignments ``name = literal`` or ``name: type = literal``.
    """
    notebook = read_notebook(path)
    return _assignments(notebook.cells[_parameters_index(notebook, path)].source, path)


def run_notebook(
    path: str | os.PathLike[str],
    parameters: Mapping[str, Any] | None = None,
    timeout_s: float | None = None,
) -> NotebookRun:
    """Execute a copy of a notebook in a fresh kernel, in the notebook's folder.

    New values go into a cell tagged ``injected-parameters`` right after the tagged one (papermill's
    convention); the file itself is not changed.

    Parameters
    ----------
    path : path-like
        The notebook, a file of nbformat 4.
    parameters : mapping, optional
        Name -> value for those parameters that differ from their defaults. Without it the notebook
        runs as it stands, and needs no tagged cell.
    timeout_s : float, optional
        The longest time that one cell may take, s; without it as long as it takes.

    Returns
    -------
    NotebookRun
        The executed copy, whose cells say when each was run, what it glued, and the time it took.

    Raises
    ------
    ValueError
        As in `read_parameters`; an unknown parameter; a value of another type than its default (an
        int for a float is fine, and anything for ``None``); a value that is no Python literal. All
        before anything runs.
    nbclient.exceptions.CellExecutionError
        A cell raised; the message holds its traceback.
    nbclient.exceptions.CellTimeoutError
        A cell took longer than `timeout_s`.
    nbclient.exceptions.DeadKernelError
        The kernel died.
    """
    from nbclient import NotebookClient

    notebook = read_notebook(path)
    if parameters is not None:
        inject(notebook, parameters, path)
    folder = str(Path(path).resolve().parent)
    client = NotebookClient(notebook, timeout=timeout_s, resources={"metadata": {"path": folder}})
    start = time.perf_counter()
    client.execute(env={**os.environ, **ONE_THREAD, UNATTENDED: "1"})
    return NotebookRun(notebook, glued(notebook), time.perf_counter() - start)


def glued(notebook: Any) -> dict[str, Any]:
    """Return what an executed notebook stored with ``myst_nb.glue``.

    Parameters
    ----------
    notebook : nbformat.NotebookNode
        An executed notebook.

    Returns
    -------
    dict
        Name -> value; a name that is glued twice has the later value.
    """
    results: dict[str, Any] = {}
    for cell in notebook.cells:
        results |= glued_in_cell(cell)
    return results


def glued_in_cell(cell: Any) -> dict[str, Any]:
    """What one executed cell stored with ``myst_nb.glue``, values by name."""
    return {
        name: value_of(output.data, output.metadata)
        for output in cell.get("outputs", [])
        if (name := glued_name(output.get("metadata", {}))) is not None
    }


def read_notebook(path: str | os.PathLike[str]) -> Any:
    """Return a notebook; ValueError, which names the file, if it is none, or larger than `limits`
    says.
    """
    import nbformat

    try:
        content = limits.read_bytes(Path(path), limits.TREE_BYTES)
    except OSError as error:
        raise ValueError(
            f"{path}: expected a notebook, got {type(error).__name__}: {error}"
        ) from None
    try:
        return nbformat.reads(content.decode(), as_version=4)
    except Exception as error:  # a broken file makes nbformat fail in many ways
        raise ValueError(
            f"{path}: expected a notebook, got {type(error).__name__}: {error}"
        ) from None


def as_notebook(text: str) -> Any:
    """A notebook from its content as JSON."""
    import nbformat

    return nbformat.from_dict(json.loads(text))


def _parameters_index(notebook: Any, path: str | os.PathLike[str]) -> int:
    tagged = [
        i
        for i, cell in enumerate(notebook.cells)
        if cell.cell_type == "code" and "parameters" in cell.metadata.get("tags", [])
    ]
    if len(tagged) != 1:
        raise ValueError(f"{path}: expected one code cell tagged 'parameters', got {len(tagged)}")
    return tagged[0]


def _assignments(source: str, path: str | os.PathLike[str]) -> dict[str, Any]:
    try:
        statements = ast.parse(source).body
        return dict(_assignment(statement) for statement in statements)
    except (SyntaxError, ValueError) as error:
        raise ValueError(
            f"{path}: the cell tagged 'parameters' may only hold name = literal; {error}"
        ) from None


def _assignment(statement: ast.stmt) -> tuple[str, Any]:
    match statement:
        case (
            ast.Assign(targets=[ast.Name(id=name)], value=value)
            | ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value)
        ):
            return name, _literal_of(name, value)
    raise ValueError(f"line {statement.lineno}: {ast.unparse(statement)}")


def _literal_of(name: str, value: ast.expr) -> Any:
    """The object that an expression denotes; ValueError if it must be computed."""
    try:
        return ast.literal_eval(value)
    except ValueError:
        raise ValueError(
            f"line {value.lineno}: {name} = {ast.unparse(value)} must be computed; "
            "write its value as a number or text, or compute it in another cell"
        ) from None


def inject(notebook: Any, parameters: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Put parameters into a notebook, in a cell of their own after the tagged one; ValueError as
    for `run_notebook`.

    A cell that was put there before is replaced.
    """
    import nbformat

    index = _parameters_index(notebook, path)
    lines = assignments(_assignments(notebook.cells[index].source, path), parameters, path)
    notebook.cells = [
        cell
        for cell in notebook.cells
        if "injected-parameters" not in cell.metadata.get("tags", [])
    ]
    if not lines:
        return
    cell = nbformat.v4.new_code_cell("\n".join(lines), metadata={"tags": ["injected-parameters"]})
    if notebook.nbformat_minor < 5:
        del cell["id"]  # cells have an identity only from 4.5 on
    notebook.cells.insert(_parameters_index(notebook, path) + 1, cell)


def assignments(
    defaults: Mapping[str, Any], parameters: Mapping[str, Any], path: str | os.PathLike[str]
) -> list[str]:
    """Parameters as lines of code; ValueError, with those that there are, for one that does not fit
    the defaults.
    """
    has = f"it has {', '.join(defaults) or 'none'}"
    unknown = sorted(set(parameters) - set(defaults))
    if unknown:
        meant = [f"{name} is {LETTERS[name]}" for name in unknown if LETTERS.get(name) in defaults]
        raise ValueError(
            f"{path}: unknown parameter {', '.join(unknown)}; {', '.join([*meant, has])}"
        )
    try:
        return [
            f"{name} = {_literal(value, defaults[name], name)}"
            for name, value in parameters.items()
        ]
    except ValueError as error:
        raise ValueError(f"{path}: {error}; {has}") from None


def _literal(value: Any, default: Any, name: str) -> str:
    """Return the value's source text; refuse another type than the default's."""
    value = value.item() if isinstance(value, np.generic) else value
    fits = (
        default is None
        or type(value) is type(default)
        or (type(default) is float and type(value) is int)
    )
    if not fits:
        raise ValueError(
            f"{name}: expected {type(default).__name__} as in {default!r}, got {value!r}"
        )
    try:
        ast.literal_eval(repr(value))
    except (SyntaxError, ValueError):
        raise ValueError(f"{name}: expected a Python literal, got {value!r}") from None
    return repr(value)
