"""What pages and chapters say, for tests that compute their numbers anew."""

import json
import re
from functools import cache

import pytest

from workbench.pages.browser import CHROMIUM, Browser
from workbench.pages.figures import HTML, ROOT

built = pytest.mark.skipif(
    not (HTML / "index.html").exists(), reason="no built pages: run make book first"
)


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """One browser for all tests of pages of a folder, whose conftest.py imports it."""
    if CHROMIUM is None:
        pytest.skip("Chromium is missing (Debian package: chromium)")
    browser = Browser(tmp_path_factory.mktemp("profile"))
    browser.open("about:blank")
    yield browser
    browser.close()


@cache
def text_of(path: str) -> str:
    """The text of a page, or of a chapter's text cells, with single spaces."""
    text = (ROOT / path).read_text(encoding="utf-8")
    if path.endswith(".ipynb"):
        cells = json.loads(text)["cells"]
        text = "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    return " ".join(text.split())


def page_says(path: str, *sentences: str) -> None:
    """The page or chapter has each of these, to the digit."""
    for sentence in sentences:
        assert sentence in text_of(path), sentence


def table_of(text: str, kind: str) -> list[list[str]]:
    """The rows of a page's table of a kind without its head, as lists of cells."""
    table = text.partition(f":class: {kind}\n")[2].partition("````")[0]
    rows = re.split(r"^\* - ", table, flags=re.MULTILINE)[2:]
    return [re.split(r"^  - ", row, flags=re.MULTILINE) for row in rows]
