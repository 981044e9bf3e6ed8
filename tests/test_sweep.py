"""`sweep` of functions: the table, what a run that fails costs, several processes."""

import os
import re
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from processes import ended, started, wait_until

from trinolab.sweep import sweep
from trinolab.sweep.engines import Inline
from trinolab.sweep.grid import Interval


class Pair(NamedTuple):
    total: float
    ratio: float


@dataclass
class Errors:
    E_t_mm: float


def pair(a, b):
    return Pair(a + b, a / b)


def identify(seed):
    """The process, and how many threads linear algebra and OpenCV use in it."""
    import cv2

    return {
        "process": os.getpid(),
        "cv2": cv2.getNumThreads(),
        "blas": int(os.environ["OPENBLAS_NUM_THREADS"]),
    }


def end_process(seed):
    os.kill(os.getpid(), signal.SIGKILL)


def test_the_table_has_a_row_a_run():
    found = sweep(pair, a=np.array([1.0, 4.0]), b=[1, 2])
    assert list(found.columns) == ["a", "b", "total", "ratio", "seconds", "status", "error"]
    assert found[["a", "b", "total", "ratio"]].values.tolist() == [
        [1.0, 1, 2.0, 1.0],
        [1.0, 2, 3.0, 0.5],
        [4.0, 1, 5.0, 4.0],
        [4.0, 2, 6.0, 2.0],
    ]
    assert (found["seconds"] >= 0).all()
    assert found["status"].tolist() == ["ok"] * 4
    assert found.attrs == {"parameters": ["a", "b"]}


def test_a_run_that_raises_is_a_row_and_the_others_go_on():
    found = sweep(pair, a=1, b=[1, 0, 2])
    assert found["status"].tolist() == ["ok", "failed", "ok"]
    assert found["error"].tolist() == ["", "ZeroDivisionError: division by zero", ""]
    assert np.isnan(found["total"]).tolist() == [False, True, False]


def test_what_a_function_may_return():
    def several(kind):
        return {
            "number": 2.5,
            "numpy": np.float32(0.5),
            "truth": np.bool_(True),
            "mapping": {"x": 1},
            "dataclass": Errors(0.3),
            "text": "two\nwords",
            "nothing": None,
            "array": np.zeros(3),
        }[kind]

    found = sweep(
        several,
        kind=["number", "numpy", "truth", "mapping", "dataclass", "text", "nothing", "array"],
    )
    assert found["result"].tolist()[:3] == [2.5, 0.5, 1.0]
    assert found["x"][3] == 1
    assert found["E_t_mm"][4] == 0.3
    assert found["status"].tolist() == ["ok"] * 5 + ["no number"] * 3
    assert found["error"].tolist()[5:] == [
        r"result is no number: 'two\nwords'",
        "result is no number: None",
        "result is no number: array([0., 0., 0.])",
    ]
    assert found["result"].isna().tolist() == [False] * 3 + [True] * 5


def test_a_result_named_like_another_column_is_renamed():
    found = sweep(lambda a: {"a": 2 * a, "seconds": 5, "b": 1}, a=[1])
    assert list(found.columns) == [
        "a",
        "a_result",
        "seconds_result",
        "b",
        "seconds",
        "status",
        "error",
    ]
    assert found.loc[0, ["a", "a_result", "seconds_result"]].tolist() == [1, 2, 5]


def test_parameters_named_like_options_go_into_the_mapping():
    found = sweep(lambda workers, sample: workers - sample, {"workers": [5, 6], "sample": 1})
    assert found["result"].tolist() == [4, 5]


def test_a_sample():
    found = sweep(pair, a=Interval(0, 1), b=Interval(1, 100, log=True), sample=20)
    assert sorted((found["a"] * 20).astype(int)) == list(range(20))
    pd.testing.assert_frame_equal(
        found.drop(columns="seconds"),
        sweep(pair, a=Interval(0, 1), b=Interval(1, 100, log=True), sample=20).drop(
            columns="seconds"
        ),
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"a": []}, "a: expected at least one value, got none"),
        ({"a": 1}, "pair: missing a required argument: 'b'; it takes a, b"),
        ({"a": 1, "b": 1, "c": 1}, "pair: got an unexpected keyword argument 'c'; it takes a, b"),
        ({"a": 1, "status": 1}, "status: cannot be swept, the table has a column of this name"),
        ({"a": range(1000), "b": range(1000)}, "the grid has 1,000,000 runs"),
        ({"a": 1, "b": 1, "workers": 0}, "workers: expected"),
        ({"a": 1, "b": Interval(0, 1)}, "b: an interval needs a number of points"),
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
    with pytest.raises(
        ValueError,
        match="other processes cannot import it; put it into a module, or use one worker",
    ):
        sweep(lambda a: a, a=[1, 2], workers=2)


def test_a_process_that_ends_ends_the_sweep():
    with pytest.raises(ValueError, match="a worker process has ended abruptly"):
        sweep(end_process, seed=range(3), workers=2)


def nap(log):
    Path(log).write_text("begun")
    while True:
        time.sleep(1)


@pytest.mark.heavy
@pytest.mark.parametrize("workers", [1, 2])
def test_an_interruption_is_answered_at_once(tmp_path, workers):
    logs = [str(tmp_path / name) for name in "abc"]
    code = f"from trinolab.sweep import sweep; from test_sweep import nap; sweep(nap, log={logs}, workers={workers})"
    with started("", code, env={**os.environ, "PYTHONPATH": str(Path(__file__).parent)}) as process:
        wait_until(lambda: sum(Path(log).exists() for log in logs) >= workers, process)
        process.send_signal(signal.SIGINT)
        _, err = ended(process)  # a nap would never end
    assert err[-1] == "KeyboardInterrupt\n"


def test_inline_keeps_to_its_thread():
    future = Inline().submit(threading.get_ident)
    assert future.done()
    assert future.result() == threading.get_ident()
