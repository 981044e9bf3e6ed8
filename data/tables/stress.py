"""The simulated bench broken on purpose, one thing at a time: what the estimators give then, and
what they say of it.

Random poses at which CCD1 and CCD2 share four markers are rendered with one fault of
`workbench.studies.broken`, and measured with two cameras and with CCD3 at 40 deg: with the rig as its
file states it, and with one of which nothing is stated, which stands for a calibration of usual
quality. Only a window of each image around the handle is rendered and searched, as a tracker does it:
a tenth of the work. A draw is a block of `BLOCK` instants, from a generator of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice, product
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from trinolab.bench.layer import cropped
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.methods import BEST
from workbench.intervals import Interval, highest_share, of_ratio, of_sums
from workbench.studies.broken import FAULTS, Instant, Taken
from workbench.studies.carrier import Row, Table
from workbench.studies.replication import (
    CHECKED,
    EVERY,
    WRONG_DEG,
    WRONG_MM,
    Deviation,
    deviation,
    measure_instant,
    shared_poses,
)
from workbench.studies.stress import SEED

RIGS = {"paper_pair": 2, "raised_40deg": 3}  # how many of the cameras that take the frames
HANDLES = ("coded", "paper")
# The faults of the calibration itself are silent, or stated, already.
SILENT_FAULTS = tuple(name for name in FAULTS if not name.startswith("calibration"))
BLOCK = 10  # instants
DRAWS = 4
# All estimators measure the first draws, two the others: the paper's with its check, and the best.
FIRST_DRAWS = 2
OFTEN = (CHECKED, BEST)
WINDOW_PX = 320  # a side; the markers and half a marker's distance beside them
SIGMAS = 5.0  # off by more of them is beyond what a pose says of itself


def trial(fault: str, handle: str, silent: bool, draw: int) -> list[Row]:
    """A block of instants with a fault: a row per rig, instant and estimator.

    Parameters
    ----------
    fault : str
        Of `FAULTS`.
    handle : str
        A shipped one. Where it has look-alikes the true pose chooses among them, and nothing else.
    silent : bool
        Whether the rig's file says nothing of its errors, or what it does.
    draw : int
        Of the block.

    Raises
    ------
    ValueError
        For an unknown fault or handle.
    """
    methods = EVERY if draw < FIRST_DRAWS else {name: EVERY[name] for name in OFTEN}
    the_handle = load_handle(handle)
    truths, taken = instants(fault, handle, draw)
    rows: list[Row] = []
    for (name, count), (T, one) in product(RIGS.items(), zip(truths, taken, strict=True)):
        rig = one.rig.part(range(count))
        if silent:
            rig = replace(rig, covariance=None)
        poses = measure_instant(one.frames[:count], rig, the_handle, methods, T)
        for estimator, pose in poses.items():
            off = as_row(deviation(pose, T, the_handle))
            rows.append({"rig": name, "estimator": estimator, "block": draw, **off})
    return rows


def instants(fault: str, handle: str, block: int) -> tuple[list[RigidTransform], list[Taken]]:
    """A block's true poses, and the frames of all cameras; parameters and errors as for `trial`."""
    if fault not in FAULTS:
        raise ValueError(f"fault: expected one of {', '.join(FAULTS)}, got {fault!r}")
    the_handle = load_handle(handle)
    places = list(FAULTS).index(fault), HANDLES.index(handle)
    rng = np.random.default_rng([SEED, *places, block])
    truths = list(islice(shared_poses(load_rig("paper_pair"), the_handle, rng), BLOCK))
    every = load_rig("raised_40deg")
    taken = [FAULTS[fault](Instant(watched(every, T), the_handle, T), rng) for T in truths]
    return truths, taken


def watched(rig: Rig, T_world_handle: RigidTransform) -> Rig:
    """The rig's cameras as windows around the handle's origin, inside their images."""
    return replace(rig, cameras=tuple(_window(camera, T_world_handle) for camera in rig.cameras))


def _window(camera: Camera, T_world_handle: RigidTransform) -> Camera:
    (uv,) = np.rint(camera.project(T_world_handle.translation[None])).astype(int)
    u, v = np.clip(uv - WINDOW_PX // 2, 0, np.array(camera.size) - WINDOW_PX)
    return cropped(camera, (int(u), int(v)), (WINDOW_PX, WINDOW_PX))


def as_row(one: Deviation) -> dict[str, Any]:
    """A deviation, and what `judged` counts."""
    return {
        **one._asdict(),
        "measured": one.measured,
        "wrong": one.wrong,
        "unforeseen": unforeseen(one),
        "beyond": beyond(one),
    }


def unforeseen(one: Deviation) -> bool:
    """Whether a pose is a false one, and more than five of its own sigmas off where it is."""
    return (one.mm > max(WRONG_MM, SIGMAS * one.sigma_mm)) or (
        one.deg > max(WRONG_DEG, SIGMAS * one.sigma_deg)
    )


def beyond(one: Deviation) -> bool:
    """Whether a pose is more than five of its own sigmas off, however little that is."""
    return one.mm > SIGMAS * one.sigma_mm or one.deg > SIGMAS * one.sigma_deg


def judged(rows: pd.DataFrame) -> Row:
    """What instants say together.

    Parameters
    ----------
    rows : pandas.DataFrame
        Of `as_row`, and the `block` of each.

    Returns
    -------
    dict
        Instants `n`, of them `measured`, and of these `wrong`, off by more than 2 mm or 5 deg, with
        `wrong_share_below`, the upper 95 % bound of the share of all instants; for mm and deg the
        mean of the error with its 95 % interval, the largest one, and the rms of error by reported
        sigma; `seed`; `unforeseen`, those of the wrong ones that are off by more than five of their
        own sigmas as well; the 95 % interval of the rms of error by sigma, by the bootstrap over
        blocks; of the joint NEES of what is measured the mean `nees` and the quantiles `nees_95` and
        `nees_99`; how many of these are `beyond` five of their own sigmas, however little that is.
    """
    found = rows[rows["measured"]]
    n, wrong = len(rows), int(rows["wrong"].sum())
    row: dict[str, float] = {
        "n": n,
        "measured": len(found),
        "wrong": wrong,
        "wrong_share_below": highest_share(wrong, n),
    }
    ratios = {unit: (rows[unit] / rows[f"sigma_{unit}"]) ** 2 for unit in ("mm", "deg")}
    for unit, squares in ratios.items():
        errors = found[unit]
        row[f"mean_{unit}"] = errors.mean()
        low, high, _ = of_sums(errors.sum(), (errors**2).sum(), len(found))
        row[f"low_{unit}"], row[f"high_{unit}"] = low, high
        row[f"largest_{unit}"] = errors.max()
        row[f"error_by_sigma_{unit}"] = np.sqrt(squares.mean())
    row["seed"] = SEED
    row["unforeseen"] = int(rows["unforeseen"].sum())
    for unit, squares in ratios.items():
        low, high = np.sqrt(over_blocks(rows, squares, SEED)[:2])
        row[f"error_by_sigma_low_{unit}"], row[f"error_by_sigma_high_{unit}"] = low, high
    row["nees"] = found["nees"].mean()
    row["nees_95"], row["nees_99"] = found["nees"].quantile([0.95, 0.99])
    row["beyond"] = int(rows["beyond"].sum())
    return row


def over_blocks(rows: pd.DataFrame, values: Sequence[float] | pd.Series, seed: int) -> Interval:
    """The interval of the mean of values of what is measured, by drawing blocks again."""
    sums = rows.assign(values=values).groupby("block")[["values", "measured"]].sum()
    return of_ratio(sums["values"], sums["measured"], seed)


def table(name: str, faults: Sequence[str], silent: bool) -> Table:
    return Table(
        name,
        trial,
        [{"fault": faults, "handle": HANDLES, "silent": [silent]}],
        by=("fault", "rig", "handle", "estimator"),
        draws=DRAWS,
        summary=judged,
        again={"fault": "none", "handle": "coded"},
    )


TABLES = [
    table("stress", tuple(FAULTS), silent=False),
    table("stress_silent", SILENT_FAULTS, silent=True),
]
