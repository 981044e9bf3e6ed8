"""A student's code runs in a process of its own: whatever it does is seen, said and ended."""

import io
import json
import os
import socket
import subprocess
import sys
import time

import pytest
from processes import wait_until
from wayward import asks, changes, ends, hangs, waits, warns
from wronghandins import ATTEMPTS, CONFINED, RIGHT, alive, hand_in, notebook

from workbench.course import running, sandbox
from workbench.course.child import BEING_CHECKED, Call, executed
from workbench.course.plain import plain
from workbench.course.running import how, run_file, run_given
from workbench.course.submissions import cells_of


def test_whatever_a_function_does_is_seen_and_the_next_one_is_tried():
    functions = (ends, hangs, waits, asks, changes, warns, len)
    given = {function.__name__: function for function in functions}
    calls = [Call(name, [([1, 2],), ([3],)]) for name in given]
    found = run_given(given, calls, cpu_s=0.5, wait_s=3.0).outcomes
    assert found["ends"] == [{"stuck": "ends Python (exit code 3)"}]
    assert found["hangs"][0]["stuck"].startswith("does not end: it was stopped")
    assert found["waits"][0]["stuck"].startswith("does not end: it was stopped")
    assert found["asks"][0]["raised"].startswith("EOFError")
    assert [one["changed"] for one in found["changes"]] == [[0], [0]]
    assert not any(one["printed"] for one in found["warns"])
    assert [one["returned"] for one in found["len"]] == [plain(2), plain(1)]


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("time", "does not end: it was stopped after 9 s"),
        (-14, "does not end: it was stopped after 7 s"),
        (-24, "does not end: it was stopped after 5 s of computing"),
        ("memory", "was ended by the system: it may have asked for too much memory"),
        (-9, "was ended by the system: it may have asked for too much memory"),
        ("processes", "was ended: it has started more than 16 processes"),
        (3, "ends Python (exit code 3)"),
    ],
)
def test_how_a_process_ended_is_said_in_words(code, words):
    assert how(code, cpu_s=5.0, wait_s=7.0, enough_s=9.0) == words


def test_cells_run_one_after_the_other_without_their_magic(tmp_path, monkeypatch):
    """As in the process in which a student's file runs; a cell that raises is passed over."""
    monkeypatch.setenv(BEING_CHECKED, "")
    file = tmp_path / "04_kalman.ipynb"
    sources = [
        "%matplotlib inline\na = 1\n!ls",
        ["print('heard by nobody')\n", "b = a + 1\n"],
        "raise SystemExit",
        'c = a + b\nshare = (7\n% 4)\ntext = """\n%d of all\n!"""',
    ]
    file.write_text(notebook(*sources))
    answers = io.StringIO()
    namespace = executed(cells_of(file), answers)
    assert (namespace["b"], namespace["c"], namespace["share"]) == (2, 3, 3)
    assert namespace["text"] == "\n%d of all\n!"
    lines = [json.loads(line) for line in answers.getvalue().splitlines()]
    assert lines == [
        *(["at", f"cell {k}"] for k in (1, 2, 3)),
        ["raised", "cell 3", "SystemExit"],
        ["at", "cell 4"],
    ]


def test_a_file_that_raises_is_named_and_its_values_are_read():
    found = run_file([("04.py", "answer = 1\n1 / 0\n")], [], ["answer"])
    assert found.raised == {"04.py": "ZeroDivisionError: division by zero"}
    assert found.values == {"answer": plain(1)}


def test_a_file_that_never_ends_is_stopped():
    found = run_file([("04.py", "while True:\n    pass\n")], [], ["answer"], cells_s=1.0)
    assert found.stuck == "04.py does not end: it was stopped after 1 s of computing"


@pytest.mark.slow
@CONFINED
def test_a_heartbeat_does_not_extend_the_time_and_a_grandchild_does_not_survive():
    code = (
        "import subprocess, time, sys\n"
        "subprocess.Popen(['/bin/sleep', '98765'], start_new_session=True)\n"
        "while True:\n    print('{}', file=sys.__stdout__, flush=True)\n    time.sleep(0.05)\n"
    )
    found = run_file([("04.py", code)], [], ["a"], enough_s=8.0)
    assert found.stuck == "04.py does not end: it was stopped after 8 s"
    wait_until(lambda: not alive("98765"))


@pytest.mark.slow
@CONFINED
def test_a_confined_program_reaches_nothing_but_its_folder(tmp_path):
    hand_in(tmp_path, "ada", RIGHT.encode(), "04_kalman.py")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        code = ATTEMPTS.replace("CLASS", str(tmp_path)).replace("PORT", port)
        code = code.replace("PID", str(os.getpid())) + "open('own', 'w')\nown = os.listdir()"
        found = run_file([("04.py", code)], [], ["done", "own"])
    assert (found.raised, found.stuck) == ({}, None)
    assert found.values["done"] == plain([])
    assert "own" in found.values["own"]


def test_bwrap_that_is_not_there_or_fails_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert not sandbox.works.__wrapped__()
    (tmp_path / "bwrap").write_text("#!/bin/sh\nexit 1\n")
    (tmp_path / "bwrap").chmod(0o755)
    assert not sandbox.works.__wrapped__()


@pytest.mark.slow
def test_without_limits_of_the_system_a_function_runs_and_a_process_is_ended(tmp_path, monkeypatch):
    """As on Windows, which has no module `resource`."""
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['resource'] = None\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    found = run_given({"length": len}, [Call("length", [([1, 2],)])])
    assert [one["returned"] for one in found.outcomes["length"]] == [plain(2)]
    sleeps = [sys.executable, "-S", "-c", "import time; time.sleep(600)"]
    with subprocess.Popen(sleeps, start_new_session=True) as process:
        assert running._watched(process, time.monotonic() + 0.3) == "time"
        running._kill(process)
