"""Which shipped tables the cells of a notebook read, and which command makes each again."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..studies.__main__ import MAKES

ROOT = Path(__file__).resolve().parents[3]
# the functions that read a table by its name -> the folder that it is in, below `data`
LOADERS = {"load_sweep": "sweeps", "gallery.load": "sweeps/gallery"}


def tables_read(sources: list[str]) -> list[list[str]]:
    """The shipped files that each cell of a notebook shows, read by itself or by a cell whose names
    it uses.

    Parameters
    ----------
    sources : list of str
        The code of each cell; IPython's own syntax counts as no code.

    Returns
    -------
    list of list of str
        Paths below the folder ``data``.
    """
    of_name: dict[str, set[str]] = {}
    loaders = dict(LOADERS)
    of_cells = []
    for source in sources:
        try:
            tree = ast.parse(source)
        except SyntaxError:
            tree = ast.Module([], [])
        texts = _texts(ast.walk(tree))
        files: set[str] = set()
        for statement in _one_by_one(tree.body):
            names = _Names(statement)
            own = set(_files_named(statement, texts, loaders))
            own = own.union(*(of_name.get(name, set()) for name in names.read))
            for name in names.made:
                of_name[name] = set(own)
            for name in names.changed:
                of_name[name] = of_name.get(name, set()) | own
            files |= own
        of_cells.append(sorted(files))
    return of_cells


def _one_by_one(statements: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements in the order in which they are read, those of blocks one by one after the block's
    head, as if each were run once.
    """
    for statement in statements:
        match statement:
            case ast.For(target=target, iter=value):
                yield ast.Assign([target], value)
            case ast.If(test=value) | ast.While(test=value):
                yield ast.Expr(value)
            case ast.With(items=items):
                yield from (
                    ast.Assign(
                        [item.optional_vars] if item.optional_vars else [], item.context_expr
                    )
                    for item in items
                )
            case ast.Try():
                pass
            case _:
                yield statement
                continue
        for block in ("body", "handlers", "orelse", "finalbody"):
            for part in getattr(statement, block, []):
                yield from _one_by_one(part.body if block == "handlers" else [part])


class _Names(ast.NodeVisitor):
    """The names that a statement reads, makes, and changes the things of; what it has for itself, such
    as the arguments of a function and the variables of a comprehension, is none that it reads.
    """

    def __init__(self, statement: ast.stmt) -> None:
        self.read: set[str] = set()
        self.made: set[str] = set()
        self.changed: set[str] = set()
        self._own: set[str] = set()
        self.visit(statement)
        self.read -= self._own

    def visit_Name(self, node: ast.Name) -> None:
        (self.read if isinstance(node.ctx, ast.Load) else self.made).add(node.id)

    def visit_arg(self, node: ast.arg) -> None:
        self._own.add(node.arg)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.generic_visit(node)
        self._own |= self.made
        self.made = {node.name}

    def visit_comprehension(self, node: ast.comprehension) -> None:
        self._own |= {one.id for one in ast.walk(node.target) if isinstance(one, ast.Name)}
        self.visit(node.iter)
        for test in node.ifs:
            self.visit(test)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        if isinstance(node.ctx, ast.Store) and isinstance(node.value, ast.Name):
            self.changed.add(node.value.id)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        method = node.func
        if isinstance(method, ast.Attribute) and method.attr in ("append", "extend", "update"):
            self.changed |= {method.value.id} if isinstance(method.value, ast.Name) else set()
        self.generic_visit(node)


def _files_named(tree: ast.stmt, texts: list[str], loaders: dict[str, str]) -> Iterator[str]:
    """The shipped files that the calls of a statement name; where a variable names them, those of its
    cell's texts that are names of tables. A function that is given such a name becomes a loader.
    """
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        name = ast.unparse(call.func).removeprefix("datasets.")
        parts = _texts(call.args)
        if name == "data_path" and len(parts) == len(call.args):
            yield "/".join(parts)
        elif name in loaders:
            named = [f"{loaders[name]}/{text}.csv" for text in parts[:1] or texts]
            yield from (path for path in named if (ROOT / "data" / path).is_file())
            if isinstance(tree, ast.FunctionDef) and not parts:
                loaders[tree.name] = loaders[name]


def _texts(nodes: Iterable[ast.AST]) -> list[str]:
    """The texts among nodes."""
    values = [node.value for node in nodes if isinstance(node, ast.Constant)]
    return [value for value in values if isinstance(value, str)]


def command_for(table: str) -> str:
    """The command that makes a file of the folder ``data`` again; empty for what was typed.

    Parameters
    ----------
    table : str
        Its path below that folder.
    """
    place = Path(table)
    if place.parent.as_posix() == "accept":
        return "make sheet"
    if place.parent.as_posix() == "sweeps/gallery":
        return f"python -m workbench.studies gallery {place.stem}"
    for study, tables in MAKES.items():
        if place.suffix == ".csv" and place.stem in tables:
            option = f" --factor {place.stem}" if study == "factors" else ""
            return f"python -m workbench.studies {study}{option}"
    return ""
