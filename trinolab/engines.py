"""Where the runs of a sweep are computed: executors of `concurrent.futures`, all used in the same way."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any, NamedTuple

from .notebookrun import ONE_THREAD
from .warmkernel import close_kernels


class Engine(NamedTuple):
    """An executor, and how many runs it is given before one of them is finished."""

    executor: Executor
    ahead: int


class Inline(Executor):
    """Runs everything at once, in this thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return a future that is done; an interruption goes through."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def processes(workers: int) -> Iterator[Engine]:
    """Processes of this computer, with one thread each for linear algebra and OpenCV; no process for one worker."""
    if workers == 1:
        yield Engine(Inline(), 1)
        return
    others = set(multiprocessing.active_children())
    with one_thread_each(), ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _unheard) as pool:
        try:
            yield Engine(pool, 4 * workers)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()  # what they compute nobody waits for
            raise


@contextmanager
def kernels(workers: int, sweep: str) -> Iterator[Engine]:
    """Threads, each of which has a kernel do its work; they are processes of their own, with one thread each, too.

    The kernels of the notebook job that `sweep` names are closed at the end.
    """
    with ThreadPoolExecutor(workers) as pool:
        try:
            yield Engine(pool, 2 * workers)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        finally:
            close_kernels(sweep)


def as_finished(engine: Engine, calls: Iterable[tuple[Any, ...]]) -> Iterator[tuple[Any, Future[Any]]]:
    """Compute calls (key, function, argument, ...), and give keys and futures in the order in which they are done."""
    pending: dict[Future[Any], Any] = {}
    try:
        for key, *call in calls:
            pending[engine.executor.submit(*call)] = key
            while len(pending) >= engine.ahead:
                yield from _done(pending)
        while pending:
            yield from _done(pending)
    finally:
        for future in pending:
            future.cancel()


def check_portable(function: Callable[..., Any]) -> None:
    """Refuse, with a ValueError, a function that another process could not find."""
    name = getattr(function, "__qualname__", repr(function))
    main = getattr(function, "__module__", None) == "__main__" and not hasattr(sys.modules["__main__"], "__file__")
    try:
        pickle.dumps(function)
    except Exception:  # whatever an object's own pickling raises
        main = True
    if main:
        raise ValueError(f"{name}: other processes cannot import it; put it into a module, or use one worker")


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes that start meanwhile use one thread each for linear algebra and OpenCV."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def _done(pending: dict[Future[Any], Any]) -> Iterator[tuple[Any, Future[Any]]]:
    """Those that are done, at least one; they are taken from `pending`."""
    for future in wait(pending, return_when=FIRST_COMPLETED).done:
        yield pending.pop(future), future


def _unheard() -> None:
    """Ctrl-C is the matter of the process that started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
