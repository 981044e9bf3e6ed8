"""Files that grow by whole lines, and the lock that keeps a second process out."""

import errno
import os
import signal
import threading
from pathlib import Path

import pytest
from processes import ended, started, wait_until

from trinolab.files import journal, limits
from trinolab.files.journal import Journal, locked, sole_writer

pytestmark = pytest.mark.skipif(journal.fcntl is None, reason="a system without locks of files")
BUSY = "another process works on it"
# Writes "a", leaves "b" unfinished, takes the lock of "new", says so, and waits for its end.
HOLDS = """
import time
from pathlib import Path
from trinolab.files.journal import Journal, sole_writer
lines = Journal(Path("lines"), "head\\n", lambda number, line: True)
lines.add_line("a")
with lines.path.open("ab") as unfinished, sole_writer("new"):
    unfinished.write(b"b")
    Path("ready").touch()
    while True:
        time.sleep(0.01)
"""


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "lines"


def opened(path, head="head\n", is_line=lambda number, line: line == str(number)):
    return Journal(path, head, is_line)


def refused(path, what=locked):
    with pytest.raises(ValueError, match=f"{path.name}: {BUSY}$"), what(path):
        pass


@pytest.mark.parametrize(
    ("text", "left"),
    [
        (b"", 0),
        (b"head\n", 0),
        (b"head\n0\n1\n", 2),
        (b"head\n0\n1", 1),
        (b"head\n0\n2\n1\n", 1),
        (b"head\n\xff\n0\n", 0),
        (b"head\n0\n\n1\n", 1),
        (b"other\n0\n", 0),
        (b"hea", 0),
    ],
)
def test_whole_lines_are_taken_up_and_the_rest_is_cut_off(path, text, left):
    path.write_bytes(text)
    with opened(path) as lines:
        assert lines.lines() == ["0", "1"][:left]
        assert path.read_text() == "".join(f"{line}\n" for line in ["head", "0", "1"][: left + 1])


def test_lines_in_any_script_are_counted_in_bytes(path):
    path.write_text("Kopf ä\nμ\n°\nabc", encoding="utf-8")
    with opened(path, "Kopf ä\n", lambda number, line: line in "μ°") as lines:
        assert lines.lines() == ["μ", "°"]
        lines.add_line("°")
    assert path.read_text(encoding="utf-8") == "Kopf ä\nμ\n°\n°\n"


def test_a_second_one_is_refused_until_the_first_one_is_closed(path):
    with opened(path) as first:
        first.add_line("0")
        refused(path, lambda path: opened(path, "another head\n"))
        assert first.lines() == ["0"]
    with opened(path) as second:
        assert second.lines() == ["0"]


def test_one_writes_at_a_time_and_the_lock_is_gone_afterwards(tmp_path):
    (tmp_path / ".new.lock").touch()  # of a process that was killed
    with sole_writer(tmp_path / "new"):
        refused(tmp_path / "new", sole_writer)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_locked_and_left_as_it_was(tmp_path):
    (tmp_path / "f").mkdir()
    with locked(tmp_path / "f"):
        refused(tmp_path / "f")
        assert list((tmp_path / "f").iterdir()) == []


def test_a_copy_of_the_process_does_not_hold_what_was_closed(path):
    lines = opened(path)
    gate, go = os.pipe()
    if not (child := os.fork()):
        os.close(go)
        os.read(gate, 1)  # until the test ends
        os._exit(0)
    try:
        lines.close()
        opened(path).close()
    finally:
        os.close(go)
        os.close(gate)
        os.waitpid(child, 0)


def test_a_file_that_was_removed_before_it_is_locked_is_made_anew(path, monkeypatch):
    first = opened(path)
    real = journal.fcntl.flock

    def late(held, how):
        """The first one is done just before the second one locks."""
        monkeypatch.setattr(journal.fcntl, "flock", real)
        first.remove()
        real(held, how)

    monkeypatch.setattr(journal.fcntl, "flock", late)
    with opened(path) as second:
        second.add_line("0")
        assert path.read_text() == "head\n0\n"
        refused(path)


def test_who_waits_has_it_alone_when_the_other_lets_go(path):
    order = []

    def wait():
        with locked(path, wait=True):
            refused(path)
            order.append("second")

    thread = threading.Thread(target=wait)
    with locked(path, wait=True):
        thread.start()
        refused(path)
        order.append("first")
    thread.join()
    assert order == ["first", "second"]


def test_a_process_that_is_killed_lets_go(path):
    with started("", HOLDS) as process:
        wait_until((path.parent / "ready").exists, process)
        refused(path)
        refused(path.with_name("new"), sole_writer)
        process.send_signal(signal.SIGKILL)
        ended(process)
    with sole_writer("new"), opened(path, is_line=lambda number, line: True) as lines:
        assert lines.lines() == ["a"]
    assert {path.name for path in Path().iterdir()} == {"lines", "ready"}


def test_what_cannot_be_opened_is_named(tmp_path):
    nowhere = tmp_path / "no" / "lines"
    with pytest.raises(ValueError, match="no/lines: cannot be written"), locked(nowhere):
        pass
    with pytest.raises(ValueError, match="no/lines: no such folder"):
        opened(nowhere)


def test_rows_that_are_kept_are_no_longer_than_a_table(path, monkeypatch):
    with opened(path) as rows:
        rows.add_line("x" * 100)
    monkeypatch.setattr(limits, "TABLE_BYTES", 50)
    with pytest.raises(ValueError, match=r"lines: 0\.0 MiB, expected at most 0"):
        opened(path)


def test_without_locks_the_lines_are_kept_all_the_same(path, monkeypatch):
    def none(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    for name, value in (("fcntl.flock", none), ("fcntl", None)):
        monkeypatch.setattr(f"trinolab.files.journal.{name}", value)
        with opened(path) as lines:
            lines.add_line("0")
        with opened(path) as lines:
            assert lines.lines() == ["0"]
            lines.remove()
        assert not path.exists()


def test_a_full_disk_is_named_and_leaves_no_file_without_lines(path):
    resource = pytest.importorskip("resource", reason="limits of a process are set as POSIX does")
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3, limit[1]))
        with pytest.raises(ValueError, match="lines: cannot be written"):
            opened(path)
        assert not path.exists()
        resource.setrlimit(resource.RLIMIT_FSIZE, (8, limit[1]))
        with opened(path) as lines:
            lines.add_line("0")
            with pytest.raises(ValueError, match="lines: cannot be written"):
                lines.add_line("1")
            assert lines.lines() == ["0"]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    with opened(path) as lines:
        lines.add_line("1")
        assert lines.lines() == ["0", "1"]
