"""Files that ask for far more than they are long: each is refused in one line, by a command that has
500 MB. And the budget is one, for all readers.
"""

import shutil

import numpy as np
import pytest
from bombs import BOMBS, MIB, Ran, run_limited
from commandfuzz import READ, Attempt, attempts, finding, make_bag
from healthy import BOARDS, EVALUATE, MEASURE, TRACK, VIDEOS, make_healthy

resource = pytest.importorskip("resource", reason="limits of a process are set as POSIX does")

MOST = 500 * MIB  # of memory that a command may need to refuse a file
COUNT = 3


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    root = tmp_path_factory.mktemp("budget")
    make_healthy(root, COUNT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        make_bag(root)
    return root


@pytest.fixture
def folder(healthy, tmp_path, monkeypatch):
    """The working folder: a copy of the healthy one."""
    shutil.copytree(healthy, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


FEW = ("a pipe for an image", "10^5 dots", "a PNG of 900 megapixels", "an MCAP that lies")


@pytest.mark.parametrize(
    "name", [name if name in FEW else pytest.param(name, marks=pytest.mark.slow) for name in BOMBS]
)
def test_a_bomb_is_refused_in_one_line_and_with_little_memory(folder, name):
    bomb = BOMBS[name]
    if "MCAP" in name:
        pytest.importorskip("rosbags", reason="extra ros is not installed")
    (folder / bomb.name).unlink(missing_ok=True)
    bomb.make(folder / bomb.name)
    ran = run_limited(bomb.line)
    assert (ran.code, len(ran.lines)) == (2, 1), ran.lines
    assert ran.lines[0].startswith(f"trinolab {bomb.line.split()[0]}: {bomb.said}")
    assert len(ran.lines[0]) < 1200  # whatever the file has
    assert ran.peak < MOST


@pytest.mark.heavy
def test_whole_commands_on_wrong_files_answer_or_say_one_line(healthy, tmp_path):
    """A sample of what `make verify` has by the hundred."""
    for attempt in attempts(np.random.default_rng(0), healthy, tmp_path / "work", 6):
        assert finding(attempt) == "", attempt


@pytest.mark.parametrize(
    ("code", "lines", "found"),
    [
        (0, [], ""),
        (1, ["3 of 3 lost"], ""),
        (2, ["said once", "trinolab evaluate: x: no"], ""),
        (2, ["x: no"], "no line of what is wrong: x: no"),
        (1, ["Traceback (most recent call last):", "KeyError: 1"], "traceback: KeyError: 1"),
        (-9, [], "exit code -9"),
        (2, ["trinolab evaluate: not enough memory (x)"], "memory: trinolab evaluate: not enough"),
    ],
)
def test_what_a_command_must_not_do_is_a_finding(code, lines, found):
    ran = Ran(code, lines, 0, 0.0)
    said = finding(Attempt(next(iter(READ)), "x", "other bytes", ran))
    assert said.startswith(found)
    assert bool(said) == bool(found)


@pytest.mark.slow
@pytest.mark.parametrize("line", [TRACK, VIDEOS, MEASURE, EVALUATE, BOARDS])
def test_with_as_little_memory_the_commands_do_their_work(folder, line):
    assert run_limited(line).code == 0
