"""The book as one PDF: its pages whole, its links within it."""

import base64
import io

import numpy as np
import pytest
from PIL import Image
from pypdf import PdfReader

from workbench.pages import printing
from workbench.pages.browser import CHROMIUM, Browser
from workbench.pages.contents import pages
from workbench.pages.figures import HTML

pytestmark = [
    pytest.mark.skipif(not (HTML / "index.html").exists(), reason="no built pages"),
    pytest.mark.skipif(CHROMIUM is None, reason="Chromium is missing (Debian package: chromium)"),
]


def texts(reader):
    return [page.extract_text() for page in reader.pages]


@pytest.mark.heavy
def test_pages_are_joined_and_link_to_each_other():
    printed = list(printing.print_pages(HTML, ["book/start", "book/notation"]))
    assert [fault for one in printed for fault in printing.faults(one)] == []
    reader = PdfReader(io.BytesIO(printing.join(printed, HTML)))
    assert [mark.title for mark in reader.outline] == [
        "A master handle, three cameras",
        "Notation",
    ]
    first = reader.get_destination_page_number(reader.outline[1])
    assert "Notation" in texts(reader)[first]
    addresses, inside = [], set()
    for page in reader.pages:
        for annotation in page.get("/Annots", []):
            link = annotation.get_object()
            addresses.append(link.get("/A", {}).get("/URI", ""))
            if "/Dest" in link:
                inside.add(reader.get_page_number(link["/Dest"][0].get_object()))
    assert not [one for one in addresses if one.startswith("file:")]
    assert any(one.startswith("https://creativecommons.org") for one in addresses)
    assert first in inside, "the start page leads to the notation"


@pytest.mark.heavy
def test_the_whole_book_is_printed_without_a_fault():
    found = []
    for printed in printing.print_pages(HTML, pages(printing.ROOT)):
        found += printing.faults(printed)
    assert found == []


def as_address(grey):
    """An image of grey levels as an address that holds it."""
    file = io.BytesIO()
    Image.fromarray(grey).save(file, "png")
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


NOISE = np.random.default_rng(0).integers(0, 255, (60, 60), dtype=np.uint8)
WHITE = np.full((60, 60), 255, np.uint8)


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("<p>text</p>", None),
        (f'<p>text</p><img width="200" src="{as_address(NOISE)}">', None),
        ('<p>text</p><div style="break-before: page">&nbsp;</div>', "page 2: blank"),
        (f'<p>text</p><img width="200" src="{as_address(WHITE)}">', "page 1: a picture is blank"),
        (f'<img width="200" height="2000" src="{as_address(NOISE)}">', "a picture is cut"),
        (
            '<p>t</p><div style="position: relative; overflow: hidden; height: 300px">'
            f'<img style="position: absolute; left: 600px" width="200" src="{as_address(NOISE)}"></div>',
            "a picture is cut",
        ),
    ],
    ids=["text", "picture", "blank page", "blank picture", "tall picture", "wide picture"],
)
def test_what_is_wrong_with_a_printed_page_is_found(browser, tmp_path, body, fault):
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><title>t</title><body>{body}", encoding="utf-8")
    browser.open(page.as_uri())
    pdf = browser.page.pdf(format="A4", margin={"right": "0.4in", "left": "0.4in"})
    found = printing.faults(printing.Printed("page", "t", body.count("<img"), pdf))
    assert (fault is None) == (found == []), found
    assert fault is None or any(fault in one for one in found), found


def test_a_picture_that_is_missing_is_found(browser, tmp_path):
    (tmp_path / "page.html").write_text("<p>text</p>", encoding="utf-8")
    browser.open((tmp_path / "page.html").as_uri())
    pdf = browser.page.pdf()
    assert printing.faults(printing.Printed("p", "t", 1, pdf)) == ["p: 0 pictures of 1"]


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()
