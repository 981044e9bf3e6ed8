"""Sweeps that are kept in a folder: notebooks by the command, functions; interrupted, stale,
refused.
"""

import json
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from healthy import contents, run
from makenotebook import glued, make_notebook
from processes import GATE, ended, is_running, open_gate, started, wait_until

from workbench import provenance
from workbench.sweep import runs, sweep
from workbench.sweep.folder import read_sweep

# Each run leaves a line in `trace`: its parameter and its process. From `waits_from` on a run waits
# for the gate.
WORK = f"""
import os, time
with open("trace", "a") as file:
    print(a, os.getpid(), file=file)
while a >= waits_from and not os.path.exists({GATE!r}):
    time.sleep(0.01)
if a > 4: raise ValueError("too much")
"""
RESULTS = glued(
    square="a**2",
    wrong="[a] if a == 2 else 1",
    seconds="7",
    verdict="'large' if a > 2 else 'small'",
)
LINE = "sweep n.ipynb -p a=0:5:6 --workers 2 --out new/s"


@pytest.fixture
def notebook(tmp_path, monkeypatch):
    """A notebook in the working folder."""
    monkeypatch.chdir(tmp_path)
    return make_notebook(Path("n.ipynb"), WORK, RESULTS, parameters="a = 1\nwaits_from = 99")


def traced():
    """How often each parameter was run, and the processes."""
    rows = [line.split() for line in Path("trace").read_text().splitlines()]
    return [int(a) for a, _ in rows], {int(process) for _, process in rows}


@pytest.mark.usefixtures("notebook")
def test_the_command_makes_table_figure_and_manifest(capfd):
    assert run(LINE + " --keep") == 1  # for two of the runs are not ok
    out, err = capfd.readouterr()
    assert out == (
        "6 runs: 4 ok, 1 no number, 1 failed; written to new/s\n"
        "the first failed: ValueError: too much (code cell 2)\n"
        "the first no number: wrong is no number: [2]\n"
    )
    assert err == ""
    found = read_sweep("new/s")
    results = ["square", "wrong", "seconds_result", "verdict"]
    assert list(found.columns) == ["a", *results, "seconds", "status", "error"]
    assert found["square"].tolist()[:5] == [a**2 for a in range(5)]
    assert found["status"].tolist() == ["ok", "ok", "no number", "ok", "ok", "failed"]
    assert found["verdict"].tolist()[1:5] == ["small", "small", "large", "large"]
    assert found.attrs["parameters"] == ["a"]
    manifest = json.loads(Path("new/s/manifest.json").read_text())
    assert manifest["command"] == f"trinolab {LINE} --keep"
    assert manifest["values"] == {"a": list(range(6))}
    assert set(manifest["made_from"]) == set(
        ("the notebook", "the package", "its data", "the environment", "the choice of cells")
    )
    assert manifest["cells"] == {"each run": "all, in a fresh kernel"}
    assert manifest.keys() >= {"grid", "verdicts", "workers", "versions", "commit", "machine"}
    assert Path("new/s/figure.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert len(list(Path("new/s/notebooks").iterdir())) == 6
    assert len(traced()[1]) == 6  # a kernel for each run
    assert {path.name for path in Path().iterdir()} == {"n.ipynb", "new", "trace"}


def finished():
    """The numbers of the runs that are kept, from whole lines."""
    path = Path("new/s/runs.jsonl")
    lines = path.read_text().split("\n")[:-1] if path.exists() else []
    return [json.loads(line)["run"] for line in lines]


@pytest.mark.usefixtures("notebook")
@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGINT, 130),
        pytest.param(signal.SIGKILL, -signal.SIGKILL, marks=pytest.mark.heavy),
    ],
)
def test_a_sweep_that_is_stopped_keeps_its_runs_and_goes_on(capfd, number, code):
    line = LINE.replace("0:5:6", "0:4:5").replace("--workers 2", "--workers 1")
    line += " -p waits_from=3"
    with started(line) as process:
        wait_until(lambda: len(finished()) == 3 and len(traced()[0]) == 4, process)
        before = contents(Path("new"))
        assert run(line) == 2
        assert capfd.readouterr().err == "trinolab sweep: new/s: another process works on it\n"
        assert contents(Path("new")) == before
        process.send_signal(number)
        assert (result := ended(process))[0] == code
    kept = finished()
    assert sorted(kept) == [0, 1, 2]
    said = "trinolab sweep: interrupted, 3 of 5 runs are kept in new/s; the same command goes on\n"
    assert result[1] == [said] * (number == signal.SIGINT)
    wait_until(
        lambda: not any(map(is_running, traced()[1]))
    )  # kernels end with the process that started them
    assert not Path("new/s/table.csv").exists()
    open_gate()
    assert run(line) == 1  # one result of the third run is no number
    found = read_sweep("new/s")
    assert found["square"].tolist() == [a**2 for a in range(5)]
    times = [traced()[0].count(a) for a in range(5)]
    assert all(times[a] == 1 for a in kept)
    assert max(times) <= 2


def test_a_function_is_kept_and_stale_when_its_file_has_changed(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    Path("mine.py").write_text(
        "def f(a):\n    with open('trace', 'a') as file:\n        file.write('x')\n    return a\n"
    )
    import mine

    first = sweep(mine.f, a=np.linspace(0, 1, 3), out="s")
    assert sweep(mine.f, a=np.linspace(0, 1, 3), out="s").equals(first)
    assert read_sweep("s").equals(first)
    assert Path("trace").read_text() == "xxx"
    Path("mine.py").write_text(Path("mine.py").read_text() + "# changed\n")
    sweep(mine.f, a=np.linspace(0, 1, 3), out="s")
    assert caplog.messages == [
        "s: the function has changed since; 3 finished runs are stale and are done again"
    ]
    assert Path("trace").read_text() == "xxxxxx"
    real = provenance.surroundings
    monkeypatch.setattr(
        provenance, "surroundings", lambda code: {**real(code), "the package": "x", "its data": "y"}
    )
    sweep(mine.f, a=np.linspace(0, 1, 3), out="s")
    assert caplog.messages[1:] == [
        "s: the package and its data have changed since; 3 finished runs are stale and are done again"
    ]


def test_a_chapter_is_found_by_its_name(tmp_path, monkeypatch):
    assert runs.find_notebook("06_matching").name == "06_matching.ipynb"
    monkeypatch.chdir(tmp_path)
    make_notebook(tmp_path / "mine.ipynb", glued(b="a"))
    found = sweep("mine", a=[1.0, np.float64(2.0)], progress=False)
    assert found["b"].tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="no_such: no such notebook"):
        sweep("no_such", a=1.0)
