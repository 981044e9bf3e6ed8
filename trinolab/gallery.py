"""The sweep gallery: which sweeps it has, and its tables made again.

    python -m trinolab.gallery [NAME ...] --out data/sweeps/gallery

Each sweep is a function of `sweep_trials`, or a chapter, at the settings of a grid as `trinolab sweep` takes it.
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from .factors import load_sweep, write_sweep
from .grids import parse, runs
from .outcome import LAST_COLUMNS, OK
from .outputs import check_targets
from .sweep import sweep
from .sweep_trials import accuracy, background_pixels, search_window


class Exhibit(NamedTuple):
    """One sweep.

    Attributes
    ----------
    what : callable or str
        A function, or a chapter's name.
    grid : tuple of str
        As behind ``-p``.
    results : tuple of str
        What the table keeps of a chapter's results; empty for all that a function gives.
    """

    what: Callable[..., dict[str, float]] | str
    grid: tuple[str, ...]
    results: tuple[str, ...] = ()


SEEDS = "seed=0,1,2"
PAIRS = ("wrong_matches", "missing_matches", "due_matches")
SPOTS = ("last_missed_calm", "last_missed_hard", "missed_calm_windows", "missed_hard_windows")
GALLERY = {
    "update_rate": Exhibit(background_pixels, ("update_rate=log:0.001:0.512:10",)),
    "difference_threshold": Exhibit(background_pixels, ("difference_threshold=3,5,7,10,15,20,30,45,60,90",)),
    "background": Exhibit(background_pixels, ("update_rate=log:0.001:0.256:5", "difference_threshold=5,10,15,30,60")),
    "process_noise": Exhibit(search_window, ("jerk_intensity=log:1e4:1e13:10",)),
    "surplus": Exhibit("05_markers", ("surplus=1.0,1.25,1.5,2.0,3.0,5.0",), SPOTS),
    "ncc_threshold": Exhibit("06_matching", ("ncc_threshold=0.5:0.95:10", SEEDS), PAIRS),
    "epipolar_gate": Exhibit("06_matching", ("epipolar_gate_px=log:0.25:16.0:7", SEEDS), PAIRS),
    "noise": Exhibit(accuracy, ("read_noise=log:0.5:32.0:7", SEEDS)),
    "blur": Exhibit(accuracy, ("blur_px=0.3,0.5,0.7,1.0,1.5,2.0,3.0,4.0", SEEDS)),
    "marker_size": Exhibit(accuracy, ("marker_diameter_mm=1.0,1.5,2.0,2.5,3.0,4.0,5.0", SEEDS)),
    "distance": Exhibit(accuracy, ("distance_mm=430.0,500.0,570.0,650.0,750.0,900.0,1100.0", SEEDS)),
    "baseline": Exhibit(accuracy, ("baseline_mm=25.0,50.0,75.0,100.0,150.0,200.0,300.0", SEEDS)),
    "vergence": Exhibit(accuracy, ("vergence_deg=0.0,4.0,7.0,10.5,14.0,18.0,22.0", SEEDS)),
    "elevation": Exhibit(accuracy, ("elevation_deg=10.0:90.0:9", SEEDS)),
}


def settings(name: str) -> list[dict[str, Any]]:
    """The parameters of each run of a sweep, in the table's order. ValueError for an unknown name."""
    return runs(parse(_exhibit(name).grid))


def command(name: str) -> str:
    """What makes a table again, for a shell. ValueError for an unknown name."""
    what, grid, _ = _exhibit(name)
    if callable(what):
        return f"python -m trinolab.gallery {name}"
    grids = [part for text in grid for part in ("-p", text)]
    return shlex.join(["trinolab", "sweep", f"notebooks/{what}.ipynb", *grids, "--out", f"sweeps/{name}"])


def load(name: str) -> pd.DataFrame:
    """A shipped table, a row a run: the parameters, then the results. ValueError for an unknown name."""
    names = list(settings(name)[0])
    found = load_sweep(f"gallery/{name}")
    found.attrs["parameters"] = names
    return found


def make(name: str, workers: int = 1, kept: Path | None = None) -> pd.DataFrame:
    """Do a sweep, and return its table as `load` gives it.

    Parameters
    ----------
    name : str
        Of `GALLERY`.
    workers : int
        Processes.
    kept : path, optional
        Folder that keeps finished runs, see `sweep.sweep`.

    Raises
    ------
    ValueError
        For an unknown name; if a run fails.
    """
    exhibit, rows = _exhibit(name), settings(name)
    grid = {key: list(dict.fromkeys(row[key] for row in rows)) for key in rows[0]}
    found = sweep(exhibit.what, grid, out=kept, workers=workers)
    if len(bad := found[found["status"] != OK]):
        raise ValueError(f"{name}: {len(bad)} of {len(found)} runs failed; the first: {bad['error'].iloc[0]}")
    results = exhibit.results or [column for column in found if column not in (*grid, *LAST_COLUMNS)]
    return found[[*grid, *results]]


def _exhibit(name: str) -> Exhibit:
    if name not in GALLERY:
        raise ValueError(f"name: expected one of {', '.join(GALLERY)}, got {name!r}")
    return GALLERY[name]


def main(argv: Sequence[str] | None = None) -> int:
    """Write the tables, all at the end: a table is data, and data that have changed make finished runs stale."""
    parser = argparse.ArgumentParser(prog="python -m trinolab.gallery", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"all without it: {', '.join(GALLERY)}")
    parser.add_argument("--out", default="data/sweeps/gallery", help="folder of the tables (%(default)s)")
    parser.add_argument("--kept", default="_build/sweeps", help="folder for finished runs; a command that was stopped "
                        "goes on with them (%(default)s)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (one a core)")
    arguments = parser.parse_args(argv)
    names = list(dict.fromkeys(map(str, arguments.names))) or list(GALLERY)
    try:
        _make_all(names, arguments.workers, Path(arguments.out), Path(arguments.kept))
    except (ValueError, KeyboardInterrupt) as error:
        print(f"{parser.prog}: {str(error) or 'stopped'}", file=sys.stderr)
        return 2 if isinstance(error, ValueError) else 130
    return 0


def _make_all(names: Sequence[str], workers: int, out: Path, kept: Path) -> None:
    for name in names:
        _exhibit(name)
    check_targets(paths := [out / f"{name}.csv" for name in names])
    tables = []
    for name in names:
        print(name, file=sys.stderr)
        tables.append(make(name, workers, kept / name))
    for name, path, table in zip(names, paths, tables, strict=True):
        write_sweep(table, path)
        shutil.rmtree(kept / name)


if __name__ == "__main__":
    raise SystemExit(main())
