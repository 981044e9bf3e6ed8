"""Processor time that a wrong use of each command takes before it is refused, in s and by that of
``import numpy, cv2``, which is part of it.

Each line is a process of its own, in a folder that has nothing of what is asked for:

    python tests/benchmarks/bench_refusals.py
"""

import os
import resource
import shlex
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

REPEATS = 7
LIMIT_S = 0.8
RIVAL = "import numpy, cv2"
BOARD = "--board chessboard --columns 9 --rows 6 --square 25 --out rig.toml"
RIG = "--rig raised_40deg --handle coded"
WRONG_USES = (
    f"calibrate --images left=none right=none {BOARD}",
    f"calibrate --corners none.csv {BOARD}",
    "measure none --out poses.csv",
    "track none --out poses.csv",
    f"track --video ccd1=none.mkv {RIG} --out poses.csv",
    "refine none --out refined",
    f"refine --video ccd1=none.mkv {RIG} --out refined",
    "evaluate none.csv none.csv --handle coded",
    "kit --handle none.toml --out kit.pdf",
    "kit --handle coded --diameter -3 --out kit.pdf",
    "capture --camera ccd1=none.mkv --out recording",
    "preflight none",
    f"preflight --video ccd1=none.mkv {RIG}",
    f"render {RIG} --motion none.csv --out recording",
    "teleop none --out session",
    f"teleop --live-simulation {RIG} --scale 0 --out session",
    "live none",
    f"accept none {RIG} --out sheet",
    "accept --rig raised_40deg --handle none.toml --out sheet",
    f"accept {RIG} --poses 0 --out sheet",
    "bag none --out bag",
    "sweep none.ipynb -p alpha=1 --out runs",
    "check none",
    "scoreboard --csv none/board.csv",
    "eq 99",
)


def processor_s(code: str, folder: str) -> tuple[float, int]:
    """What a process of its own takes, and its exit code."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    taken = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return taken, done.returncode


def main() -> int:
    codes = {RIVAL: RIVAL} | {
        line: f"import workbench.cli; raise SystemExit(workbench.cli.main({shlex.split(line)}))"
        for line in WRONG_USES
    }
    times = {line: list[float]() for line in codes}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(REPEATS):
            for line, code in codes.items():
                taken, status = processor_s(code, folder)
                assert status == (0 if line == RIVAL else 2), line
                times[line].append(taken)
        assert not any(Path(folder).iterdir())
    medians = {line: statistics.median(of) for line, of in times.items()}
    for line, median in medians.items():
        print(f"{median:5.2f} s {median / medians[RIVAL]:5.1f}  {line}")
    kept = max(medians.values()) <= LIMIT_S
    print(f"at most {LIMIT_S} s: limit {'kept' if kept else 'BROKEN'}")
    return int(not kept)


if __name__ == "__main__":
    raise SystemExit(main())
