"""What `make book` runs again: jobs that are stale or failed, and nothing else."""

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
import yaml
from makenotebook import glued, make_notebook

from workbench.pages import build
from workbench.studies.ground_truth import read_recording

ROOT = Path(__file__).resolve().parents[3]
KILLS_ITSELF = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"


@pytest.fixture
def book(tmp_path, monkeypatch):
    """A book of two chapters, in a folder of its own."""
    monkeypatch.setattr(build, "ROOT", tmp_path)
    for name in (
        *("EXECUTED", "MADE_FROM", "CACHE", "SCOREBOARD", "NEW_SCOREBOARD"),
        *("GENERATED", "SECONDS"),
    ):
        monkeypatch.setattr(build, name, tmp_path / "_build" / getattr(build, name).name)
    build.EXECUTED.mkdir(parents=True)
    (tmp_path / "notebooks").mkdir()
    (tmp_path / "_toc.yml").write_text(
        "{root: start, parts: [{chapters: [{file: notebooks/one}, {file: notebooks/two}]}]}"
    )
    for name, code in (
        ("one", "from trinolab import window"),
        ("two", "from trinolab import lens"),
    ):
        make_notebook(chapter(tmp_path, name), code, glued(b="a"))
    return tmp_path


def job(name, command="pass", needs=()):
    made_from = {} if name.startswith("recording ") else {"the package": name}
    return build.Job(name, [sys.executable, "-c", command], made_from, needs)


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
    assert {one.name: one.good for one in build.run_all(jobs)} == {"scoreboard": True, "one": False}
    out = capsys.readouterr().out
    assert re.search(r"^one: FAILED after \d+ s \([12] of 2\)$", out, re.MULTILINE)
    assert "what was wrong" in out
    assert build.SCOREBOARD.read_text() == "no\n"
    assert json.loads(build.MADE_FROM.read_text()) == {"scoreboard": {"the package": "scoreboard"}}
    assert json.loads(build.SECONDS.read_text()).keys() == {"scoreboard"}


def test_a_chapter_is_run_and_stored(book, capsys):
    path = chapter(book, "one")
    build.EXECUTED.rmdir()
    assert build.run_chapter(path) == 0
    stored = build.read_notebook(build.result_of("one"))
    assert any(cell.get("outputs") for cell in stored.cells)
    # the cells' times stay with it, and yet Jupyter Book knows it for the same notebook
    assert any("execution" in cell.metadata for cell in stored.cells)
    build.put_into_cache(build.result_of("one"))
    assert build.is_cached(path)
    make_notebook(path, "raise ValueError('a broken chapter')", glued(b="a"))
    assert build.run_chapter(path) == 1
    out = capsys.readouterr().out
    assert "raise ValueError('a broken chapter')" in out
    assert out.rstrip().endswith("ValueError: a broken chapter")


def test_a_chapter_whose_kernel_dies_says_so_in_a_line(book, capsys):
    path = make_notebook(chapter(book, "one"), "import os; os._exit(1)")
    assert build.run_chapter(path) == 1
    assert capsys.readouterr().out.startswith("one.ipynb: its kernel died; ")


def test_the_last_lines_say_what_failed(book, monkeypatch, capsys):
    monkeypatch.chdir(book)
    why = "print('[IPKernelApp] WARNING | no matter'); raise SystemExit('why')"
    jobs = [job("ledger"), job("one", why), job("two", KILLS_ITSELF)]
    monkeypatch.setattr(build, "stale_jobs", lambda: jobs)
    assert build.main() == 1
    lines = capsys.readouterr().out.splitlines()
    assert "why" in lines
    assert not any("no matter" in line for line in lines)
    assert any(line.startswith("two: ended by signal 9;") for line in lines)
    assert re.match("FAILED: (one, two|two, one)\\.", lines[-2])


def test_what_needs_a_recording_waits_for_it_and_what_needs_none_begins_beside_it(
    book, monkeypatch, capsys
):
    monkeypatch.setattr(build, "WORKERS", 2)
    monkeypatch.setattr(build, "keep", lambda job: None)
    jobs = [
        job("recording hard", "import time; time.sleep(1)"),
        job("one", needs=("recording hard",)),
        job("two"),
    ]
    ended = {one.name: one for one in build.run_all(jobs)}
    assert all(one.good for one in ended.values())
    assert ended["two"].start < ended["recording hard"].end <= ended["one"].start
    assert json.loads(build.SECONDS.read_text()).keys() == {"one", "two"}
    assert "recording hard: done after" in capsys.readouterr().out


def test_what_needs_a_recording_that_failed_is_not_run(book, capsys):
    jobs = [job("recording hard", "raise SystemExit('why')"), job("one", needs=("recording hard",))]
    assert [(one.name, one.good) for one in build.run_all(jobs)] == [("recording hard", False)]
    assert "one: not run, it needs recording hard" in capsys.readouterr().out.splitlines()


def test_the_longest_way_to_the_end_comes_first(book, monkeypatch, capsys):
    monkeypatch.setattr(build, "WORKERS", 1)
    monkeypatch.setattr(build, "keep", lambda job: None)
    monkeypatch.setattr(build, "EXPECTED_S", {"recording calm": 5.0})
    build.SECONDS.write_text('{"long": 40, "short": 2}')
    jobs = [job("recording calm"), job("short"), job("new"), job("long", needs=("recording calm",))]
    ways = build.ways(jobs)
    assert ways == {"recording calm": 45.0, "short": 2, "new": build.USUAL_S, "long": 40}
    names = ["recording calm", "long", "new", "short"]
    assert [one.name for one in build.run_all(jobs)] == names


def test_a_build_says_what_decided_how_long_it_took(monkeypatch):
    monkeypatch.setattr(build, "WORKERS", 2)
    ended = [
        build.Ended("recording hard", 0.0, 50.0, True),
        build.Ended("one", 0.1, 20.0, True),
        build.Ended("two", 20.1, 40.0, True),
        build.Ended("three", 50.2, 80.0, True),
    ]
    assert [one.name for one in build.critical_path(ended)] == ["recording hard", "three"]
    assert [one.name for one in build.critical_path(ended[1:3])] == ["one", "two"]
    _, shares = build.times_said(ended, build.Ended("the pages", 80.0, 170.0, True))
    assert "4 jobs took 80 s" in shares
    assert "25%" in shares


def test_a_label_makes_the_ledger_stale_and_other_text_does_not(book):
    path = chapter(book, "one")
    notebook = build.read_notebook(path)
    before = build.stale_jobs()[1].made_from
    assert before["labels"] == ""
    notebook.cells.append(nbformat.v4.new_markdown_cell("Text.\n\n(eq-20)=\n$$ x \\tag{20} $$"))
    nbformat.write(notebook, path)
    assert build.labels() == ["eq-20"]
    assert build.stale_jobs()[1].made_from == {**before, "labels": "eq-20"}


def test_the_recordings_are_those_that_the_chapters_read():
    text = "".join(path.read_text("utf-8") for path in ROOT.glob("notebooks/*.ipynb"))
    named = set(re.findall(r'read_recording\(\\"(\w+)\\"', text))
    assert named == set(build.RECORDINGS)
    assert inspect.signature(read_recording).parameters["seconds"].default == build.RECORDED_S
    recordings = {f"recording {name}" for name in (*build.RECORDINGS, build.TASK)}
    assert build.EXPECTED_S.keys() <= recordings | {path.stem for path in build.chapters()}


def test_a_chapter_needs_the_recordings_that_its_code_reads():
    found = {path.stem: build.recordings_of(path) for path in build.chapters()}
    assert found["01_structure"] == ["hard"]
    assert found["04_kalman"] == found["06_matching"] == found["recordings"] == ["calm", "hard"]
    assert found["11_master_slave"] == found["11b_delay"] == ["task"]
    assert found["02_workspace"] == found["12b_wall"] == found["gallery"] == []


def test_the_pages_are_stale_when_a_docstring_has_changed(book):
    (book / "trinolab").mkdir()
    (book / "trinolab" / "pose.py").write_text('"""A pose."""')
    before = build.pages_made_from()
    assert build.pages_made_from() == before
    (book / "trinolab" / "pose.py").write_text('"""The pose."""')
    assert build.pages_made_from() != before


@pytest.fixture
def small_book(tmp_path):
    """Eight pages with the configuration of the book."""
    config = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
    config["html"].pop("favicon")
    config["sphinx"]["config"]["html_css_files"] = []
    names = [f"book/page{k}" for k in range(8)]
    toc = {"format": "jb-book", "root": names[0], "chapters": [{"file": one} for one in names[1:]]}
    for name, said in (("_config.yml", config), ("_toc.yml", toc)):
        (tmp_path / name).write_text(yaml.safe_dump(said, sort_keys=False))
    for folder in ("book/_static", "book/_templates"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "book" / "references.bib").touch()
    for name in names:
        (tmp_path / f"{name}.md").write_text("# A page\n\nText.\n")
    return tmp_path


@pytest.mark.heavy
def test_a_warning_of_any_page_fails_the_build_in_several_processes(small_book):
    for page in ("page2", "page6"):
        (small_book / "book" / f"{page}.md").write_text("# A page\n\n{ref}`nowhere`\n")
    (small_book / "book" / "page4.md").write_text("# A page\n\n```{nothing}\n```\n")
    command = [*build.BUILD_COMMAND, "--pages", str(small_book)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count("undefined label: 'nowhere'") == 2
    assert "Unknown directive type: 'nothing'" in done.stderr
