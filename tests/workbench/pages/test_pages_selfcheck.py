"""The questions at the end of each chapter, and their answers, which open without a mouse."""

import re
from pathlib import Path

import nbformat
import pytest
from chapters import LESSONS

from workbench.pages.browser import CHROMIUM, Browser

ROOT = Path(__file__).resolve().parents[3]
HTML = ROOT / "_build" / "html"


def test_every_chapter_ends_with_questions_and_folded_answers():
    for path in LESSONS:
        last = nbformat.read(path, as_version=4).cells[-1].source
        assert last.startswith("## Do you know it?\n"), path.name
        questions = re.findall(r"^\*\*(\d)\.\*\* (.+)$", last, flags=re.MULTILINE)
        answers = re.findall(r"^```\{dropdown\} Answer to (\d)\n\S", last, flags=re.MULTILINE)
        assert 4 <= len(questions) <= 5, path.name
        assert [number for number, _ in questions] == answers, path.name
        for _, question in questions:
            # what begins so can be answered by yes or no
            assert not re.match(r"(Is|Are|Does|Do|Can|Will|Has|Have) ", question), question


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is missing (Debian package: chromium)")
@pytest.mark.skipif(
    not (HTML / "index.html").exists(), reason="no built pages: run make book first"
)
def test_an_answer_opens_by_keyboard_and_says_so(tmp_path):
    """A native element: what assistive technology reads of it is the browser's own doing."""
    browser = Browser(tmp_path)
    browser.open((HTML / "notebooks" / "04_kalman.html").as_uri())
    answers = "[...document.querySelectorAll('#do-you-know-it details')]"
    assert browser.evaluate(f"{answers}.length") >= 4
    assert browser.evaluate(f"{answers}.every((one) => !one.open)")
    assert browser.evaluate(f"{answers}.every((one) => one.firstElementChild.tagName == 'SUMMARY')")
    browser.evaluate(f"{answers}[0].querySelector('summary').focus(), null")
    browser.press("Enter")
    assert browser.evaluate(f"{answers}.map((one) => one.open).indexOf(true)") == 0
    browser.press("Enter")
    assert browser.evaluate(f"{answers}.every((one) => !one.open)")
    browser.press("Tab")
    browser.press(" ")
    assert browser.evaluate(f"{answers}.map((one) => one.open).lastIndexOf(true)") == 1
    browser.close()
