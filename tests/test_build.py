"""What `make book` runs again: jobs that are stale or failed, and nothing else."""

import json
import sys

import build
import nbformat
import pytest
from makenotebook import glued, make_notebook


@pytest.fixture
def book(tmp_path, monkeypatch):
    """A book of two chapters, in a folder of its own."""
    for name, path in {
        "ROOT": "",
        "EXECUTED": "_build/executed",
        "MADE_FROM": "_build/made_from.json",
        "CACHE": "_build/.jupyter_cache",
        "SCOREBOARD": "_build/scoreboard.csv",
        "NEW_SCOREBOARD": "_build/scoreboard.new.csv",
        "GENERATED": "_build/generated",
    }.items():
        monkeypatch.setattr(build, name, tmp_path / path)
    build.EXECUTED.mkdir(parents=True)
    (tmp_path / "notebooks").mkdir()
    (tmp_path / "_toc.yml").write_text(
        "parts: [{chapters: [{file: notebooks/one}, {file: notebooks/two}]}]"
    )
    for name, code in (
        ("one", "from trinolab import window"),
        ("two", "from trinolab import lens"),
    ):
        make_notebook(tmp_path / "notebooks" / f"{name}.ipynb", code, glued(b="a"))
    return tmp_path


def job(name, command="pass"):
    return build.Job(name, [sys.executable, "-c", command], {"the package": name})


def chapter(book, name):
    return book / "notebooks" / f"{name}.ipynb"


def pretend_to_run(book, name):
    """Leave what an execution leaves."""
    notebook = build.read_notebook(chapter(book, name))
    for count, cell in enumerate(notebook.cells, 1):
        cell.execution_count = count
    nbformat.write(notebook, build.result_of(name))


def test_what_is_finished_is_not_run_again_until_something_has_changed(book, monkeypatch, capsys):
    stale = build.stale_jobs()
    assert [one.name for one in stale] == ["scoreboard", "ledger", "one", "two"]
    for one in stale[2:]:
        pretend_to_run(book, one.name)
        build.keep(one)
    assert [one.name for one in build.stale_jobs()] == ["scoreboard", "ledger"]
    assert "one: unchanged\ntwo: unchanged\n" in capsys.readouterr().out
    assert build.executed(chapter(book, "one")) == build.result_of("one")
    assert build.is_cached(chapter(book, "one"))
    text = chapter(book, "one").read_text()
    chapter(book, "one").write_text(text.replace("window", "rigid"))
    assert [one.name for one in build.stale_jobs()] == ["scoreboard", "ledger", "one"]
    assert build.executed(chapter(book, "one")) is None
    chapter(book, "one").write_text(text)
    monkeypatch.setenv("TRINOLAB_DATA", "elsewhere")
    assert len(build.stale_jobs()) == 4


def test_a_job_that_fails_is_named_and_the_others_are_kept(book, capsys):
    jobs = [
        job(
            "scoreboard",
            f"from pathlib import Path; Path({str(build.NEW_SCOREBOARD)!r}).write_text('no\\n')",
        ),
        job("one", "raise SystemExit('what was wrong')"),
    ]
    assert build.run_all(jobs) == ["one"]
    out = capsys.readouterr().out
    assert "one: FAILED after" in out
    assert "what was wrong" in out
    assert build.SCOREBOARD.read_text() == "no\n"
    assert json.loads(build.MADE_FROM.read_text()) == {"scoreboard": {"the package": "scoreboard"}}


def test_a_chapter_is_run_and_stored(book, capsys):
    path = chapter(book, "one")
    assert build.run_chapter(path) == 0
    stored = build.read_notebook(build.result_of("one"))
    assert any(cell.get("outputs") for cell in stored.cells)
    make_notebook(path, "raise ValueError('a broken chapter')", glued(b="a"))
    assert build.run_chapter(path) == 1
    assert "a broken chapter" in capsys.readouterr().out


def test_the_pages_are_stale_when_a_docstring_has_changed(book):
    (book / "trinolab").mkdir()
    (book / "trinolab" / "pose.py").write_text('"""A pose."""')
    before = build.pages_made_from()
    assert build.pages_made_from() == before
    (book / "trinolab" / "pose.py").write_text('"""The pose."""')
    assert build.pages_made_from() != before
