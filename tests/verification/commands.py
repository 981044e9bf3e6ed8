"""Whole commands on wrong files, with 2 GB of memory: an answer, or one line of what is wrong."""

import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from commandfuzz import MIB, attempts, finding, make_bag
from healthy import make_healthy
from tqdm import tqdm

COUNT = 3  # instants of the recording
SEED = 1
LONG_S = 1.0  # of processor time, from which on a refusal is listed


def report(arguments) -> None:
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        before = Path.cwd()
        os.chdir(root)
        try:
            findings = _attempts(root, arguments.commands)
        finally:
            os.chdir(before)
    if findings:
        sys.exit(1)


def _healthy(root: Path) -> Path:
    folder = root / "healthy"
    if not folder.exists():
        folder.mkdir()
        make_healthy(folder, COUNT)
        os.chdir(folder)
        make_bag(folder)
        os.chdir(root)
    return folder


def _attempts(root: Path, count: int) -> int:
    """Print what commands did on files of which one is wrong; the number of findings."""
    print(f"{count} commands with 2 GB of memory, on files of which one is wrong (seed {SEED})")
    codes: Counter = Counter()
    refused = list[float]()  # s of processor time
    peak = 0
    findings = 0
    rng = np.random.default_rng(SEED)
    made = attempts(rng, _healthy(root), root / "work", count)
    for attempt in tqdm(made, total=count, leave=False, unit="command"):
        codes[attempt.ran.code] += 1
        peak = max(peak, attempt.ran.peak)
        if attempt.ran.code == 2:
            refused.append(attempt.ran.seconds)
            if attempt.ran.seconds > LONG_S:
                print(
                    f"{attempt.ran.seconds:.2f} s: {attempt.line}: {attempt.file} ({attempt.what})"
                )
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
