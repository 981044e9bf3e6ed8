"""Slides for the lectures, from the chapters' own figures: ``make slides``.

``book/teaching/slides/04.md`` is what a lecture shows. A line ``---`` ends a slide, an image whose
address is the label of a figure of the chapter shows this figure or film as the page has it, and a
quotation is a speaker's note. The slides need no network; the key N shows the notes, and printed
they stand below each slide.
"""

from __future__ import annotations

import base64
import re
import shutil
import sys
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markdown_it import MarkdownIt
from mdit_py_plugins.dollarmath import dollarmath_plugin

from trinolab.files.outputs import write_whole

from ..course.exercises import CHAPTERS
from .build import BUILD, HTML, ROOT
from .figures import content, pictures

SOURCES = ROOT / "book" / "teaching" / "slides"
SLIDES = BUILD / "slides"
# draws formulas as pictures: a font that no slide has shown yet would be missing where it is printed
MATHJAX = HTML / "_static" / "mathjax" / "tex-svg.js"
FIGURE = re.compile(r"!\[\]\((fig-[\w-]+|film)\)")


class Slide(NamedTuple):
    """A slide as HTML: what the class sees, and what the speaker says."""

    body: str
    notes: str


def main() -> int:
    """Write the slides of all chapters that have some, and return the exit code."""
    if not (HTML / "index.html").exists():
        print("no built pages: run `make book` first", file=sys.stderr)
        return 2
    shutil.rmtree(SLIDES, ignore_errors=True)
    try:
        counts = write_all_slides(SLIDES)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    for chapter, count in counts.items():
        print(f"{SLIDES / chapter}.html: {count} slides")
    return 0


def write_all_slides(folder: Path) -> dict[str, int]:
    """Write the slides of all chapters, and what draws their formulas, into a new folder; return how
    many slides each chapter has.
    """
    script = folder / "mathjax" / MATHJAX.name
    script.parent.mkdir(parents=True)
    shutil.copyfile(MATHJAX, script)
    return {chapter: write_slides(chapter, folder / f"{chapter}.html") for chapter in CHAPTERS}


def write_slides(chapter: str, target: Path) -> int:
    """Write a chapter's slides; return how many they are.

    Raises
    ------
    ValueError
        A slide asks for a figure that the chapter does not have, or the chapter has no slides.
    """
    source = SOURCES / f"{chapter}.md"
    if not source.exists():
        raise ValueError(f"{source}: the chapter has no slides")
    text = source.read_text(encoding="utf-8")
    slides = read_slides(text, figures_of(chapter), str(source))
    title = text.partition("\n")[0].removeprefix("# ")
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, autoescape=True
    )
    page = environment.get_template("slides.html.j2").render(title=title, slides=slides)
    write_whole(target, page)
    return len(slides)


def read_slides(text: str, figures: Mapping[str, str], name: str) -> list[Slide]:
    """The slides of a text.

    Parameters
    ----------
    text
        As the head of this module says.
    figures
        Label -> HTML of the figures that the chapter has.
    name
        Of the text, for errors.
    """
    markdown = MarkdownIt("commonmark").enable("table").use(dollarmath_plugin, renderer=_formula)

    def figure(label: re.Match[str]) -> str:
        if label[1] not in figures:
            raise ValueError(f"{name}: the chapter has no figure {label[1]}")
        return f"\n{figures[label[1]]}\n"

    markdown.options["html"] = True
    slides = []
    for part in re.split(r"^---$", text, flags=re.MULTILINE):
        lines = part.strip().splitlines()
        notes = "\n".join(line.removeprefix(">") for line in lines if line.startswith(">"))
        shown = "\n".join(line for line in lines if not line.startswith(">"))
        slides.append(Slide(markdown.render(FIGURE.sub(figure, shown)), markdown.render(notes)))
    return slides


def _formula(content: str, options: Mapping[str, bool]) -> str:
    """A formula as MathJax finds it."""
    before, after = (r"\[", r"\]") if options["display_mode"] else (r"\(", r"\)")
    return before + escape(content) + after


def figures_of(chapter: str) -> dict[str, str]:
    """The figures of a chapter and its studies: label -> HTML with the picture in it; its first film
    is called ``film``.
    """
    found: dict[str, str] = {}
    for page in sorted(HTML.glob(f"notebooks/{chapter}*.html")):
        for picture in pictures(page.read_text(encoding="utf-8"), page.stem):
            label = picture.name.removeprefix(f"{page.stem}-")
            data, ending = content(picture.address, page.parent)
            if ending == ".webm":
                found.setdefault("film", _film(data, picture.alt))
            else:
                found[label] = _image(data, ending, picture.alt)
    return found


def _image(data: bytes, ending: str, alt: str) -> str:
    kind = "svg+xml" if ending == ".svg" else ending.removeprefix(".")
    return f'<img src="{_embedded(f"image/{kind}", data)}" alt="{escape(alt)}">'


def _film(data: bytes, alt: str) -> str:
    source = _embedded("video/webm", data)
    return f'<video controls loop muted src="{source}" aria-label="{escape(alt)}"></video>'


def _embedded(kind: str, data: bytes) -> str:
    """The address of what a page holds itself."""
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


if __name__ == "__main__":
    sys.exit(main())
