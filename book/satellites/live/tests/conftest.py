"""A browser, and a live page on the simulated bench in it; nothing where the extras are missing."""

from importlib.util import find_spec

import pytest
from pages import browser  # noqa: F401

if find_spec("mink") and find_spec("tornado"):
    from livepage import Bench, Live, shows
else:
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def live(bench, browser, tmp_path):  # noqa: F811
    with Live(bench.source, tmp_path) as live:
        browser.open(live.address)
        shows(browser, "last && last.status === 'measured'")
        yield live
