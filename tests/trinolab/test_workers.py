"""Processes that work for another one end with it, also when it is killed."""

import os
import signal
from contextlib import suppress

from processes import started, wait_until

# A pool whose workers have nothing to do: its process says which they are, and waits.
POOL = """
import multiprocessing, os, time
from concurrent.futures import ProcessPoolExecutor
from trinolab.workers import serve_parent

if __name__ == "__main__":
    pool = ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), serve_parent)
    pool.submit(os.getpid).result()
    pool.submit(time.sleep, 0.2)
    pool.submit(time.sleep, 0.2).result()
    print(*pool._processes, flush=True)
    time.sleep(900)
"""


def is_alive(pid):
    with suppress(ProcessLookupError):
        os.kill(pid, 0)
        return True
    return False


def test_idle_workers_end_with_a_parent_that_was_killed(tmp_path):
    (tmp_path / "pool.py").write_text(POOL)
    run = "import runpy; runpy.run_path('pool.py', run_name='__main__')"
    with started("", run, cwd=tmp_path, env={**os.environ}) as process:
        pids = [int(pid) for pid in process.stdout.readline().split()]
        assert len(pids) == 2
        assert all(is_alive(pid) for pid in pids)
        for pid in pids:
            os.kill(pid, signal.SIGINT)  # is left to the parent
        assert all(is_alive(pid) for pid in pids)
        process.send_signal(signal.SIGKILL)
        process.wait()
        wait_until(lambda: not any(is_alive(pid) for pid in pids))
