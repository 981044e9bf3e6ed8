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
from types import ModuleType
from typing import Any

from trinolab.checks import as_whole
from trinolab.files.outputs import check_targets, write_table

from .carrier import make_tables, script


@dataclass(frozen=True)
class Study:
    """A study as a command.

    Attributes
    ----------
    what : str
        What it makes, for who asks for help.
    tables : tuple of str, optional
        The names of their files, if it is not one of the study's name.
    counts : mapping of str to (int, str)
        Options that are whole numbers: default, and what they count.
    names : tuple of str
        An option that takes some of the study's parts: its name on the command line, its metavar.
    kept : str, optional
        The folder below ``_build`` in which finished work is kept; empty for the study's own name.
    workers : bool
        Whether processes share the work.
    out : str
        The folder of the tables.
    make : str
        The function of its module that makes them, called with the options by their names; it
        returns one table, or one for each of `tables` in their order, or None. Without it the
        module's `TABLES` are made, see `carrier.Table`.
    """

    what: str
    tables: tuple[str, ...] | None = None
    counts: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    names: tuple[str, str] | None = None
    kept: str | None = ""
    workers: bool = True
    out: str = "data/sweeps"
    make: str = ""


STUDIES = {
    "bound": Study("the Cramer-Rao bound at Table 1's poses, for every shipped rig: bound.csv"),
    "budget": Study(
        "the error budget of Table 1: budget.csv, mixes.csv, patterns.csv, smooth.csv",
        ("budget", "mixes", "patterns", "smooth"),
        counts={"draws": (5, "tables of rendered frames")},
        kept=None,
        workers=False,
        make="make_tables",
    ),
    "claims": Study(
        "the trials of the protocol: claims_results.csv, claims_draws.csv",
        ("claims_results", "claims_draws"),
        names=("names", "TRIAL"),
        workers=False,
        out="data",
        make="make_tables",
    ),
    "drawn_rigs": Study(
        "rig files that are off, before the frames of two renderers: drawn_rigs.csv",
        counts={"draws": (4, "rig files of each size and pose")},
        kept="second",
        make="make_table",
    ),
    "elevation": Study("CCD3's elevation from 10 to 90 deg: elevation.csv"),
    "calibration_error": Study(
        "what a rig file that is off costs a pose: calibration_error.csv",
        counts={"draws": (40, "rigs drawn a level")},
    ),
    "factors": Study(
        "the four factors of Sect. 6.5, a table each",
        ("distortion", "distance", "marker_size", "speed", "turn"),
        counts={"seeds": (1, "draws of the noise")},
        names=("--factor", "FACTOR"),
    ),
    "fitts": Study("a pointing task by simulated operators, by scale and delay: fitts.csv"),
    "gallery": Study(
        "the sweep gallery, a table each",
        (),
        names=("names", "SWEEP"),
        kept="sweeps",
        out="data/sweeps/gallery",
    ),
    "match_rivals": Study(
        "rules that pair spots, with exact and wrong calibrations: match_rivals.csv",
        counts={"draws": (12, "pairs of recordings")},
    ),
    "instant_times": Study(
        "what an instant of a track takes, by SimpleBlobDetector's time: instant_times.csv, "
        "instant_films.csv",
        ("instant_times", "instant_films"),
        counts={"instants": (10_000, "of all films together")},
        make="make_tables",
    ),
    "second_renderer": Study(
        "the estimators on path-traced frames: second_renderer.csv",
        kept="second",
        make="make_table",
    ),
    "sensitivity": Study(
        "the headline numbers with other assumptions: sensitivity.csv",
        counts={"draws": (2, "of the noise, a pose")},
        out="data",
        make="make_table",
    ),
    "stress": Study(
        "the bench broken, one thing at a time, with rig files as they are and with silent ones: "
        "stress.csv, stress_silent.csv",
        ("stress", "stress_silent"),
        counts={"blocks": (4, "of ten instants, of each fault and handle")},
    ),
    "webcams": Study("three webcams and a printed rod, by its size: webcams.csv"),
    "tuning": Study(
        "the most likely parameters of the filters of image and pose; prints them",
        (),
        kept=None,
        workers=False,
        out="",
        make="print_most_likely",
    ),
}
# A study -> the tables that it makes, but for the gallery's, which are in a folder of their own.
MAKES = {name: study.tables or (name,) for name, study in STUDIES.items() if study.tables != ()}


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
        if study.out:
            about = "of the tables (%(default)s)"
            command.add_argument("--out", default=study.out, metavar="FOLDER", help=about)
        for count, (default, what) in study.counts.items():
            about = f"{what} (%(default)s)"
            command.add_argument(f"--{count}", type=int, default=default, metavar="N", help=about)
        if study.names is not None:
            option, metavar = study.names
            many = "+" if option.startswith("-") else "*"
            about = "some of them; all without it"
            known: dict[str, Any] = {"dest": "names"} if option.startswith("-") else {}
            command.add_argument(
                option, nargs=many, metavar=metavar, default=[], help=about, **known
            )
        if study.kept is not None:
            about = "for finished work; a command that was stopped goes on with it (%(default)s)"
            kept = f"_build/{study.kept or name}"
            command.add_argument("--kept", type=Path, default=kept, metavar="FOLDER", help=about)
        if study.workers:
            cores = os.cpu_count() or 1
            about = "processes (one per core)"
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
    if options.pop("hashes", False):
        script("claims").print_hashes()
        return
    folder = Path(options.pop("out", ""))
    if not study.make:
        for count in study.counts:
            options["draws"] = options.pop(count)
        make_tables(script(arguments.study).TABLES, folder, **options)
        return
    paths = [folder / f"{name}.csv" for name in MAKES.get(arguments.study, ())]
    check_targets(paths)
    if arguments.study == "claims":  # rows of trials that are not run stay
        options["before"] = paths
    made: Any = getattr(_module(arguments.study), study.make)(**options)
    for table, path in zip([made] if len(paths) == 1 else made or (), paths, strict=True):
        write_table(table, path)


def _module(study: str) -> ModuleType:
    """Where a study's function is: beside this file, or in ``data/tables``."""
    if (Path(__file__).parent / f"{study}.py").is_file():
        module = import_module(f".{study}", __package__)
        if hasattr(module, STUDIES[study].make):
            return module
    return script(study)


if __name__ == "__main__":
    raise SystemExit(main())
