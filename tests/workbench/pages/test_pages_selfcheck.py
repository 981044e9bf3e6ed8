"""The questions at the end of each chapter, and their answers, which open without a mouse."""

import re
from pathlib import Path

import nbformat
from chapters import LESSONS
from pages import HTML, built

ROOT = Path(__file__).resolve().parents[3]


def test_every_chapter_ends_with_questions_and_folded_answers():
    for path in LESSONS:
        last = nbformat.read(path, as_version=4).cells[-1].source
        assert last.startswith("## Do you know it?\n"), path.name
        questions = re.findall(r"^\*\*(\d)\.\*\* .+$", last, flags=re.MULTILINE)
        answers = re.findall(r"^```\{dropdown\} Answer to (\d)\n\S", last, flags=re.MULTILINE)
        assert 4 <= len(questions) <= 5, path.name
        assert questions == answers, path.name


@built
def test_an_answer_opens_by_keyboard_and_says_so(browser):
    """A native element: what assistive technology reads of it is the browser's own doing."""
    browser.open((HTML / "notebooks" / "04_kalman.html").as_uri())
    answers = "[...document.querySelectorAll('#do-you-know-it details')]"
    assert browser.evaluate(f"{answers}.length") >= 4
    assert browser.evaluate(f"{answers}.every((one) => one.firstElementChild.tagName == 'SUMMARY')")
    browser.evaluate(f"{answers}[0].querySelector('summary').focus(), null")
    opened = f"{answers}.map((one) => one.open).indexOf(true)"
    for key, first_open in (("Enter", 0), ("Enter", -1), ("Tab", -1), (" ", 1)):
        browser.press(key)
        assert browser.evaluate(opened) == first_open
