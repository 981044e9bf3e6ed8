"""The book in an hour: what it quotes is what the chapters have, and what they lack is named."""

import base64
import re
from pathlib import Path

import nbformat
import pytest
from chapters import NOTEBOOKS
from executed import as_it_stands
from nbformat.v4 import new_code_cell, new_notebook, new_output

from workbench.pages import hour
from workbench.pages.hour import Picture, Quoted

TEMPLATE = (Path(hour.__file__).parent / hour.TEMPLATE).read_text(encoding="utf-8")
PICTURES = re.findall(r'picture\((\d+), "([\w-]+)", "', TEMPLATE)
VALUES = re.findall(r'(number|words)\((\d+), "(\w+)"', TEMPLATE)
PNG = b"\x89PNG, as good as one"


def notebook(folder, name, values=(), pictures=()):
    """An executed notebook that has glued values and shown figures."""
    cells = []
    for key, value in values:
        about = {"scrapbook": {"name": key, "mime_prefix": ""}}
        outputs = [new_output("display_data", {"text/plain": repr(value)}, metadata=about)]
        cells.append(new_code_cell("glue", outputs=outputs))
    for label, png in pictures:
        shown = {"image/png": base64.b64encode(png).decode()}
        about = {"figure": {"name": label, "caption": ""}, "image": {"alt": f"Alt of {label}."}}
        outputs = [new_output("display_data", shown)]
        cells.append(new_code_cell("draw", outputs=outputs, metadata={"mystnb": about}))
    nbformat.write(new_notebook(cells=cells), folder / f"{name}.ipynb")


def whole_hour():
    """Chapters that have all that the text quotes."""
    chapters = {chapter: Quoted({}, {}) for chapter in range(1, 13)}
    for _, chapter, name in VALUES:
        chapters[int(chapter)].values[name] = 7
    for chapter, label in PICTURES:
        chapters[int(chapter)].pictures[label] = Picture(PNG, f"Alt of {label}.")
    return chapters


def test_a_study_adds_to_its_lesson(tmp_path):
    notebook(tmp_path, "05_markers", [("gain", 0.5)], [("fig-a", PNG)])
    notebook(tmp_path, "05b_centroid", [("gain", 0.7), ("noise", "small")], [("fig-b", PNG + b"b")])
    notebook(tmp_path, "11_master_slave", [("late", 154.2)])
    notebook(tmp_path, "recordings", [("other", 1)])
    shown = {
        "fig-a": Picture(PNG, "Alt of fig-a."),
        "fig-b": Picture(PNG + b"b", "Alt of fig-b."),
    }
    assert hour.read_chapters(tmp_path) == {
        5: Quoted({"gain": 0.5, "noise": "small"}, shown),
        11: Quoted({"late": 154.2}, {}),
    }


def test_each_chapter_has_a_question_a_picture_and_its_place():
    text, shown = hour.text_and_pictures(whole_hour())
    assert set(shown) == {label for _, label in PICTURES}
    _, *parts = re.split(r"^## \d+\. ", text, flags=re.MULTILINE)
    assert len(parts) == 12
    for chapter, part in enumerate(parts, start=1):
        assert re.search(r"^\*\*[^*]+\?\*\*$", part, re.MULTILINE), chapter
        assert f":name: hour-{chapter}\n" in part
        place = part.partition("**The place:**")[2]
        assert f"{{doc}}`chapter {chapter} </notebooks/{chapter:02}_" in place


@pytest.mark.parametrize(("kind", "name"), [("values", "too_much"), ("pictures", "fig-pose-rays")])
def test_what_a_chapter_lacks_is_named(kind, name):
    chapters = whole_hour()
    for quoted in chapters.values():
        getattr(quoted, kind).pop(name, None)
    with pytest.raises(ValueError, match=f"hour: chapter . has no '{name}' among its {kind}"):
        hour.text_and_pictures(chapters)


@pytest.mark.heavy
def test_every_value_is_glued_in_its_chapter():
    known = {
        (int(path.stem[:2]), name) for path in NOTEBOOKS for name in as_it_stands(path).results
    }
    assert {(int(chapter), name) for _, chapter, name in VALUES} <= known
