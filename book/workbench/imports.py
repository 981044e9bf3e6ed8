"""Which files of our packages a piece of code imports, directly or not.

The imports between our own modules are `grimp`'s graph. Beside it stands what it does not know: a notebook's
source, modules that lie beside it, and the names of `trinolab`'s face, which load a module when they are asked
for.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import grimp

import trinolab
from trinolab import FACE

PACKAGES = {
    "trinolab": Path(trinolab.__file__).resolve().parent,
    "workbench": Path(__file__).resolve().parent,
    "satellites": Path(__file__).resolve().parent.with_name("satellites"),
}
TESTS = "tests"  # in a satellite's folder: no code of ours
FACED = "trinolab"  # the package whose `FACE` loads names when they are asked for


def our_files() -> list[Path]:
    """Every module of the packages."""
    return [
        path
        for folder in PACKAGES.values()
        for path in sorted(folder.glob("**/*.py"))
        if TESTS not in path.relative_to(folder).parts
    ]


def is_ours(path: Path) -> bool:
    """Whether a file belongs to one of the packages."""
    return any(folder in path.parents for folder in PACKAGES.values())


def imported_files(source: str, folder: Path) -> set[Path]:
    """The files of our packages, and of modules beside a source, that the source imports, directly
    or not.

    Imports count wherever they stand, in a function as well; what is only for a type checker does
    not.

    Parameters
    ----------
    source : str
        Python.
    folder : Path
        Where the source lies.

    Raises
    ------
    SyntaxError
        The source, or a file that it imports, is no Python.
    """
    files: set[Path] = set()
    waiting = [source]
    while waiting:
        for module in modules_imported(waiting.pop()):
            if module.partition(".")[0] in PACKAGES:
                files |= files_of_module(module)
                continue
            for path in _files_beside(module, folder):
                if path not in files:
                    files.add(path)
                    waiting.append(path.read_text(encoding="utf-8"))
    return files


def files_of_module(name: str) -> set[Path]:
    """The files that are loaded for one of our modules, or for a name in it: its own, those of the
    packages that it lies in, and of all that these import.
    """
    graph = import_graph()
    modules: set[str] = set()
    waiting = [_in_full(name)]
    while waiting:
        module = waiting.pop()
        while module and module not in graph.modules:
            module = module.rpartition(".")[0]
        if not module or module in modules:
            continue
        modules.add(module)
        waiting.append(module.rpartition(".")[0])
        waiting.extend(graph.find_modules_directly_imported_by(module))
    return {_file_of(module) for module in modules}


def module_of_file(path: Path) -> str:
    """The dotted name of one of our files."""
    name, folder = next(item for item in PACKAGES.items() if item[1] in path.parents)
    parts = path.relative_to(folder).with_suffix("").parts
    return ".".join([name, *parts]).removesuffix(".__init__")


def modules_imported(source: str) -> list[str]:
    """The absolute names of all that a source imports; some may be names in a module."""
    return list(dict.fromkeys(_names_imported(ast.parse(source))))


def import_graph() -> grimp.ImportGraph:
    """Who imports whom in the packages, as their files are now."""
    return _graph_of(tuple((path, path.stat().st_mtime_ns) for path in our_files()))


@lru_cache(maxsize=1)
def _graph_of(state: object) -> grimp.ImportGraph:
    return grimp.build_graph(*PACKAGES, exclude_type_checking_imports=True, cache_dir=None)


def _in_full(name: str) -> str:
    """Where a name of the face is defined; other names as they are."""
    package, _, rest = name.partition(".")
    if package != FACED:
        return name
    first, _, rest = rest.partition(".")
    home = FACE.get(first, f"{FACED}.{first}").replace(":", ".")
    return ".".join(filter(None, [home, rest]))


def _file_of(module: str) -> Path:
    package, *parts = module.split(".")
    path = PACKAGES[package].joinpath(*parts)
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def _files_beside(module: str, folder: Path) -> Iterator[Path]:
    """The files below a folder that are loaded for a module."""
    for part in module.split("."):
        yield from (
            path
            for path in (folder / f"{part}.py", folder / part / "__init__.py")
            if path.is_file()
        )
        folder = folder / part


def _names_imported(node: ast.AST) -> Iterator[str]:
    match node:
        case ast.Import(names=aliases):
            yield from (alias.name for alias in aliases)
            if any(alias.name == FACED and alias.asname for alias in aliases):
                # nobody knows which of them it will use
                yield from (f"{FACED}.{name}" for name in FACE)
        case ast.Attribute(value=ast.Name(id=package), attr=name) if package == FACED:
            yield f"{FACED}.{name}"
        case ast.ImportFrom(module=str(module), names=aliases, level=0):
            yield module
            yield from (f"{module}.{alias.name}" for alias in aliases if alias.name != "*")
        case ast.If(test=ast.Name(id="TYPE_CHECKING"), orelse=otherwise):
            for statement in otherwise:
                yield from _names_imported(statement)
        case _:
            for child in ast.iter_child_nodes(node):
                yield from _names_imported(child)
