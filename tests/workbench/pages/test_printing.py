"""The book as one PDF: its pages whole, its links within it."""

import base64
import io

import numpy as np
import pytest
from pages import built
from PIL import Image
from pypdf import PdfReader

from workbench.pages import printing
from workbench.pages.contents import pages
from workbench.pages.figures import HTML

pytestmark = built


@pytest.mark.heavy
def test_pages_are_joined_and_link_to_each_other():
    printed = list(printing.print_pages(HTML, ["book/start", "book/notation"]))
    reader = PdfReader(io.BytesIO(printing.join(printed, HTML)))
    titles = [mark.title for mark in reader.outline]
    assert titles == ["A master handle, three cameras", "Notation"]
    first = reader.get_destination_page_number(reader.outline[1])
    assert "Notation" in reader.pages[first].extract_text()
    links = [one.get_object() for page in reader.pages for one in page.get("/Annots", [])]
    addresses = [link.get("/A", {}).get("/URI", "") for link in links]
    inside = [link["/Dest"][0].get_object() for link in links if "/Dest" in link]
    assert not [one for one in addresses if one.startswith("file:")]
    assert any(one.startswith("https://creativecommons.org") for one in addresses)
    leads_to = {reader.get_page_number(page) for page in inside}
    assert first in leads_to, "the start page leads to the notation"


@pytest.mark.heavy
def test_the_whole_book_is_printed_without_a_fault():
    book = printing.print_pages(HTML, pages(printing.ROOT))
    assert [fault for printed in book for fault in printing.faults(printed)] == []


def as_address(grey):
    """An image of grey levels as an address that holds it."""
    file = io.BytesIO()
    Image.fromarray(grey).save(file, "png")
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


NOISE = np.random.default_rng(0).integers(0, 255, (60, 60), dtype=np.uint8)
WHITE = np.full((60, 60), 255, np.uint8)


@pytest.mark.parametrize(
    ("body", "count", "fault"),
    [
        ("<p>text</p>", 0, None),
        (f'<p>text</p><img width="200" src="{as_address(NOISE)}">', 1, None),
        ("<p>text</p>", 1, "0 pictures of 1"),
        ('<p>text</p><div style="break-before: page">&nbsp;</div>', 0, "page 2: blank"),
        (f'<p>t</p><img width="200" src="{as_address(WHITE)}">', 1, "page 1: a picture is blank"),
        (f'<img width="200" height="2000" src="{as_address(NOISE)}">', 1, "a picture is cut"),
        (
            '<p>t</p><div style="position: relative; overflow: hidden; height: 300px">'
            f'<img style="position: absolute; left: 600px" width="200" src="{as_address(NOISE)}"></div>',
            1,
            "a picture is cut",
        ),
    ],
    ids=["text", "picture", "missing", "blank page", "blank picture", "tall", "wide"],
)
def test_what_is_wrong_with_a_printed_page_is_found(browser, tmp_path, body, count, fault):
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><title>t</title><body>{body}", encoding="utf-8")
    browser.open(page.as_uri())
    pdf = browser.pdf(format="A4", margin={"right": "0.4in", "left": "0.4in"})
    found = printing.faults(printing.Printed("page", "t", count, pdf))
    assert (fault is None) == (found == []), found
    assert fault is None or any(fault in one for one in found), found
