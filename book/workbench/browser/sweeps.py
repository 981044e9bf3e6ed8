"""Sweeps on a chapter's page: which, at which values, and the parts of the chapter that a run needs.

A reader's browser gets the chapter already cut (`workbench.sweep.slicing`).
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ..provenance import hash_text
from ..sweep.notebook import read_notebook, read_parameters
from ..sweep.slicing import slice_notebook

__all__ = ["SWEEPS", "PageSweep", "part_of", "with_sweep", "write_sweeps"]


class PageSweep(NamedTuple):
    """A sweep that a page offers: the parameter, what the chapter calls it, and its values."""

    parameter: str
    called: str
    values: tuple[float, ...]


SWEEPS = {
    "03_background": PageSweep(
        "update_rate", "α of Eq. 6, a frame", (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
    ),
    "06_matching": PageSweep(
        "ncc_threshold", "ε₀, the least correlation", (0.3, 0.5, 0.65, 0.8, 0.9)
    ),
}


@cache
def part_of(chapter: Path) -> dict[str, Any]:
    """What a browser runs of a chapter: once, and at each value.

    Raises
    ------
    ValueError
        If the chapter's text does not tell what can run once.
    """
    parameter = SWEEPS[chapter.stem].parameter
    notebook = read_notebook(chapter)
    part = slice_notebook(notebook, [parameter])
    if part is None or part.once is None:
        raise ValueError(f"{chapter}: cannot be cut for a sweep of {parameter}")
    tags = [cell.metadata.get("tags", []) for cell in notebook.cells if cell.cell_type == "code"]
    return {
        "chapter": chapter.stem,
        "parameter": parameter,
        "defaults": read_parameters(chapter),
        "parameters": 1 + next(k for k, some in enumerate(tags) if "parameters" in some),
        "once": _sources(part.once),
        "each": _sources(part.each),
        "held": part.held,
    }


def write_sweeps(folder: Path, chapters: list[Path]) -> None:
    """Write what a browser runs of each of the chapters that has a sweep."""
    folder.mkdir(parents=True, exist_ok=True)
    for chapter in chapters:
        if chapter.stem in SWEEPS:
            text = json.dumps(part_of(chapter))
            (folder / f"{chapter.stem}.json").write_text(text, encoding="utf-8")


def with_sweep(page: str, chapter: Path, version: str) -> str:
    """A chapter's page with the form of its sweep, if it has one.

    Parameters
    ----------
    version
        Of all that runs in the browser: runs of another one are not taken up.
    """
    if chapter.stem not in SWEEPS:
        return page
    sweep = SWEEPS[chapter.stem]
    made_from = hash_text(version + json.dumps(part_of(chapter)))
    data = json.dumps({**sweep._asdict(), "made_from": made_from}).replace("</", "<\\/")
    added = (
        f'<script type="application/json" id="browser-sweep-data">{data}</script>\n'
        '<script type="module" src="../_browser/static/sweep.js"></script>\n'
    )
    return page.replace("</head>", f"{added}</head>", 1)


def _sources(notebook: Any) -> list[str]:
    return [cell.source for cell in notebook.cells if cell.cell_type == "code"]
