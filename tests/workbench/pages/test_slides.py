"""Slides show the chapters' own figures, and notes are the speaker's alone."""

import re

import pytest

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


def test_a_figure_that_is_not_there_is_named():
    with pytest.raises(ValueError, match=r"04\.md: the chapter has no figure fig-one"):
        slides.read_slides(TEXT, {}, "04.md")


@pytest.mark.skipif(
    not (slides.HTML / "index.html").exists(), reason="no built pages: run make book first"
)
@pytest.mark.parametrize("chapter", CHAPTERS)
def test_each_lecture_has_slides_from_its_own_figures(chapter, tmp_path):
    count = slides.write_slides(chapter, tmp_path / "slides.html")
    assert 6 <= count <= 20
    text = (tmp_path / "slides.html").read_text(encoding="utf-8")
    assert text.count("<aside>") == count
    assert "data:image/" in text


@pytest.mark.skipif(
    not (slides.HTML / "index.html").exists(), reason="no built pages: run make book first"
)
def test_what_draws_the_formulas_lies_beside_the_slides(tmp_path, monkeypatch):
    monkeypatch.setattr(slides, "CHAPTERS", {"04": "kalman"})
    slides.write_all_slides(tmp_path / "slides")
    page = (tmp_path / "slides" / "04.html").read_text(encoding="utf-8")
    (script,) = re.findall(r'<script defer src="([^"]+)"', page)
    assert (tmp_path / "slides" / script).is_file()
