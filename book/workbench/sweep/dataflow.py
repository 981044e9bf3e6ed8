"""What each statement of a notebook reads, binds and changes, from its text alone.

The statements are gone through in their order. Behind the names stand objects: after ``b = a[0]``
a change of ``b`` is one of ``a``. A whole and its parts are one object, and a call may give back
what it was given. A function of the notebook is looked into wherever it is named.

What the text cannot say is taken for granted: that a function of a library changes random
generators, what it gets as ``out=`` and nothing else, unless its value is thrown away; then it may
change whatever it was given, and the world outside (`OUTSIDE`). Matplotlib and its like only draw.
A method changes its object, unless it is known not to (`PURE`). What `exec`, a magic and the like
read and change cannot be known (`ANY`).

>>> cell = ast.parse("b = a[0]; b.append(c); print(b); glue('size', len(a))").body
>>> flow = Flow()
>>> whole = flow.block(cell)
>>> taken, appended, printed, glued = [flow.effects[statement] for statement in cell]
>>> bool(appended.changes & glued.reads), bool(printed.changes & glued.reads)
(True, False)
"""

from __future__ import annotations

import ast
import builtins
from collections.abc import Callable, Hashable, Iterable, Sequence, Set
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

__all__ = ["ANY", "OUTSIDE", "RANDOM", "RESULTS", "Effects", "Flow", "Look", "Thing", "Value"]


class Thing(NamedTuple):
    """What a name may stand for: an object, a drawing, a generator of random numbers, a module or
    what is imported from it, a function or class of the notebook; or something without a name.
    """

    kind: str
    which: int | str


ANY = Thing("world", "any name and any object")
OUTSIDE = Thing("world", "outside of the notebook's names")
RANDOM = Thing("world", "the global random numbers")
RESULTS = Thing("world", "the results")
GIVEN = Thing("object", "the objects that a function is given")
HELD = Thing("object", "what these hold")

Things = frozenset[Thing]


class Value(NamedTuple):
    """What a value may be, or be a part of; and what it holds, as a list does."""

    own: Things = frozenset()
    held: Things = frozenset()

    @property
    def every(self) -> Things:
        """All that belongs to it."""
        return self.own | self.held

    def or_(self, *others: Value) -> Value:
        """One of several values."""
        return Value(
            self.own.union(*(other.own for other in others)),
            self.held.union(*(other.held for other in others)),
        )

    def part(self) -> Value:
        """One of its parts; what a module has is no module."""
        return Value(frozenset(one for one in self.every if one.kind != "module"), self.held)

    def inside(self) -> Value:
        """What holds it."""
        return Value(frozenset(), self.part().own)

    def of(self, given: Value) -> Value:
        """What it is for a function that is given this."""
        own, held = (frozenset(_concrete(things, given)) for things in self)
        return Value(own, held)


NOTHING = Value()

OPAQUE = {"exec", "eval", "globals", "locals", "vars", "setattr", "delattr", "__import__"}
OPAQUE |= {"get_ipython", "compile"}
HARMLESS = {"print", "display"}
FRESH = {"abs", "all", "any", "bool", "complex", "divmod", "float", "format", "hash", "int", "len"}
FRESH |= {"isinstance", "pow", "print", "range", "repr", "round", "str", "sum", "type"}
RESULT_MODULES = ("myst_nb", "scrapbook")
DRAWING: tuple[str, ...] = (
    "matplotlib",
    "workbench.plotting",
    "IPython.display",
    "pyvista",
    "ipywidgets",
)
DRAWING += ("workbench.sweep.sliders", "workbench.sweep.figures", "workbench.applets")
COMPUTING = ("numpy", "scipy", "cv2", "heapq", "bisect")
MAKING_NEW = ("numpy", "math", "cmath", "statistics", "trinolab", "workbench")
OPENCV_RANDOM = ("cv2.rand", "cv2.setRNG", "cv2.theRNG", "cv2.kmeans")
WRITING = ("write", "save", "unlink", "mkdir", "rmdir", "touch", "to_csv")
SETTING = ("set", "save", "imwrite", "use", "write")  # so begin names of what is no computation
OUTER_MODULES = ("os", "sys", "shutil", "subprocess", "importlib", "ctypes", "threading", "socket")
GENERATORS = {"default_rng", "Generator", "RandomState", "Random", "SeedSequence", "PCG64"}
VIEWS = {"asarray", "asanyarray", "ascontiguousarray", "atleast_1d", "atleast_2d", "atleast_3d"}
VIEWS |= {"array_split", "broadcast_arrays", "broadcast_to", "diagonal", "expand_dims", "flip"}
VIEWS |= {"fliplr", "flipud", "moveaxis", "ravel", "real", "imag", "reshape", "rollaxis", "rot90"}
VIEWS |= {"split", "squeeze", "swapaxes", "transpose", "hsplit", "vsplit", "frombuffer"}
MUTATORS = {"add", "append", "appendleft", "clear", "discard", "extend", "fill", "insert", "pop"}
MUTATORS |= {"popitem", "remove", "reverse", "setdefault", "setflags", "sort", "update"}

# Methods of numbers, texts, containers, arrays, tables, rigid motions and of this package's frozen
# data that leave their object as it is. The first give something new, the others perhaps a part.
COPYING = {
    "all",
    "any",
    "argmax",
    "argmin",
    "argsort",
    "as_euler",
    "as_matrix",
    "as_quat",
    "astype",
}
COPYING |= {"as_rotvec", "copy", "count", "cumsum", "dot", "endswith", "flatten", "format", "index"}
COPYING |= {"is_integer", "isna", "item", "join", "lower", "magnitude", "max", "mean", "median"}
COPYING |= {"min", "nonzero", "notna", "nunique", "prod", "quantile", "replace", "round", "split"}
COPYING |= {"startswith", "std", "strip", "sum", "tobytes", "tolist", "upper", "var"}
PURE = COPYING | {
    "_asdict",
    "_replace",
    "agg",
    "apply",
    "clip",
    "clipped",
    "concatenate",
    "contains",
}
PURE |= {"crop", "from_components", "get", "groupby", "grown", "images_of", "inv", "items", "keys"}
PURE |= {"project", "rays", "reindex", "reset_index", "reshape", "set_index", "squeeze", "to_numpy"}
PURE |= {"head", "merge", "pivot", "rename", "sort_values", "transpose", "unique", "values", "view"}
PURE |= {"where"}


class Look(NamedTuple):
    """What a call of a function reads and changes outside of it, what names stand for after it, and
    what it returns.
    """

    reads: set[str | Thing]
    changes: set[str | Thing]
    values: dict[str, Value]
    returned: Value


@dataclass
class Effects:
    """What a piece of code does to names and things.

    Attributes
    ----------
    reads : set
        Names and things that it needs as they were before it.
    binds : set of str
        Names that it binds in any case.
    changes : set
        Names that it may bind, and things that it may change.
    """

    reads: set[str | Thing] = field(default_factory=set)
    binds: set[str] = field(default_factory=set)
    changes: set[str | Thing] = field(default_factory=set)

    @property
    def writes(self) -> set[str | Thing]:
        """All that may be another after it."""
        return self.changes | self.binds

    def then(self, other: Effects) -> None:
        """Go on with other code."""
        self.reads |= other.reads - self.binds
        self.binds |= other.binds
        self.changes |= other.changes

    def perhaps(self, *others: Effects) -> None:
        """Go on with one of several pieces of code."""
        for other in others:
            self.reads |= other.reads - self.binds
            self.changes |= other.changes | other.binds
        self.binds |= set.intersection(*(other.binds for other in others))


class Flow:
    """Goes through statements in their order.

    Attributes
    ----------
    effects : dict
        From each statement, also those within others, to its `Effects`.
    headers : dict
        From each `for` and `if` to what its first line does: the iterator, the condition.
    """

    def __init__(self) -> None:
        self.effects: dict[ast.stmt, Effects] = {}
        self.headers: dict[ast.stmt, Effects] = {}
        self._values: dict[str, Value] = {}  # what each name stands for now
        self._functions: dict[Thing, ast.AST] = {}
        self._inside: list[Thing] = []  # functions that are being looked into
        self._looks: dict[Hashable, Look] = {}  # what looking into a function has shown
        self._returned: list[Value] = []
        self._now = Effects()

    def block(self, statements: Iterable[ast.stmt]) -> Effects:
        """Go through statements, one after the other."""
        whole = Effects()
        for statement in statements:
            whole.then(self._statement(statement))
        return whole

    def draws(self, effects: Effects) -> bool:
        """Whether code that was just gone through has bound a drawing."""
        names = [name for name in effects.writes if isinstance(name, str)]
        return any(thing.kind == "drawn" for name in names for thing in self._known(name).every)

    def _statement(self, node: ast.stmt) -> Effects:
        before = self._now
        self._now = Effects()
        self._visit(node)
        done, self._now = self._now, before
        if not self._inside:  # a loop's statements are gone through twice
            earlier = self.effects.get(node, Effects())
            done.reads |= earlier.reads
            done.changes |= earlier.changes
            self.effects[node] = done
        return done

    def _visit(self, node: ast.stmt) -> None:
        match node:
            case ast.Assign(targets=targets, value=value):
                got = self._value(value)
                for target in targets:
                    self._bind(target, got, value)
            case ast.AnnAssign(target=target, value=value):
                if value is not None:
                    self._bind(target, self._value(value), value)
            case ast.AugAssign(target=target, value=value):
                self._augment(target, self._value(value))
            case ast.Delete(targets=targets):
                for target in targets:
                    self._bind(target, NOTHING)
            case ast.Import() | ast.ImportFrom():
                self._import(node)
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                self._definition(node)
            case _:
                self._visit_block(node)

    def _visit_block(self, node: ast.stmt) -> None:
        """Visit a statement that holds others, or none of those above."""
        match node:
            case ast.For() | ast.AsyncFor():
                self._header(node, lambda: self._bind_each(node.target, node.iter))
                self._loop(node)
            case ast.While(test=test):
                self._value(test)
                self._loop(node)
                self._value(test)
            case ast.If(test=test, body=body, orelse=orelse):
                self._header(node, lambda: self._value(test))
                self._either(body, orelse)
            case ast.With(items=items, body=body) | ast.AsyncWith(items=items, body=body):
                for item in items:
                    got = self._value(item.context_expr)
                    if item.optional_vars is not None:
                        self._bind(item.optional_vars, got)
                self._now.then(self.block(body))
            case ast.Try():
                self._try(node)
            case _:
                self._visit_other(node)

    def _visit_other(self, node: ast.stmt) -> None:
        match node:
            case ast.Expr(value=ast.Call() as call):
                self._call(call, thrown_away=True)
            case ast.Return(value=value):
                if value is not None:
                    self._give(self._value(value))
            case ast.Raise():
                self._children(node)
                self._now.changes.add(RESULTS)  # a run that raises gives none
            case ast.Expr() | ast.Assert() | ast.Pass() | ast.Break() | ast.Continue():
                self._children(node)
            case _:  # global, match and whatever comes
                self._children(node)
                self._unknown()

    def _unknown(self) -> None:
        self._now.reads.add(ANY)
        self._now.changes.add(ANY)

    def _give(self, value: Value) -> None:
        """Let the function that is looked into return a value."""
        if self._returned:
            self._returned[-1] = self._returned[-1].or_(value)

    def _header(self, node: ast.stmt, visit: Callable[[], object]) -> None:
        """Visit a first line, and keep what it does by itself."""
        before, self._now = self._now, Effects()
        visit()
        header, self._now = self._now, before
        self._now.then(header)
        self.headers[node] = header

    def _loop(self, node: ast.For | ast.AsyncFor | ast.While) -> None:
        for _ in range(2):  # what the end of a body has bound, its beginning may read
            self._either(node.body, [])
            if not isinstance(node, ast.While):
                self._bind_each(node.target, node.iter)
        self._either(node.orelse, [])

    def _either(self, body: Sequence[ast.stmt], orelse: Sequence[ast.stmt]) -> None:
        """One of two blocks: afterwards a name stands for what it is after either."""
        before = dict(self._values)
        first = self.block(body)
        after_first, self._values = self._values, before
        second = self.block(orelse)
        for name, value in after_first.items():
            self._values[name] = self._values.get(name, NOTHING).or_(value)
        self._now.perhaps(first, second)

    def _try(self, node: ast.Try) -> None:
        self._either(node.body, [])
        for handler in node.handlers:
            if handler.type is not None:
                self._value(handler.type)
            self._either(handler.body, [])
        self._either(node.orelse, [])
        self._now.then(self.block(node.finalbody))

    def _import(self, node: ast.Import | ast.ImportFrom) -> None:
        for alias in node.names:
            if alias.name == "*":
                self._unknown()
                continue
            of = f"{node.module}." if isinstance(node, ast.ImportFrom) else ""
            name = alias.asname or alias.name
            origin = f"{of}{alias.name}"
            if not of and alias.asname is None:  # import a.b binds a
                name = origin = alias.name.partition(".")[0]
            self._now.binds.add(name)
            self._values[name] = Value(frozenset({Thing("module", origin)}))

    def _definition(self, node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> None:
        for part in node.decorator_list:
            self._value(part)
        if isinstance(node, ast.ClassDef):
            for base in node.bases:
                self._value(base)
        else:
            for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
                self._value(default)
        self._now.binds.add(node.name)
        self._values[node.name] = Value(frozenset({self._function(node)}))

    def _function(self, node: ast.AST) -> Thing:
        thing = Thing("function", id(node))
        self._functions[thing] = node
        return thing

    # names

    def _known(self, name: str) -> Value:
        """What a name stands for; one that is not bound yet is an object, unless it is Python's."""
        if name not in self._values and not hasattr(builtins, name):
            return Value(frozenset({Thing("object", name)}))
        return self._values.get(name, NOTHING)

    def _bind(self, target: ast.AST, value: Value, code: ast.AST | None = None) -> None:
        """Let a target stand for a value, which this code gives."""
        match target:
            case ast.Name(id=name):
                self._now.binds.add(name)
                if isinstance(code, ast.Constant):  # which nothing can change
                    self._values[name] = NOTHING
                else:
                    self._values[name] = Value(value.own | {_new(target)}, value.held)
            case ast.Tuple(elts=targets) | ast.List(elts=targets):
                values = code.elts if isinstance(code, (ast.Tuple, ast.List)) else []
                for k, part in enumerate(targets):
                    if len(values) == len(targets):
                        self._bind(part, self._value_of(values[k]), values[k])
                    else:
                        self._bind(part, value.part())
            case ast.Starred(value=inner):
                self._bind(inner, value.part())
            case ast.Attribute(value=owner) | ast.Subscript(value=owner):
                self._children(target)
                self._change_part(owner, value)

    def _change_part(self, owner: ast.expr, value: Value) -> None:
        """``owner.a = ...``, ``owner[i] = ...``: then it holds the value."""
        root = _root(owner)
        for thing in self._values.get(root or "", NOTHING).own:
            if thing.kind == "module" and not _is_in(str(thing.which), DRAWING):
                self._unknown()
        self._change(self._value_of(owner).own)
        self._hold(root, value)

    def _hold(self, root: str | None, value: Value) -> None:
        if root is not None:
            self._values[root] = self._known(root).or_(value.inside())

    def _augment(self, target: ast.AST, value: Value) -> None:
        if isinstance(target, ast.Name):
            self._name(target.id)
            self._change(self._known(target.id).own)  # an array's += is in place
            self._now.binds.add(target.id)
            old = self._known(target.id)
            self._values[target.id] = Value(old.own | {_new(target)}, old.held | value.every)
        else:
            self._bind(target, value)

    def _bind_each(self, target: ast.AST, iterable: ast.expr) -> None:
        """Let a target stand for what an iterable gives; zip and enumerate give things apart."""
        value = self._value(iterable)
        parts = target.elts if isinstance(target, (ast.Tuple, ast.List)) else []
        match iterable:
            case ast.Call(func=ast.Name(id="zip"), args=given) if len(given) == len(parts):
                for part, argument in zip(parts, given, strict=True):
                    self._bind(part, self._value_of(argument).part())
            case ast.Call(func=ast.Name(id="enumerate"), args=[argument, *_]) if len(parts) == 2:
                self._bind(parts[0], NOTHING)
                self._bind(parts[1], self._value_of(argument).part())
            case _:
                self._bind(target, value.part())

    def _change(self, things: Iterable[Thing]) -> None:
        changing = ("object", "drawn", "generator")
        self._now.changes |= {thing for thing in things if thing.kind in changing}

    def _name(self, name: str, given: Value = NOTHING, place: ast.AST | None = None) -> Value:
        """Read a name; look into a function, which may be called with what is `given` at a place of
        the code, and give what it returns.
        """
        if name in OPAQUE and name not in self._values:
            self._unknown()
        if name not in self._now.binds:
            self._now.reads.add(name)
        things = self._known(name).every
        self._now.reads |= {thing for thing in things if thing.kind not in ("module", "function")}
        functions = [thing for thing in things if thing in self._functions]
        return NOTHING.or_(*(self._look_into(thing, given, place) for thing in functions))

    def _look_into(self, function: Thing, given: Value, place: ast.AST | None = None) -> Value:
        """What a function or the methods of a class do with what they are given; what it gives.

        It is looked into once for all objects that it may be given, in a state of its outer names.
        """
        if function in self._inside:
            return NOTHING
        some = Value(_abstract(given.own, GIVEN), _abstract(given.held, HELD))
        names, functions = self._behind(function, some)
        known = frozenset((name, self._values[name]) for name in names & self._values.keys())
        case = (function, some, place, functions & set(self._inside), known)
        if case not in self._looks:
            self._looks[case] = self._look(function, some, place)
        look = self._looks[case]
        self._now.reads |= _concrete(look.reads, given) - self._now.binds
        self._now.changes |= _concrete(look.changes, given)
        for name, value in look.values.items():
            self._values[name] = value.of(given)
        return look.returned.of(given)

    def _behind(self, function: Thing, given: Value) -> tuple[set[str], Things]:
        """The names and functions on which depends what looking into a function shows."""
        names: set[str] = set()
        seen: set[Thing] = set()
        ahead = {function, *given.every} & self._functions.keys()
        while ahead:
            seen |= ahead
            names.update(*(_free_names(self._functions[thing]) for thing in ahead))
            things = {thing for name in names for thing in self._known(name).every}
            ahead = (things & self._functions.keys()) - seen
        return names, frozenset(seen)

    def _look(self, function: Thing, given: Value, place: ast.AST | None) -> Look:
        node = self._functions[function]
        outer, before = self._values, self._now
        self._inside.append(function)
        self._returned.append(NOTHING)
        self._now = Effects()
        self._values = {**outer, **dict.fromkeys(_parameters(node), given)}
        if isinstance(node, ast.Lambda):
            self._give(self._value(node.body))
        elif isinstance(node, ast.ClassDef):
            self._now.then(self.block(node.body))
            for method in node.body:
                if isinstance(method, (ast.FunctionDef, ast.AsyncFunctionDef)):
                    self._look_into(self._function(method), given)
            # an object of the class brings its methods along
            self._give(Value(frozenset({function}), given.every))
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            self._now.then(self.block(node.body))
        inner, self._now = self._now, before
        values, self._values = self._values, outer
        self._inside.pop()
        local = _locals(node)
        its_own = {id(part) for part in ast.walk(node)}  # each call makes them anew
        returned = self._returned.pop()
        closure = any(thing in self._functions for thing in returned.every)
        return Look(
            _without(inner.reads - local, its_own),
            _without(inner.changes - local, its_own),
            {
                name: outer[name].or_(value)
                for name, value in values.items()
                if name not in local and outer.get(name, value) != value
            },
            _renamed(
                returned.or_(given.inside()) if closure else returned,
                its_own,
                _new(node if place is None else place),
            ),
        )

    # expressions

    def _children(self, node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):
                self._value(child)

    def _value(self, node: ast.expr) -> Value:
        """Visit an expression, and give its value."""
        match node:
            case ast.Name(id=name):
                self._name(name)
                return self._known(name)
            case ast.Call():
                return self._call(node)
            case ast.NamedExpr(target=target, value=inner):
                value = self._value(inner)
                self._bind(target, value)
                return value
            case ast.Lambda():
                function = self._function(node)
                self._look_into(function, NOTHING)
                return Value(frozenset({function}))
            case ast.ListComp() | ast.SetComp() | ast.GeneratorExp() | ast.DictComp():
                return self._comprehension(node)
            case ast.Yield(value=inner) | ast.YieldFrom(value=inner):
                if inner is not None:
                    self._give(self._value(inner).inside())
                return NOTHING
        return self._value_of_parts(node)

    def _value_of_parts(self, node: ast.expr) -> Value:
        match node:
            case ast.Tuple(elts=parts) | ast.List(elts=parts) | ast.Set(elts=parts):
                return NOTHING.or_(*map(self._value, parts)).inside()
            case ast.Dict(keys=keys, values=values):
                for key in filter(None, keys):  # which nobody can change: it has a hash
                    self._value(key)
                return NOTHING.or_(*map(self._value, values)).inside()
            case ast.IfExp(test=test, body=body, orelse=orelse):
                self._value(test)
                return self._value(body).or_(self._value(orelse))
            case ast.BoolOp(values=values):
                return NOTHING.or_(*map(self._value, values))
            case ast.Starred(value=inner) | ast.Await(value=inner):
                return self._value(inner)
            case ast.Attribute(value=inner):
                return self._value(inner).part()
            case ast.Subscript(value=inner, slice=index):
                self._value(index)
                return self._value(inner).part()
        self._children(node)
        return NOTHING

    def _comprehension(
        self, node: ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp
    ) -> Value:
        outer, before = dict(self._values), self._now
        self._now = Effects()
        for generator in node.generators:
            self._bind_each(generator.target, generator.iter)
            for condition in generator.ifs:
                self._value(condition)
        if isinstance(node, ast.DictComp):
            self._value(node.key)
        part = node.value if isinstance(node, ast.DictComp) else node.elt
        value = self._value(part).inside()
        inner, self._now, self._values = self._now, before, outer
        self._now.reads |= inner.reads - self._now.binds
        self._now.changes |= inner.changes
        return value

    def _value_of(self, node: ast.expr) -> Value:
        """The value of an expression that is visited elsewhere."""
        before, self._now = self._now, Effects()
        values = dict(self._values)
        value = self._value(node)
        self._now, self._values = before, values
        return value

    # calls

    def _call(self, node: ast.Call, thrown_away: bool = False) -> Value:
        arguments = [*node.args, *(keyword.value for keyword in node.keywords)]
        values = [self._value(argument) for argument in arguments]
        given = NOTHING.or_(*values)
        for argument in arguments:
            if isinstance(argument, ast.Name):
                self._name(argument.id, given)  # a function that is given may get the rest
        self._change(thing for thing in given.every if thing.kind == "generator")
        for keyword in node.keywords:
            if keyword.arg == "out":
                self._change(self._value_of(keyword.value).own)
        value = self._callee(node, given, thrown_away)
        for argument, before in zip(arguments, values, strict=True):
            if self._now.changes & before.own:  # one that was changed may hold the others
                self._hold(_root(argument), given)
        return value

    def _callee(self, node: ast.Call, given: Value, thrown_away: bool) -> Value:
        match node.func:
            case ast.Name(id=name) if name not in self._values:
                return self._builtin(name, given, thrown_away)
            case ast.Name(id=name):
                return self._called(name, given, thrown_away, node)
            case ast.Attribute(value=owner, attr=method):
                value = self._value(owner)
                if origin := _origin(node.func, self._values):
                    return self._library(origin, given, thrown_away, node)
                if method not in PURE:
                    self._hold(_root(owner), given)
                return self._method(method, value, given, thrown_away)
        value = self._value(node.func).or_(given)
        self._change(value.every)
        return value

    def _builtin(self, name: str, given: Value, thrown_away: bool) -> Value:
        """A call of a name that the notebook does not bind."""
        self._name(name)
        if name == "glue":
            self._now.changes.add(RESULTS)
        elif name == "next":
            self._change(given.own)
        elif name == "open" or (thrown_away and name not in HARMLESS | FRESH):
            self._now.changes.add(OUTSIDE)
            self._change(given.every)
        return NOTHING if name in FRESH else given.part()

    def _called(self, name: str, given: Value, thrown_away: bool, node: ast.Call) -> Value:
        """A call of a name that the notebook binds."""
        value = self._values[name]
        returned = self._name(name, given, node)
        if origins := [str(thing.which) for thing in value.own if thing.kind == "module"]:
            return self._library(origins[0], given, thrown_away, node)
        if any(thing in self._functions for thing in value.every):
            return returned
        self._change(value.every | given.every)  # an object that can be called
        return value.or_(given)

    def _library(self, origin: str, given: Value, thrown_away: bool, node: ast.Call) -> Value:
        """A call of what is imported."""
        last = origin.rpartition(".")[2]
        drawn = frozenset(thing for thing in given.every if thing.kind == "drawn")
        if _is_in(origin, RESULT_MODULES) or last == "glue":
            self._now.changes.add(RESULTS)
            return NOTHING
        if last in GENERATORS:
            return Value(frozenset({_new(node, "generator")}))
        if _is_in(origin, DRAWING):
            self._change(drawn)
            return Value(drawn | {_new(node, "drawn")})
        if _is_in(origin, ("numpy.random", "random")) or origin.startswith(OPENCV_RANDOM):
            self._now.reads.add(RANDOM)
            self._now.changes.add(RANDOM)
        if last in OPAQUE:
            self._unknown()
        if origin.startswith("cv2.accumulate"):  # this one takes its first argument as it is
            self._change(self._value_of(node.args[1]).own if len(node.args) > 1 else given.every)
        elif thrown_away:
            self._change(given.every)
        computes = _is_in(origin, COMPUTING) and not last.startswith(SETTING)
        acts = _is_in(origin, OUTER_MODULES) and not origin.startswith("os.path")
        if acts or (thrown_away and not computes):
            self._now.changes.add(OUTSIDE)
        fresh = _is_in(origin, MAKING_NEW) and last not in VIEWS
        return NOTHING if fresh else given

    def _method(self, name: str, owner: Value, given: Value, thrown_away: bool) -> Value:
        """A call of an object's method."""
        if name == "glue":
            self._now.changes.add(RESULTS)
        drawn = frozenset(thing for thing in owner.own if thing.kind == "drawn")
        if drawn:  # whatever else its name may stand for
            self._change(drawn)
            return Value(drawn)
        generators = {thing for thing in owner.own if thing.kind == "generator"}
        if generators:
            self._change(generators)
            if thrown_away:  # shuffle
                self._change(given.every)
            return owner if name == "spawn" else NOTHING
        if name in MUTATORS:
            self._change(owner.own)
        elif name not in PURE:
            self._change(owner.every)
            if thrown_away:
                self._change(given.every)
        if name.startswith(WRITING) or (thrown_away and name not in MUTATORS | PURE):
            self._now.changes.add(OUTSIDE)
        return NOTHING if name in COPYING else owner.part().or_(given)


def _new(node: ast.AST, kind: str = "object") -> Thing:
    """What comes into being at a place of the code."""
    return Thing(kind, id(node))


def _without(effects: set[str | Thing], nodes: set[int]) -> set[str | Thing]:
    """Without the objects that come into being at these places of the code."""
    return {one for one in effects if isinstance(one, str) or one.which not in nodes}


def _abstract(things: Things, objects: Thing) -> Things:
    """The things with one in the place of all objects."""
    rest = frozenset(thing for thing in things if thing.kind != "object")
    return rest if len(rest) == len(things) else rest | {objects}


def _concrete(things: Set[Any], given: Value) -> set[Any]:
    """The things with the objects that are given in the place of those that stand for them."""
    rest = set(things) - {GIVEN, HELD}
    if GIVEN in things:
        rest |= {thing for thing in given.own if thing.kind == "object"}
    if HELD in things:
        rest |= {thing for thing in given.held if thing.kind == "object"}
    return rest


def _renamed(value: Value, nodes: set[int], new: Thing) -> Value:
    """A value whose objects that come into being at these places are another one."""

    def renamed(things: Things) -> Things:
        return frozenset(
            new if thing.which in nodes and thing.kind == "object" else thing for thing in things
        )

    return Value(renamed(value.own), renamed(value.held))


def _is_in(origin: str, modules: Iterable[str]) -> bool:
    return any(origin == module or origin.startswith(f"{module}.") for module in modules)


def _root(node: ast.expr) -> str | None:
    """The name at the front of ``name.a[i].b``."""
    while isinstance(node, (ast.Attribute, ast.Subscript, ast.Starred)):
        node = node.value
    return node.id if isinstance(node, ast.Name) else None


def _origin(node: ast.expr, values: dict[str, Value]) -> str:
    """Where ``module.a.b`` comes from; empty if its first name is no module."""
    path: list[str] = []
    while isinstance(node, ast.Attribute):
        path.insert(0, node.attr)
        node = node.value
    if not isinstance(node, ast.Name):
        return ""
    modules = [thing for thing in values.get(node.id, NOTHING).own if thing.kind == "module"]
    return ".".join([str(modules[0].which), *path]) if modules else ""


@lru_cache(maxsize=1000)
def _free_names(node: ast.AST) -> set[str]:
    """The names that a function or class takes from outside of it."""
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)} - _locals(node)


def _parameters(node: ast.AST) -> set[str]:
    if isinstance(node, ast.ClassDef):
        return set()
    assert isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
    of = node.args
    every = [*of.posonlyargs, *of.args, *of.kwonlyargs, *filter(None, (of.vararg, of.kwarg))]
    return {argument.arg for argument in every}


@lru_cache(maxsize=1000)
def _locals(node: ast.AST) -> set[str | Thing]:
    """The names that belong to a function."""
    local: set[str | Thing] = set(_parameters(node))

    def collect(part: ast.AST) -> None:
        for child in ast.iter_child_nodes(part):
            if isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                local.add(child.name)
            elif isinstance(child, ast.Name) and isinstance(child.ctx, (ast.Store, ast.Del)):
                local.add(child.id)
            elif isinstance(child, (ast.Import, ast.ImportFrom)):
                local.update(
                    (alias.asname or alias.name).partition(".")[0] for alias in child.names
                )
            if not isinstance(
                child,
                (
                    ast.FunctionDef,
                    ast.AsyncFunctionDef,
                    ast.ClassDef,
                    ast.Lambda,
                    ast.ListComp,
                    ast.SetComp,
                    ast.DictComp,
                    ast.GeneratorExp,
                ),
            ):
                collect(child)

    if not isinstance(node, ast.Lambda):
        collect(node)
    return local
