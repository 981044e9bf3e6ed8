"""Whole commands on wrong files, with 2 GB of memory: an answer, or one line of what is wrong."""

import shutil
import tempfile
from collections import Counter
from contextlib import chdir
from pathlib import Path

import numpy as np
import pandas as pd
from bombs import BOMBS, MIB, run_limited
from commandfuzz import attempts, finding, make_bag
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
        return not (_bombs(root, healthy) + _attempts(root, healthy, arguments.commands))


def _bombs(root: Path, healthy: Path) -> int:
    """Print what each bomb costs; the number of those that are not refused as they should be."""
    print("files that ask for far more than they are long: refused in one line?")
    rows = []
    for name, bomb in BOMBS.items():
        work = root / "bomb"
        shutil.rmtree(work, ignore_errors=True)
        shutil.copytree(healthy, work)
        (work / bomb.name).unlink(missing_ok=True)
        bomb.make(work / bomb.name)
        ran = run_limited(bomb.line, folder=work)
        begin = f"trinolab {bomb.line.split()[0]}: {bomb.said}"
        good = ran.code == 2 and len(ran.lines) == 1 and ran.lines[0].startswith(begin)
        length = (work / bomb.name).lstat().st_size
        said = "" if good else str(ran.lines[-1:])
        rows.append((name, length, ran.peak / MIB, ran.seconds, said))
    table = pd.DataFrame(rows, columns=["file", "bytes", "peak, MB", "s", "finding"])
    print(table.to_string(index=False, float_format="{:.2f}".format), flush=True)
    return int((table["finding"] != "").sum())


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
