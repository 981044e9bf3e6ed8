"""Chromium, and the folder that `make browser` builds; where either is missing, its tests say so."""

import pytest

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
