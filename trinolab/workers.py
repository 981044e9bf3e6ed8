"""Worker processes that do not outlive the process they work for."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from multiprocessing.process import BaseProcess


def serve_parent() -> None:
    """Leave Ctrl-C to the process that started this one, and end when it is gone.

    A worker that waits for its next task does not notice by itself that its parent was killed: the
    other workers hold the ends of the same pipes.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)
