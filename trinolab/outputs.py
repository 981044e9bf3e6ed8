"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def check_target(path: str | Path) -> None:
    """Refuse, with a ValueError, a place where `write_whole` could not write: asked before a long computation."""
    target, folder = Path(path), Path(path).resolve().parent
    if not folder.is_dir():
        raise ValueError(f"{path}: no such folder to write into")
    if target.exists() and not target.is_file():
        raise ValueError(f"{path}: cannot be written (a folder or a device is there)")
    if not os.access(folder, os.W_OK):
        raise ValueError(f"{path}: cannot be written (no permission in its folder)")


def write_whole(path: str | Path, text: str) -> None:
    """Write a text file through a temporary one beside it, so that it is never seen half written.

    Raises
    ------
    ValueError
        If the file cannot be written.
    """
    check_target(path)
    target = Path(path).resolve()
    try:
        with tempfile.NamedTemporaryFile("w", dir=target.parent, prefix=f".{target.name}.", delete=False,
                                         encoding="utf-8") as file:
            temporary = Path(file.name)
            try:
                file.write(text)
                file.close()
                temporary.chmod(0o644)
                os.replace(temporary, target)
            finally:
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise ValueError(f"{path}: cannot be written ({error.strerror})") from None
