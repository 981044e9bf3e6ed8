"""What a result was made from and where: hashes that tell whether it is stale, versions, commit,
machine.

A result depends on the code that makes it, not on the whole package: on what its notebook, function
or module imports, directly or not. One walk along these imports serves the pages of the book, the
sweeps and the recordings.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

from .. import FACE, __version__
from ..datasets import data_path

PACKAGE = Path(__file__).resolve().parents[1]


def surroundings(code: Iterable[Path] | None = None) -> dict[str, str]:
    """A hash of each thing that a result depends on beside its own notebook or function.

    Parameters
    ----------
    code : iterable of Path, optional
        The package's files that the result is made with, of `imported_files`; all of the package
        without it.

    Returns
    -------
    dict
        Hashes of the package's code, its data and the environment, each under the name that a
        sentence gives it.
    """
    environment = [
        sys.version,
        platform.machine(),
        str(os.environ.get("TRINOLAB_DATA")),
        *_installed(),
    ]
    return {
        "the package": hash_files(PACKAGE.glob("**/*.py") if code is None else code, PACKAGE),
        "its data": hash_files(data_path().glob("**/*"), data_path()),
        "the environment": hash_text("\n".join(environment)),
    }


@lru_cache
def _installed() -> list[str]:
    """Names and versions of all installed packages, as they are when a process asks first: that
    takes a while.
    """
    return sorted(f"{found.name} {found.version}" for found in metadata.distributions())


def made_from_notebook(notebook: Any, folder: Path) -> dict[str, str]:
    """A hash of each thing that a notebook's results depend on: its code, the package's that it
    imports, data, ...

    Parameters
    ----------
    notebook : nbformat.NotebookNode
    folder : Path
        Where the notebook lies: modules beside it count as its own code.
    """
    files = imported_files(_source(notebook), folder)
    beside = [path for path in files if PACKAGE not in path.parents]
    own = (
        hash_text(hash_cells(notebook) + hash_files(beside, folder))
        if beside
        else hash_cells(notebook)
    )
    return {"the notebook": own, **surroundings(files.difference(beside))}


def made_from_function(function: Callable[..., Any]) -> dict[str, str]:
    """A hash of each thing that a function's results depend on: its file, the package's code that
    this imports, ...

    All of the package's code counts for a function that no file is known of.
    """
    path = _source_file(function)
    if path is None:
        return {"the function": hash_function(function), **surroundings()}
    files = {
        path,
        *imported_files(path.read_text(encoding="utf-8"), path.parent, _package_of(path)),
    }
    beside = [file for file in files if PACKAGE not in file.parents]
    own = hash_files(beside, path.parent) if beside else hash_function(function)
    return {"the function": own, **surroundings(files.difference(beside))}


def made_from_module(name: str) -> dict[str, str]:
    """A hash of each thing that the results of one of the package's modules depend on."""
    return surroundings(imported_files(f"import {name}", PACKAGE.parent))


@lru_cache
def code_hash(name: str) -> str:
    """A hash of one of the package's modules with all that it imports, as they are when a process
    asks first.
    """
    return hash_files(imported_files(f"import {name}", PACKAGE.parent), PACKAGE)


def imported_files(source: str, folder: Path, package: str = "") -> set[Path]:
    """The files of this package, and of modules beside a source, that the source imports, directly
    or not.

    Imports count wherever they stand, in a function as well; what is only for a type checker does
    not.

    Parameters
    ----------
    source : str
        Python.
    folder : Path
        Where the source lies.
    package : str
        The package that it belongs to, with dots between; empty outside of one.

    Raises
    ------
    SyntaxError
        The source, or a file that it imports, is no Python.
    """
    found: set[Path] = set()
    looked_for: set[tuple[str, Path]] = set()
    waiting = [(source, folder, package)]
    while waiting:
        text, place, within = waiting.pop()
        for module in modules_imported(text, within):
            ours = module.partition(".")[0] == PACKAGE.name
            if within and not ours:
                continue  # the package imports installed ones, and none that lie beside its files
            start = PACKAGE.parent if ours else place
            if (module, start) in looked_for:
                continue
            looked_for.add((module, start))
            for path in _files_of(module, start):
                if path not in found:
                    found.add(path)
                    waiting.append(
                        (path.read_text(encoding="utf-8"), path.parent, _package_of(path))
                    )
    return found


@lru_cache(maxsize=1024)
def modules_imported(source: str, package: str) -> tuple[str, ...]:
    """The absolute names of all that a source imports; some may be names in a module."""
    return tuple(dict.fromkeys(_names_imported(ast.parse(source), package)))


def _names_imported(node: ast.AST, package: str) -> Iterator[str]:
    match node:
        case ast.Import(names=aliases):
            yield from (alias.name for alias in aliases)
            if any(alias.name == PACKAGE.name and alias.asname for alias in aliases):
                # nobody knows which of them it will use
                yield from (f"{PACKAGE.name}.{name}" for name in FACE)
        case ast.Attribute(value=ast.Name(id=PACKAGE.name), attr=name):
            yield f"{PACKAGE.name}.{name}"
        case ast.ImportFrom(module=module, names=aliases, level=level):
            above = package.split(".")[: len(package.split(".")) - level + 1] if level else []
            base = ".".join(filter(None, [*above, module]))
            yield base
            yield from (f"{base}.{alias.name}" for alias in aliases if alias.name != "*")
        case ast.If(test=ast.Name(id="TYPE_CHECKING"), orelse=otherwise):
            for statement in otherwise:
                yield from _names_imported(statement, package)
        case _:
            for child in ast.iter_child_nodes(node):
                yield from _names_imported(child, package)


def _files_of(module: str, place: Path) -> Iterator[Path]:
    """The files below a folder that are loaded for a module: the packages' that it lies in, and its
    own; or for a name of the face.
    """
    parts = module.split(".")
    if parts[0] == PACKAGE.name and len(parts) > 1:
        parts[1:2] = FACE.get(parts[1], parts[1]).split(".")
    for part in parts:
        yield from (
            path for path in (place / f"{part}.py", place / part / "__init__.py") if path.is_file()
        )
        place = place / part


def _package_of(path: Path) -> str:
    """The package that a file belongs to, with dots between; empty if it is none of ours."""
    if PACKAGE not in path.parents:
        return ""
    return ".".join(path.parent.relative_to(PACKAGE.parent).parts)


def _source(notebook: Any) -> str:
    """The code of a notebook as Python, without IPython's own syntax."""
    from IPython.core.inputtransformer2 import TransformerManager

    cells = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    return "\n".join(TransformerManager().transform_cell(source) for source in cells)


def _source_file(function: Callable[..., Any]) -> Path | None:
    """The file that a function is written in, if there is one."""
    try:
        place = inspect.getsourcefile(inspect.unwrap(function))
    except TypeError:  # no Python function
        return None
    return Path(place).resolve() if place is not None and Path(place).is_file() else None


def hash_files(files: Iterable[Path], root: Path) -> str:
    """A hash of the names, below `root`, and the contents of files."""
    state = hashlib.sha256()
    for path in sorted(
        path for path in files if path.is_file() and "__pycache__" not in path.parts
    ):
        content = path.read_bytes()
        state.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode() + content)
    return state.hexdigest()


def hash_text(text: str) -> str:
    """A hash of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def hash_function(function: Callable[..., Any]) -> str:
    """A hash of the file that a function is written in, or of its own lines where there is no such
    file.
    """
    path = _source_file(function)
    if path is not None:
        return hash_text(path.read_text(encoding="utf-8"))
    try:
        return hash_text(inspect.getsource(function))
    except (OSError, TypeError):  # no Python function, or one without lines
        return hash_text(repr(getattr(function, "__code__", function)))


def hash_cells(notebook: Any) -> str:
    """A hash of a notebook's code."""
    return hash_text(
        json.dumps([cell.source for cell in notebook.cells if cell.cell_type == "code"])
    )


def versions() -> dict[str, str]:
    """The versions of Python, of this package, and of what it computes with."""
    names = ("numpy", "scipy", "pandas", "opencv-contrib-python-headless", "matplotlib")
    return {
        "python": platform.python_version(),
        "trinolab": __version__,
        **{name: metadata.version(name) for name in names},
    }


def commit() -> str:
    """The commit of the checkout that this package lies in, ``+`` behind it if files have changed;
    else empty.
    """
    try:
        name, changes = (
            subprocess.run(
                ["git", *command],
                cwd=PACKAGE,
                capture_output=True,
                text=True,
                check=True,
                timeout=10,
            ).stdout.strip()
            for command in (
                ["rev-parse", "HEAD"],
                ["status", "--porcelain", "--untracked-files=no"],
            )
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return f"{name}+" if changes else name


def machine() -> dict[str, Any]:
    """The computer: name, system, processor type, number of cores."""
    return {
        "name": platform.node(),
        "system": platform.platform(),
        "processor": platform.machine(),
        "cores": os.cpu_count(),
    }
