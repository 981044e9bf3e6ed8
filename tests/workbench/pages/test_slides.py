"""Slides show the chapters' own figures, and notes are the speaker's alone."""

import re

import pytest
from pages import built

from workbench.course.exercises import CHAPTERS
from workbench.pages import slides

TEXT = """# A title

> Wait for the class.
---
## Gain

![](fig-one)

$$K = \\frac{P}{P + R} < 1$$

- a list of $x_1$
> One note,
> in two lines.
"""


def test_a_text_becomes_slides():
    first, second = slides.read_slides(TEXT, {"fig-one": '<img src="a" alt="b">'}, "04.md")
    assert first.body.strip() == "<h1>A title</h1>"
    assert first.notes.strip() == "<p>Wait for the class.</p>"
    assert '<img src="a" alt="b">' in second.body
    assert r"\[K = \frac{P}{P + R} &lt; 1\]" in second.body
    assert r"\(x_1\)" in second.body
    assert "note" not in second.body
    assert "in two lines" in second.notes


@built
@pytest.mark.parametrize(
    "chapter",
    [pytest.param(one, marks=[pytest.mark.heavy] * (one != "04")) for one in CHAPTERS],
)
def test_each_lecture_has_slides_from_its_own_figures(chapter, tmp_path, monkeypatch):
    monkeypatch.setattr(slides, "CHAPTERS", {chapter: CHAPTERS[chapter]})
    slides.write_all_slides(tmp_path / "slides")
    text = (tmp_path / "slides" / f"{chapter}.html").read_text(encoding="utf-8")
    assert 6 <= text.count("<aside>") <= 20
    assert "data:image/" in text
    (script,) = re.findall(r'<script defer src="([^"]+)"', text)
    assert (tmp_path / "slides" / script).is_file()
