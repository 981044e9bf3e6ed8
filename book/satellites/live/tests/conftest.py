"""A browser, and a live page on the simulated bench in it."""

import pytest
from livepage import Bench, Live, shows

from workbench.pages.browser import Browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
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
