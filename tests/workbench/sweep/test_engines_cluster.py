"""Sweeps on a real Dask cluster: two workers, each a process of its own, one of which is killed."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from makenotebook import glued, make_notebook
from processes import HANGS_S, is_running, open_gate, started, wait_until

from workbench.sweep import engines, sweep
from workbench.sweep.engines import cluster
from workbench.sweep.folder import read_sweep

pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
# Says where it is, and lives until its standard input is closed.
CLUSTER = """
import json, os, sys
from dask.distributed import Client, LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        print(json.dumps([client.scheduler.address, sorted(client.run(os.getpid).values())]), flush=True)
        sys.stdin.read()
"""
WORK = """
import os, time
with open("kernels", "a") as file:
    file.write(f"{os.getpid()}\\n")
with open("trace", "a") as file:
    file.write(f"{a} {os.getppid()} {os.environ['OMP_NUM_THREADS']}\\n")
while a >= 8 and not os.path.exists("go"):
    time.sleep(0.01)
"""


@pytest.fixture(scope="module")
def dask(tmp_path_factory):
    """The address of a scheduler, and the processes of its workers at the start."""
    script = tmp_path_factory.mktemp("dask") / "start.py"
    script.write_text(CLUSTER)
    process = subprocess.Popen(
        [sys.executable, str(script)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        stderr=subprocess.DEVNULL,
        cwd=script.parent,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parent)},
    )
    yield json.loads(process.stdout.readline())
    process.communicate(timeout=HANGS_S)


@pytest.fixture
def here():
    """The address of a scheduler in this process, with one worker, a thread: it starts at once."""
    from dask.distributed import LocalCluster

    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as local:
        yield local.scheduler_address


def absolute(x):
    return abs(x)


def test_workers_with_other_code_are_refused(here, monkeypatch):
    versions = iter("ab")  # each one who is asked has another
    monkeypatch.setattr(engines, "package_hash", lambda: next(versions))
    with (
        pytest.raises(ValueError, match="has another version"),
        cluster(here),
    ):
        pass


def test_a_sweep_is_computed_by_a_cluster_in_this_process(here):
    with cluster(here) as engine:
        found = sweep(absolute, x=[-1.0, 2.0, -3.0], executor=engine.executor)
    assert found["result"].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.heavy
def test_a_worker_that_is_killed_costs_no_result_and_none_keeps_a_kernel(
    dask, tmp_path, monkeypatch
):
    address, processes = dask
    monkeypatch.chdir(tmp_path)
    make_notebook(Path("n.ipynb"), WORK, glued(square="a**2"), parameters="a = 0")
    line = f"sweep n.ipynb -p a=0:23:24 --scheduler {address} --out s"
    rows, trace = Path("s/runs.jsonl"), Path("trace")
    with started(line, stderr=None) as process:
        wait_until(lambda: rows.exists() and len(rows.read_text().splitlines()) >= 6, process)
        os.kill(processes[0], signal.SIGKILL)
        kept = [json.loads(row)["run"] for row in rows.read_text().split("\n")[:-1]]
        # a new worker begins
        workers = {str(one) for one in processes}
        wait_until(lambda: {row.split()[2] for row in trace.open()} > workers, process)
        open_gate()
        out, _ = process.communicate(timeout=HANGS_S)
    assert (process.returncode, out) == (0, "24 runs: 24 ok; written to s\n")
    assert read_sweep("s")["square"].tolist() == [a**2 for a in range(24)]
    begun = [row.split() for row in trace.open()]
    # what was there was not run again
    assert len(kept) < 24
    assert all([a for a, *_ in begun].count(str(number)) == 1 for number in kept)
    assert {threads for *_, threads in begun} == {"1"}
    # no worker keeps a kernel, not even the one that was killed
    wait_until(lambda: not any(is_running(int(kernel)) for _, kernel, *_ in begun))
