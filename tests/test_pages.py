"""The built pages as a reader sees them who has no network."""

import os
import re
import shutil
import subprocess
from functools import cache
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
HTML = ROOT / "_build" / "html"
TOC = yaml.safe_load((ROOT / "_toc.yml").read_text(encoding="utf-8"))
CHAPTERS = [chapter for part in TOC["parts"] for chapter in part["chapters"]]
PAGES = [TOC["root"], *(chapter["file"] for chapter in CHAPTERS)]
REFERENCE = [section["file"] for chapter in CHAPTERS for section in chapter.get("sections", [])]
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--enable-logging=stderr",
    "--virtual-time-budget=10000",
]
# The console marks every line as INFO. The theme preloads its icon fonts in a way that a browser
# refuses for pages read from files; they come all the same, by the style sheet.
ERROR = re.compile(r"(?!.*webfonts/fa-)(?i:.*(?:uncaught|error|failed|refused|blocked|net::))")

pytestmark = pytest.mark.skipif(
    not (HTML / "index.html").exists(), reason="no built pages: run make book first"
)
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="Chromium is missing (Debian package: chromium)"
)
each_page = pytest.mark.parametrize("page", [*PAGES, *REFERENCE])
# Those of the reference are alike, and so are the pages that hold text and formulas alone.
ALIKE = {"book/notation", "book/assumptions", "book/design", "book/bibliography", "book/api/index"}
each_kind = pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[pytest.mark.heavy] * (page in ALIKE))
        for page in [*PAGES, *REFERENCE[:1]]
    ],
)


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


def test_start_page_has_the_scoreboard():
    rows = (
        re.search(r"<table[^>]*scoreboard.*?</table>", read(TOC["root"]), flags=re.DOTALL)
        .group()
        .count("<tr")
    )
    assert rows >= 21, "a head and twenty claims"


@pytest.fixture
def load(tmp_path):
    """Load a page in Chromium with every host name unknown; return the finished page and the
    console's errors.
    """

    def run(page):
        address = (HTML / f"{page}.html").as_uri()
        command = [
            CHROMIUM,
            *FLAGS,
            "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={tmp_path / 'profile'}",
            "--dump-dom",
            address,
        ]
        done = subprocess.run(
            command,
            capture_output=True,
            encoding="utf-8",
            timeout=120,
            check=True,
            env={**os.environ, "HOME": str(tmp_path)},
        )
        return done.stdout, [
            line for line in done.stderr.splitlines() if ":CONSOLE" in line and ERROR.match(line)
        ]

    return run


@needs_chromium
@each_kind
def test_page_works_without_network(load, page):
    formulas = len(re.findall(r'class="math notranslate nohighlight', read(page)))
    dom, errors = load(page)
    assert errors == []
    assert dom.count("<mjx-container") >= formulas
    assert "<mjx-merror" not in dom
    assert formulas > 0 or not page.startswith("notebooks/")


@needs_chromium
def test_film_of_the_chain_plays(load, tmp_path):
    (film,) = re.findall("<video.*?</video>", read("notebooks/01_structure"), flags=re.DOTALL)
    said = "`${film.videoWidth} px, ${film.duration} s`"
    script = f"film = document.querySelector('video'); film.onloadeddata = () => document.body.dataset.film = {said};"
    (tmp_path / "film.html").write_text(
        f"<body>{film}<script>{script}</script></body>", encoding="utf-8"
    )
    dom, errors = load(tmp_path / "film")
    assert errors == []
    assert 'data-film="960 px, 2 s"' in dom
