"""What a result was made from and where: hashes that tell whether it is stale, versions, commit, machine."""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

from . import __version__
from .datasets import data_path

PACKAGE = Path(__file__).resolve().parent


def surroundings() -> dict[str, str]:
    """A hash of each thing that every result depends on: the package, its data, the environment."""
    packages = sorted(f"{found.name} {found.version}" for found in metadata.distributions())
    environment = [sys.version, platform.machine(), str(os.environ.get("TRINOLAB_DATA")), *packages]
    return {"the package": hash_files(PACKAGE.glob("**/*.py"), PACKAGE),
            "its data": hash_files(data_path().glob("**/*"), data_path()),
            "the environment": hash_text("\n".join(environment))}


def hash_files(files: Iterable[Path], root: Path) -> str:
    """A hash of the names, below `root`, and the contents of files."""
    state = hashlib.sha256()
    for path in sorted(path for path in files if path.is_file() and "__pycache__" not in path.parts):
        content = path.read_bytes()
        state.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode() + content)
    return state.hexdigest()


def hash_text(text: str) -> str:
    """A hash of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def hash_function(function: Callable[..., Any]) -> str:
    """A hash of the file that a function is written in, or of its own lines where there is no such file."""
    try:
        place = inspect.getsourcefile(inspect.unwrap(function))
        if place is not None and Path(place).is_file():
            return hash_text(Path(place).read_text(encoding="utf-8"))
        return hash_text(inspect.getsource(function))
    except (OSError, TypeError):  # no Python function, or one without lines
        return hash_text(repr(getattr(function, "__code__", function)))


def hash_cells(notebook: Any) -> str:
    """A hash of a notebook's code."""
    return hash_text(json.dumps([cell.source for cell in notebook.cells if cell.cell_type == "code"]))


def versions() -> dict[str, str]:
    """The versions of Python, of this package, and of what it computes with."""
    names = ("numpy", "scipy", "pandas", "opencv-contrib-python-headless", "matplotlib")
    return {"python": platform.python_version(), "trinolab": __version__,
            **{name: metadata.version(name) for name in names}}


def commit() -> str:
    """The commit of the checkout that this package lies in, ``+`` behind it if files have changed; else empty."""
    try:
        name, changes = (subprocess.run(["git", *command], cwd=PACKAGE, capture_output=True, text=True, check=True,
                                        timeout=10).stdout.strip()
                         for command in (["rev-parse", "HEAD"], ["status", "--porcelain", "--untracked-files=no"]))
    except (OSError, subprocess.SubprocessError):
        return ""
    return f"{name}+" if changes else name


def machine() -> dict[str, Any]:
    """The computer: name, system, processor type, number of cores."""
    return {"name": platform.node(), "system": platform.platform(), "processor": platform.machine(),
            "cores": os.cpu_count()}
