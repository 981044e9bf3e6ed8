"""Figures on a dark page: a Sphinx extension that marks drawings.

A drawing on white paper may have light and dark exchanged, which `custom.css` does; a photograph may
not.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
from docutils import nodes

DARK = 150  # grey levels of the brightest channel
INK = 0.1  # the most of a drawing's pixels that are dark


def is_drawing(path: Path) -> bool:
    """Return whether an image is lines and letters on white paper, and no photograph or map."""
    image = cv2.imread(str(path))
    return image is not None and bool((image.max(axis=2) < DARK).mean() < INK)


def mark_drawings(app: Any, document: nodes.document, name: str) -> None:
    """Give the drawings of a page a class. The theme leaves ``dark-light`` as it is."""
    for image in document.findall(nodes.image):
        if image["uri"].endswith(".png") and is_drawing(Path(app.srcdir, image["uri"])):
            image["classes"] += ["drawing", "dark-light"]


def setup(app: Any) -> dict[str, bool]:
    """Connect with Sphinx."""
    app.connect("doctree-resolved", mark_drawings)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
