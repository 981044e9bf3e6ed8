"""Slips of the pen, planted in a module's source: an operator, a comparison, a number, a sign, a dropped term."""

import ast
from collections.abc import Iterator
from typing import NamedTuple

OPERATORS = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


class Slip(NamedTuple):
    """A slip, not yet planted.

    Attributes
    ----------
    words : str
        The line, what stands there and what the slip makes of it.
    place : int
        Number of the expression in the order of `ast.walk`.
    changed : ast.expr
    """

    words: str
    place: int
    changed: ast.expr


def slips(source: str) -> list[Slip]:
    """All slips of a module; texts, types and messages hold none."""
    tree = ast.parse(source)
    mute = _mute(tree)
    return [
        Slip(f"line {node.lineno}: {ast.unparse(node)} -> {ast.unparse(changed)}", place, changed)
        for place, node in enumerate(ast.walk(tree))
        if id(node) not in mute
        for changed in _changes(node)
    ]


def planted(source: str, slip: Slip) -> str:
    """The module's source with a slip."""
    tree = ast.parse(source)
    old = next(node for place, node in enumerate(ast.walk(tree)) if place == slip.place)
    _replace(tree, old, slip.changed)
    return ast.unparse(ast.fix_missing_locations(tree))


def _mute(tree: ast.AST) -> set[int]:
    """Identities of the nodes in annotations, decorators and messages."""
    mute = set()
    for node in ast.walk(tree):
        parts = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        parts += getattr(node, "decorator_list", [])
        if isinstance(node, ast.Raise | ast.JoinedStr):
            parts.append(node)
        mute |= {id(inner) for part in parts if part is not None for inner in ast.walk(part)}
    return mute


def _changes(node: ast.AST) -> Iterator[ast.expr]:
    """What may stand in the place of an expression."""
    if isinstance(node, ast.BinOp):
        if type(node.op) in OPERATORS:
            yield ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right)
        if isinstance(node.op, ast.MatMult):
            yield ast.BinOp(node.right, node.op, node.left)
        if isinstance(node.op, ast.Add | ast.Sub):
            yield node.left
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(OPERATORS[type(node.op)](), node.values)
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPERATORS:
        first = OPERATORS[type(node.ops[0])]()
        yield ast.Compare(node.left, [first, *node.ops[1:]], node.comparators)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield node.operand
    elif isinstance(node, ast.Constant) and type(node.value) is int:
        yield ast.Constant(node.value + 1)
    elif isinstance(node, ast.Constant) and type(node.value) is float:
        yield ast.Constant(1.1 * node.value if node.value else 0.1)


def _replace(tree: ast.AST, old: ast.AST, changed: ast.expr) -> None:
    for parent in ast.walk(tree):
        for name, value in ast.iter_fields(parent):
            if value is old:
                setattr(parent, name, changed)
            elif isinstance(value, list):
                setattr(parent, name, [changed if one is old else one for one in value])
