"""One run of a notebook at one setting: whole in a fresh kernel, or by its tags in a fork of the
state that its ``once`` cells have left.
"""

from __future__ import annotations

import asyncio
import atexit
import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from multiprocessing.reduction import send_handle
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

from .cells import Plan, code_cells, parameters_cell
from .exact import source_for_kernel
from .notebook import ONE_THREAD, UNATTENDED, as_notebook, glued, inject, read_notebook
from .outcome import Outcome, failed, finished

# nbclient, nbformat and jupyter_client belong to the extra "book": imported where they are used.

START_S = 60.0  # to start a kernel, or IPython
NOT_STARTED = "Kernel died before replying to kernel_info"
CAN_FORK = hasattr(os, "fork")  # Windows cannot

quiet = logging.getLogger("trinolab.kernels")  # what nbclient says of a failure is in the outcome
quiet.addHandler(logging.NullHandler())
quiet.propagate = False

_lock = threading.Lock()
_clients: dict[Any, str] = {}  # of nbclient, and the sweeps that they work for
_states: dict[str, State] = {}
_ended: set[str] = set()  # sweeps for which nothing more starts


class NotebookJob(NamedTuple):
    """A notebook to be run.

    Attributes
    ----------
    sweep : str
        A name that no other sweep has: what works for it ends together.
    name, text, folder : str
        The notebook's name, its content as JSON, and the folder where it runs.
    timeout_s : float or None
        The longest time that one cell may take, s.
    keep : bool
        Return the executed notebook as well.
    plan : Plan or None
        When its cells run; None for a notebook that runs whole.
    fixed : dict
        Parameters with one value in all runs; ``once`` cells see them.
    varying : tuple of str
        The other parameters.
    """

    sweep: str
    name: str
    text: str
    folder: str
    timeout_s: float | None
    keep: bool = False
    plan: Plan | None = None
    fixed: Mapping[str, Any] = {}
    varying: tuple[str, ...] = ()


def notebook_job(
    path: str | Path,
    timeout_s: float | None = None,
    keep: bool = False,
    plan: Plan | None = None,
    fixed: Mapping[str, Any] | None = None,
    varying: Sequence[str] = (),
) -> NotebookJob:
    """The job of a notebook file. ValueError if it is none."""
    return NotebookJob(
        uuid4().hex,
        Path(path).name,
        json.dumps(read_notebook(path)),
        str(Path(path).resolve().parent),
        timeout_s,
        keep,
        plan,
        fixed or {},
        tuple(varying),
    )


def check_kernel(path: str | Path) -> None:
    """Refuse, with a ValueError, a notebook whose kernel is not installed."""
    from jupyter_client.kernelspec import KernelSpecManager, NoSuchKernel

    name = _kernel_name(read_notebook(path))
    try:
        KernelSpecManager(log=quiet).get_kernel_spec(name)
    except NoSuchKernel:
        raise ValueError(f"{path}: its kernel {name} is not installed") from None


def runs_here(path: str | Path) -> bool:
    """Whether a notebook's kernel is this Python, so that its state can be forked."""
    from jupyter_client.kernelspec import KernelSpecManager

    spec = KernelSpecManager(log=quiet).get_kernel_spec(_kernel_name(read_notebook(path)))
    python = os.path.realpath(spec.argv[0]) if os.path.isabs(spec.argv[0]) else spec.argv[0]
    return CAN_FORK and python in ("python", "python3", os.path.realpath(sys.executable))


def run_job(job: NotebookJob, parameters: Mapping[str, Any]) -> Outcome:
    """Run a notebook with these parameters."""
    return run_whole(job, parameters) if job.plan is None else run_tagged(job, parameters)


def run_both(job: NotebookJob, parameters: Mapping[str, Any]) -> tuple[Outcome, Outcome]:
    """Run a notebook by its tags, and as a whole with the executed notebook; see `agreement`."""
    tagged = run_tagged(job, parameters)
    return tagged, run_whole(job._replace(keep=True), parameters)


def run_whole(job: NotebookJob, parameters: Mapping[str, Any], starts: int = 3) -> Outcome:
    """Run all cells in a fresh kernel, of which so many starts are tried: one that finds its ports
    taken by another kernel dies before any cell runs.
    """
    import nbformat
    from nbclient import NotebookClient

    notebook = as_notebook(job.text)
    inject(notebook, parameters, job.name)
    client = NotebookClient(
        notebook,
        timeout=job.timeout_s,
        resources={"metadata": {"path": job.folder}},
        log=quiet,
        extra_arguments=["--HistoryManager.enabled=False"],
    )

    async def begin(**_: Any) -> None:
        if job.sweep in _ended:
            raise RuntimeError("the sweep has ended")
        kernel: Any = client.kc
        await kernel.execute_interactive(
            source_for_kernel(),
            silent=True,
            store_history=False,
            timeout=START_S,
            output_hook=lambda _: None,
        )

    client.on_notebook_start = begin
    with _lock:
        _clients[client] = job.sweep
    start = time.perf_counter()
    try:
        asyncio.run(
            client.async_execute(
                env={**os.environ, **ONE_THREAD, UNATTENDED: "1"},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )
        outcome = finished(glued(notebook), time.perf_counter() - start)
    except Exception as error:  # whatever a notebook raises, or the kernel that it has ended
        outcome = failed(_reason(error, notebook), time.perf_counter() - start)
    finally:
        del _clients[client]
        _kill(client)
    if NOT_STARTED in outcome.error and starts > 1 and job.sweep not in _ended:
        return run_whole(job, parameters, starts - 1)
    return outcome._replace(notebook=nbformat.writes(notebook)) if job.keep else outcome


def run_tagged(job: NotebookJob, parameters: Mapping[str, Any]) -> Outcome:
    """Run the cells of a setting in a fork of the notebook's state."""
    assert job.plan is not None
    start = time.perf_counter()
    try:
        state = _state_of(job)
        start = time.perf_counter()
        lines = "\n".join(f"{name} = {parameters[name]!r}" for name in job.varying)
        each = state.run(lines, [(number, state.sources[number]) for number in job.plan.each])
    except Exception as error:
        text = str(error) if isinstance(error, StoppedError) else f"{type(error).__name__}: {error}"
        return failed(text, time.perf_counter() - start)
    by_cell = {**state.glued, **each}
    results = {name: value for cell in sorted(by_cell) for name, value in by_cell[cell].items()}
    return finished(results, time.perf_counter() - start)


def close_kernels(sweep: str | None = None) -> None:
    """End what works for a sweep in this process, or everything; nothing more starts for it."""
    with _lock:
        _ended.update({sweep} if sweep else {*_clients.values(), *_states})
        states = [_states.pop(name) for name in list(_states) if sweep in (None, name)]
        clients = [client for client, name in _clients.items() if sweep in (None, name)]
    for state in states:
        state.close()
    for client in clients:
        _kill(client)


def _kill(client: Any) -> None:
    """End the kernel of one of nbclient's clients; one that is about to start sees that it should
    not.
    """
    process = getattr(getattr(client.km, "provisioner", None), "process", None)
    if process is not None:
        process.kill()
        process.wait()


class StoppedError(Exception):
    """Cells have not come to their end; the message says why."""


class State:
    """What the ``once`` cells of a notebook have left, in a process that can be forked (`forking`).

    Attributes
    ----------
    sources : dict
        Sources of the code cells by number.
    glued : dict
        What the ``once`` cells have glued, by cell and name.
    """

    def __init__(self, job: NotebookJob) -> None:
        self._job = job
        self._notebook = as_notebook(job.text)
        cells = enumerate(code_cells(self._notebook), 1)
        self.sources = {number: cell.source for number, cell in cells}
        self.glued: dict[int, dict[str, Any]] = {}
        self._asking = threading.Lock()
        self._preparing = threading.Lock()
        self._outcome: StoppedError | None = None
        self._prepared = False
        self._start(job.folder)

    def prepare(self) -> None:
        """Run the ``once`` cells, unless they have run; `StoppedError` if they have not come to their
        end.
        """
        with self._preparing:
            if not self._prepared:
                self._prepared = True
                try:
                    self._prepare()
                except StoppedError as stopped:
                    self._outcome = stopped
                except (EOFError, ConnectionError):
                    self._outcome = StoppedError(
                        "DeadKernelError: Kernel died in a cell tagged once"
                    )
        if self._outcome is not None:
            raise self._outcome

    def _prepare(self) -> None:
        sources = dict(self.sources)
        fixed = [f"{name} = {value!r}" for name, value in self._job.fixed.items()]
        # a cell that reads one that varies, however hidden, fails
        varying = [f"del {name}" for name in self._job.varying]
        parameters = parameters_cell(self._notebook)
        sources[parameters] = "\n".join([sources[parameters], *fixed, *varying])
        assert self._job.plan is not None
        self._requests.send([(number, sources[number]) for number in self._job.plan.once])
        self.glued = self._received(self._requests, self._process.pid)
        if left := self._requests.recv():
            raise StoppedError(
                f"cells tagged once leave threads or processes, which no setting has: {left[0]}"
            )

    def run(self, lines: str, cells: Sequence[tuple[int, str]]) -> dict[int, dict[str, Any]]:
        """Run cells after some lines in a fork; what they glued, by cell and name. `StoppedError` if
        they have not come to their end.
        """
        answer, other = Pipe()
        with answer:
            with self._asking:
                send_handle(self._requests, other.fileno(), self._process.pid)
            other.close()
            try:
                process_id = answer.recv()
                answer.send((lines, cells))
                return self._received(answer, process_id)
            except (EOFError, ConnectionError):
                raise StoppedError("DeadKernelError: Kernel died") from None

    def close(self) -> None:
        """End the process and all its forks."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._requests.close()
        os.close(self._lifeline)

    def _start(self, folder: str) -> None:
        self._requests, theirs = Pipe()
        watched, self._lifeline = os.pipe()
        command = [sys.executable, "-P", "-m", f"{__package__}.forking"]
        self._process = subprocess.Popen(
            [*command, str(theirs.fileno()), str(watched)],
            cwd=folder,
            env={
                **os.environ,
                **ONE_THREAD,
                UNATTENDED: "1",
                "MPLBACKEND": "module://matplotlib_inline.backend_inline",
            },
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=[theirs.fileno(), watched],
            start_new_session=True,
        )
        theirs.close()
        os.close(watched)

    def _received(self, connection: Connection, process_id: int) -> dict[int, dict[str, Any]]:
        """What the cells of a process have glued, when they have come to their end."""
        begun = 0
        while True:
            # IPython starts before the first cell
            limit_s = self._job.timeout_s if begun else START_S
            if not connection.poll(limit_s):
                os.kill(process_id, signal.SIGKILL)
                raise StoppedError(f"CellTimeoutError: over {limit_s:g} s (code cell {begun})")
            what, content = connection.recv()
            if what == "cell":
                begun = content
            elif what == "failed":
                raise StoppedError(content)
            else:
                return content


def _state_of(job: NotebookJob) -> State:
    """The state of a sweep's notebook; the first run prepares it, and the others wait."""
    with _lock:
        if job.sweep in _ended:
            raise StoppedError("the sweep has ended")
        if job.sweep not in _states:
            _states[job.sweep] = State(job)
        state = _states[job.sweep]
    state.prepare()
    return state


def _kernel_name(notebook: Any) -> str:
    return notebook.metadata.get("kernelspec", {}).get("name", "python3")


def _reason(error: Exception, notebook: Any) -> str:
    """What went wrong, in one line; of a cell that raised its number among the code cells."""
    ename = getattr(error, "ename", None)
    if ename is None:
        return f"{type(error).__name__}: {error}"
    raised = (
        number
        for number, cell in enumerate(code_cells(notebook), 1)
        if any(output.output_type == "error" for output in cell.outputs)
    )
    return f"{ename}: {getattr(error, 'evalue', '')} (code cell {next(raised, 0)})"


atexit.register(close_kernels)
