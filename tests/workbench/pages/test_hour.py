"""The book in an hour: what it quotes is what the chapters have, and what they lack is named."""

import re

import nbformat
import pytest
from jinja2 import UndefinedError
from nbformat.v4 import new_code_cell, new_notebook, new_output

from workbench.pages.chapters import chapters


def notebook(folder, name, **values):
    """An executed notebook that has glued values, and a figure."""
    cells = []
    for key, value in values.items():
        about = {"scrapbook": {"name": key, "mime_prefix": ""}}
        outputs = [new_output("display_data", {"text/plain": repr(value)}, metadata=about)]
        cells.append(new_code_cell("glue", outputs=outputs))
    figure = {"mystnb": {"figure": {"name": f"fig-{name}"}, "image": {"alt": "A line."}}}
    picture = new_output("display_data", {"image/png": "iVBORw=="})
    cells.append(new_code_cell("draw", outputs=[picture], metadata=figure))
    nbformat.write(new_notebook(cells=cells), folder / f"{name}.ipynb")


def test_a_study_adds_to_its_lesson(tmp_path):
    notebook(tmp_path, "05_markers", gain=0.5)
    notebook(tmp_path, "05b_centroid", gain=0.7, noise="small")
    notebook(tmp_path, "recordings", other=1)
    found = chapters(tmp_path, tmp_path / "pictures")
    pictures = {"fig-05_markers": "A line.", "fig-05b_centroid": "A line."}
    assert found == {"5": {"glued": {"gain": 0.5, "noise": "small"}, "pictures": pictures}}
    assert (tmp_path / "pictures" / "fig-05_markers.png").read_bytes() == b"\x89PNG"


def test_each_chapter_has_a_question_a_picture_and_its_place(page):
    text = page("hour")
    _, *parts = re.split(r"^## \d+\. ", text, flags=re.MULTILINE)
    assert len(parts) == 12
    for chapter, part in enumerate(parts, start=1):
        assert re.search(r"^\*\*[^*]+\?\*\*$", part, re.MULTILINE), chapter
        assert f":name: hour-{chapter}\n:alt: 7\n" in part
        place = part.partition("**The place:**")[2]
        assert f"{{doc}}`chapter {chapter} </notebooks/{chapter:02}_" in place


@pytest.mark.parametrize(
    ("kind", "name"), [("glued", "film_measured"), ("pictures", "fig-structure-pose")]
)
def test_what_a_chapter_lacks_is_named(page, kind, name):
    with pytest.raises(UndefinedError, match=name):
        page("hour", **{kind: {}})
