"""The studies as a command: makes the tables of ``data/sweeps`` again, each whole or not at all.

python -m workbench.studies NAME [--out FOLDER] [options]
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from trinolab.checks import as_whole
from trinolab.files.outputs import check_targets, write_table


@dataclass(frozen=True)
class Study:
    """A study as a command.

    Attributes
    ----------
    what : str
        What it makes, for who asks for help.
    make : str
        The function of its module that makes the tables, called with the options by their names; it
        returns one table, or one for each of `tables` in their order.
    tables : tuple of str
        The names of their files.
    counts : mapping of str to (int, str)
        Options that are whole numbers: default, and what they count.
    names : tuple of str
        An option that takes some of the study's parts: its name on the command line, its metavar.
    kept : tuple of str
        The folder in which finished work is kept, and what that is.
    workers : bool
        Whether processes share the work.
    out : str
        The folder of the tables.
    writes : bool
        Whether `make` is given `out`, and writes each table itself as soon as it is whole.
    """

    what: str
    make: str = "make_table"
    tables: tuple[str, ...] = ()
    counts: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    names: tuple[str, str] | None = None
    kept: tuple[str, str] | None = None
    workers: bool = False
    out: str = "data/sweeps"
    writes: bool = False


STUDIES = {
    "bound": Study(
        "the Cramer-Rao bound at Table 1's poses, for every shipped rig: bound.csv",
        "sweep_bounds",
        ("bound",),
    ),
    "budget": Study(
        "the error budget of Table 1: budget.csv, mixes.csv, patterns.csv, smooth.csv",
        "make_tables",
        ("budget", "mixes", "patterns", "smooth"),
        counts={"draws": (5, "tables of rendered frames")},
    ),
    "claims": Study(
        "the trials of the protocol: claims_results.csv, claims_draws.csv",
        "make_tables_in",
        ("claims_results", "claims_draws"),
        names=("names", "TRIAL"),
        kept=("_build/claims", "finished draws"),
        out="data",
        writes=True,
    ),
    "drawn_rigs": Study(
        "rig files that are off, before the frames of two renderers: drawn_rigs.csv",
        tables=("drawn_rigs",),
        counts={"draws": (4, "rig files of each size and pose")},
        kept=("_build/second", "the recordings and finished instants"),
        workers=True,
    ),
    "elevation": Study(
        "CCD3's elevation from 10 to 90 deg: elevation.csv", "sweep_elevation", ("elevation",)
    ),
    "calibration_error": Study(
        "what a rig file that is off costs a pose: calibration_error.csv",
        tables=("calibration_error",),
        counts={"draws": (40, "rigs drawn a level")},
        kept=("_build/calibration_error", "finished draws"),
        workers=True,
    ),
    "factors": Study(
        "the four factors of Sect. 6.5, a table each",
        "make_tables",
        ("distortion", "distance", "marker_size", "speed", "turn"),
        counts={"seeds": (1, "draws of the noise")},
        names=("--factor", "FACTOR"),
        writes=True,
    ),
    "fitts": Study(
        "a pointing task by simulated operators, by scale and delay: fitts.csv", tables=("fitts",)
    ),
    "gallery": Study(
        "the sweep gallery, a table each",
        "make_tables",
        names=("names", "SWEEP"),
        kept=("_build/sweeps", "finished runs"),
        workers=True,
        out="data/sweeps/gallery",
        writes=True,
    ),
    "match_rivals": Study(
        "rules that pair spots, with calibrations that are right and off: match_rivals.csv",
        tables=("match_rivals",),
        counts={"draws": (12, "pairs of recordings")},
        kept=("_build/match_rivals", "finished draws"),
    ),
    "instant_times": Study(
        "what an instant of a track takes, by SimpleBlobDetector's time: instant_times.csv, "
        "instant_films.csv",
        "make_tables",
        ("instant_times", "instant_films"),
        counts={"instants": (10_000, "of all films together")},
        kept=("_build/instant_times", "finished films"),
        workers=True,
    ),
    "second_renderer": Study(
        "the estimators on path-traced frames: second_renderer.csv",
        tables=("second_renderer",),
        kept=("_build/second", "the recordings"),
    ),
    "sensitivity": Study(
        "the headline numbers with other assumptions: sensitivity.csv",
        tables=("sensitivity",),
        counts={"draws": (2, "of the noise, a pose")},
        kept=("_build/sensitivity", "finished instants"),
        out="data",
    ),
    "stress": Study(
        "the bench broken, one thing at a time, with rig files as they are and with silent ones: "
        "stress.csv, stress_silent.csv",
        "make_tables",
        ("stress", "stress_silent"),
        counts={"instants": (40, "of each fault and handle")},
        kept=("_build/stress", "finished blocks"),
        workers=True,
    ),
    "webcams": Study(
        "three webcams and a printed rod, by its size: webcams.csv", tables=("webcams",)
    ),
    "tuning": Study(
        "the most likely parameters of the filters of image and pose; prints them",
        "print_most_likely",
    ),
}
# A study -> the tables that it makes, but for the gallery's, which are in a folder of their own.
MAKES = {name: study.tables for name, study in STUDIES.items() if study.tables}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a study and return the exit code: 2 for a mistake in the input, 130 for an
    interruption.
    """
    parser = _parser()
    arguments = parser.parse_args(argv)
    try:
        run(arguments)
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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m workbench.studies", description=(__doc__ or "").partition("\n\n")[0]
    )
    commands = parser.add_subparsers(dest="study", required=True, metavar="NAME")
    for name, study in STUDIES.items():
        command = commands.add_parser(name, help=study.what, description=study.what)
        if study.tables or study.writes:
            about = "of the tables (%(default)s)"
            command.add_argument("--out", default=study.out, metavar="FOLDER", help=about)
        for count, (default, what) in study.counts.items():
            about = f"{what} (%(default)s)"
            command.add_argument(f"--{count}", type=int, default=default, metavar="N", help=about)
        if study.names is not None:
            option, metavar = study.names
            many = "+" if option.startswith("-") else "*"
            about = "some of them; all without it"
            command.add_argument(option, nargs=many, metavar=metavar, default=[], help=about)
        if study.kept is not None:
            folder, what = study.kept
            about = f"for {what}; a command that was stopped goes on with them (%(default)s)"
            command.add_argument("--kept", type=Path, default=folder, metavar="FOLDER", help=about)
        if study.workers:
            cores = os.cpu_count() or 1
            about = "processes (one a core)"
            command.add_argument("--workers", type=int, default=cores, metavar="N", help=about)
        if name == "claims":
            about = "print the hash of each row of the protocol instead"
            command.add_argument("--hashes", action="store_true", help=about)
    return parser


def run(arguments: argparse.Namespace) -> None:
    """Compute what was asked for, and write it; a study's module is loaded when it is run."""
    study = STUDIES[arguments.study]
    options = {name: value for name, value in vars(arguments).items() if name != "study"}
    for count in {*study.counts, "workers"} & set(options):
        as_whole(options[count], f"--{count}", low=1)
    module = import_module(f".{arguments.study}", __package__)
    if options.pop("hashes", False):
        module.print_hashes()
        return
    make = getattr(module, study.make)
    if study.writes:
        make(**options | {"out": Path(options["out"])})
        return
    folder = Path(options.pop("out", ""))
    paths = [folder / f"{name}.csv" for name in study.tables]
    check_targets(paths)
    tables: Any = make(**options)
    for table, path in zip([tables] if len(paths) == 1 else tables or (), paths, strict=True):
        write_table(table, path)


if __name__ == "__main__":
    raise SystemExit(main())
