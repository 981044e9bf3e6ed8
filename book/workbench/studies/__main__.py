"""The studies as a command: makes the tables of ``data/sweeps`` again, each whole or not at all.

python -m workbench.studies NAME [--out FOLDER] [options]
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from trinolab.checks import as_whole
from trinolab.files.outputs import check_targets, write_table

if TYPE_CHECKING:
    import pandas as pd

# A study -> the tables that it makes, but for the gallery's, which are in a folder of their own.
MAKES = {
    "bound": ("bound",),
    "budget": ("budget", "mixes", "patterns", "smooth"),
    "calibration_error": ("calibration_error",),
    "claims": ("claims_results", "claims_draws"),
    "elevation": ("elevation",),
    "factors": ("distortion", "distance", "marker_size", "speed", "turn"),
    "fitts": ("fitts",),
    "second_renderer": ("second_renderer",),
    "sensitivity": ("sensitivity",),
    "stress": ("stress",),
    "webcams": ("webcams",),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a study and return the exit code: 2 for a mistake in the input, 130 for an
    interruption.
    """
    parser = argparse.ArgumentParser(
        prog="python -m workbench.studies", description=(__doc__ or "").partition("\n\n")[0]
    )
    studies = parser.add_subparsers(dest="study", required=True, metavar="NAME")
    _add(
        studies,
        "bound",
        "the Cramer-Rao bound at Table 1's poses, for every shipped rig: bound.csv",
    )
    budget = _add(
        studies,
        "budget",
        "the error budget of Table 1: budget.csv, mixes.csv, patterns.csv, smooth.csv",
    )
    budget.add_argument(
        "--draws", type=int, default=5, metavar="N", help="tables of rendered frames (%(default)s)"
    )
    claims = _add(
        studies,
        "claims",
        "the trials of the protocol: claims_results.csv, claims_draws.csv",
        out="data",
    )
    claims.add_argument("names", nargs="*", metavar="TRIAL", help="some of them; all without it")
    claims.add_argument(
        "--hashes", action="store_true", help="print the hash of each row of the protocol instead"
    )
    _add_kept(claims, "_build/claims", "finished draws")
    _add(studies, "elevation", "CCD3's elevation from 10 to 90 deg: elevation.csv")
    calibration = _add(
        studies,
        "calibration_error",
        "what a rig file that is off costs a pose: calibration_error.csv",
    )
    calibration.add_argument(
        "--draws", type=int, default=40, metavar="N", help="rigs drawn a level (%(default)s)"
    )
    _add_kept(calibration, "_build/calibration_error", "finished draws")
    _add_workers(calibration)
    factors = _add(studies, "factors", "the four factors of Sect. 6.5, a table each")
    factors.add_argument(
        "--factor", nargs="+", metavar="FACTOR", help="some of them; all without it"
    )
    factors.add_argument(
        "--seeds", type=int, default=1, metavar="N", help="draws of the noise (%(default)s)"
    )
    _add(studies, "fitts", "a pointing task by simulated operators, by scale and delay: fitts.csv")
    gallery = _add(studies, "gallery", "the sweep gallery, a table each", out="data/sweeps/gallery")
    gallery.add_argument("names", nargs="*", metavar="SWEEP", help="some of them; all without it")
    _add_kept(gallery, "_build/sweeps", "finished runs")
    _add_workers(gallery)
    second = _add(
        studies, "second_renderer", "the estimators on path-traced frames: second_renderer.csv"
    )
    _add_kept(second, "_build/second", "the recordings")
    sensitivity = _add(
        studies,
        "sensitivity",
        "the headline numbers with other assumptions: sensitivity.csv",
        out="data",
    )
    sensitivity.add_argument(
        "--draws", type=int, default=2, metavar="N", help="of the noise, a pose (%(default)s)"
    )
    _add_kept(sensitivity, "_build/sensitivity", "finished instants")
    stress = _add(studies, "stress", "the bench broken, one thing at a time: stress.csv")
    stress.add_argument(
        "--instants",
        type=int,
        default=390,
        metavar="N",
        help="of each fault and handle (%(default)s)",
    )
    _add_kept(stress, "_build/stress", "finished blocks")
    _add_workers(stress)
    _add(studies, "webcams", "three webcams and a printed rod, by its size: webcams.csv")
    studies.add_parser(
        "tuning", help="the most likely parameters of the filters of image and pose; prints them"
    )
    arguments = parser.parse_args(argv)
    try:
        _check_counts(arguments)
        _run(arguments)
    except ValueError as error:
        print(f"{parser.prog} {arguments.study}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(
            f"{parser.prog} {arguments.study}: {str(stop) or 'stopped, nothing was written'}",
            file=sys.stderr,
        )
        return 130
    return 0


def _add(
    studies: argparse._SubParsersAction, name: str, what: str, out: str = "data/sweeps"
) -> argparse.ArgumentParser:
    parser = studies.add_parser(name, help=what, description=what)
    parser.add_argument("--out", default=out, metavar="FOLDER", help="of the tables (%(default)s)")
    return parser


def _add_kept(parser: argparse.ArgumentParser, folder: str, what: str) -> None:
    parser.add_argument(
        "--kept",
        default=folder,
        metavar="FOLDER",
        help=f"for {what}; a command that was stopped goes on with them (%(default)s)",
    )


def _add_workers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (one a core)",
    )


def _check_counts(a: argparse.Namespace) -> None:
    """ValueError for a count that was given as less than one."""
    for count in ("draws", "seeds", "instants", "workers"):
        if count in a:
            as_whole(getattr(a, count), f"--{count}", low=1)


def _run(a: argparse.Namespace) -> None:
    """Compute what was asked for; a study's module is loaded when it is run."""
    study = import_module(f".{a.study}", __package__)
    if a.study == "tuning":
        study.print_most_likely()
    elif a.study == "gallery":
        study.make_tables(a.names, a.workers, Path(a.out), Path(a.kept))
    elif a.study == "claims" and a.hashes:
        study.print_hashes()
    elif a.study == "claims":
        study.make_tables(*_targets(a.out, MAKES["claims"]), Path(a.kept), a.names)
    elif a.study == "factors":
        names = a.factor or list(study.FACTORS)
        if unknown := [name for name in names if name not in study.FACTORS]:
            raise ValueError(
                f"factor: expected one of {', '.join(study.FACTORS)}, got {unknown[0]!r}"
            )
        for name, path in zip(names, _targets(a.out, names), strict=True):
            write_table(study.sweep_factor(name, a.seeds), path)  # each as soon as it is whole
    elif a.study == "budget":
        paths = _targets(a.out, MAKES["budget"])
        for table, path in zip(study.make_tables(a.draws), paths, strict=True):
            write_table(table, path)
    else:
        (path,) = _targets(a.out, MAKES[a.study])
        write_table(_one_table(a, study), path)


def _one_table(a: argparse.Namespace, study: ModuleType) -> pd.DataFrame:
    """The table of a study that has one, of the study's own name."""
    if a.study == "second_renderer":
        return study.make_table(Path(a.kept))
    if a.study == "sensitivity":
        return study.make_table(Path(a.kept), a.draws)
    if a.study == "calibration_error":
        return study.make_table(a.draws, a.workers, Path(a.kept))
    if a.study == "stress":
        return study.make_table(a.instants, a.workers, Path(a.kept))
    if a.study == "webcams":
        return study.make_table()
    if a.study == "fitts":
        return study.make_table(progress=True)
    return study.sweep_elevation(progress=True) if a.study == "elevation" else study.sweep_bounds()


def _targets(out: str, names: Sequence[str]) -> list[Path]:
    """The files of tables; ValueError before anything is computed if they cannot be written."""
    paths = [Path(out) / f"{name}.csv" for name in names]
    check_targets(paths)
    return paths


if __name__ == "__main__":
    raise SystemExit(main())
