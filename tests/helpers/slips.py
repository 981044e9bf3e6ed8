"""Slips of the pen, planted in a source: an operator, a comparison, a number, a sign, sides or arguments
swapped, a dropped term.
"""

import ast
from collections.abc import Callable
from typing import NamedTuple

OTHER_SIGN = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.MatMult: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Mod: ast.Add,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
OTHER_BORDER = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
TURNED_ROUND = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}


class Slip(NamedTuple):
    """A slip, not yet planted.

    Attributes
    ----------
    words : str
        The line, what stands there, and what is changed in it.
    place : int
        Number of the node in the order of `ast.walk`.
    change : callable
        Changes the node.
    """

    words: str
    place: int
    change: Callable[[ast.AST], object]


def slips(source: str) -> list[Slip]:
    """All slips of a module; texts, types and messages hold none."""
    tree = ast.parse(source)
    mute = _mute(tree)
    found = []
    for place, node in enumerate(ast.walk(tree)):
        if id(node) in mute:
            continue
        for what, change in (*changes(node), *_dropped(node)):
            first_line = ast.unparse(node).partition("\n")[0]
            found.append(Slip(f"line {node.lineno}: {first_line}: {what}", place, change))
    return found


def planted(source: str, slip: Slip) -> str:
    """The module's source with a slip."""
    tree = ast.parse(source)
    slip.change(node_at(tree, slip.place))
    return ast.unparse(ast.fix_missing_locations(tree))


def _dropped(node):
    """A term of a sum that is left out."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        yield "second term dropped", lambda it: setattr(it, "right", ast.Constant(0))


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


def node_at(tree, place):
    """The node with a number in the order of `ast.walk`."""
    return next(node for k, node in enumerate(ast.walk(tree)) if k == place)


def changes(node):  # noqa: C901
    """What may be changed in a node: in words, and a function that does it."""
    if isinstance(node, ast.BinOp) and type(node.op) in OTHER_SIGN:
        other = OTHER_SIGN[type(node.op)]
        yield other.__name__, lambda it: setattr(it, "op", other())
        if isinstance(node.op, ast.Sub | ast.Div | ast.MatMult):
            yield "sides swapped", _swap_sides
    if isinstance(node, ast.Compare):
        for k, op in enumerate(node.ops):
            for table in (OTHER_BORDER, TURNED_ROUND):
                if type(op) in table:
                    yield table[type(op)].__name__, _compared(k, table[type(op)])
    if isinstance(node, ast.BoolOp):
        other_word = ast.Or if isinstance(node.op, ast.And) else ast.And
        yield other_word.__name__, lambda it: setattr(it, "op", other_word())
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield "without its sign", lambda it: setattr(it, "op", ast.UAdd())
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        for step in (-1, 1):
            value = node.value + step
            yield f"{value}", lambda it, value=value: setattr(it, "value", value)
    if isinstance(node, ast.Call) and len(node.args) > 1:
        yield "arguments swapped", lambda it: it.args.reverse()
    if isinstance(node, ast.Tuple) and len(node.elts) > 1 and isinstance(node.ctx, ast.Load):
        yield "turned round", lambda it: it.elts.reverse()
    if isinstance(node, ast.Attribute) and node.attr == "T":
        yield "not transposed", lambda it: setattr(it, "attr", "real")
    if isinstance(node, ast.If):
        yield "never", lambda it: setattr(it, "test", ast.Constant(False))
        yield "always", lambda it: setattr(it, "test", ast.Constant(True))
    if isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add):
        yield "Sub", lambda it: setattr(it, "op", ast.Sub())


def _swap_sides(node):
    node.left, node.right = node.right, node.left


def _compared(k, op):
    def change(node):
        node.ops[k] = op()

    return change
