"""The process that runs the ``once`` cells of a notebook, and a fork of it for each setting.

    python -P -m workbench.sweep.forking REQUESTS LIFELINE

The process is IPython's shell without a kernel: it has no threads, so that it can be forked. What
a setting leaves behind ends with its fork. `jobs` starts the process and talks to it through two
inherited pipes; it ends, with all its forks, when the lifeline closes.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import warnings
from collections.abc import Sequence
from multiprocessing import active_children
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from typing import Any

from IPython.core.displaypub import DisplayPublisher
from IPython.core.interactiveshell import InteractiveShell
from traitlets import Dict
from traitlets.config import Config

from .exact import MIME, carry_values, glued_name, value_of

LIFELINE = "trinolab lifeline"
# no history, whose writer is a thread; figures are made, and no pictures of them
CONFIG = {"HistoryManager": {"enabled": False}, "InlineBackend": {"figure_formats": set()}}


class Publisher(DisplayPublisher):
    """Keeps what is glued, and shows nothing."""

    glued = Dict()

    def publish(self, data: Any, metadata: Any = None, source: Any = None, **_: Any) -> None:
        """Keep the value of a glued output."""
        name = glued_name(metadata or {})
        if name is not None:
            self.glued[name] = value_of(data, metadata)


class Shell(InteractiveShell):
    """IPython's shell, of which no window is expected."""

    def enable_gui(self, gui: str | None = None) -> None:
        """Take ``%matplotlib inline`` as a kernel does."""


def run_cells(shell: Any, cells: Sequence[tuple[int, str]], answer: Connection) -> None:
    """Run cells, given as numbers and sources.

    The process at the other end is sent ``("cell", number)`` before each one, and at the end
    ``("done", glued)``, which has a dict of names and values for each cell, or ``("failed",
    reason)``.
    """
    glued: dict[int, dict[str, Any]] = {}
    for number, source in cells:
        answer.send(("cell", number))
        shell.display_pub.glued = glued[number] = {}
        result = shell.run_cell(source, store_history=True)
        error = result.error_before_exec or result.error_in_exec
        if error is not None:
            answer.send(("failed", f"{type(error).__name__}: {error} (code cell {number})"))
            return
    answer.send(("done", glued))


def serve(requests: Connection) -> None:
    """Run the cells of the first request, then a fork for each further one."""
    shell = Shell.instance(config=Config(CONFIG), display_pub_class=Publisher)
    carry_values(shell, MIME)
    run_cells(shell, requests.recv(), requests)
    left = [*_own_threads(), *active_children()]
    requests.send([str(one) for one in left])
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # forks that have ended leave nothing
    while True:
        answer = Connection(recv_handle(requests))
        with warnings.catch_warnings():  # of the thread that watches the lifeline
            warnings.simplefilter("ignore")
            process_id = os.fork()
        if process_id == 0:
            _run_setting(shell, answer)
        answer.close()


def _run_setting(shell: Any, answer: Connection) -> None:
    """In a fork: run the cells of one setting, and end."""
    try:
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        answer.send(os.getpid())
        lines, cells = answer.recv()
        exec(lines, shell.user_ns)
        run_cells(shell, cells, answer)
    finally:
        os._exit(0)


def _own_threads() -> list[threading.Thread]:
    """The threads that the cells have started; tqdm's watches a bar, and a fork can lack it."""
    services = (threading.main_thread(), *filter(_is_service, threading.enumerate()))
    return [thread for thread in threading.enumerate() if thread not in services]


def _is_service(thread: threading.Thread) -> bool:
    return thread.name == LIFELINE or type(thread).__module__.startswith("tqdm")


def _end_with(lifeline: int) -> None:
    os.read(lifeline, 1)
    os.killpg(0, signal.SIGKILL)


def main(requests: str, lifeline: str) -> None:
    """Serve the process that holds the other ends of these descriptors."""
    watch = threading.Thread(target=_end_with, args=(int(lifeline),), name=LIFELINE, daemon=True)
    watch.start()
    try:
        serve(Connection(int(requests)))
    except EOFError:
        os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main(*sys.argv[1:])
