"""Whatever is handed in has a row and earns what it is worth; a class is not at the mercy of a file."""

import csv
import os
import shutil
import signal
from pathlib import Path

import pytest
from processes import ended, started, wait_until
from wronghandins import (
    CONFINED,
    FORGING,
    NOTEBOOKS,
    POINTS,
    PROGRAMS,
    RIGHT,
    alive,
    hand_in,
    notebook,
)

from workbench.cli import main
from workbench.course import sandbox, submissions
from workbench.course.exercises import exercise
from workbench.course.running import Found
from workbench.course.submissions import cells_of, check_class, handed_in
from workbench.provenance import code_hash

VALUES = "answer_04_1 = {'gain': 0.444, 'mean': 6.889, 'variance': 0.444}"


def rows(folder):
    with (folder / "points.csv").open(encoding="utf-8") as file:
        return {row["student"]: row for row in csv.DictReader(file)}


def points(folder):
    return {name: int(row["points"]) for name, row in rows(folder).items()}


def class_of(folder, **programs):
    for name, program in programs.items():
        hand_in(folder, name, program.encode(), "04_kalman.py")
    check_class(folder, folder / "points.csv")
    return points(folder)


@pytest.mark.parametrize(
    ("name", "content", "readable"),
    [
        *(pytest.param("04.ipynb", *one, id=kind) for kind, one in NOTEBOOKS.items()),
        *(pytest.param("04.py", *one, id=kind) for kind, one in PROGRAMS.items()),
    ],
)
def test_a_file_is_read_or_named(tmp_path, name, content, readable):
    (tmp_path / name).write_bytes(content)
    if readable:
        assert any("filter_number" in source for _, source in cells_of(tmp_path / name))
    else:
        with pytest.raises(ValueError, match=rf"{name}: is no (notebook|text) that can be read"):
            cells_of(tmp_path / name)


def test_every_way_of_handing_in_has_a_row(tmp_path):
    right = NOTEBOOKS["plain"][0]
    moodle = "Ada Lovelace_12345_assignsubmission_file_"
    hand_in(tmp_path, moodle, right)
    (tmp_path / "smithjohn_LATE_12345_67890_04_kalman-2.ipynb").write_bytes(right)
    (tmp_path / "leejo_11_67891_04_kalman.ipynb").write_bytes(right)
    (tmp_path / "leejo_12_67892_04_kalman.ipynb").write_bytes(right)
    (tmp_path / "essay.ipynb").write_bytes(right)
    (tmp_path / "04_loose.py").write_text(RIGHT)
    hand_in(tmp_path, "two", right)
    hand_in(tmp_path, "two", right, "04_kalman-Copy1.ipynb")
    (tmp_path / "none").mkdir()
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / "04_kalman.ipynb").symlink_to(tmp_path / "two" / "04_kalman.ipynb")
    (tmp_path / "folder").symlink_to(tmp_path / "two")
    hand_in(tmp_path, "deep", right, "readme.txt")
    hand_in(tmp_path / "deep", "week4", right)
    os.mkfifo(tmp_path / "none" / "04_pipe.py")
    found = {it.student: it for it in handed_in(tmp_path, tmp_path / "points.csv")}
    readable = {name for name, it in found.items() if it.wrong is None}
    assert readable == {moodle, "smithjohn", "leejo_11", "leejo_12", "04_loose", "deep"}
    reasons = {
        "essay": "its name does not say the chapter",
        "two": "04_kalman-Copy1.ipynb, 04_kalman.ipynb cannot be read: these are 2 files",
        "none": "04_pipe.py cannot be read: it is no file",
        "link": "04_kalman.ipynb cannot be read: it is a link",
        "folder": "folder cannot be read: it is a link",
    }
    assert set(found) - readable == set(reasons)
    for name, reason in reasons.items():
        assert reason in found[name].wrong
    assert found["smithjohn"].beside is None  # what lies beside it is others'


def test_a_folder_that_cannot_be_walked_has_a_row(tmp_path, monkeypatch):
    def endless(folder, pattern):
        return endless(folder, pattern)

    hand_in(tmp_path, "deep", b"")
    monkeypatch.setattr(Path, "rglob", endless)
    (found,) = handed_in(tmp_path, tmp_path / "points.csv")
    assert (found.student, found.wrong) == ("deep", "deep cannot be read")


def test_a_class_goes_on_whatever_one_file_is(tmp_path):
    hand_in(tmp_path, "=cmd|calc", b"")
    hand_in(tmp_path, "bob\x1b[31m", b"[" * 100_000)
    assert class_of(tmp_path, ada=RIGHT) == {"ada": POINTS, "'=cmd|calc": 0, "bob": 0}
    says = rows(tmp_path)["bob"]["said"]
    assert says == "04_kalman.ipynb cannot be read: is no notebook that can be read"


@pytest.mark.slow
@CONFINED
@pytest.mark.parametrize(
    "names",
    [
        ["one right case, then an end", "a report from a case", "takes the exercise"],
        pytest.param(list(FORGING), marks=pytest.mark.heavy),
    ],
    ids=["sample", "all"],
)
def test_no_program_earns_what_it_has_not_answered(tmp_path, names):
    forging = {name: FORGING[name].replace("CLASS", str(tmp_path)) for name in names}
    assert class_of(tmp_path, ada=RIGHT, **forging) == {"ada": POINTS, **dict.fromkeys(names, 0)}
    text = (tmp_path / "points.csv").read_text(encoding="utf-8")
    assert len(text) < 20_000 * (1 + len(names))
    assert "\x1b" not in text
    assert (tmp_path / "ada" / "04_kalman.py").read_text() == RIGHT


@pytest.mark.slow
def test_without_bwrap_right_answers_count_and_the_advice_is_one_line(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(sandbox, "works", lambda: False)
    hand_in(tmp_path, "ada", RIGHT.encode(), "04_kalman.py")
    hand_in(tmp_path, "bob", FORGING["a report from a case"].encode(), "04_kalman.py")
    assert main(["check", "--all", str(tmp_path)]) == 0
    assert points(tmp_path) == {"ada": POINTS, "bob": 0}
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if "podman run" in line] == [sandbox.ADVICE]


@pytest.mark.slow
@CONFINED
def test_asked_to_end_the_command_leaves_no_process(tmp_path):
    sleeps = b"import subprocess\nsubprocess.run(['/bin/sleep', '87654'])\n"
    hand_in(tmp_path, "ada", sleeps, "04.py")
    command = started(f"check --all {tmp_path}")
    wait_until(lambda: alive("87654"))
    command.send_signal(signal.SIGTERM)
    assert ended(command)[0] == 128 + signal.SIGTERM
    wait_until(lambda: not alive("87654"))


def test_what_is_not_there_is_said_with_the_reason():
    asked = exercise("04.2")
    for says, found in {
        "filter_number is not there.": Found(),
        "filter_number is not there, because cell 2 hangs.": Found(stuck="cell 2 hangs"),
        "filter_number is not there; cell 1 raises NameError: x.": Found(
            raised={"cell 1": "NameError: x"}
        ),
    }.items():
        verdict = submissions.verdict_of(asked, found)
        assert (verdict.says, verdict.points, verdict.of) == (says, 0, asked.points)


def test_a_notebook_is_checked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    wrong = "def filter_number(*a): return 3"
    Path("04_kalman.ipynb").write_text(notebook("%matplotlib inline\n1 / 0", VALUES, wrong))
    assert main(["check", "04"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "04.1 right: gain, mean, variance are right."
    assert lines[1].startswith("04.2 not yet: filter_number(")
    assert "kalman_step is not there; cell 1 raises ZeroDivisionError: division by z" in lines[2]
    assert lines[-1].startswith("2 of ")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["04"], "expected one file 04*.ipynb or 04*.py, found none"),
        (["99"], "expected one of"),
        (["04", "nowhere.ipynb"], "nowhere.ipynb: there is no such file"),
        (["04", "broken.ipynb"], "broken.ipynb: is no notebook that can be read"),
        ([], "expected a chapter"),
        (["--all", "nowhere"], "nowhere: expected a folder"),
        (["--all", "class"], "class: no folder in it has a file like 04_kalman.ipynb"),
    ],
)
def test_a_mistake_of_the_caller_is_one_line(tmp_path, monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(tmp_path)
    Path("broken.ipynb").write_text("{")
    Path("class", "ada").mkdir(parents=True)
    Path("class", "ada", "notes.txt").touch()
    assert main(["check", *arguments]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said


@pytest.mark.parametrize(
    ("line", "is_one"),
    [
        ('{"student": "a", "chapter": "04", "hash": "x", "verdicts": []}', True),
        ('{"student": "a", "chapter": "04", "hash": "x"}', False),
        ('{"student": "a", "chap', False),
        ("4", False),
    ],
)
def test_a_kept_line_that_is_damaged_is_none(line, is_one):
    assert submissions.is_line(0, line) is is_one


def test_a_class_is_checked_once_and_anew_when_its_exercises_have_changed(tmp_path, monkeypatch):
    asked = []
    checked = submissions._checked

    def counted(chapter, path, beside):
        asked.append(path.parent.name)
        return checked(chapter, path, beside)

    def with_another_kalman(module):
        """What `code_hash` would give if somebody had changed the exercises of chapter 4."""
        return "another" if module.endswith(".exercises.kalman") else code_hash(module)

    monkeypatch.setattr(submissions, "_checked", counted)
    assert class_of(tmp_path, ada=VALUES, bob="answer_04_1 = {'gain': 0.5}") == {"ada": 2, "bob": 0}
    shutil.copytree(tmp_path / "ada", tmp_path / "eve")
    assert class_of(tmp_path) == {"ada": 2, "bob": 0, "eve": 2}
    assert asked == ["ada", "bob", "eve"]
    row = rows(tmp_path)["ada"]
    assert [row["04.1"], row["04.2"]] == ["2", "0"]
    monkeypatch.setattr(submissions, "code_hash", with_another_kalman)
    monkeypatch.setattr(submissions, "_checked", lambda chapter, *_: asked.append(chapter) or [])
    class_of(tmp_path)
    assert asked[3:] == ["04"] * 3
