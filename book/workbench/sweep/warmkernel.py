"""Notebooks run one after the other in kernels that stay: each starts as in a new kernel, see
`kernelstate`.
"""

from __future__ import annotations

import asyncio
import atexit
import json
import logging
import os
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

from .notebook import ONE_THREAD, UNATTENDED, glued, imported, inject, read_notebook
from .outcome import Outcome, failed, finished
from .slicing import Slice

__all__ = [
    "Kernel",
    "Key",
    "NotebookJob",
    "check_kernel",
    "close_kernels",
    "notebook_job",
    "open_kernels",
    "run_job",
]

# nbclient, nbformat and jupyter_client belong to the extra "book": imported where they are used.

STATE = "__import__('workbench.sweep.kernelstate', fromlist=['reset'])"
START_S = 60.0  # to start a kernel

_quiet = logging.getLogger("trinolab.kernels")  # what nbclient says of a failure is in the outcome

_quiet.addHandler(logging.NullHandler())

_quiet.propagate = False

_idle: dict[Key, list[Kernel]] = {}

_all: set[Kernel] = set()

_ended: set[str] = set()  # sweeps whose kernels are closed

_lock = threading.Lock()


class Key(NamedTuple):
    """What a kernel is for: its sweep, its name, the folder where it starts, the modules that its
    notebook imports.
    """

    sweep: str
    name: str
    folder: str
    imports: str


class NotebookJob(NamedTuple):
    """A notebook to be run: its name, its content as JSON, the folder where it runs, and how.

    `sweep` is a name that no other sweep has: kernels are not shared, and are closed together.
    `timeout_s` is the longest time of one cell, None without a limit; `fresh` starts a kernel for each run; `keep`
    returns what was executed. Of a notebook that is run in part (`slicing`) `text` is what the results need, `once` and
    `each` are its parts, and `held` the names that go from one to the other; they are empty for one that cannot be
    parted.
    """

    sweep: str
    name: str
    text: str
    folder: str
    timeout_s: float | None
    fresh: bool = False
    keep: bool = False
    once: str = ""
    each: str = ""
    held: tuple[str, ...] = ()
    drawn: bool = True


def notebook_job(
    path: str | Path,
    timeout_s: float | None,
    fresh: bool = False,
    keep: bool = False,
    part: Slice | None = None,
) -> NotebookJob:
    """The job of a notebook file, or of the `part` of it that is needed. ValueError if it is
    none.
    """
    job = NotebookJob(
        uuid4().hex,
        Path(path).name,
        json.dumps(read_notebook(path)),
        str(Path(path).resolve().parent),
        timeout_s,
        fresh,
        keep,
    )
    if part is None:
        return job
    job = job._replace(text=json.dumps(part.needed), drawn=False)
    if part.once is None:
        return job
    return job._replace(
        once=json.dumps(part.once), each=json.dumps(part.each), held=tuple(part.held)
    )


def check_kernel(path: str | Path) -> None:
    """Refuse, with a ValueError, a notebook whose kernel is not installed."""
    from jupyter_client.kernelspec import KernelSpecManager, NoSuchKernel

    name = _kernel_name(read_notebook(path))
    try:
        KernelSpecManager(log=_quiet).get_kernel_spec(name)
    except NoSuchKernel:
        raise ValueError(f"{path}: its kernel {name} is not installed") from None


def run_job(job: NotebookJob, parameters: Mapping[str, Any]) -> Outcome:
    """Run a notebook with these parameters, in a kernel that is free, or in a new one; texts that
    it glues are no results.
    """
    import nbformat

    notebook = _read(job.text)
    kernel = None
    start = time.perf_counter()
    inject(notebook, parameters, job.name)
    try:
        kernel = _take(job, notebook)
        if kernel.before is not None:
            notebook = _read(job.each)
            inject(notebook, parameters, job.name)
        start = time.perf_counter()
        kernel.run(notebook, job.timeout_s)
        if kernel.before is not None:
            _put_before(notebook, kernel.before)
        # what it says in words is for its readers
        results = {
            name: value for name, value in glued(notebook).items() if not isinstance(value, str)
        }
        outcome = finished(results, time.perf_counter() - start)
    except Exception as error:  # whatever a notebook raises, or the kernel that it has ended
        outcome = failed(_reason(error, notebook), time.perf_counter() - start)
    if kernel is not None:
        _give_back(kernel, job.fresh)
    return outcome._replace(notebook=nbformat.writes(notebook)) if job.keep else outcome


def _read(text: str) -> Any:
    import nbformat

    return nbformat.from_dict(json.loads(text))


def _put_before(notebook: Any, before: Any) -> None:
    """Put what the cells gave that ran once before what they gave now."""
    cells = [cell for cell in notebook.cells if not _is_injected(cell)]
    for cell, earlier in zip(cells, before.cells, strict=True):
        if cell.cell_type == "code":
            cell.outputs = [*earlier.outputs, *cell.outputs]


def _is_injected(cell: Any) -> bool:
    return "injected-parameters" in cell.metadata.get("tags", [])


def close_kernels(sweep: str | None = None) -> None:
    """End the kernels of a sweep in this process, or all; what still runs in one of them fails, and
    no other starts.
    """
    with _lock:
        mine = {kernel for kernel in _all if sweep in (None, kernel.key.sweep)}
        _ended.update({kernel.key.sweep for kernel in mine} | ({sweep} if sweep else set()))
        idle = {kernel for key in {kernel.key for kernel in mine} for kernel in _idle.pop(key, [])}
    for kernel in mine - idle:
        kernel.kill()
    for kernel in idle:
        kernel.close()


def open_kernels() -> list[Kernel]:
    """The kernels of this process that have not ended."""
    with _lock:
        return list(_all)


class Kernel:
    """A kernel, and an event loop of its own: whichever thread has the kernel runs the loop.

    `sound` is whether another notebook may run in it; `before` what ran in it once, executed, if
    each run begins where that has ended.
    """

    def __init__(self, key: Key, warm: bool, drawn: bool = True) -> None:
        self.key = key
        self.sound = True
        self.before: Any = None
        self._used = False
        self._loop = asyncio.SelectorEventLoop()
        self._manager: Any = None
        self._client: Any = None
        with _lock:
            _all.add(self)
        try:
            self._loop.run_until_complete(self._start())
            self.sound = warm and self._did(
                f"{STATE}.remember(get_ipython(), {key.imports!r}, {drawn})"
            )
        except BaseException:
            self.close()
            raise

    def run(self, notebook: Any, timeout_s: float | None) -> None:
        """Execute a notebook in place; raises what nbclient raises."""
        from nbclient import NotebookClient
        from nbclient.exceptions import CellExecutionError

        client = NotebookClient(notebook, km=self._manager, timeout=timeout_s, log=_quiet)
        client.kc, self._used = self._client, True
        try:
            self._loop.run_until_complete(client.async_execute())
        except CellExecutionError:
            raise
        except BaseException:  # too long, or dead
            self.sound = False
            raise

    def prepare(self, once: Any, held: Sequence[str], timeout_s: float | None) -> None:
        """Run a part of a notebook in place, and let each run begin with these variables of it.

        Where that raises, or leaves something that cannot be copied, it is forgotten: then each run
        has to do it itself. RuntimeError if it cannot be forgotten.
        """
        from nbclient.exceptions import CellExecutionError

        with suppress(CellExecutionError):
            self.run(once, timeout_s)
            if self._did(f"{STATE}.hold(get_ipython(), {list(held)!r})"):
                self.before, self._used = once, False
                return
        if not self.reset():
            raise RuntimeError("what the notebook has left cannot be taken back")

    def reset(self) -> bool:
        """Forget the run before; whether that could be done."""
        used, self._used = self._used, False
        return not used or self._did(f"{STATE}.reset()")

    @property
    def process_id(self) -> int | None:
        """The process's number; None before it has started."""
        process = self._process()
        return None if process is None else process.pid

    def _process(self) -> Any:
        return getattr(getattr(self._manager, "provisioner", None), "process", None)

    def kill(self) -> None:
        """End the process at once, from any thread; who waits for it is told that it has died."""
        process = self._process()
        if process is not None:  # else it is about to start, and sees that it should not
            process.kill()

    def close(self) -> None:
        """End the process, and free what belongs to it."""
        _all.discard(self)
        try:
            self._loop.run_until_complete(self._stop())
        finally:
            self._loop.close()

    async def _start(self) -> None:
        from jupyter_client import AsyncKernelManager

        self._manager = AsyncKernelManager(kernel_name=self.key.name, log=_quiet)
        extra = ["--HistoryManager.enabled=False"] if self._manager.ipykernel else []
        await self._manager.start_kernel(
            cwd=self.key.folder,
            env={**os.environ, **ONE_THREAD, UNATTENDED: "1"},
            extra_arguments=extra,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        if self.key.sweep in _ended:  # meanwhile
            raise RuntimeError("the sweep has ended")
        self._client = self._manager.client()
        self._client.start_channels()
        await self._client.wait_for_ready(timeout=START_S)
        self._client.allow_stdin = False

    def _did(self, code: str) -> bool:
        """Let the kernel do something that leaves no trace; whether it succeeded."""
        return self._loop.run_until_complete(self._asked(code))

    async def _asked(self, code: str) -> bool:
        reply = asyncio.ensure_future(
            self._client.execute_interactive(
                code,
                silent=True,
                store_history=False,
                allow_stdin=False,
                timeout=START_S,
                output_hook=lambda _: None,
            )
        )
        while not reply.done() and await self._manager.is_alive():
            await asyncio.wait({reply}, timeout=0.5)
        if not reply.done() or reply.exception() is not None:  # it has died, or does not answer
            reply.cancel()
            return False
        return reply.result()["content"]["status"] == "ok"

    async def _stop(self) -> None:
        if self._client is not None:
            self._client.stop_channels()
        if self._manager is not None and self._manager.has_kernel:
            await self._manager.shutdown_kernel(now=True)


def _take(job: NotebookJob, notebook: Any) -> Kernel:
    """A kernel in which nothing has run, or that is as if nothing had."""
    key = Key(job.sweep, _kernel_name(notebook), job.folder, imported(notebook))
    while not job.fresh:
        with _lock:
            if job.sweep in _ended:
                raise RuntimeError("the sweep has ended")
            waiting = _idle.get(key)
            kernel = waiting.pop() if waiting else None
        if kernel is None:
            break
        if kernel.reset():
            return kernel
        kernel.close()
    kernel = Kernel(key, warm=not job.fresh, drawn=job.drawn)
    if job.once and kernel.sound:
        try:
            kernel.prepare(_read(job.once), job.held, job.timeout_s)
        except BaseException:
            kernel.close()
            raise
    return kernel


def _give_back(kernel: Kernel, fresh: bool) -> None:
    with _lock:
        if reusable := kernel.sound and not fresh and kernel.key.sweep not in _ended:
            _idle.setdefault(kernel.key, []).append(kernel)
    if not reusable:
        kernel.close()


def _kernel_name(notebook: Any) -> str:
    return notebook.metadata.get("kernelspec", {}).get("name", "python3")


def _reason(error: Exception, notebook: Any) -> str:
    """What went wrong, in one line; of a cell that raised its number among the code cells of the
    notebook.
    """
    ename = getattr(error, "ename", None)
    evalue = getattr(error, "evalue", "")
    if ename is None:
        return f"{type(error).__name__}: {error}"
    cells = [cell for cell in notebook.cells if cell.cell_type == "code" and not _is_injected(cell)]
    number = next(
        (
            k
            for k, cell in enumerate(cells, 1)
            if any(o.output_type == "error" for o in cell.outputs)
        ),
        0,
    )
    return f"{ename}: {evalue} (code cell {number})"


atexit.register(close_kernels)
