"""Where the runs of a sweep are computed: executors of `concurrent.futures`, all used in the same
way.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager, suppress
from multiprocessing.reduction import ForkingPickler
from typing import Any, NamedTuple

from trinolab.workers import serve_parent

from ..provenance import surroundings
from .jobs import close_kernels
from .notebook import ONE_THREAD

BATCH_S = 0.02
CONNECT_S = 10.0  # to a scheduler, and to its first worker


class Engine(NamedTuple):
    """An executor, and how it is used.

    Attributes
    ----------
    executor : concurrent.futures.Executor
    ahead : int
        How many calls it is given before one of them is finished.
    batch_s : float
        Runs that are shorter than this go together, s: to send each alone would take longer than to
        compute it.
    """

    executor: Executor
    ahead: int
    batch_s: float = 0.0


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
    """Processes of this computer, with one thread each for linear algebra and OpenCV; no process
    for one worker.
    """
    if workers == 1:
        yield Engine(Inline(), 1)
        return
    others = set(multiprocessing.active_children())
    with (
        one_thread_each(),
        ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), serve_parent) as pool,
    ):
        try:
            yield Engine(pool, 4 * workers, BATCH_S)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()  # what they compute nobody waits for
            raise


@contextmanager
def kernels(workers: int, sweep: str) -> Iterator[Engine]:
    """Threads, each of which has a kernel do its work; they are processes of their own, with one
    thread each, too.

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


@contextmanager
def cluster(address: str, sweep: str = "") -> Iterator[Engine]:
    """The workers of a Dask cluster that runs already (extra ``cluster``); `sweep` as in `kernels`.

    Raises
    ------
    ValueError
        If no scheduler answers, it has no workers, or they have another version of this package or
        its data.
    """
    try:
        from dask.distributed import Client
    except ImportError:
        raise ValueError(
            "a Dask cluster needs the package dask[distributed] (extra 'cluster')"
        ) from None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ValueError(f"{address}: no Dask scheduler answers ({error})") from None
    with client:
        settle(client, address)
        try:
            yield Engine(
                client.get_executor(pure=False), 4 * sum(client.nthreads().values()), BATCH_S
            )
        finally:
            with suppress(Exception):  # workers that are gone have no kernels either
                client.run(_close_on_worker, sweep)


def as_finished(
    engine: Engine, calls: Iterable[tuple[Any, ...]]
) -> Iterator[tuple[Any, Future[Any]]]:
    """Compute calls (key, function, argument, ...), and give keys and futures in the order in which
    they are done.
    """
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
    main = getattr(function, "__module__", None) == "__main__" and not hasattr(
        sys.modules["__main__"], "__file__"
    )
    try:
        ForkingPickler.dumps(function)
    except Exception:  # whatever an object's own pickling raises
        main = True
    if main:
        raise ValueError(
            f"{name}: other processes cannot import it; put it into a module, or use one worker"
        )


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


async def _close_on_worker(sweep: str) -> None:
    """End the kernels of a sweep in a worker: in a thread, because the worker's own event loop runs
    here, and a kernel is ended by running another one.
    """
    await asyncio.to_thread(close_kernels, sweep)


def settle(client: Any, address: str) -> None:
    """Give each worker one thread for linear algebra and OpenCV; ValueError if its code is not that
    of this process.
    """
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
        hashes = client.run(settled)
    except TimeoutError:
        raise ValueError(f"{address}: the cluster has no workers") from None
    except Exception as error:  # what a worker without this package raises
        raise ValueError(f"{address}: its workers cannot load trinolab ({error})") from None
    own_hash = package_hash()
    for worker, their_hash in hashes.items():
        if their_hash != own_hash:
            raise ValueError(f"{address}: {worker} has another version of trinolab, or of its data")


def settled() -> str:
    """In a worker: use one thread for linear algebra and OpenCV; the hash of this package and its
    data.
    """
    os.environ.update(ONE_THREAD)
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(1)
    return package_hash()


def package_hash() -> str:
    """The hash of this package and its data."""
    hashes = surroundings()
    return hashes["the package"] + hashes["its data"]
