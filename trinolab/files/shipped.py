"""Paths of the files that are shipped with the package. Nothing is loaded for them."""

from __future__ import annotations

from pathlib import Path


def data_path(*parts: str) -> Path:
    """Return the path of a shipped data file: ``data/`` of a checkout, or the package's copy where
    it is installed.

    Raises
    ------
    ValueError
        If there is no such file; it lists those beside it.
    """
    package = Path(__file__).resolve().parents[1]
    root = next(
        (folder for folder in (package / "data", package.parent / "data") if folder.is_dir()), None
    )
    if root is None:
        raise ValueError(f"data: not found in or beside {package}; is the installation complete?")
    path = root.joinpath(*parts)
    if not path.exists():
        beside = sorted(p.name for p in path.parent.glob("*")) if path.parent.is_dir() else []
        raise ValueError(
            f"{'/'.join(parts)}: no such data file; there are {', '.join(beside) or 'none'}"
        )
    return path
