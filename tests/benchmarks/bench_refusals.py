"""Processor time that a wrong use of each command takes before it is refused, and that of ``import numpy,
cv2``, which is part of it.

Each line is a process of its own, in a folder that has nothing of what is asked for:

    python tests/benchmarks/bench_refusals.py
"""

import resource
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import clock

REPEATS = 7
LIMIT_S = 0.8
BOARD = "--board chessboard --columns 9 --rows 6 --square 25 --out rig.toml"
RIG = "--rig raised_40deg --handle coded"
WRONG_USES = (
    f"calibrate --corners none.csv {BOARD}",
    "measure none --out poses.csv",
    "track none --out poses.csv",
    f"track --video ccd1=none.mkv {RIG} --out poses.csv",
    "refine none --out refined",
    "evaluate none.csv none.csv --handle coded",
    "kit --handle coded --diameter -3 --out kit.pdf",
    "capture --camera ccd1=none.mkv --out recording",
    "preflight none",
    f"render {RIG} --motion none.csv --out recording",
    "teleop none --out session",
    f"teleop --live-simulation {RIG} --scale 0 --out session",
    "live none",
    f"accept none {RIG} --out sheet",
    f"accept {RIG} --poses 0 --out sheet",
    "bag none --out bag",
    "sweep none.ipynb -p alpha=1 --out runs",
    "check none",
    "scoreboard --csv none/board.csv",
    "eq 99",
)


def processor_s(code, folder):
    """What a process of its own takes, and its exit code."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    taken = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return taken, done.returncode


def main() -> int:
    codes = {"import numpy, cv2": ("import numpy, cv2", 0, None)} | {
        words: (f"import workbench.cli as c; exit(c.main({shlex.split(words)}))", 2, LIMIT_S)
        for words in WRONG_USES
    }
    with tempfile.TemporaryDirectory() as folder:
        for words, (code, expected, limit) in codes.items():
            found = [processor_s(code, folder) for _ in range(REPEATS)]
            assert {status for _, status in found} == {expected}, words
            clock.line(words, [taken for taken, _ in found], "s", limit)
        assert not any(Path(folder).iterdir())
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
