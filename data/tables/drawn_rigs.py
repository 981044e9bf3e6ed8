"""Rig files that are off, and three sets of frames: the errors of the poses, and their covariances.

    python -m workbench.studies drawn_rigs

makes ``drawn_rigs.csv`` again. The images are those of `second_renderer`: stills of a handle that a
path tracer has rendered, which takes Mitsuba 3 where they are not kept, and those of our own bench at
the same poses. The third set, path-traced as well, judges what was chosen on these: see
`second.recipe`. Each image is measured with the rig as it is, and with rig files that are off by drawn
amounts, good and bad ones. A file states how far it may be off, or it says nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from second_renderer import our_instant, recorded

from satellites.second import recipe
from trinolab.camera import Rig
from trinolab.datasets import load_handle
from trinolab.files.poses import poses_by_frame, read_poses
from trinolab.files.recording import instants, open_folder
from trinolab.handle import Handle
from trinolab.pose import Pose
from workbench.intervals import of_ratio
from workbench.studies import stress
from workbench.studies.broken import believed
from workbench.studies.carrier import all_runs
from workbench.studies.drawn_rigs import THIRD
from workbench.studies.replication import EVERY, deviation, measure_instant
from workbench.studies.second_renderer import OURS, SECOND

RIGS = ("paper_pair", "raised_40deg")
SEED = 61  # of the draws
SEEDS = {SECOND: SEED, OURS: SEED, THIRD: 62}


class Level(NamedTuple):
    """How far a rig file is off: standard deviations of principal points, px, and of directions, deg;
    and whether the file states them.
    """

    off_px: float
    off_deg: float
    stated: bool


EXACT = Level(0.0, 0.0, True)
LEVELS = (
    EXACT,
    Level(0.1, 0.005, True),
    Level(0.1, 0.005, False),
    Level(0.3, 0.02, True),
    Level(0.3, 0.02, False),
)


def trial(renderer: str, handle: str, instant: int, draws: int, kept: str) -> dict[str, float]:
    """All that one instant gives, as sums that add up.

    Parameters
    ----------
    renderer : {"second", "bench", "third"}
    handle : str
        A shipped one of the recipe. Where it has look-alikes the true pose chooses among them, and
        nothing else.
    instant : int
        Of the set of frames.
    draws : int
        Rig files of each size. A draw has one direction of error, which the sizes scale; renderers,
        handles, estimators, and what is stated, are compared on the same draws.
    kept : str
        Folder of the recordings, see `second_renderer.recorded`.

    Returns
    -------
    dict
        For each rig, level, estimator and quantity of `sums` a number, named
        ``rig/level/estimator/quantity``; levels go by their numbers.
    """
    stills = "third" if renderer == THIRD else "stills"
    folder = recorded(f"{stills}-{handle}", Path(kept))
    the_handle = load_handle(handle)
    T = poses_by_frame(read_poses(folder / "truth.csv"))[instant]
    if renderer == OURS:
        images = our_instant(instant, T, the_handle)
    else:
        images = next(instants(open_folder(folder)[0], instant)).images
    results = {}
    rigs = recipe.rigs()
    for name, (number, level) in product(RIGS, enumerate(LEVELS)):
        files = drawn(rigs[name], level, instant, draws, SEEDS[renderer])
        poses = _measured(recipe.by_rig(images, name), files, the_handle, T)
        for estimator, found in poses.items():
            for quantity, value in sums(found, T, the_handle).items():
                results[f"{name}/{number}/{estimator}/{quantity}"] = value
    return results


def drawn(rig: Rig, level: Level, instant: int, draws: int, seed: int = SEED) -> Iterator[Rig]:
    """What rig files say of a rig; one that is exact says one thing."""
    if level == EXACT:
        yield rig
        return
    for draw in range(draws):
        yield believed(rig, *level, np.random.default_rng([seed, instant, draw]))


def _measured(
    images: list[np.ndarray], files: Iterator[Rig], handle: Handle, T: RigidTransform
) -> dict[str, list[Pose]]:
    """The poses by each estimator, of the images of one instant with several rig files."""
    poses: dict[str, list[Pose]] = {name: [] for name in EVERY}
    for rig in files:
        for name, pose in measure_instant(images, rig, handle, EVERY, T).items():
            poses[name].append(pose)
    return poses


def sums(poses: Sequence[Pose], truth: RigidTransform, handle: Handle) -> dict[str, float]:
    """The quantities of `stress.sums`."""
    return stress.sums([deviation(pose, truth, handle) for pose in poses])


def make_table(draws: int, workers: int, kept: Path) -> pd.DataFrame:
    """A row for each renderer, rig, handle, level and estimator.

    Parameters
    ----------
    draws : int
        Rig files of each size for each of thirty poses.
    workers : int
        Processes.
    kept : Path
        Folder of the recordings, and of finished instants; a call that was stopped goes on with
        them.

    Returns
    -------
    pandas.DataFrame
        Columns: `renderer`, `rig`, `handle`, `estimator`, `off_px`, `off_deg`, `stated`; then those of
        `stress.make_tables`; the interval of 95 % of the mean `nees` by the bootstrap over poses.

    Raises
    ------
    ValueError
        If Mitsuba is not installed where a recording is missing, a recording cannot be written or
        read, or an instant fails.
    """
    for stills, handle in product(("stills", "third"), recipe.HANDLES):
        recorded(f"{stills}-{handle}", kept)
    poses = range(len(recipe.stills(recipe.HANDLES[0]).truth))
    grid: dict[str, Sequence] = {
        "renderer": list(SEEDS),
        "handle": list(recipe.HANDLES),
        "instant": list(poses),
        "draws": [draws],
        "kept": [str(kept)],
    }
    runs = all_runs("drawn_rigs", trial, grid, kept / "drawn_rigs", workers, yes=True)
    rows = [
        {"renderer": renderer, "rig": rig, "handle": handle, "estimator": estimator}
        | level._asdict()
        | row(part, f"{rig}/{number}/{estimator}", SEEDS[renderer])
        for (renderer, handle), part in runs.groupby(["renderer", "handle"], sort=False)
        for rig, (number, level), estimator in product(RIGS, enumerate(LEVELS), EVERY)
    ]
    return pd.DataFrame(rows)


def row(instants: pd.DataFrame, name: str, seed: int = SEED) -> dict[str, float]:
    """The row of some instants, of the columns whose names begin so."""
    low, high, _ = of_ratio(instants[f"{name}/nees"], instants[f"{name}/measured"], seed)
    return stress.judged(instants, name) | {"seed": seed, "nees_low": low, "nees_high": high}
