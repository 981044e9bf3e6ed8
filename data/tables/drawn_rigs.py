"""Rig files that are off, and three sets of frames: the errors of the poses, and their covariances.

    python -m workbench.studies drawn_rigs

makes ``drawn_rigs.csv`` again. The images are those of `second_renderer`: stills of a handle that a
path tracer has rendered, which takes Mitsuba 3 where they are not kept, and those of our own bench at
the same poses. The third set, path-traced as well, judges what was chosen on these: see
`second.recipe`. Each image is measured with the rig as it is, and with rig files that are off by drawn
amounts, good and bad ones. A file states how far it may be off, or it says nothing.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from second_renderer import INSTANTS, recorded, seen
from stress import as_row, judged, over_blocks

from satellites.second import recipe
from trinolab.camera import Rig
from trinolab.datasets import load_handle
from workbench.studies.broken import believed
from workbench.studies.carrier import Row, Table
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


def trial(renderer: str, handle: str, instant: int, kept: str, draw: int) -> list[Row]:
    """An instant with one file of each level: a row per rig, level and estimator.

    Parameters
    ----------
    renderer : {"second", "bench", "third"}
    handle : str
        A shipped one of the recipe. Where it has look-alikes the true pose chooses among them, and
        nothing else.
    instant : int
        Of the set of frames.
    kept : str
        Folder of the recordings, see `second_renderer.recorded`.
    draw : int
        Of the direction of error, which the levels scale; renderers, handles, estimators, and what
        is stated, are compared on the same draws. A file that is exact is one, of the first draw.
    """
    the_handle = load_handle(handle)
    images, T = seen(renderer, handle, instant, Path(kept))
    rigs = recipe.rigs()
    rows: list[Row] = []
    for name, level in product(RIGS, LEVELS):
        if level == EXACT and draw > 0:
            continue
        file = drawn(rigs[name], level, instant, draw, SEEDS[renderer])
        poses = measure_instant(recipe.by_rig(images, name), file, the_handle, EVERY, T)
        for estimator, pose in poses.items():
            keys = {"rig": name, "estimator": estimator, **level._asdict(), "block": instant}
            rows.append(keys | as_row(deviation(pose, T, the_handle)))
    return rows


def drawn(rig: Rig, level: Level, instant: int, draw: int, seed: int = SEED) -> Rig:
    """What a rig file says of a rig."""
    if level == EXACT:
        return rig
    return believed(rig, *level, np.random.default_rng([seed, instant, draw]))


def row(rows: pd.DataFrame) -> Row:
    """`stress.judged`, and the 95 % interval of the mean `nees` by the bootstrap over instants."""
    seed = SEEDS[rows["renderer"].iloc[0]]
    low, high, _ = over_blocks(rows, rows["nees"], seed)
    return {**judged(rows), "seed": seed, "nees_low": low, "nees_high": high}


def table(kept: Path) -> Table:
    """The table, of the recordings in a folder."""
    return Table(
        "drawn_rigs",
        trial,
        [
            {
                "renderer": list(SEEDS),
                "handle": recipe.HANDLES,
                "instant": range(INSTANTS),
                "kept": [str(kept)],
            }
        ],
        by=("renderer", "rig", "handle", "estimator", *Level._fields),
        draws=4,
        summary=row,
        again={"renderer": OURS, "handle": "coded"},
    )


def make_table(draws: int, workers: int, kept: Path) -> pd.DataFrame:
    """Render what is not there yet, then compute the table.

    Raises
    ------
    ValueError
        If Mitsuba is not installed where a recording is missing, or a recording cannot be written or
        read.
    """
    for stills, handle in product(("stills", "third"), recipe.HANDLES):
        recorded(f"{stills}-{handle}", kept)
    return table(kept).make(draws, workers, kept)
