"""A sign of life on the terminal while a command works, wherever two seconds pass without one.

Most commands show a progress bar, whose step may take long: a part of a data sheet, the run of a
chapter. Then the bar's time has to go on. Between the bars, while something is read, adjusted or
drawn, a line says that the command is at work, and for how long.
"""

from __future__ import annotations

import logging
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

QUIET_S = 2.0  # without a sign of life, that a person takes for a command that hangs
TICK_S = 0.5
_STEERING = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")  # all but tabs and the ends of lines


class _Watcher:
    """Looks what the bars of this process show, and shows its own line where there is none."""

    def __init__(self) -> None:
        self._ended = Event()
        self._line: Any = None  # a bar of tqdm, without a bar
        self._begun_s = self._quiet_since_s = time.monotonic()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def end(self) -> None:
        self._ended.set()
        self._thread.join()
        self.hush()

    def hush(self) -> None:
        """Take the own line away: something else is to be written."""
        line, self._line = self._line, None
        if line is not None:
            line.close()
        self._quiet_since_s = time.monotonic()

    def _run(self) -> None:
        from tqdm import tqdm

        while not self._ended.wait(TICK_S):
            with tqdm.get_lock():
                shown = list(tqdm._instances)
            bars = [bar for bar in shown if bar is not self._line]
            if bars:
                self.hush()
                for bar in bars:
                    bar.refresh()  # its time goes on
            elif time.monotonic() - self._quiet_since_s >= QUIET_S:
                self._show(tqdm)

    def _show(self, tqdm: Any) -> None:
        if self._line is None:
            self._line = tqdm(bar_format="{desc}", leave=False, file=sys.stderr)
        self._line.set_description_str(f"at work, {time.monotonic() - self._begun_s:.0f} s")


class Quiet(logging.StreamHandler):
    """Writes the log's lines to standard error, without a sign of life before them."""

    def emit(self, record: logging.LogRecord) -> None:
        hush()
        super().emit(record)

    def format(self, record: logging.LogRecord) -> str:
        return shown(super().format(record))


def shown(text: str) -> str:
    """A text for a terminal: names of files and what stands in them come from others, and a control
    character in them would steer it.
    """
    return _STEERING.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


_watchers: list[_Watcher] = []  # one, while a command works


@contextmanager
def watched() -> Iterator[None]:
    """A sign of life at least every two seconds while the block lasts, if standard error is a
    terminal.
    """
    if not sys.stderr.isatty():
        yield
        return
    _watchers.append(_Watcher())
    try:
        yield
    finally:
        _watchers.pop().end()


def hush() -> None:
    """Take the sign of life away, if there is one, because something else is to be written."""
    for watcher in _watchers:
        watcher.hush()
