"""The questions at the end of each chapter, and their answers, which open without a mouse."""

import re
from pathlib import Path

import nbformat
from chapters import LESSONS

ROOT = Path(__file__).resolve().parents[3]


def test_every_chapter_ends_with_questions_and_folded_answers():
    for path in LESSONS:
        last = nbformat.read(path, as_version=4).cells[-1].source
        assert last.startswith("## Do you know it?\n"), path.name
        questions = re.findall(r"^\*\*(\d)\.\*\* .+$", last, flags=re.MULTILINE)
        answers = re.findall(r"^```\{dropdown\} Answer to (\d)\n\S", last, flags=re.MULTILINE)
        assert 3 <= len(questions) <= 5, path.name
        assert questions == answers, path.name
