"""Which figures have light and dark exchanged on a dark page."""

import cv2
import numpy as np
import pytest
from docutils import nodes
from docutils.utils import new_document

from workbench.pages import darkfigures


@pytest.fixture
def folder(tmp_path):
    """A drawing, lines on paper, and a photograph of the bench with a white margin."""
    paper = np.full((100, 100, 3), 255, np.uint8)
    cv2.imwrite(str(tmp_path / "drawing.png"), cv2.line(paper.copy(), (0, 0), (99, 99), (0, 0, 0)))
    paper[20:80, 20:80] = 45
    cv2.imwrite(str(tmp_path / "photograph.png"), paper)
    return tmp_path


def test_a_drawing_is_marked_and_a_photograph_is_not(folder):
    document = new_document("page")
    document += [nodes.image(uri=f"{name}.png") for name in ("drawing", "photograph", "missing")]
    document += nodes.image(uri="film.svg")
    app = type("App", (), {"srcdir": folder})
    darkfigures.mark_drawings(app, document, "page")
    marked = [
        image["uri"] for image in document.findall(nodes.image) if "drawing" in image["classes"]
    ]
    assert marked == ["drawing.png"]
