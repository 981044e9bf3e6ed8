"""Chromium, and the folder that `make browser` builds; where either is missing, its tests say so."""

import json

import pytest

from workbench.browser.guest import door, session
from workbench.browser.numbers import serving
from workbench.browser.site import SITE
from workbench.pages.browser import CHROMIUM, Browser


@pytest.fixture(scope="session")
def address():
    """Of the folder, which is served here."""
    if CHROMIUM is None:
        pytest.skip("Chromium is missing (Debian package: chromium)")
    if not (SITE / "_browser" / "sweeps").exists():
        pytest.skip("the pages that run in a browser are not built: make browser")
    with serving(SITE) as address:
        yield address


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


class Page:
    """The other side of the door, in Python: it keeps what is handed out."""

    def __init__(self):
        self.outputs = []
        self.answer = ({}, [])

    def __call__(self, frame):
        header, arrays = door._unpack(frame)
        if header["asks"] == "output":
            self.outputs.append(json.loads(json.dumps(header["output"], allow_nan=False)))
            return door._pack({}, [])
        self.asked = header, arrays
        return door._pack(*self.answer)


@pytest.fixture
def door_page(monkeypatch, tmp_path):
    page = Page()
    monkeypatch.setattr(door, "_call", page)
    monkeypatch.setattr(session, "CELLS", tmp_path)
    monkeypatch.setattr(session, "namespace", {"__name__": "__main__"})
    return page
