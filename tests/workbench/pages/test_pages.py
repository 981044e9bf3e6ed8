"""The built pages as a reader sees them who has no network."""

import re
from functools import cache, partial
from html import unescape
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import unquote, urlsplit

import pytest
import sitecheck
import yaml
from pages import HTML, built

ROOT = Path(__file__).resolve().parents[3]
TOC = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
CHAPTERS = [chapter for part in TOC["parts"] for chapter in part["chapters"]]
SECTIONS = [section["file"] for chapter in CHAPTERS for section in chapter.get("sections", [])]
PAGES = [TOC["root"], *(chapter["file"] for chapter in CHAPTERS), *SECTIONS]
pytestmark = built
# One page or two of each kind; `make verify` looks at all of them.
KINDS = {
    *("book/start", "book/scoreboard", "book/errata", "book/api/pose", "notebooks/04_kalman"),
    *("notebooks/02_workspace", "notebooks/06_matching", "notebooks/10_estimators"),
}
# Every page but those of the sources, which are alike: the first of them, and one more.
ALL = [
    *(f"{page}.html" for page in PAGES),
    *("genindex.html", "py-modindex.html", "search.html"),
    *("_modules/index.html", "_modules/trinolab/pose.html"),
]


def read(page):
    return (HTML / f"{page}.html").read_text(encoding="utf-8")


def test_every_link_leads_somewhere():
    """Of all pages, the lists of modules and sources included: file and place within the book, and
    the form of an address outside.
    """
    pose = HTML / "book" / "api" / "pose.html"
    for bad in ("pose.html#nowhere", "nowhere.html", "https:/example.org", "htp://example.org"):
        assert fault_of(bad, pose)
    links = [
        (file, link)
        for file in HTML.glob("**/*.html")
        for link in dict.fromkeys(re.findall(r'<a\b[^>]*\shref="([^"]*)"', whole(file)))
    ]
    assert [(file, link) for file, link in links if fault_of(unescape(link), file)] == []


def fault_of(link, file):
    """Whether a link in a file leads nowhere."""
    parts = urlsplit(link)
    if parts.scheme == "mailto":
        return not re.fullmatch(r"[^@\s]+@[^@\s]+\.\w+", parts.path)
    if parts.scheme or parts.netloc:
        good = parts.scheme in {"http", "https"} and re.fullmatch(r"([\w-]+\.)+\w+", parts.netloc)
        return not good or re.search(r"\s", link)
    target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
    place = unquote(parts.fragment)
    return not target.is_file() or (place and place not in places(target))


@cache
def whole(file):
    return file.read_text(encoding="utf-8")


@cache
def places(file):
    """The names in a page that a link may lead to."""
    return set(re.findall(r'\b(?:id|name)="([^"]+)"', whole(file)))


def test_an_entry_of_the_reference_leads_to_source_equation_and_chapter():
    entry = read("book/api/pose").split('id="trinolab.pose.rigid_fit"')[1]
    entry = entry.split('<dt class="sig')[0]
    for link in (
        "../../_modules/trinolab/pose.html#rigid_fit",
        "../equations.html#equation-23",
        "../../notebooks/08_pose.html",
    ):
        assert f'href="{link}"' in entry
    assert "points_source" in entry.split("Parameters")[1]


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
        ("book/equations", "api/pose.html#trinolab.pose.rigid_fit"),
        ("book/start", "scoreboard.html#scoreboard"),
        ("notebooks/08_pose", "../book/assumptions.html#a16"),
        ("notebooks/04_kalman", "../book/errata.html#erratum-eq-12"),
        ("book/report", "scoreboard.html#claim-17"),
        ("book/report", "assumptions.html#a11"),
        ("book/protocol", "scoreboard.html#claim-17"),
        ("book/scoreboard", "protocol.html#criterion-17"),
    ],
)
def test_what_belongs_together_is_linked(page, link):
    assert f'href="{link}"' in read(page)


def test_styles_load_only_their_own_files():
    for style in HTML.glob("_static/**/*.css"):
        text = re.sub(r"/\*.*?\*/", "", style.read_text(encoding="utf-8"), flags=re.DOTALL)
        found = re.findall(r"""(?:@import\s*|url\(\s*)["']?((?:\w+:)?//[^"')\s]+)""", text)
        assert not found, f"{style.relative_to(HTML)}: {found}"


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=[pytest.mark.heavy] * (page not in KINDS)) for page in PAGES],
)
def test_page_works_without_network(browser, page):
    """What it loads from elsewhere, or what is not there, the browser calls an error."""
    formulas = len(re.findall(r'class="math notranslate nohighlight', read(page)))
    assert formulas > 0 or not page.startswith("notebooks/")
    assert sitecheck.faults(browser, (HTML / f"{page}.html").as_uri(), schemes=()) == []
    assert browser.evaluate("document.querySelectorAll('mjx-container').length") >= formulas
    assert browser.evaluate("document.querySelectorAll('mjx-merror').length") == 0


@pytest.mark.parametrize("page", ["book/start.html", "book/api/workspace.html", "search.html"])
def test_a_page_is_open_to_all_in_light_and_dark(browser, page):
    assert sitecheck.faults(browser, (HTML / page).as_uri()) == []


@pytest.mark.heavy
def test_every_page_is_open_to_all_in_light_and_dark(browser):
    """What a page must not have, and axe-core's serious faults: half an hour on two cores that ten
    others use.
    """
    said = [(page, sitecheck.faults(browser, (HTML / page).as_uri())) for page in ALL]
    assert [(page, found) for page, found in said if found] == []


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


def test_a_chapter_works_from_a_server(browser, site):
    browser.open(f"{site}/notebooks/01_structure.html")
    assert browser.evaluate(sitecheck.MISSING) == []
    assert browser.errors == []
    assert browser.evaluate("document.querySelector('article') !== null")
    browser.navigate(f"{site}/index.html")
    browser.arrives("/book/start.html")
    assert browser.errors == []


def test_each_kind_of_fault_of_a_page_is_found(browser, tmp_path):
    """A page that has them all."""
    (tmp_path / "bad.html").write_text(BAD, encoding="utf-8")
    found = "\n".join(sitecheck.faults(browser, (tmp_path / "bad.html").as_uri()))
    kinds = r"""error: console|error: net::ERR_FILE_NOT_FOUND|missing: <img|raw: See {ref}`there`
raw: where \alpha is|axe, light: image-alt|axe, light: color-contrast|axe, dark: color-contrast
wide code: |clipped at 1280|px wider than 400|over the edge: a_word_"""
    for kind in kinds.replace("\n", "|").split("|"):
        assert kind in found, (kind, found)


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
