"""In a kernel that runs notebook after notebook: take it back to where it was before the first of
them.

Reset are: the variables, history and outputs of the notebook; the modules of this package and those
that lie beside the notebook, which are loaded anew; working folder, environment variables,
``sys.path`` and other settings of ``sys``, builtins, warnings and loggers; figures, rcParams and
the inline backend of matplotlib; what IPython shows, and its callbacks; options of NumPy and
pandas; the global random numbers of Python, NumPy and OpenCV, which are those of a new process:
seeded by chance, OpenCV's always alike. Not reset is what a notebook changes inside other modules.

A part of a notebook that is the same each time may run once: `hold` makes what it has left the
state that is gone back to. Its variables are copied for each run.
"""

from __future__ import annotations

import builtins
import gc
import importlib
import io
import logging
import multiprocessing
import os
import pickle
import random
import sys
import threading
import warnings
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from scipy.spatial.transform import RigidTransform, Rotation

__all__ = [
    "Kept",
    "hold",
    "is_installed",
    "logger_states",
    "other_threads",
    "put_back",
    "remember",
    "reset",
    "restore_loggers",
    "to_undo",
    "undo_ipython",
    "undo_matplotlib",
    "undo_numpy",
    "undo_opencv",
    "undo_pandas",
    "undo_python",
]

SERVICES = {"ipykernel", "tqdm", "zmq"}  # their threads stay, whatever a notebook does
OWN = ("trinolab", "workbench")

to_undo: list[Callable[[], Any]] = []


def remember(shell: Any, imports: str = "", drawn: bool = True) -> None:
    """Remember the state of this process, once, before anything runs.

    Parameters
    ----------
    shell : IPython's shell
    imports : str
        The names of the modules that the notebook imports, with spaces between. They are loaded
        first: libraries set up things of their own, which are not the notebook's.
    drawn : bool
        Otherwise figures are made, and no pictures of them.
    """
    forget = _modules()
    for name in ("cv2", "matplotlib.pyplot", "pandas", *imports.split()):
        with suppress(Exception):  # the notebook will see it
            importlib.import_module(name)
    if not drawn:
        from matplotlib_inline.config import InlineBackend

        InlineBackend.instance().figure_formats = set()
    to_undo[:] = [other_threads(), *_undos(shell, forget), gc.collect]
    forget()


def _undos(shell: Any, forget: Callable[[], None]) -> list[Callable[[], Any]]:
    """What leads back to the state of now."""
    return [
        lambda: shell.reset(new_session=True),
        undo_python(),
        forget,
        undo_matplotlib(),
        undo_ipython(shell),
        undo_numpy(),
        undo_pandas(),
        undo_opencv(),
    ]


def hold(shell: Any, names: Iterable[str]) -> None:
    """Let each run begin where this one has ended, with copies of these variables; modules stay
    loaded.

    Raises
    ------
    Exception
        If that cannot be done: threads or processes still run, a variable cannot be copied, or a
        module that lies beside the notebook was loaded, which a run may change.
    """
    check = to_undo[0]
    check()
    if beside := [
        name
        for name in sys.modules
        if name.partition(".")[0] not in OWN and not is_installed(name) and name != "__main__"
    ]:
        raise RuntimeError(f"{beside[0]}: lies beside the notebook")
    kept = Kept({name: shell.user_ns[name] for name in names if name in shell.user_ns})
    to_undo[:] = [
        check,
        *_undos(shell, _modules(set(sys.modules))),
        gc.collect,
        lambda: shell.user_ns.update(kept.copies()),
    ]
    reset()


class Kept:
    """Variables of which copies can be had: these share what the variables share.

    Modules, functions and classes are no copies. Nor are SciPy's rotations and rigid motions: a
    copy of one is normalised anew, and differs in the last digit.
    """

    def __init__(self, variables: dict[str, Any]) -> None:
        same: list[Any] = []
        alike = (ModuleType, FunctionType, type, Rotation, RigidTransform)

        class Pickler(pickle.Pickler):
            def persistent_id(self, obj: Any) -> int | None:
                if not isinstance(obj, alike):
                    return None
                same.append(obj)
                return len(same) - 1

        class Unpickler(pickle.Unpickler):
            def persistent_load(self, pid: int) -> Any:
                return same[pid]

        file = io.BytesIO()
        Pickler(file, pickle.HIGHEST_PROTOCOL).dump(variables)
        self._content = file.getvalue()
        self._unpickler = Unpickler

    def copies(self) -> dict[str, Any]:
        """Copies of the variables."""
        copies: dict[str, Any] = self._unpickler(io.BytesIO(self._content)).load()
        return copies


def reset() -> None:
    """Go back to the state that `remember` saw.

    Raises
    ------
    RuntimeError
        If that cannot be done: threads or processes that the notebook started still run.
    """
    for undo in to_undo:
        undo()
    if not gc.get_freeze_count():  # what is here now need not be looked through after each run
        gc.freeze()


def other_threads() -> Callable[[], None]:
    threads_before = set(threading.enumerate())

    def check() -> None:
        late = {
            thread
            for thread in set(threading.enumerate()) - threads_before
            if type(thread).__module__.partition(".")[0] not in SERVICES
        }
        if late or multiprocessing.active_children():
            raise RuntimeError("threads or processes of the notebook still run")

    return check


def undo_python() -> Callable[[], None]:
    folder = Path.cwd()
    environ = dict(os.environ)
    names = dict(vars(builtins))
    path = list(sys.path)
    arguments = list(sys.argv)
    streams = {
        name: getattr(sys, name)
        for name in ("stdin", "stdout", "stderr", "displayhook", "excepthook")
    }
    limit = sys.getrecursionlimit()
    filters = list(warnings.filters)
    loggers = logger_states()

    def undo() -> None:
        os.chdir(folder)
        put_back(os.environ, environ)
        put_back(vars(builtins), names)
        sys.path = list(path)
        sys.argv = list(arguments)
        for name, value in streams.items():
            setattr(sys, name, value)
        sys.setrecursionlimit(limit)
        sys.settrace(None)
        warnings.filters[:] = filters  # type: ignore[index]
        with warnings.catch_warnings():  # leaving it makes Python look at the filters anew
            pass
        restore_loggers(loggers)
        random.seed()

    return undo


def logger_states() -> dict[str, tuple[Any, ...]]:
    """Level, handlers and switches of every logger."""
    loggers = {"": logging.getLogger(), **logging.Logger.manager.loggerDict}
    return {
        name: (logger.level, list(logger.handlers), logger.propagate, logger.disabled)
        for name, logger in loggers.items()
        if isinstance(logger, logging.Logger)
    }


def restore_loggers(kept: dict[str, tuple[Any, ...]]) -> None:
    for name in logger_states():
        logger = logging.getLogger(name)
        level, logger.handlers[:], logger.propagate, logger.disabled = kept.get(
            name, (logging.NOTSET, [], True, False)
        )
        logger.setLevel(level)


def _modules(kept: set[str] | None = None) -> Callable[[], None]:
    """Forget the modules of this package and those beside the notebook; but not these."""
    modules_before = kept or {
        name for name in sys.modules if name.partition(".")[0] not in OWN or name == __name__
    }

    def undo() -> None:
        for name in set(sys.modules) - modules_before:
            if not is_installed(name):
                del sys.modules[name]

    return undo


def is_installed(name: str) -> bool:
    """Whether a module comes with Python or from its packages, and neither from here nor from a
    notebook's folder.
    """
    place = getattr(sys.modules[name], "__file__", None)
    if name.partition(".")[0] in OWN:
        return False
    # site-, dist-
    return place is None or place.startswith(os.path.dirname(os.__file__)) or "-packages" in place


def undo_matplotlib() -> Callable[[], None]:
    import matplotlib
    import matplotlib.pyplot as plt
    from matplotlib_inline.config import InlineBackend

    # loads the backend, which then has said to IPython how figures are shown
    plt.close(plt.figure())
    parameters = dict(matplotlib.rcParams)
    inline = InlineBackend.instance()
    settings = {
        name: value
        for name, value in inline.trait_values().items()
        if name in ("figure_formats", "print_figure_kwargs", "close_figures")
    }

    def undo() -> None:
        plt.close("all")
        dict.update(matplotlib.rcParams, parameters)
        for name, value in settings.items():
            setattr(inline, name, value)

    return undo


def undo_ipython(shell: Any) -> Callable[[], None]:
    callbacks = {name: list(functions) for name, functions in shell.events.callbacks.items()}
    tables = [
        getattr(formatter, name)
        for formatter in shell.display_formatter.formatters.values()
        for name in ("singleton_printers", "type_printers", "deferred_printers")
        if hasattr(formatter, name)
    ]
    printers = [(table, dict(table)) for table in tables]
    node = shell.ast_node_interactivity

    def undo() -> None:
        for name, functions in callbacks.items():
            shell.events.callbacks[name][:] = functions
        for table, content in printers:
            put_back(table, content)
        shell.ast_node_interactivity = node

    return undo


def undo_numpy() -> Callable[[], None]:
    import numpy as np

    print_options: dict[str, Any] = {
        name: value for name, value in np.get_printoptions().items() if name != "override_repr"
    }
    errors = np.geterr()

    def undo() -> None:
        np.random.seed(None)
        np.set_printoptions(**print_options)
        np.seterr(**errors)

    return undo


def undo_pandas() -> Callable[[], None]:
    import pandas as pd

    def options(level: dict[str, Any], above: str = "") -> dict[str, Any]:
        return {
            name: value
            for key, entry in level.items()
            for name, value in (
                options(entry, f"{above}{key}.")
                if isinstance(entry, dict)
                else {f"{above}{key}": entry}
            ).items()
        }

    options_before = options(pd.options.d)

    def undo() -> None:
        now = options(pd.options.d)
        for name in [
            name
            for name, value in options_before.items()
            if now[name] is not value and now[name] != value
        ]:
            pd.set_option(name, options_before[name])

    return undo


def undo_opencv() -> Callable[[], None]:
    import cv2

    count = cv2.getNumThreads()

    def undo() -> None:
        cv2.setNumThreads(count)
        cv2.setRNGSeed(0)  # stands for the seed of a new process

    return undo


def put_back(table: Any, content: dict[Any, Any]) -> None:
    """Give a mapping its former content, touching only what differs."""
    for name in [name for name in table if name not in content]:
        del table[name]
    for name, value in content.items():
        if name not in table or table[name] is not value:
            table[name] = value
