"""`sweep` of functions: the table, what a run that fails costs, several processes."""

import os
import re
import sys
import threading
from concurrent.futures import BrokenExecutor, CancelledError, Future
from typing import NamedTuple
from unittest.mock import Mock

import cv2
import nbformat
import numpy as np
import pytest
from nbformat.v4 import new_code_cell, new_notebook

from workbench.sweep import engines, runs, sweep
from workbench.sweep.engines import Inline
from workbench.sweep.folder import NOTEBOOKS, Identity, SweepFolder, read_sweep
from workbench.sweep.notebook import inject
from workbench.sweep.outcome import Outcome


class Pair(NamedTuple):
    total: float
    ratio: float


def pair(a, b):
    return Pair(a + b, a / b)


def identify(seed):
    """The process, and how many threads linear algebra and OpenCV use in it."""
    blas = int(os.environ["OPENBLAS_NUM_THREADS"])
    return {"process": os.getpid(), "cv2": cv2.getNumThreads(), "blas": blas}


def test_the_table_has_a_row_a_run():
    found = sweep(pair, {"a": np.array([1.0, 4.0])}, b=[1, 2])
    assert list(found.columns) == ["a", "b", "total", "ratio", "seconds", "status", "error"]
    rows = [[1.0, 1, 2.0, 1.0], [1.0, 2, 3.0, 0.5], [4.0, 1, 5.0, 4.0], [4.0, 2, 6.0, 2.0]]
    assert found[["a", "b", "total", "ratio"]].values.tolist() == rows
    assert (found["seconds"] >= 0).all()
    assert found["status"].tolist() == ["ok"] * 4
    assert found.attrs == {"parameters": ["a", "b"]}


def test_what_a_function_may_return():
    """One that raises costs its row, and the others go on."""
    returned = {
        "number": 2.5,
        "numpy": np.float32(0.5),
        "truth": np.bool_(True),
        "mapping": {"x": 1},
        "own columns": {"kind": 0.3, "seconds": 5},
        "text": "two\nwords",
        "nothing": None,
        "array": np.zeros(3),
    }
    found = sweep(lambda kind: returned[kind], kind=[*returned, "no such"])
    assert found["result"].tolist()[:3] == [2.5, 0.5, 1.0]
    assert found["x"][3] == 1
    assert found.loc[4, ["kind_result", "seconds_result"]].tolist() == [0.3, 5]
    assert found["status"].tolist() == ["ok"] * 5 + ["no number"] * 3 + ["failed"]
    assert found["error"].tolist()[5:] == [
        r"result is no number: 'two\nwords'",
        "result is no number: None",
        "result is no number: array([0., 0., 0.])",
        "KeyError: 'no such'",
    ]
    assert found["result"][5] == "two words"
    assert found["result"].notna().tolist() == [kind in (0, 1, 2, 5) for kind in range(9)]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"a": 1}, "pair: missing a required argument: 'b'; it takes a, b"),
        ({"a": 1, "b": 1, "c": 1}, "pair: got an unexpected keyword argument 'c'; it takes a, b"),
        ({"a": 1, "status": 1}, "status: cannot be swept, the table has a column of this name"),
        ({"a": 1, "b": 1, "workers": 0}, "workers: expected"),
    ],
)
def test_what_is_refused(arguments, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        sweep(pair, **arguments)


def test_several_processes_with_one_thread_each():
    found = sweep(identify, seed=range(12), workers=2)
    assert found["seed"].tolist() == list(range(12))
    assert os.getpid() not in set(found["process"])
    assert 1 <= found["process"].nunique() <= 2
    assert found["cv2"].tolist() == found["blas"].tolist() == [1] * 12


def test_a_function_that_cannot_travel_is_refused():
    with pytest.raises(ValueError, match="other processes cannot import it; put it into a module"):
        sweep(lambda a: a, a=[1, 2], workers=2)


# --- engines, without a process or a cluster


def test_inline_a_failure_is_the_run_s_own_and_an_interruption_everyone_s():
    def stopped():
        raise KeyboardInterrupt

    engine = Inline()
    assert engine.submit(max, 3, 5).result() == 5
    assert engine.submit(threading.get_ident).result() == threading.get_ident()
    assert isinstance(engine.submit(lambda: 1 / 0).exception(), ZeroDivisionError)
    with pytest.raises(KeyboardInterrupt):
        engine.submit(stopped)


def test_a_cluster_of_one_thread_computes_a_sweep():
    dask = pytest.importorskip("dask.distributed", reason="the extra `cluster` is not installed")
    one = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with dask.LocalCluster(**one) as local, engines.cluster(local.scheduler_address) as engine:
        found = sweep(pair, a=[1.0, 2.0], b=4, executor=engine.executor)
    assert found["ratio"].tolist() == [0.25, 0.5]


def test_without_dask_there_is_no_cluster(monkeypatch):
    monkeypatch.setitem(sys.modules, "dask.distributed", None)
    with pytest.raises(ValueError, match=r"needs the package dask.distributed. .extra 'cluster'"):
        engines.cluster("tcp://localhost:1", "sweep").__enter__()


@pytest.mark.parametrize(
    ("method", "answer", "said"),
    [
        ("wait_for_workers", TimeoutError(), "the cluster has no workers"),
        ("run", ModuleNotFoundError("no trinolab"), r"cannot load trinolab \(no trinolab\)"),
        ("run", [{"w1": engines.package_hash(), "w2": "other"}], "w2 has another version"),
    ],
)
def test_a_cluster_that_cannot_be_used_is_refused(method, answer, said):
    client = Mock()
    client.run.return_value = {}
    getattr(client, method).side_effect = answer
    with pytest.raises(ValueError, match=f"tcp://here: .*{said}"):
        engines.settle(client, "tcp://here")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (BrokenExecutor(), "a worker process has ended abruptly, and with it the sweep"),
        (CancelledError(), "the cluster has given up runs, and with them the sweep"),
        (AttributeError("no such thing"), None),
    ],
)
def test_an_engine_that_is_gone_ends_the_sweep_and_what_it_cannot_compute_has_failed(error, said):
    future = Future()
    future.set_exception(error)
    if said is None:
        failed = [(run.results, run.status, run.error) for run in runs.received(future, 3)]
        assert failed == [({}, "failed", "AttributeError: no such thing")] * 3
        return
    with pytest.raises(ValueError, match=said):
        runs.received(future, 3)


# --- the folder


IDENTITY = Identity("pair", ["a"], "hash", 3)
DONE = Outcome({"x": 1.0}, 0.5, "ok", "", "")


def test_a_notebook_that_cannot_be_kept_is_a_refusal_and_its_run_is_not_done(tmp_path):
    with SweepFolder(tmp_path / "s", IDENTITY, {}, {}) as folder:
        folder.add(0, DONE)
        (tmp_path / "s" / NOTEBOOKS).write_text("a file in the folder's place")
        with pytest.raises(ValueError, match=f"{NOTEBOOKS}: cannot be written"):
            folder.add(1, DONE._replace(notebook="{}"))
        assert folder.done == {0: DONE}
        assert folder.kept() == 1
    with pytest.raises(ValueError, match="s: the sweep is not finished; the command that began it"):
        read_sweep(tmp_path / "s")


@pytest.mark.parametrize("text", ["[]", "3", "{", ""])
def test_a_manifest_that_is_none_is_named(tmp_path, text):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(ValueError, match=r"manifest\.json: expected"):
        read_sweep(tmp_path)


# --- a notebook's parameters


@pytest.mark.parametrize("minor", [4, 5])
def test_parameters_are_put_behind_the_defaults_once(minor):
    """An older notebook's cells have no identity, and get none."""
    cell = new_code_cell("a = 1\nb = 'x'", metadata={"tags": ["parameters"]})
    notebook = new_notebook(cells=[cell, new_code_cell("a")])
    notebook.nbformat_minor = minor
    for one in notebook.cells if minor < 5 else []:
        del one["id"]
    inject(notebook, {}, "n.ipynb")
    assert len(notebook.cells) == 2
    inject(notebook, {"a": 2}, "n.ipynb")
    inject(notebook, {"a": 3, "b": "y"}, "n.ipynb")
    sources = [cell.source for cell in notebook.cells]
    assert sources == ["a = 1\nb = 'x'", "a = 3\nb = 'y'", "a"]
    assert all(("id" in cell) == (minor == 5) for cell in notebook.cells)
    nbformat.validate(notebook)
