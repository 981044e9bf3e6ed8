"""What a result was made from and where: hashes that tell whether it is stale, versions, commit,
machine.

A result depends on the code that makes it, not on all of it: on what its notebook, function or
module imports, directly or not, see `imports`. That serves the pages of the book and the sweeps.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

from trinolab import __version__
from trinolab.datasets import data_path

from .imports import files_of_module, imported_files, is_ours, module_of_file, our_files


def surroundings(code: Iterable[Path] | None = None) -> dict[str, str]:
    """A hash of each thing that a result depends on beside its own notebook or function.

    Parameters
    ----------
    code : iterable of Path, optional
        The modules that the result is made with, of `imported_files`; all of both packages without
        it.

    Returns
    -------
    dict
        Hashes of the packages' code, their data and the environment, each under the name that a
        sentence gives it.
    """
    environment = [
        sys.version,
        platform.machine(),
        str(os.environ.get("TRINOLAB_DATA")),
        *_installed(),
    ]
    # without the scripts that make them
    data = [path for path in data_path().glob("**/*") if path.suffix != ".py"]
    return {
        "the package": hash_code(our_files() if code is None else code),
        "its data": hash_files(data, data_path()),
        "the environment": hash_text("\n".join(environment)),
    }


@lru_cache
def _installed() -> list[str]:
    """Names and versions of all installed packages, as they are when a process asks first: that
    takes a while.
    """
    return sorted(f"{found.name} {found.version}" for found in metadata.distributions())


def made_from_notebook(notebook: Any, folder: Path) -> dict[str, str]:
    """A hash of each thing that a notebook's results depend on: its code, the packages' that it
    imports, data, ...

    Parameters
    ----------
    notebook : nbformat.NotebookNode
    folder : Path
        Where the notebook lies: modules beside it count as its own code.
    """
    files = imported_files(source_of(notebook), folder)
    beside = [path for path in files if not is_ours(path)]
    own = (
        hash_text(hash_cells(notebook) + hash_files(beside, folder))
        if beside
        else hash_cells(notebook)
    )
    return {"the notebook": own, **surroundings(files.difference(beside))}


def made_from_function(function: Callable[..., Any]) -> dict[str, str]:
    """A hash of each thing that a function's results depend on: its file, the packages' code that
    this imports, ...

    All of the packages' code counts for a function that no file is known of.
    """
    path = _source_file(function)
    if path is None:
        return {"the function": hash_function(function), **surroundings()}
    if is_ours(path):
        files = files_of_module(module_of_file(path))
        return {"the function": hash_function(function), **surroundings(files)}
    files = {path, *imported_files(path.read_text(encoding="utf-8"), path.parent)}
    beside = [file for file in files if not is_ours(file)]
    own = hash_files(beside, path.parent)
    return {"the function": own, **surroundings(files.difference(beside))}


def made_from_module(name: str) -> dict[str, str]:
    """A hash of each thing that the results of one of our modules depend on."""
    return surroundings(files_of_module(name))


@lru_cache
def code_hash(name: str) -> str:
    """A hash of one of our modules with all that it imports, as they are when a process asks
    first.
    """
    return hash_code(files_of_module(name))


def source_of(notebook: Any) -> str:
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


def hash_code(files: Iterable[Path]) -> str:
    """A hash of some of our modules, by their names and contents."""
    state = hashlib.sha256()
    for module, path in sorted((module_of_file(path), path) for path in files):
        state.update(f"{module}\n".encode() + path.read_bytes())
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
    """The versions of Python, of trinolab, and of what it computes with."""
    names = ("numpy", "scipy", "pandas", "opencv-contrib-python-headless", "matplotlib")
    return {
        "python": platform.python_version(),
        "trinolab": __version__,
        **{name: metadata.version(name) for name in names},
    }


def commit() -> str:
    """The commit of the checkout that the workbench lies in, ``+`` behind it if files have changed;
    else empty.
    """
    try:
        name, changes = (
            subprocess.run(
                ["git", *command],
                cwd=Path(__file__).parent,
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
