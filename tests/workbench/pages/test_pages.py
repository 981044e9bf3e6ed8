"""The built pages as a reader sees them who has no network."""

import re
from functools import cache, partial
from html import unescape
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import unquote, urlsplit

import pytest
import sitecheck
import yaml

from workbench.pages.browser import CHROMIUM, Browser

ROOT = Path(__file__).resolve().parents[3]
HTML = ROOT / "_build" / "html"
TOC = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
CHAPTERS = [chapter for part in TOC["parts"] for chapter in part["chapters"]]
SECTIONS = [section["file"] for chapter in CHAPTERS for section in chapter.get("sections", [])]
STUDIES = [page for page in SECTIONS if page.startswith("notebooks/")]
REFERENCE = [page for page in SECTIONS if page not in STUDIES]
API = [page for page in REFERENCE if page.startswith("book/api/")]
PAGES = [TOC["root"], *(chapter["file"] for chapter in CHAPTERS), *STUDIES]
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
    *("book/decisions/index", "book/api/index", *API[1:]),
}
each_kind = pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.heavy] * (page in ALIKE))
        for page in [*PAGES, *REFERENCE]
    ],
)
# Every page but those of the sources, which are alike: the first of them, and one more.
ALL = [
    *(f"{page}.html" for page in [*PAGES, *REFERENCE]),
    *("genindex.html", "py-modindex.html", "search.html"),
    *("_modules/index.html", "_modules/trinolab/pose.html"),
]


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


def test_every_link_leads_somewhere():
    """Of all pages, the lists of modules and sources included: file and place within the book, and
    the form of an address outside.
    """
    broken = []
    for file in HTML.glob("**/*.html"):
        for link in dict.fromkeys(re.findall(r'<a\b[^>]*\shref="([^"]*)"', whole(file))):
            if fault := fault_of(unescape(link), file):
                broken.append(f"{file.relative_to(HTML)}: {link}: {fault}")
    assert not broken, "\n".join(broken)


def fault_of(link, file):
    """What is wrong with a link in a file, or nothing."""
    parts = urlsplit(link)
    if parts.scheme == "mailto":
        return None if re.fullmatch(r"[^@\s]+@[^@\s]+\.\w+", parts.path) else "no address"
    if parts.scheme or parts.netloc:
        good = parts.scheme in {"http", "https"} and re.fullmatch(r"([\w-]+\.)+\w+", parts.netloc)
        return None if good and not re.search(r"\s", link) else "no address"
    target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
    if not target.is_file():
        return "no such file"
    place = unquote(parts.fragment)
    return None if not place or place in places(target) else "no such place"


@cache
def whole(file):
    return file.read_text(encoding="utf-8")


@cache
def places(file):
    """The names in a page that a link may lead to."""
    return set(re.findall(r'\b(?:id|name)="([^"]+)"', whole(file)))


@pytest.mark.parametrize(
    ("link", "fault"),
    [
        ("pose.html", None),
        ("pose.html#trinolab.pose.rigid_fit", None),
        ("https://creativecommons.org/licenses/by/4.0/", None),
        ("pose.html#nowhere", "no such place"),
        ("nowhere.html", "no such file"),
        ("https:/creativecommons.org", "no address"),
        ("htp://creativecommons.org", "no address"),
    ],
)
def test_a_broken_link_is_found(link, fault):
    assert fault_of(link, HTML / "book" / "api" / "pose.html") == fault


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
    for no, chapter in ((1, "02_workspace"), (16, "05_markers"), (20, "08_pose")):
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


@needs_chromium
@each_kind
def test_page_works_without_network(browser, page):
    formulas = len(re.findall(r'class="math notranslate nohighlight', read(page)))
    assert formulas > 0 or not page.startswith("notebooks/")
    assert sitecheck.faults(browser, (HTML / f"{page}.html").as_uri(), schemes=()) == []
    assert browser.evaluate("document.querySelectorAll('mjx-container').length") >= formulas
    assert browser.evaluate("document.querySelectorAll('mjx-merror').length") == 0


@needs_chromium
@pytest.mark.parametrize("page", ["book/start.html", "book/api/workspace.html", "search.html"])
def test_a_page_is_open_to_all_in_light_and_dark(browser, page):
    assert sitecheck.faults(browser, (HTML / page).as_uri()) == []


@needs_chromium
@pytest.mark.heavy
def test_every_page_is_open_to_all_in_light_and_dark(browser):
    """What a page must not have, and axe-core's serious faults: half an hour on two cores that ten
    others use.
    """
    said = []
    for page in ALL:
        found = sitecheck.faults(browser, (HTML / page).as_uri())
        said += [f"{page}: {one}" for one in found]
    assert said == []


@pytest.fixture(scope="module")
def site():
    """The address of a server of the built pages, on this machine alone."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(HTML))) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


class Quiet(SimpleHTTPRequestHandler):
    """A server that says nothing of what it serves."""

    def log_message(self, *_):
        pass


@needs_chromium
def test_a_chapter_works_from_a_server(browser, site):
    browser.open(f"{site}/notebooks/01_structure.html")
    assert browser.evaluate(sitecheck.MISSING) == []
    assert browser.errors == []
    assert browser.evaluate("document.querySelector('article') !== null")
    browser.navigate(f"{site}/index.html")
    browser.arrives("/book/start.html")
    assert browser.errors == []


@needs_chromium
@pytest.mark.heavy
def test_every_page_works_from_a_server(browser, site):
    said = []
    for page in ALL:
        browser.open(f"{site}/{page}")
        said += [f"{page}: {one}" for one in browser.evaluate(sitecheck.MISSING)]
        said += [f"{page}: {one}" for one in browser.errors]
    assert said == []


@needs_chromium
def test_each_kind_of_fault_of_a_page_is_found(browser, tmp_path):
    """A page that has them all."""
    (tmp_path / "bad.html").write_text(BAD, encoding="utf-8")
    found = sitecheck.faults(browser, (tmp_path / "bad.html").as_uri())
    for kind in (
        "error: console",
        "error: net::ERR_FILE_NOT_FOUND",
        "missing: <img",
        "raw: See {ref}`there`",
        r"raw: where \alpha is",
        "axe, light: image-alt",
        "axe, light: color-contrast",
        "axe, dark: color-contrast",
        "wide code: ",
        "clipped at 1280",
        "px wider than 400",
        "over the edge: a_word_",
    ):
        assert any(kind in one for one in found), (kind, found)


BAD = r"""<!doctype html><html lang="en"><title>bad</title><body><main><article>
<script>console.error("this is wrong")</script>
<img src="nowhere.png">
<p>See {ref}`there`.</p><p>where \alpha is</p>
<p style="color: #999; background: #fff">faint</p>
<div class="cell_input"><div class="highlight" style="width: 5rem; overflow: hidden">
<pre style="overflow: auto">a line that is much too long for its box</pre></div></div>
<div class="math" style="width: 5rem; overflow: hidden">
<mjx-math style="display: block; width: 20rem">x</mjx-math></div>
<p>a_word_that_is_wider_than_any_telephone_and_has_no_place_to_be_broken_at_all</p>
</article></main></body></html>
"""


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
