"""The simulated bench broken on purpose, one thing at a time: what the estimators give then, and
what they say of it.

    python -m workbench.studies stress

makes ``stress.csv`` and ``stress_silent.csv`` again. Random poses at which CCD1 and CCD2 share four
markers are rendered with one fault of `broken`, and measured with two cameras and with CCD3 at 40 deg:
with the rig as its file states it, and with one of which nothing is stated, which stands for a
calibration of usual quality. Only a window of each image around the handle is rendered and searched, as
a tracker does it: a tenth of the work. A round has `BLOCK` instants of each fault and handle, drawn from
generators of their own; rounds are kept, and more of them later add to those that there are.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from trinolab.bench.layer import cropped
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import Handle
from trinolab.methods import BEST
from trinolab.parameters import Parameters

from ..intervals import highest_share, of_ratio, of_sums
from .broken import FAULTS, Instant, Taken
from .carrier import all_runs
from .replication import (
    CHECKED,
    EVERY,
    WRONG_DEG,
    WRONG_MM,
    Deviation,
    deviation,
    measure_instant,
    shared_poses,
)

RIGS = {"paper_pair": 2, "raised_40deg": 3}  # how many of the cameras that take the frames
HANDLES = ("coded", "paper")
STATED, SILENT = "stated", "silent"  # what the rig's file says of its errors: what it does, nothing
# The faults of the calibration itself are silent, or stated, already.
SILENT_FAULTS = tuple(name for name in FAULTS if not name.startswith("calibration"))
# Faults of where and when the cameras look: an image by itself does not show them.
GEOMETRY = (
    "rolling shutter 10 ms",
    "calibration 0.1 px, 0.005 deg",
    "calibration 0.3 px, 0.02 deg",
    "frames 5 ms apart",
    "calibration 0.1 px, 0.005 deg, stated",
    "calibration 0.3 px, 0.02 deg, stated",
)
BLOCK = 10  # instants
SEED = 15
# All estimators measure the first rounds, two the others: the paper's with its check, and the best.
FIRST_ROUNDS = 2
OFTEN = (CHECKED, BEST)
WINDOW_PX = 320  # a side; the markers and half a marker's distance beside them
SIGMAS = 5.0  # off by more of them is beyond what a pose says of itself


def trial(fault: str, handle: str, block: int) -> dict[str, float]:
    """One block of instants with a fault, as sums that add up.

    Parameters
    ----------
    fault : str
        Of `FAULTS`.
    handle : str
        A shipped one. Where it has look-alikes the true pose chooses among them, and nothing else.
    block : int
        The round that it belongs to.

    Returns
    -------
    dict
        For each rig, estimator and quantity of `sums` a number, named
        ``stated/rig/estimator/quantity``, and ``silent/...`` for the faults of `SILENT_FAULTS`.

    Raises
    ------
    ValueError
        For an unknown fault or handle.
    """
    truths, taken = instants(fault, handle, block)
    files = {STATED: taken}
    if fault in SILENT_FAULTS:
        files[SILENT] = [one._replace(rig=replace(one.rig, covariance=None)) for one in taken]
    methods = EVERY if block < FIRST_ROUNDS else {name: EVERY[name] for name in OFTEN}
    results = {}
    for (file, seen), (rig, count) in product(files.items(), RIGS.items()):
        found = _measured(seen, count, truths, load_handle(handle), methods)
        for estimator, deviations in found.items():
            for name, value in sums(deviations).items():
                results[f"{file}/{rig}/{estimator}/{name}"] = value
    return results


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


def _measured(
    taken: Sequence[Taken],
    count: int,
    truths: Sequence[RigidTransform],
    handle: Handle,
    methods: Mapping[str, Parameters],
) -> dict[str, list[Deviation]]:
    """The estimators' deviations, with the first cameras; each instant may have a rig of its own."""
    deviations: dict[str, list[Deviation]] = {name: [] for name in methods}
    for one, T in zip(taken, truths, strict=True):
        rig = one.rig.part(range(count))
        poses = measure_instant(one.frames[:count], rig, handle, methods, T)
        for name, pose in poses.items():
            deviations[name].append(deviation(pose, T, handle))
    return deviations


SUMS = (
    "n",
    "measured",
    "wrong",
    "unforeseen",
    "beyond",
    "nees",
    *(
        f"{what}_{unit}"
        for unit in ("mm", "deg")
        for what in ("sum", "squares", "ratios", "largest")
    ),
)


def sums(deviations: Sequence[Deviation]) -> dict[str, float]:
    """The quantities of `SUMS`, where ``ratios`` are squares of error by sigma; and ``nees_0``,
    ``nees_1``, ...: each one's, NaN where it is not measured.
    """
    measured = [one for one in deviations if one.measured]
    totals = {
        "n": float(len(deviations)),
        "measured": float(len(measured)),
        "wrong": float(sum(one.wrong for one in measured)),
        "unforeseen": float(sum(unforeseen(one) for one in measured)),
        "beyond": float(sum(beyond(one) for one in measured)),
        "nees": float(sum(one.nees for one in measured)),
    }
    for unit in ("mm", "deg"):
        errors = np.array([getattr(one, unit) for one in measured])
        sigmas = np.array([getattr(one, f"sigma_{unit}") for one in measured])
        totals[f"sum_{unit}"] = float(errors.sum())
        totals[f"squares_{unit}"] = float((errors**2).sum())
        totals[f"ratios_{unit}"] = float(((errors / sigmas) ** 2).sum())
        totals[f"largest_{unit}"] = float(errors.max(initial=0.0))
    return totals | {f"nees_{k}": one.nees for k, one in enumerate(deviations)}


def unforeseen(one: Deviation) -> bool:
    """Whether a pose is a false one, and more than five of its own sigmas off where it is."""
    return (one.mm > max(WRONG_MM, SIGMAS * one.sigma_mm)) or (
        one.deg > max(WRONG_DEG, SIGMAS * one.sigma_deg)
    )


def beyond(one: Deviation) -> bool:
    """Whether a pose is more than five of its own sigmas off, however little that is."""
    return one.mm > SIGMAS * one.sigma_mm or one.deg > SIGMAS * one.sigma_deg


def make_tables(
    instants: int, workers: int, kept: Path | None
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The table of rigs as their files state them, and that of silent files: all faults, or those of
    `SILENT_FAULTS`, and both handles, a row for each of them, each rig and each estimator.

    Parameters
    ----------
    instants : int
        Of a fault and handle; whole rounds are computed.
    workers : int
        Processes.
    kept : path, optional
        Folder that keeps finished rounds, see `sweep.runs.sweep`.

    Returns
    -------
    tuple of pandas.DataFrame
        Columns: `fault`, `rig`, `handle`, `estimator`; instants `n`, of them `measured`, and of
        these `wrong`, off by more than 2 mm or 5 deg, with `wrong_share_below`, the upper 95 % bound
        of the share of all instants; for mm and deg the mean of the error with its 95 % interval,
        the largest one, and the rms of error by reported sigma; `seed`; `unforeseen`, those of the
        wrong ones that are off by more than five of their own sigmas as well; the 95 % interval of
        the rms of error by sigma, by the bootstrap over blocks; of the joint NEES of what is
        measured the mean `nees` and the quantiles `nees_95` and `nees_99`; how many of these are
        `beyond` five of their own sigmas, however little that is.

    Raises
    ------
    ValueError
        If a block fails.
    """
    rounds = [
        _round(k, workers, None if kept is None else kept / f"round_{k}")
        for k in range(-(-instants // BLOCK))
    ]
    blocks = pd.concat(rounds)
    silent = blocks[blocks["fault"].isin(SILENT_FAULTS)]
    return _rows(blocks, STATED), _rows(silent, SILENT)


def _round(number: int, workers: int, kept: Path | None) -> pd.DataFrame:
    """A block of each fault and handle."""
    print(f"round {number}", file=sys.stderr)
    grid: dict[str, list] = {"fault": list(FAULTS), "handle": list(HANDLES), "block": [number]}
    return all_runs("stress", trial, grid, kept, workers, yes=True)


def _rows(blocks: pd.DataFrame, file: str) -> pd.DataFrame:
    """A row for each fault, handle, rig and estimator."""
    rows = [
        {"fault": fault, "rig": rig, "handle": handle, "estimator": estimator}
        | judged(part, f"{file}/{rig}/{estimator}")
        for (fault, handle), part in blocks.groupby(["fault", "handle"], sort=False)
        for rig in RIGS
        for estimator in EVERY
    ]
    return pd.DataFrame(rows)


def judged(blocks: pd.DataFrame, name: str) -> dict[str, float]:
    """The row of some blocks; those that an estimator has not measured do not count."""
    mine = blocks[blocks[f"{name}/n"].notna()]
    total = {what: float(mine[f"{name}/{what}"].sum()) for what in SUMS}
    n, measured, wrong = (int(total[what]) for what in ("n", "measured", "wrong"))
    row: dict[str, float] = {
        "n": n,
        "measured": measured,
        "wrong": wrong,
        "wrong_share_below": highest_share(wrong, n),
    }
    counts = mine[f"{name}/measured"]
    for unit in ("mm", "deg"):
        row[f"mean_{unit}"] = total[f"sum_{unit}"] / measured if measured else np.nan
        low, high, _ = of_sums(total[f"sum_{unit}"], total[f"squares_{unit}"], measured)
        row[f"low_{unit}"], row[f"high_{unit}"] = low, high
        row[f"largest_{unit}"] = float(mine[f"{name}/largest_{unit}"].max())
        row[f"error_by_sigma_{unit}"] = (
            np.sqrt(total[f"ratios_{unit}"] / measured) if measured else np.nan
        )
    row["seed"] = SEED
    row["unforeseen"] = int(total["unforeseen"])
    for unit in ("mm", "deg"):
        low, high = np.sqrt(of_ratio(mine[f"{name}/ratios_{unit}"], counts, SEED)[:2])
        row[f"error_by_sigma_low_{unit}"], row[f"error_by_sigma_high_{unit}"] = low, high
    each = mine.filter(like=f"{name}/nees_").stack().dropna()
    row["nees"] = total["nees"] / measured if measured else np.nan
    row["nees_95"], row["nees_99"] = each.quantile([0.95, 0.99])
    row["beyond"] = int(total["beyond"])
    return row


def by_fault(table: pd.DataFrame, rig: str, estimator: str) -> pd.DataFrame:
    """The shipped table for a reader: a row per fault, both handles together.

    Parameters
    ----------
    table : pandas.DataFrame
        Of `make_tables`.
    rig, estimator : str
        Whose rows are shown.

    Returns
    -------
    pandas.DataFrame
        The fault; instants `n`; the share `measured`; how many were `wrong`, the upper 95 % bound of
        their share, how many of them were `unforeseen`, and how many of all `beyond` five sigmas, see
        `make_tables`; mean error and rms of error by reported sigma for mm and deg; mean NEES.
    """
    rows = []
    mine = table[(table["rig"] == rig) & (table["estimator"] == estimator)]
    for fault, both in mine.groupby("fault", sort=False):
        n, measured, wrong = (int(both[name].sum()) for name in ("n", "measured", "wrong"))
        share = both["measured"] / max(measured, 1)
        row: dict[str, Any] = {
            "fault": fault,
            "n": n,
            "measured": measured / n,
            "wrong": wrong,
            "wrong, at most": highest_share(wrong, n),
            "unforeseen": int(both["unforeseen"].sum()),
            "beyond": int(both["beyond"].sum()),
        }
        for unit in ("mm", "deg"):
            squares = both[f"error_by_sigma_{unit}"] ** 2
            row[unit] = float((both[f"mean_{unit}"] * share).sum()) if measured else np.nan
            row[f"by sigma, {unit}"] = (
                float(np.sqrt((squares * share).sum())) if measured else np.nan
            )
        row["NEES"] = float((both["nees"] * share).sum()) if measured else np.nan
        rows.append(row)
    return pd.DataFrame(rows)
