"""The built pages as a reader sees them who has no network."""

import re
from functools import cache
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest
import yaml
from browser import CHROMIUM, Browser

ROOT = Path(__file__).resolve().parents[1]
HTML = ROOT / "_build" / "html"
TOC = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
CHAPTERS = [chapter for part in TOC["parts"] for chapter in part["chapters"]]
PAGES = [TOC["root"], *(chapter["file"] for chapter in CHAPTERS)]
REFERENCE = [section["file"] for chapter in CHAPTERS for section in chapter.get("sections", [])]
pytestmark = pytest.mark.skipif(
    not (HTML / "index.html").exists(), reason="no built pages: run make book first"
)
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is missing (Debian package: chromium)"
)
each_page = pytest.mark.parametrize("page", [*PAGES, *REFERENCE])
# Those of the reference are alike, and so are the pages that hold text and formulas alone.
ALIKE = {
    *("book/notation", "book/glossary", "book/assumptions", "book/design", "book/bibliography"),
    *("book/api/index", *REFERENCE[1:]),
}
each_kind = pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.heavy] * (page in ALIKE))
        for page in [*PAGES, *REFERENCE]
    ],
)
WIDTHS_PX = (1280, 1920, 400)


def read(page):
    return (HTML / f"{page}.html").read_text(encoding="utf-8")


class Loaded(HTMLParser):
    """The addresses that a browser loads by itself; a link that the reader may click is none of
    them.
    """

    def __init__(self, text):
        super().__init__()
        self.addresses = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if tag in {"script", "img", "iframe", "video", "audio", "source", "embed"}:
            self.addresses.append(attrs.get("src"))
        elif tag == "link" and attrs.get("rel") not in {"canonical", "license", "author"}:
            self.addresses.append(attrs.get("href"))
        elif tag == "object":
            self.addresses.append(attrs.get("data"))


@each_page
def test_page_loads_only_its_own_files(page):
    local = [
        address.partition("?")[0].partition("#")[0]
        for address in Loaded(read(page)).addresses
        if address and not address.startswith("data:")
    ]
    assert local, "no script or style found at all"
    for address in local:
        assert not re.match(r"\w+:|//", address), address
        assert ((HTML / page).parent / address).exists(), address


@cache
def places(file):
    """The names in a page that a link may lead to."""
    return set(re.findall(r'\b(?:id|name)="([^"]+)"', file.read_text(encoding="utf-8")))


@each_page
def test_every_link_inside_the_book_leads_somewhere(page):
    article = read(page).split("<article", 1)[1].split("</article>")[0]
    for link in set(re.findall(r'<a [^>]*href="([^"]+)"', article)):
        path, _, place = unescape(link).partition("#")
        if re.match(r"\w+:", path):
            continue
        file = ((HTML / page).parent / path).resolve() if path else HTML / f"{page}.html"
        assert file.exists(), link
        assert not place or unquote(place) in places(file), link


def test_an_entry_of_the_reference_leads_to_source_equation_and_chapter():
    entry = (
        read("book/api/pose").split('id="trinolab.pose.rigid_fit"')[1].split('<dt class="sig')[0]
    )
    for link in (
        "../../_modules/trinolab/pose.html#rigid_fit",
        "../equations.html#equation-23",
        "../../notebooks/08_pose.html",
    ):
        assert f'href="{link}"' in entry
    assert "points_source" in entry.split("Parameters")[1]
    assert 'href="api/pose.html#trinolab.pose.rigid_fit"' in read("book/equations")


def test_the_index_leads_to_the_equation_itself_and_back():
    index = read("book/equations")
    for no, chapter in ((4, "02_workspace"), (16, "05_markers"), (20, "08_pose")):
        assert f'href="../notebooks/{chapter}.html#eq-{no}"' in index
        assert re.search(
            rf'<div class="[^"]*math[^"]*" id="eq-{no}">', read(f"notebooks/{chapter}")
        )
        assert f'href="../book/equations.html#equation-{no}"' in read(f"notebooks/{chapter}")


@pytest.mark.parametrize(
    ("page", "link"),
    [
        ("notebooks/08_pose", "../book/assumptions.html#a16"),
        ("notebooks/04_kalman", "../book/errata.html#erratum-eq-12"),
        ("book/report", "scoreboard.html#claim-17"),
        ("book/report", "assumptions.html#a11"),
        ("book/protocol", "scoreboard.html#claim-17"),
        ("book/scoreboard", "protocol.html#criterion-17"),
    ],
)
def test_assumptions_claims_and_errata_are_linked_where_they_are_used(page, link):
    assert f'href="{link}"' in read(page)


def test_the_picture_of_the_house_is_described():
    (picture,) = re.findall(r"<img[^>]*house[^>]*>", read("book/design"))
    assert len(re.search('alt="([^"]*)"', picture).group(1)) > 100


def test_styles_load_only_their_own_files():
    for style in HTML.glob("_static/**/*.css"):
        text = re.sub(r"/\*.*?\*/", "", style.read_text(encoding="utf-8"), flags=re.DOTALL)
        found = re.findall(r"""(?:@import\s*|url\(\s*)["']?((?:\w+:)?//[^"')\s]+)""", text)
        assert not found, f"{style.relative_to(HTML)}: {found}"


def test_first_page_leads_to_the_book():
    assert f"url={TOC['root']}.html" in (HTML / "index.html").read_text(encoding="utf-8")


def test_start_page_has_the_film_the_answer_and_a_link_to_the_scoreboard():
    start = read(TOC["root"])
    assert "<video" in start
    assert "Does it replicate?" in start
    assert 'href="scoreboard.html#scoreboard"' in start


def test_scoreboard_has_a_row_for_each_claim():
    rows = (
        re.search(r"<table[^>]*scoreboard.*?</table>", read("book/scoreboard"), flags=re.DOTALL)
        .group()
        .count("<tr")
    )
    assert rows >= 21, "a head and twenty claims"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


# Of each formula: whether its box cuts it off, or cannot be scrolled to its end.
CLIPPED = """
[...document.querySelectorAll('article div.math')].filter(box => {
    const formula = box.querySelector('mjx-math').getBoundingClientRect();
    const edges = box.getBoundingClientRect();
    const scrolls = getComputedStyle(box).overflowX == 'auto';
    return formula.left < edges.left - 1 || (formula.right > edges.right + 1 && !scrolls);
}).map(box => box.textContent.slice(0, 60))
"""
# The lines of a chapter's code that its box does not show whole.
WIDE_CODE = """
[...document.querySelectorAll('article .cell_input div.highlight pre')]
    .filter(box => box.scrollWidth > box.clientWidth + 1)
    .map(box => box.textContent.slice(0, 60))
"""
# How far the page itself can be scrolled sideways.
WIDE_PAGE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


@needs_chromium
@each_kind
def test_page_works_without_network(browser, page):
    formulas = len(re.findall(r'class="math notranslate nohighlight', read(page)))
    browser.open((HTML / f"{page}.html").as_uri())
    assert browser.errors == []
    assert browser.evaluate("document.querySelectorAll('mjx-container').length") >= formulas
    assert browser.evaluate("document.querySelectorAll('mjx-merror').length") == 0
    assert formulas > 0 or not page.startswith("notebooks/")
    for width in WIDTHS_PX:
        browser.resize(width)
        assert browser.evaluate(CLIPPED) == [], width
        assert browser.evaluate(WIDE_PAGE) == 0, width


@needs_chromium
@pytest.mark.parametrize("page", [page for page in PAGES if (ROOT / f"{page}.ipynb").exists()])
def test_no_line_of_code_is_wider_than_its_box(browser, page):
    browser.open((HTML / f"{page}.html").as_uri(), width=1280)
    assert browser.evaluate(WIDE_CODE) == []


@needs_chromium
def test_film_of_the_chain_plays(browser, tmp_path):
    (film,) = re.findall("<video.*?</video>", read("notebooks/01_structure"), flags=re.DOTALL)
    (tmp_path / "film.html").write_text(f"<body>{film}</body>", encoding="utf-8")
    browser.open((tmp_path / "film.html").as_uri())
    size = """
    new Promise(done => {
        const film = document.querySelector('video');
        const tell = () => done([film.videoWidth, film.duration]);
        film.readyState >= 2 ? tell() : film.onloadeddata = tell;
    })
    """
    assert browser.evaluate(size) == [960, 6]
    assert browser.errors == []
