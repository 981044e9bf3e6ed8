"""What a notebook may leave behind in a kernel is taken back, part by part, in this process."""

import builtins
import logging
import os
import random
import sys
import threading
import warnings
from types import SimpleNamespace

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from workbench.sweep import kernelstate


def test_a_mapping_gets_back_what_it_had_and_keeps_what_is_the_same():
    kept = [1]
    table = {"a": kept, "b": 2, "c": 3}
    before = dict(table)
    table["a"] = kept
    table["b"] = 5
    del table["c"]
    table["d"] = 4
    kernelstate.put_back(table, before)
    assert table == before
    assert table["a"] is kept


def settings():
    """Those of Python that a notebook may change."""
    return (
        os.getcwd(),
        dict(os.environ),
        list(sys.path),
        list(sys.argv),
        sys.getrecursionlimit(),
        list(warnings.filters),
        sys.displayhook,
    )


def test_settings_of_python_are_taken_back(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "settrace", lambda _: None)  # or who measures coverage sees no more
    monkeypatch.setattr(random, "seed", lambda: None)
    before = settings()
    monkeypatch.setattr(sys, "path", sys.path)
    undo = kernelstate.undo_python()
    os.chdir(tmp_path)
    os.environ["TRINOLAB_OF_A_NOTEBOOK"] = "1"
    sys.path.insert(0, str(tmp_path))
    sys.argv.append("--more")
    sys.setrecursionlimit(sys.getrecursionlimit() + 100)
    warnings.simplefilter("ignore")
    sys.displayhook = print
    builtins.of_a_notebook = 1
    undo()
    assert settings() == before
    assert not hasattr(builtins, "of_a_notebook")


def test_loggers_are_as_before_and_new_ones_as_if_nobody_had_touched_them():
    old = logging.getLogger("trinolab.of_the_tests.old")
    old.setLevel(logging.WARNING)
    kept = kernelstate.logger_states()
    new = logging.getLogger("trinolab.of_the_tests.new")
    for logger in (old, new):
        logger.setLevel(logging.DEBUG)
        logger.addHandler(logging.NullHandler())
        logger.propagate = False
        logger.disabled = True
    kernelstate.restore_loggers(kept)
    assert old.level == logging.WARNING
    assert new.level == logging.NOTSET
    for logger in (old, new):
        assert (logger.handlers, logger.propagate, logger.disabled) == ([], True, False)


def test_a_thread_that_still_runs_keeps_a_kernel_from_being_used_again(monkeypatch):
    monkeypatch.setattr(kernelstate.multiprocessing, "active_children", list)  # another test's
    check = kernelstate.other_threads()
    check()
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    try:
        with pytest.raises(RuntimeError, match="threads or processes of the notebook still run"):
            check()
    finally:
        done.set()
        thread.join()
    check()


def test_only_what_lies_beside_a_notebook_or_in_the_package_is_loaded_anew(monkeypatch, tmp_path):
    beside = SimpleNamespace(__file__=str(tmp_path / "helper.py"))
    monkeypatch.setitem(sys.modules, "helper_of_a_notebook", beside)
    installed = {
        name: kernelstate.is_installed(name)
        for name in ("json", "sys", "numpy", kernelstate.__name__, "helper_of_a_notebook")
    }
    assert installed == {
        "json": True,
        "sys": True,
        "numpy": True,
        kernelstate.__name__: False,
        "helper_of_a_notebook": False,
    }


def test_options_of_numpy_pandas_and_opencv_are_taken_back():
    before = np.get_printoptions(), np.geterr(), pd.get_option("display.max_rows")
    threads = cv2.getNumThreads()
    undo = [kernelstate.undo_numpy(), kernelstate.undo_pandas(), kernelstate.undo_opencv()]
    np.set_printoptions(precision=2)
    np.seterr(all="ignore")
    pd.set_option("display.max_rows", 7)
    cv2.setNumThreads(threads + 1)
    for one in undo:
        one()
    assert before == (np.get_printoptions(), np.geterr(), pd.get_option("display.max_rows"))
    assert cv2.getNumThreads() == threads


def test_random_numbers_of_opencv_begin_as_in_a_new_process():
    undo = kernelstate.undo_opencv()
    cv2.setRNGSeed(0)
    first = cv2.randu(np.zeros(4), 0.0, 1.0)
    cv2.setRNGSeed(5)
    undo()
    np.testing.assert_array_equal(cv2.randu(np.zeros(4), 0.0, 1.0), first)


def test_figures_are_closed_and_their_parameters_taken_back():
    pytest.importorskip("matplotlib_inline", reason="a kernel's backend is not installed")
    undo = kernelstate.undo_matplotlib()
    size = plt.rcParams["font.size"]
    plt.rcParams["font.size"] = size + 3
    plt.figure()
    undo()
    assert plt.rcParams["font.size"] == size
    assert plt.get_fignums() == []


def test_callbacks_and_printers_of_the_shell_are_taken_back():
    printers = {int: repr}
    formatter = SimpleNamespace(type_printers=printers)
    shell = SimpleNamespace(
        events=SimpleNamespace(callbacks={"post_execute": [print]}),
        display_formatter=SimpleNamespace(formatters={"text/plain": formatter}),
        ast_node_interactivity="last_expr",
    )
    undo = kernelstate.undo_ipython(shell)
    shell.events.callbacks["post_execute"].append(len)
    printers[int] = str
    printers[float] = str
    shell.ast_node_interactivity = "all"
    undo()
    assert shell.events.callbacks == {"post_execute": [print]}
    assert printers == {int: repr}
    assert shell.ast_node_interactivity == "last_expr"


def test_a_reset_undoes_all_in_turn_and_spares_the_collector_once(monkeypatch):
    """What a notebook's run left is gone by then, and the rest need not be looked through."""
    done = []
    monkeypatch.setattr(kernelstate, "to_undo", [lambda k=k: done.append(k) for k in range(3)])
    monkeypatch.setattr(kernelstate.gc, "get_freeze_count", lambda: done.count("freeze"))
    monkeypatch.setattr(kernelstate.gc, "freeze", lambda: done.append("freeze"))
    kernelstate.reset()
    kernelstate.reset()
    assert done == [0, 1, 2, "freeze", 0, 1, 2]


def test_kept_variables_are_copied_anew_and_rotations_stay_to_the_last_digit():
    shared = [1.0]
    turns = Rotation.random(50, rng=0)
    kept = kernelstate.Kept({"a": shared, "b": {"of": shared}, "turns": turns, "np": np, "f": len})
    first = kept.copies()
    first["a"].append(2.0)
    assert first["b"]["of"] is first["a"]  # what was shared is shared
    second = kept.copies()
    assert second["a"] == shared == [1.0]
    assert second["np"] is np
    np.testing.assert_array_equal(second["turns"].as_quat(), turns.as_quat())


def test_what_cannot_be_copied_is_refused():
    with pytest.raises(TypeError, match="generator"):
        kernelstate.Kept({"numbers": (k for k in range(3))})
