"""A command that works shows a sign of life on a terminal, and none elsewhere."""

import os
import pty
import re
import termios
from contextlib import suppress

from processes import ended, started, wait_until

# A command that computes for as long as the test likes: until there is a file.
WAITS = """
import sys, time
from pathlib import Path
from tqdm import tqdm
from workbench import cli
from workbench.cli import alive

alive.QUIET_S = 0.2
alive.TICK_S = 0.05

def until(name):
    while not Path(name).exists():
        time.sleep(0.01)

def work(arguments):
    until("one")
    with tqdm(total=3, unit="part") as bar:
        bar.update()
        until("two")
    cli.say("the answer")
    return 0

cli._RUN["evaluate"] = work
sys.exit(cli.main(["evaluate", "poses.csv", "truth.csv", "--handle", "coded"]))
"""


class Terminal:
    """What a process writes to a terminal of its own."""

    def __init__(self):
        self.master, self.slave = pty.openpty()
        termios.tcsetwinsize(self.slave, (24, 80))
        os.set_blocking(self.master, False)
        self.text = ""

    def shows(self, pattern, last):
        """The number in the last match of a pattern, if it is larger than the one before."""
        with suppress(BlockingIOError):
            self.text += os.read(self.master, 65536).decode()
        numbers = [int(found) for found in re.findall(pattern, self.text)]
        return numbers and numbers[-1] > last

    def close(self):
        os.close(self.master)
        os.close(self.slave)


def test_seconds_go_on_before_a_bar_and_within_its_step(tmp_path):
    terminal = Terminal()
    process = started("", WAITS, cwd=tmp_path, stderr=terminal.slave)
    try:
        wait_until(lambda: terminal.shows(r"at work, (\d+) s", 1), process)
        (tmp_path / "one").touch()
        wait_until(lambda: terminal.shows(r"1/3 \[00:0(\d)<", 0), process)
        (tmp_path / "two").touch()
        assert process.communicate()[0] == "the answer\n"
        assert process.returncode == 0
        assert "at work" not in terminal.text.rpartition("1/3")[2]
    finally:
        process.kill()
        terminal.close()


def test_without_a_terminal_nothing_is_shown(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).touch()
    code = WAITS.replace('unit="part"', 'unit="part", disable=None').replace(
        'until("one")', "time.sleep(0.5)"
    )
    assert ended(started("", code, cwd=tmp_path)) == (0, [])
