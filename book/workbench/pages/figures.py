"""Every figure and film of the built pages as a file, for slides: `make figures`.

    .venv/bin/python -m workbench.pages.figures

writes them into ``_build/figures``, with a list ``index.csv``: file, page, number, caption, words for
who does not see it, licence. A figure is the file that the page shows; a film lies in its page.
"""

from __future__ import annotations

import base64
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from bs4 import BeautifulSoup, Tag

from trinolab.files.outputs import write_table

from .contents import pages

ROOT = Path(__file__).resolve().parents[3]
HTML = ROOT / "_build" / "html"
FIGURES = ROOT / "_build" / "figures"
LICENCE = "CC BY 4.0"
# what a page may embed -> how its file ends
ENDINGS = {"image/png": ".png", "image/svg+xml": ".svg", "video/webm": ".webm"}


class Picture(NamedTuple):
    """A figure or a film of a page: its name, what its address is there, and what is said of it."""

    name: str
    address: str
    number: str
    caption: str
    alt: str


def main() -> int:
    """Write all files and the list, and say how many they are; return the exit code."""
    if not (HTML / "index.html").exists():
        print("no built pages: run `make book` first", file=sys.stderr)
        return 2
    shutil.rmtree(FIGURES, ignore_errors=True)
    table = write_figures(HTML, FIGURES)
    print(f"{len(table)} figures and films: {FIGURES}")
    return 0


def write_figures(html: Path, folder: Path) -> pd.DataFrame:
    """Write the figures and films of all pages into a folder, and the list beside them.

    Returns
    -------
    DataFrame
        The list: a row per file.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for page in pages(ROOT):
        text = (html / f"{page}.html").read_text(encoding="utf-8")
        for picture in pictures(text, Path(page).name):
            data, ending = content(picture.address, (html / page).parent)
            file = folder / f"{picture.name}{ending}"
            file.write_bytes(data)
            description = (picture.number, picture.caption, picture.alt, LICENCE)
            rows.append((file.name, f"{page}.html", *description))
    table = pd.DataFrame(rows, columns=["file", "page", "number", "caption", "alt", "licence"])
    write_table(table, folder / "index.csv")
    return table


def pictures(text: str, page: str) -> Iterator[Picture]:
    """The figures and films of a page, each with a name of its own that begins with the page's.

    A figure's name is that of its place in the page, where it has one, else its number.
    """
    article = BeautifulSoup(text, "html.parser").find("article")
    media = article.find_all(["img", "video"]) if isinstance(article, Tag) else []
    for count, one in enumerate(media, 1):
        figure = one.find_parent("figure")
        caption = figure.find("figcaption") if figure else None
        number, words = _caption(caption)
        place = figure.get("id", "") if figure else ""
        name = place if place and not place.startswith("id") else f"{count:02d}"
        source = one.find("source") if one.name == "video" and not one.get("src") else one
        alt = one.get("alt") or one.get("aria-label") or one.get("title") or ""
        yield Picture(f"{page}-{name}", source["src"], number, words, alt)


def _caption(caption: Tag | None) -> tuple[str, str]:
    """The number of a figure and its words."""
    if caption is None:
        return "", ""
    number, words = (caption.find(class_=f"caption-{part}") for part in ("number", "text"))
    return tuple(" ".join(one.get_text().split()) if one else "" for one in (number, words))


def content(address: str, folder: Path) -> tuple[bytes, str]:
    """What an address holds, and how its file ends: one within the page, or one beside it."""
    if address.startswith("data:"):
        kind, _, content = address.removeprefix("data:").partition(",")
        return base64.b64decode(content), ENDINGS[kind.partition(";")[0]]
    path = folder / address.partition("?")[0]
    return path.read_bytes(), path.suffix


if __name__ == "__main__":
    sys.exit(main())
