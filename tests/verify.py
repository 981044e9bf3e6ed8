"""The heavy counts, as a report: bound, accuracy, covariances, centroids, identities, files,
refining, slips, processors.

    python tests/verify.py [--only table1 slips] [--seeds 50] [--poses 1000] ...
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy is loaded

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent / "helpers"))  # as pytest does

from verification import (
    bounds,
    centroids,
    chapters,
    commands,
    fuzz,
    heavy,
    identity,
    misled,
    mutants,
    refined,
    slips,
    spread,
    table1,
)

SECTIONS = {
    "bound": bounds.report,
    "table1": table1.report,
    "centroid": centroids.report,
    "identity": identity.report,
    "hostile": misled.report,
    "fuzz": fuzz.report,
    "commands": commands.report,
    "refine": refined.report,
    "heavy": heavy.report,
    "chapters": chapters.report,
    "mutants": mutants.report,
    "slips": slips.report,
    "spread": spread.report,
}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument(
        "--only",
        nargs="+",
        choices=SECTIONS,
        default=list(SECTIONS),
        metavar="SECTION",
        help=f"of {', '.join(SECTIONS)}; all without it",
    )
    for name, number, what in (
        ("seeds", 50, "noise seeds of Table 1's poses for each rig"),
        ("centroid-poses", 100, "random poses for the centroids of each handle"),
        ("poses", 1000, "random poses for the identities of each rig and handle"),
        ("hostile", 1000, "hostile instants in all"),
        ("refined", 20, "draws of rig and layout for each rig and handle that a recording refines"),
        ("recordings", 2, "recordings that are rendered and refined, for each rig"),
        ("slips", 100, "slips of each module of the package, a tenth of them a run"),
        ("slip-seed", 7, "seed by which they are chosen"),
        ("slip-workers", 2, "copies of the package that are tested at once"),
        ("files", 100_000, "wrong files for the readers of users' files"),
        ("commands", 300, "commands that are run on wrong files, with 2 GB of memory"),
    ):
        parser.add_argument(f"--{name}", type=int, default=number, help=f"{what} (%(default)s)")
    parser.add_argument("--all-slips", action="store_true", help="plant all slips that are missing")
    parser.add_argument(
        "--slip-modules",
        nargs="+",
        metavar="MODULE",
        help="in which slips are planted; all without it",
    )
    parser.add_argument(
        "--groups",
        nargs="+",
        choices=spread.GROUPS,
        default=list(spread.GROUPS),
        metavar="GROUP",
        help=f"what the spread is looked at of: {', '.join(spread.GROUPS)}; all without it",
    )
    return parser.parse_args()


if __name__ == "__main__":
    arguments = _arguments()
    failed = []
    for section in SECTIONS:
        if section in arguments.only:
            begin = time.perf_counter()
            if SECTIONS[section](arguments) is False:  # a report without a verdict returns None
                failed.append(section)
            print(f"[{section}: {time.perf_counter() - begin:.0f} s]\n", flush=True)
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")
