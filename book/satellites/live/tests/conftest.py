"""A browser, and a live page on the simulated bench in it; nothing where the extras are missing."""

from importlib.util import find_spec

import pytest

from workbench.pages.browser import CHROMIUM, Browser

if find_spec("mink") and find_spec("tornado"):
    from livepage import Bench, Live, shows
else:
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    if CHROMIUM is None:
        pytest.skip("Chromium is missing (Debian package: chromium)")
    browser = Browser(tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def live(bench, browser, tmp_path):
    with Live(bench.source, tmp_path) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        yield live
