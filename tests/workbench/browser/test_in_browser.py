"""Chapters' pages that run their cells in Chromium, from a folder that is served here.

`make browser` builds the folder; where it is not there, these tests say so and are left out.
"""

import json
import time

import pytest
from chapters import LESSONS
from processes import wait_until

from workbench.browser import numbers
from workbench.browser.numbers import wait_until_idle

pytestmark = pytest.mark.heavy
# Chapter 4's: imports and a figure; a mean and its variance by hand; a gain that needs them
IMPORTS, BY_HAND, GAIN = 0, 3, 4
PAGE = "notebooks/04_kalman.html"


@pytest.fixture(scope="module")
def page(address, browser):
    """Chapter 4, with a session that has begun."""
    browser.open(f"{address}/{PAGE}")
    run(browser, BY_HAND)
    return browser


def run(browser, *cells):
    browser.evaluate(f"void book.run({list(cells)}.map(k => book.cells[k]))")
    wait_until_idle(browser)


def says(browser, cell):
    return browser.evaluate(f"book.cells[{cell}].status.textContent")


def shown(browser, cell):
    return browser.evaluate(f"book.cells[{cell}].result.textContent")


def write(browser, cell, source):
    """Put a source into a cell, as a reader types it."""
    browser.evaluate(
        f"(one => {{ if (!one.editor) one.turn(); one.editor.value = {json.dumps(source)}; }})"
        f"(book.cells[{cell}])"
    )


def put_back(browser, cell):
    browser.evaluate(f"book.cells[{cell}].editor && book.cells[{cell}].turn()")


def test_a_cell_runs_and_shows_what_it_prints_in_place_of_the_stored_output(page):
    run(page, BY_HAND)
    assert (
        shown(page, BY_HAND).strip() == "mean 6.0, variance 0.8"
    )  # (2/4 + 7/1) / (1/4 + 1/1), 1 / (1/4 + 1/1)
    assert page.evaluate(f"book.cells[{BY_HAND}].output.hidden")
    assert says(page, BY_HAND).startswith("ran here in")


def test_run_all_above_runs_those_and_not_the_cell_itself(page):
    page.evaluate("book.cells.forEach(one => one.say(''))")
    page.click(f"[aria-label='Run all above cell {BY_HAND + 2}']")
    wait_until_idle(page)
    assert all(says(page, cell).startswith("ran here") for cell in range(BY_HAND + 1))
    assert says(page, BY_HAND + 1) == ""
    result = f"book.cells[{IMPORTS}].result"
    assert page.evaluate(f"{result}.querySelectorAll('img').length") == 1
    caption = page.evaluate(f"{result}.querySelector('figcaption .caption-number').textContent")
    assert caption.strip() == "Fig. 4.1"


def test_the_session_keeps_its_variables_and_a_restart_forgets_them(page):
    run(page, IMPORTS, BY_HAND, GAIN)
    assert "gain 0.8" in shown(page, GAIN)
    page.evaluate("book.restart()")
    assert not page.evaluate(f"book.cells[{GAIN}].output.hidden")
    run(page, GAIN)
    assert "NameError" in shown(page, GAIN)
    assert says(page, GAIN).startswith("failed")
    run(page, BY_HAND)


def test_a_run_that_does_not_end_is_stopped_and_the_loss_is_said(page):
    write(page, BY_HAND, "while True:\n    pass")
    page.evaluate(f"void book.run([book.cells[{BY_HAND}]])")
    time.sleep(2.0)
    assert page.evaluate("book.running")
    page.click(".browser-bar button:nth-of-type(2)")
    wait_until_idle(page)
    assert "variables are lost" in page.evaluate("book.said.textContent")
    put_back(page, BY_HAND)
    run(page, BY_HAND)
    assert says(page, BY_HAND).startswith("ran here in")


def test_keys_reach_run_and_run_a_cell_from_its_source(page):
    page.evaluate(f"book.cells[{BY_HAND}].say('')")
    page.evaluate("document.querySelector(\"[aria-label='Run cell 4']\").focus()")
    page.press("Enter")
    wait_until_idle(page)
    assert says(page, BY_HAND).startswith("ran here")
    page.press("Tab")
    assert page.evaluate("document.activeElement.ariaLabel") == "Run all above cell 4"
    unnamed = "[...document.querySelectorAll('.browser-button')].filter(b => !b.ariaLabel).length"
    assert page.evaluate(unnamed) == 0
    write(page, BY_HAND, "print(6 * 7)")
    page.evaluate(
        f"book.cells[{BY_HAND}].editor.mirror.getInputField().dispatchEvent("
        "new KeyboardEvent('keydown', {key: 'Enter', keyCode: 13, shiftKey: true, bubbles: true}))"
    )
    wait_until_idle(page)
    assert shown(page, BY_HAND).strip() == "42"
    put_back(page, BY_HAND)


def test_a_link_carries_a_source_and_leaves_what_the_reader_has_written(address, browser):
    browser.open(f"{address}/{PAGE}")
    write(browser, BY_HAND, "print('für alle')")
    browser.evaluate(f"book.cells[{BY_HAND}].copyLink()")
    link = browser.evaluate("location.href")
    assert f"#cell-{BY_HAND + 1}=" in link
    write(browser, BY_HAND, "print('mine')")
    browser.open("about:blank")
    browser.open(link)
    source = f"book.cells[{BY_HAND}].source"
    wait_until(lambda: browser.evaluate(source) == "print('für alle')")
    assert says(browser, BY_HAND) == "from the link, not run yet"
    browser.open("about:blank")
    browser.open(f"{address}/{PAGE}")
    assert browser.evaluate(source) == "print('mine')"
    put_back(browser, BY_HAND)


def test_the_runtime_is_kept_and_no_request_leaves_the_page(address, browser):
    browser.open(f"{address}/{PAGE}")
    run(browser, BY_HAND)
    kept = browser.evaluate(
        "caches.keys().then(names => caches.open(names[0])).then(one => one.keys())"
        ".then(all => all.map(one => new URL(one.url).pathname))"
    )
    assert "/_browser/files/python.wasm.gz" in kept
    assert browser.errors == []  # there is no network: a request elsewhere would be one


@pytest.mark.parametrize("chapter", [path.stem for path in LESSONS[:9]])
def test_a_chapter_runs_to_its_end_with_the_verdicts_of_the_built_page(address, browser, chapter):
    ran = numbers.run_chapter(browser, f"{address}/notebooks/{chapter}.html")
    assert [says for kind, says in ran.cells if kind not in ("done", "cannot")] == []
    table = numbers.of_chapter(chapter, ran)
    apart = table[~table["agrees"]]
    assert apart[apart["why"] == ""].to_dict("records") == []
    assert not apart["built"].map(lambda value: isinstance(value, str)).any()  # no verdict
