"""Numbers and pictures that pages quote from the chapters, as their notebooks have them when executed."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..sweep.notebook import glued, read_notebook


def chapters(executed: Path, folder: Path) -> dict[str, Any]:
    """Results by chapter: values by the names that they are glued with, and the alternative text of each figure
    that has a label. The figures are written into a folder.

    Where a lesson and its study have the same name, it is the lesson's.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {}
    for path in sorted(executed.glob("[0-9][0-9]*.ipynb")):
        chapter = found.setdefault(str(int(path.stem[:2])), {"glued": {}, "pictures": {}})
        notebook = read_notebook(path)
        chapter["glued"] = glued(notebook) | chapter["glued"]
        for label, alt, png in _pictures(notebook):
            if label not in chapter["pictures"]:
                chapter["pictures"][label] = alt
                (folder / f"{label}.png").write_bytes(png)
    return found


def _pictures(notebook: Any) -> Iterator[tuple[str, str, bytes]]:
    """The figures of an executed notebook that have a label: label, alternative text, PNG."""
    for cell in notebook.cells:
        about = cell.metadata.get("mystnb", {})
        label = about.get("figure", {}).get("name")
        for output in cell.get("outputs", []):
            png = output.get("data", {}).get("image/png")
            if label is not None and png is not None:
                yield label, about.get("image", {}).get("alt", ""), base64.b64decode(png)
