"""The book as one PDF, printed by Chromium page by page and joined: `make pdf`.

    .venv/bin/python -m workbench.pages.printing [--out FILE] [PAGE ...]

`make article` prints the article alone.

What is folded is opened, but for the cards of how a result was made, which are left out. A film and an
interactive scene are their pictures. Links within the book lead to the printed page. Then every printed
page is looked at: what is blank, cut off or split is an error.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote, urldefrag

import numpy as np
import pypdfium2
import pypdfium2.raw as pdfium
from pypdf import PdfReader, PdfWriter
from pypdf.generic import ArrayObject, FloatObject, NameObject

from trinolab.files.outputs import write_together

from .browser import AT_ONCE, CHROMIUM, Browser
from .contents import pages
from .figures import HTML, ROOT

PDF = ROOT / "_build" / "trinolab.pdf"
HEIGHT_INCHES = 11.69  # of A4
MARGIN_INCHES = 0.7
WIDTH_PX = 680  # of A4 without its margins, at 96 px an inch: the page is laid out so
LOOKED_AT = 0.5  # of 72 dpi: how finely a printed page is looked at
INK = 1e-4  # the share of a page that is not white, at least
TITLE_OF_THE_BOOK = "trinolab: a three-camera master handle, reproduced"
FOOT_INCHES = 0.55  # the number of the page stands there
NUMBER = (
    '<div style="font: 7pt sans-serif; width: 100%; text-align: center">'
    '<span class="title"></span> - <span class="pageNumber"></span></div>'
)
# Light, all folds open, films and scenes as pictures, and every picture there.
PREPARE = """
(async pictures => {
    document.documentElement.dataset.theme = 'light';
    document.querySelectorAll('details:not(.made)').forEach(one => { one.open = true; });
    document.querySelectorAll('.toggle-hidden').forEach(one => one.classList.remove('toggle-hidden'));
    document.querySelectorAll('iframe').forEach((frame, k) => {
        const picture = new Image();
        picture.src = 'data:image/png;base64,' + pictures[k];
        picture.style.maxWidth = '100%';
        frame.replaceWith(picture);
    });
    for (const film of document.querySelectorAll('video')) {
        const seen = new Promise(done => { film.onseeked = done; });
        if (film.readyState < 1) await new Promise(done => { film.onloadedmetadata = done; });
        film.currentTime = film.duration / 2;
        await seen;
        const picture = document.createElement('canvas');
        [picture.width, picture.height] = [film.videoWidth, film.videoHeight];
        picture.getContext('2d').drawImage(film, 0, 0);
        const still = new Image();
        still.src = picture.toDataURL();
        still.style.maxWidth = '100%';
        film.replaceWith(still);
    }
    const images = [...document.images];
    images.forEach(one => { one.loading = 'eager'; });
    await Promise.all(images.map(one => one.decode()));
    await document.fonts.ready;
    return document.querySelectorAll('article img:not([src$=".svg"])').length;
})
"""
# The heading of the page, without the mark that links to it.
TITLE = """
[...document.querySelector('article h1').childNodes]
    .filter(one => one.className !== 'headerlink').map(one => one.textContent).join('').trim()
"""
FRAMES = "document.querySelectorAll('article iframe')"


class Printed(NamedTuple):
    """A page of the book as it was printed: its name, its title, how many pictures it has that are
    not drawings, and the PDF.
    """

    page: str
    title: str
    pictures: int
    pdf: bytes


def main(argv: Sequence[str] | None = None) -> int:
    """Print, join, look, and return the exit code: 1 if something is wrong with a printed page."""
    parser = argparse.ArgumentParser(prog="printing.py", description="the book as one PDF")
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="some of them; all without it")
    parser.add_argument("--out", type=Path, default=PDF, metavar="FILE", help="(%(default)s)")
    arguments = parser.parse_args(argv)
    if not (HTML / "index.html").exists():
        print("no built pages: run `make book` first", file=sys.stderr)
        return 2
    if CHROMIUM is None:
        print("Chromium is missing (Debian package: chromium)", file=sys.stderr)
        return 2
    begin = time.monotonic()
    printed = []
    for one in print_pages(HTML, arguments.pages or pages(ROOT)):
        printed.append(one)
        print(f"{one.page}: printed after {time.monotonic() - begin:.0f} s", flush=True)
    joined = join(printed, HTML)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    write_together({arguments.out: joined})
    all_faults = [fault for one in printed for fault in faults(one)]
    print("".join(f"FAULT: {fault}\n" for fault in all_faults), end="")
    count = len(pypdfium2.PdfDocument(joined))
    print(f"{arguments.out}: {count} pages, {time.monotonic() - begin:.0f} s")
    return 1 if all_faults else 0


def print_pages(html: Path, names: Sequence[str]) -> Iterator[Printed]:
    """Print pages of the book, each by itself."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(Path(profile))
        try:
            for name in names:
                yield _print_page(browser, html, name)
        finally:
            browser.close()


def _print_page(browser: Browser, html: Path, name: str) -> Printed:
    browser.open((html / f"{name}.html").as_uri(), width=WIDTH_PX)
    browser.evaluate(AT_ONCE)
    frames = range(browser.evaluate(f"{FRAMES}.length"))
    shots = [browser.picture_of(f"{FRAMES}[{k}]") for k in frames]
    count = browser.evaluate(f"({PREPARE})({shots})")
    title = browser.evaluate(TITLE)
    pdf = browser.pdf(
        format="A4",
        margin=dict.fromkeys(("top", "bottom", "left", "right"), f"{MARGIN_INCHES}in"),
        print_background=True,
        display_header_footer=True,
        header_template="<span></span>",
        footer_template=NUMBER,
        outline=True,
        tagged=True,
    )
    return Printed(name, title, count, pdf)


def join(printed: Sequence[Printed], html: Path) -> bytes:
    """Join printed pages into one PDF with a bookmark each, whose links lead to pages of it."""
    writer = PdfWriter()
    places: dict[str, tuple[int, dict[str, tuple[int, float]]]] = {}
    for one in printed:
        reader = PdfReader(io.BytesIO(one.pdf))
        named = {
            str(name).removeprefix("/"): (reader.get_destination_page_number(place), place.top)
            for name, place in reader.named_destinations.items()
        }
        places[f"{one.page}.html"] = len(writer.pages), named
        writer.append(reader, outline_item=one.title, import_outline=False)
    for one in printed:
        start, named = places[f"{one.page}.html"]
        for number in range(start, start + len(PdfReader(io.BytesIO(one.pdf)).pages)):
            for annotation in writer.pages[number].get("/Annots", []):
                _lead(annotation.get_object(), f"{one.page}.html", places, html, writer)
    title = printed[0].title if len(printed) == 1 else TITLE_OF_THE_BOOK
    writer.add_metadata({"/Title": title})
    joined = io.BytesIO()
    writer.write(joined)
    return joined.getvalue()


def _lead(link: Any, page: str, places: Any, html: Path, writer: PdfWriter) -> None:
    """Let a link within the book lead to its place in the joined PDF; outside of it, nowhere."""
    if "/Dest" in link:
        target, place = page, str(link["/Dest"]).removeprefix("/")
    else:
        address, place = urldefrag(link.get("/A", {}).get("/URI", ""))
        if not address.startswith("file:"):
            return
        target = unquote(address).removeprefix(html.as_uri()).lstrip("/")
    link.pop("/A", None)
    link.pop("/Dest", None)
    if target in places:
        start, named = places[target]
        number, top = named.get(unquote(place), (0, HEIGHT_INCHES * 72))
        link[NameObject("/Dest")] = ArrayObject(
            [
                writer.pages[start + number].indirect_reference,
                NameObject("/XYZ"),
                FloatObject(0),
                FloatObject(top),
                FloatObject(0),
            ]
        )


def faults(printed: Printed) -> list[str]:
    """What is wrong with a printed page: blank, a picture that is cut, blank or missing, letters
    beyond the edge.
    """
    document = pypdfium2.PdfDocument(printed.pdf)
    texts, pictures = [], 0
    for number, page in enumerate(document, 1):
        width, height = page.get_size()
        grey = np.asarray(page.render(scale=LOOKED_AT, grayscale=True).to_pil().convert("L"))
        foot = round(FOOT_INCHES * 72 * LOOKED_AT)
        of_page = []
        if np.mean(grey[:-foot] < 250) < INK:
            of_page.append("blank")
        for picture in page.get_objects(filter=[pdfium.FPDF_PAGEOBJ_IMAGE]):
            left, bottom, right, top = picture.get_bounds()
            if min(right - left, top - bottom) < 8:
                continue  # an icon
            pictures += 1
            if left < -1 or bottom < -1 or right > width + 1 or top > height + 1:
                of_page.append("a picture is cut")
                continue
            u, v = (np.array([left, right, height - top, height - bottom]) * LOOKED_AT).reshape(
                2, 2
            )
            pixels = grey[round(v[0]) : round(v[1]), round(u[0]) : round(u[1])]
            if pixels.size and np.ptp(pixels) < 8:
                of_page.append("a picture is blank")
        text = page.get_textpage()
        edges = [text.get_charbox(k) for k in range(text.count_chars())]
        if any(box[0] < -1 or box[2] > width - MARGIN_INCHES * 36 for box in edges):
            of_page.append("letters beyond the edge")
        texts += [f"{printed.page}, page {number}: {what}" for what in dict.fromkeys(of_page)]
    if pictures < printed.pictures:
        texts.append(f"{printed.page}: {pictures} pictures of {printed.pictures}")
    return texts


if __name__ == "__main__":
    sys.exit(main())
