"""A class is not at the mercy of one file: whatever is handed in has a row, and earns what it is worth."""

import csv
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import ended, started, wait_until
from wronghandins import ATTEMPTS, FORGING, NOTEBOOKS, POINTS, PROGRAMS, RIGHT, alive, hand_in

from workbench.cli import main
from workbench.course import child, running, sandbox
from workbench.course.child import Call
from workbench.course.exercises import of_chapter
from workbench.course.plain import plain
from workbench.course.submissions import cells_of, check_class, handed_in

CONFINED = pytest.mark.skipif(not sandbox.works(), reason="bwrap does not work here")


def rows(folder):
    with (folder / "points.csv").open(encoding="utf-8") as file:
        return {row["student"]: row for row in csv.DictReader(file)}


@pytest.mark.parametrize("kind", NOTEBOOKS)
def test_a_notebook_is_read_or_named(tmp_path, kind):
    content, readable = NOTEBOOKS[kind]
    path = tmp_path / "04_kalman.ipynb"
    path.write_bytes(content)
    if readable:
        assert any("filter_number" in source for _, source in cells_of(path))
    else:
        with pytest.raises(ValueError, match="is no notebook that can be read"):
            cells_of(path)


@pytest.mark.parametrize("kind", PROGRAMS)
def test_a_program_is_read_or_named(tmp_path, kind):
    content, readable = PROGRAMS[kind]
    path = tmp_path / "04_kalman.py"
    path.write_bytes(content)
    if readable:
        compile(cells_of(path)[0][1], "04_kalman.py", "exec")
    else:
        with pytest.raises(ValueError, match="is no text that can be read"):
            cells_of(path)


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
    (tmp_path / "deep" / "week4").mkdir()
    (tmp_path / "deep" / "week4" / "04_kalman.ipynb").write_bytes(right)
    os.mkfifo(tmp_path / "none" / "04_pipe.py")
    found = {it.student: it for it in handed_in(tmp_path, tmp_path / "points.csv")}
    readable = {name for name, it in found.items() if it.wrong is None}
    assert readable == {moodle, "smithjohn", "leejo_11", "leejo_12", "04_loose", "deep"}
    says = {name: it.wrong for name, it in found.items() if it.wrong is not None}
    assert says == {
        "essay": "essay.ipynb cannot be read: its name does not say the chapter, as 04_kalman.ipynb does",
        "two": "04_kalman-Copy1.ipynb, 04_kalman.ipynb cannot be read: these are 2 files, and one "
        "counts; remove the rest",
        "none": "04_pipe.py cannot be read: it is no file",
        "link": "04_kalman.ipynb cannot be read: it is a link",
        "folder": "folder cannot be read: it is a link",
    }
    assert found["smithjohn"].beside is None  # what lies beside it is others'


def endless(folder, pattern):
    return endless(folder, pattern)


def test_a_folder_that_cannot_be_walked_has_a_row(tmp_path, monkeypatch):
    hand_in(tmp_path, "deep", b"")
    monkeypatch.setattr(Path, "rglob", endless)
    (found,) = handed_in(tmp_path, tmp_path / "points.csv")
    assert (found.student, found.wrong) == ("deep", "deep cannot be read")


def test_a_class_goes_on_whatever_one_file_is(tmp_path):
    hand_in(tmp_path, "ada", RIGHT.encode(), "04_kalman.py")
    hand_in(tmp_path, "=cmd|calc", b"")
    hand_in(tmp_path, "bob\x1b[31m", b"[" * 100_000)
    check_class(tmp_path, tmp_path / "points.csv")
    found = rows(tmp_path)
    assert {name: row["points"] for name, row in found.items()} == {
        "ada": str(POINTS),
        "'=cmd|calc": "0",
        "bob": "0",
    }
    assert found["bob"]["said"] == "04_kalman.ipynb cannot be read: is no notebook that can be read"


def points_of(folder, names):
    """The points of a student whose answers are right, and of programs that forge theirs."""
    hand_in(folder, "ada", RIGHT.encode(), "04_kalman.py")
    for name in names:
        program = FORGING[name].replace("CLASS", str(folder))
        hand_in(folder, name, program.encode(), "04_kalman.py")
    check_class(folder, folder / "points.csv")
    found = rows(folder)
    text = (folder / "points.csv").read_text(encoding="utf-8")
    assert len(text) < 20_000 * len(found)
    assert "\x1b" not in text
    assert (folder / "ada" / "04_kalman.py").read_text() == RIGHT
    return {name: int(row["points"]) for name, row in found.items()}


@pytest.mark.slow
@CONFINED
def test_no_program_earns_what_it_has_not_answered(tmp_path):
    """A sample; make verify runs all."""
    names = ["one right case, then an end", "a report from a case", "takes the exercise"]
    assert points_of(tmp_path, names) == {"ada": POINTS, **dict.fromkeys(names, 0)}


@pytest.mark.heavy
@CONFINED
def test_no_forging_program_earns_a_point_or_stops_the_class(tmp_path):
    assert points_of(tmp_path, FORGING) == {"ada": POINTS, **dict.fromkeys(FORGING, 0)}


@pytest.mark.slow
@CONFINED
def test_a_confined_program_reaches_nothing_but_its_folder(tmp_path):
    hand_in(tmp_path, "ada", RIGHT.encode(), "04_kalman.py")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        code = ATTEMPTS.replace("CLASS", str(tmp_path)).replace("PORT", port)
        code = code.replace("PID", str(os.getpid())) + "open('own', 'w')\nown = os.listdir()"
        found = running.run_file([("04.py", code)], [], ["done", "own"])
    assert (found.raised, found.stuck) == ({}, None)
    assert found.values["done"] == plain([])
    assert "own" in found.values["own"]


@pytest.mark.slow
def test_without_bwrap_right_answers_count_and_the_advice_is_one_line(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(sandbox, "works", lambda: False)
    hand_in(tmp_path, "ada", RIGHT.encode(), "04_kalman.py")
    hand_in(tmp_path, "bob", FORGING["a report from a case"].encode(), "04_kalman.py")
    assert main(["check", "--all", str(tmp_path)]) == 0
    assert {name: row["points"] for name, row in rows(tmp_path).items()} == {
        "ada": str(POINTS),
        "bob": "0",
    }
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if "podman run" in line] == [sandbox.ADVICE]


def test_bwrap_that_is_not_there_or_fails_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert not sandbox.works.__wrapped__()
    (tmp_path / "bwrap").write_text("#!/bin/sh\nexit 1\n")
    (tmp_path / "bwrap").chmod(0o755)
    assert not sandbox.works.__wrapped__()


@pytest.mark.slow
@CONFINED
def test_a_heartbeat_does_not_extend_the_time_and_a_grandchild_does_not_survive():
    code = (
        "import subprocess, time, sys\n"
        "subprocess.Popen(['/bin/sleep', '98765'], start_new_session=True)\n"
        "while True:\n    print('{}', file=sys.__stdout__, flush=True)\n    time.sleep(0.05)\n"
    )
    found = running.run_file([("04.py", code)], [], ["a"], enough_s=8.0)
    assert found.stuck == "04.py does not end: it was stopped after 8 s"
    wait_until(lambda: not alive("98765"))


@pytest.mark.slow
@CONFINED
def test_asked_to_end_the_command_leaves_no_process(tmp_path):
    hand_in(
        tmp_path, "ada", b"import subprocess\nsubprocess.run(['/bin/sleep', '87654'])\n", "04.py"
    )
    command = started(f"check --all {tmp_path}")
    wait_until(lambda: alive("87654"))
    command.send_signal(signal.SIGTERM)
    assert ended(command)[0] == 128 + signal.SIGTERM
    wait_until(lambda: not alive("87654"))


@pytest.mark.slow
def test_a_function_runs_without_limits_of_the_system(tmp_path, monkeypatch):
    """As on Windows, which has no module `resource`."""
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['resource'] = None\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    found = running.run_given({"length": len}, [Call("length", [([1, 2],)])])
    assert [one["returned"] for one in found.outcomes["length"]] == [plain(2)]


def test_a_process_that_never_ends_is_ended_without_limits_of_the_system():
    waits = [sys.executable, "-S", "-c", "import time; time.sleep(600)"]
    with subprocess.Popen(waits, start_new_session=True) as process:
        assert running._watched(process, time.monotonic() + 0.3) == "time"
        running._kill(process)


def test_the_end_of_a_process_is_no_answer():
    """Judged is what was answered, in all cases."""
    from workbench.course.grading import call_of, judge_outcomes

    asked = of_chapter("04")[1]
    outcomes = [child.outcome(asked.solution, case) for case in call_of(asked).cases]
    assert judge_outcomes(asked, outcomes).right
    for count in (0, 1, len(outcomes) - 1):
        verdict = judge_outcomes(asked, outcomes[:count])
        assert not verdict.right
        assert verdict.says == f"filter_number has answered in {count} of 6 cases."
