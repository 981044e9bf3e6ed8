"""The tests that take too long for `make test`: marked ``heavy``, they run here."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def report(arguments) -> bool:
    """Whether all of them passed."""
    print(
        "heavy: the tests that make test leaves to this report; pages in a browser are tried after "
        "make browser",
        flush=True,
    )
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-n", "auto", "-q", "-m", "heavy", "--durations=0"],
        cwd=ROOT,
    )
    return run.returncode == 0
