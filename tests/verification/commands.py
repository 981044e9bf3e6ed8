"""Whole commands on wrong files, with 2 GB of memory: an answer, or one line of what is wrong."""

import tempfile
from collections import Counter
from contextlib import chdir
from pathlib import Path

import numpy as np
from commandfuzz import MIB, attempts, finding, make_bag
from healthy import make_healthy
from tqdm import tqdm

COUNT = 3  # instants of the recording
SEED = 1


def report(arguments) -> bool:
    """Whether nothing was found."""
    with tempfile.TemporaryDirectory() as name, chdir(name):
        root = Path(name)
        healthy = root / "healthy"
        healthy.mkdir()
        make_healthy(healthy, COUNT)
        with chdir(healthy):
            make_bag(healthy)
        return not _attempts(root, healthy, arguments.commands)


def _attempts(root: Path, healthy: Path, count: int) -> int:
    """Print what commands did on files of which one is wrong; the number of findings."""
    print(f"{count} commands with 2 GB of memory, on files of which one is wrong (seed {SEED})")
    codes: Counter = Counter()
    refused, peak, findings = list[float](), 0, 0
    made = attempts(np.random.default_rng(SEED), healthy, root / "work", count)
    for attempt in tqdm(made, total=count, leave=False, unit="command"):
        codes[attempt.ran.code] += 1
        peak = max(peak, attempt.ran.peak)
        if attempt.ran.code == 2:
            refused.append(attempt.ran.seconds)
        if said := finding(attempt):
            findings += 1
            print(f"finding: {attempt.line}: {attempt.file} ({attempt.what}): {said}", flush=True)
    print(
        f"answered {codes[0] + codes[1]}, refused {codes[2]}, findings {findings}; "
        f"at most {peak / MIB:.0f} MB; s of processor time of a refusal: "
        f"median {np.median(refused):.2f}, longest {np.max(refused):.2f}",
        flush=True,
    )
    return findings
