"""Exercises and sweeps on chapters' pages in Chromium, from a folder that is served here.

`make browser` builds the folder; where it is not there, these tests say so and are left out.
"""

import json
import subprocess
import sys
import time

import pytest
from processes import CLI, wait_until

from workbench.browser.site import SITE
from workbench.course.exercises import exercise
from workbench.course.stubs import solved
from workbench.pages.browser import Browser
from workbench.sweep.notebook import glued, read_notebook

pytestmark = pytest.mark.heavy
KALMAN = "notebooks/04_kalman.html"
MATCHING = "notebooks/06_matching.html"
VALUES, FUNCTION, PREDICTION = 0, 1, 3  # of chapter 4's exercises
NOT_FOR_MARKS = "(Practice, not for marks.)"
RIGHT = solved(exercise("04.2"))
ENDLESS = "def filter_number(*_):\n    while True:\n        pass"
# Kept for the test: what a click on a button that saves gives to the reader.
SAVES = """
window.saved = [];
const made = URL.createObjectURL;
URL.createObjectURL = blob => (window.saved.push(blob.text()), made.call(URL, blob));
"""
# A chapter of no length in place of the page's own: the run at 3 waits for a stop, unless `{waits}`.
TOY = """
const asked = window.fetch;
window.fetch = (address, ...rest) => String(address).includes('/sweeps/')
    ? Promise.resolve(new Response(JSON.stringify({toy}))) : asked(address, ...rest);
"""
PARTS = {
    "chapter": "toy",
    "parameter": "ncc_threshold",
    "defaults": {"ncc_threshold": 0.5},
    "verdicts": [],
    "once": {"1": "from myst_nb import glue"},
}
AT_WORK = "while ncc_threshold == 3:\n    pass"


@pytest.fixture(scope="module")
def page(address, tmp_path_factory):
    """Chapter 4, in a browser that stays."""
    browser = Browser(tmp_path_factory.mktemp("profile"))
    browser.open(f"{address}/{KALMAN}", before=SAVES)
    yield browser
    browser.close()


def write(browser, place, source):
    """Put a source into the place of an answer, as a reader types it."""
    browser.evaluate(f"exercises.answers[{place}].editor.value = {json.dumps(source)}")


def checked(browser, place, source):
    """What is said of an answer."""
    write(browser, place, source)
    browser.evaluate(f"exercises.check(exercises.answers[{place}])")
    return verdict(browser, place)


def verdict(browser, place):
    return browser.evaluate(f"exercises.answers[{place}].said.textContent")


def status(browser, place):
    return browser.evaluate(f"exercises.answers[{place}].status.textContent")


def toy(waits):
    each = {"3": f"{AT_WORK if waits else ''}\nglue('twice', 2 * ncc_threshold)"}
    return TOY.replace("{toy}", json.dumps({**PARTS, "each": each}))


def test_an_answer_that_is_right_and_one_that_is_a_usual_mistake(page):
    says = checked(page, FUNCTION, RIGHT)
    assert says.startswith("04.2 right: filter_number agrees with the solution in 6 of 6 cases.")
    assert says.endswith(NOT_FOR_MARKS)
    wrong = checked(page, FUNCTION, RIGHT.replace("variance = variance + growth", "pass"))
    assert wrong.startswith("04.2 not yet: The variance never grows.")
    assert "Read chapter 4, One number first." in wrong
    assert checked(page, VALUES, 'answer_04_1 = {"gain": 0.5}').startswith("04.1 not yet:")
    assert page.errors == []


@pytest.mark.parametrize("by_hand", [True, False])
def test_an_answer_without_an_end_is_stopped_and_the_loss_is_said(page, by_hand):
    checked(page, FUNCTION, RIGHT)
    page.evaluate(f"exercises.limitS = {1000 if by_hand else 3}")
    write(page, FUNCTION, ENDLESS)
    page.evaluate(f"void exercises.check(exercises.answers[{FUNCTION}])")
    wait_until(lambda: status(page, FUNCTION) == "running")
    if by_hand:
        time.sleep(1.0)
        page.click("[aria-label='Stop the check of exercise 04.2']")
    wait_until(lambda: status(page, FUNCTION).startswith("stopped"))
    assert "What the session had is lost; your answers are kept." in status(page, FUNCTION)
    assert verdict(page, FUNCTION) == ""
    page.evaluate("exercises.limitS = 60")
    assert checked(page, FUNCTION, RIGHT).startswith("04.2 right:")


def test_answers_and_first_guesses_outlast_a_reload_and_are_in_the_files(
    address, browser, tmp_path_factory
):
    guess = {"gain": "the same", "predictions": "the same", "nis": "the same"}
    browser.open(f"{address}/{KALMAN}", before=SAVES)
    checked(browser, FUNCTION, RIGHT)
    assert "Your prediction is kept" in checked(browser, PREDICTION, f"answer_04_4 = {guess}")
    write(browser, VALUES, "answer_04_1 = {'gain': 4 / 9")
    browser.open(f"{address}/{KALMAN}", before=SAVES)
    assert verdict(browser, FUNCTION).startswith("04.2 right:")
    assert browser.evaluate(f"exercises.answers[{VALUES}].editor.value").endswith("4 / 9")
    browser.evaluate("document.querySelectorAll('.browser-course button').forEach(b => b.click())")
    notebook, predictions = browser.evaluate("Promise.all(saved)")

    folder = tmp_path_factory.mktemp("answers")
    (folder / "04_kalman.ipynb").write_text(notebook, encoding="utf-8")
    (folder / "predictions.json").write_text(predictions, encoding="utf-8")
    command = [sys.executable, "-c", CLI, "check", "04"]
    said = subprocess.run(command, cwd=folder, capture_output=True, text=True).stdout
    lines = {line[:4]: line for line in said.splitlines()}
    assert lines["04.2"].startswith("04.2 right: filter_number agrees")
    assert "Your prediction is kept" in lines["04.4"]
    assert "gain = the same" in lines["04.4"]
    assert "not there; cell 2 raises SyntaxError" in lines["04.1"]
    assert lines["04.3"].endswith("kalman_step is still to be written.")

    # the guess that was kept first stays the first in the next session
    other = checked(browser, PREDICTION, f"answer_04_4 = {dict(guess, gain='multiplied by c')}")
    assert "gain = the same" in other


def test_keys_write_and_check_an_answer_at_400_px(page):
    page.resize(400)
    page.evaluate(f"exercises.answers[{FUNCTION}].beginAnew()")
    editor = f"exercises.answers[{FUNCTION}].editor"
    page.evaluate(
        f"{editor}.value = 'def f():'; {editor}.mirror.focus(); {editor}.mirror.setCursor(0, 8)"
    )
    page.press("Enter")
    assert page.evaluate(f"{editor}.value") == "def f():\n    "
    page.press("Tab")
    assert page.evaluate("document.activeElement.ariaLabel") == "Check exercise 04.2"
    write(page, FUNCTION, RIGHT)
    page.press("Enter")
    wait_until(lambda: verdict(page, FUNCTION).startswith("04.2 right:"))
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.evaluate(f"exercises.answers[{FUNCTION}].beginAnew()")
    assert page.evaluate(f"{editor}.value === exercises.answers[{FUNCTION}].stub")
    page.resize(1280)


def test_a_sweep_that_was_stopped_goes_on_after_a_reload(address, browser):
    browser.open(f"{address}/{MATCHING}", before=toy(waits=True))
    browser.evaluate("sweep.input.value = '3, 1, 2'; sweep.look()")
    browser.evaluate("void sweep.start()")
    wait_until(lambda: browser.evaluate("sweep.said.textContent.startsWith('2 of 3')"))
    browser.evaluate(
        "document.getElementById('browser-sweep').querySelectorAll('button')[1].focus()"
    )
    browser.press("Enter")
    wait_until(lambda: browser.evaluate("!sweep.startButton.disabled"))
    assert browser.evaluate("sweep.said.textContent") == "stopped: 2 of 3 runs are kept"
    assert browser.evaluate("sweep.startButton.textContent") == "Continue"

    browser.open(f"{address}/{MATCHING}", before=SAVES + toy(waits=False))
    browser.evaluate("sweep.input.value = '3, 1, 2'; sweep.look()")
    before = browser.evaluate("sweep.rows")
    assert [row["value"] for row in before] == [1, 2]
    browser.evaluate("sweep.start()")
    rows = browser.evaluate("sweep.rows")
    found = {row["value"]: row["outcome"]["results"] for row in rows}
    assert found == {value: {"twice": 2 * value} for value in (1, 2, 3)}
    assert rows[:2] == before  # they were not done again
    browser.evaluate("sweep.saveButton.click()")
    (table,) = browser.evaluate("Promise.all(saved)")
    lines = [line.split(",")[:2] for line in table.splitlines()]
    assert lines == [["ncc_threshold", "twice"], ["1", "2"], ["2", "4"], ["3", "6"]]

    browser.open(f"{address}/{MATCHING}", width=400)
    browser.evaluate("sweep.input.value = '1, 2, 3'; sweep.look()")
    assert browser.evaluate("sweep.figure.querySelectorAll('img').length") == 1  # without Python
    assert browser.evaluate("document.documentElement.scrollWidth") <= 400
    browser.evaluate("sweep.forget()")
    assert browser.evaluate("sweep.rows") == []
    assert browser.errors == []


@pytest.mark.parametrize(("stem", "value"), [("03_background", 0.01), ("06_matching", 0.5)])
def test_a_run_at_the_books_own_value_gives_the_numbers_of_the_built_page(
    address, browser, stem, value
):
    built = glued(read_notebook(SITE.parent / "executed" / f"{stem}.ipynb"))
    browser.open(f"{address}/notebooks/{stem}.html")
    browser.evaluate(f"sweep.input.value = '{value}'; sweep.look()")
    browser.evaluate("sweep.start()")
    results = browser.evaluate("sweep.rows[0].outcome.results")
    numbers = {name: it for name, it in built.items() if not isinstance(it, str)}
    assert results == pytest.approx(numbers, rel=1e-3, nan_ok=True)
