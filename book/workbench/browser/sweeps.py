"""Sweeps on a chapter's page: which, at which values, and the parts of the chapter that a run needs.

A reader's browser gets the chapter already cut by its tags (`workbench.sweep.cells`).
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ..provenance import hash_text
from ..sweep.cells import code_cells, parameters_cell, plan_cells
from ..sweep.notebook import read_notebook, read_parameters


class PageSweep(NamedTuple):
    """A sweep that a page offers: the parameter, what the chapter calls it, and its values."""

    parameter: str
    called: str
    values: tuple[float, ...]


SWEEPS = {
    "03_background": PageSweep(
        "update_rate", "α of Eq. 6, per frame", (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
    ),
    "06_matching": PageSweep(
        "ncc_threshold", "ε₀, the least correlation", (0.3, 0.5, 0.65, 0.8, 0.9)
    ),
}


@cache
def part_of(chapter: Path) -> dict[str, Any]:
    """The sources that a browser runs of a chapter: once, and at each value.

    Raises
    ------
    ValueError
        If the chapter's cells are not tagged for a sweep.
    """
    parameter = SWEEPS[chapter.stem].parameter
    notebook = read_notebook(chapter)
    plan = plan_cells(notebook, [parameter])
    if plan is None:
        raise ValueError(f"{chapter}: no cell is tagged for a sweep of {parameter}")
    sources = {number: cell.source for number, cell in enumerate(code_cells(notebook), 1)}
    sources[parameters_cell(notebook)] += f"\ndel {parameter}"
    return {
        "chapter": chapter.stem,
        "parameter": parameter,
        "verdicts": list(notebook.metadata.get("trinolab", {}).get("verdicts", [])),
        "defaults": read_parameters(chapter),
        "once": {number: sources[number] for number in plan.once},
        "each": {number: sources[number] for number in plan.each},
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
