"""The simulated bench broken on purpose, one thing at a time: what the estimators give then, and
what they say of it.

    python -m trinolab.studies stress

makes ``stress.csv`` again. Random poses at which CCD1 and CCD2 share four markers are rendered with
one fault of `broken`, and measured by every estimator, with two cameras and with CCD3 at 40 deg. A
block of instants is drawn from its own generator, so that blocks may be computed in any order,
kept, and added up.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from scipy.stats import beta

from ..camera import Rig
from ..datasets import load_handle, load_rig
from ..handle import Handle
from ..methods import ESTIMATORS
from ..sweep import sweep
from ..sweep.outcome import OK
from .broken import FAULTS, Instant, Taken
from .replication import EVERY, Deviation, deviation, measure_frames, shared_poses

RIGS = {"paper_pair": 2, "raised_40deg": 3}  # how many of the cameras that take the frames
HANDLES = ("coded", "paper")
BLOCK = 10  # instants
SEED = 15


def trial(fault: str, handle: str, block: int) -> dict[str, float]:
    """One block of instants with a fault, as sums that add up.

    Parameters
    ----------
    fault : str
        Of `FAULTS`.
    handle : str
        A shipped one. Where it has look-alikes the true pose chooses among them, and nothing else.
    block : int
        Its number.

    Returns
    -------
    dict
        For each rig, estimator and quantity of `SUMS` a number, named ``rig/estimator/quantity``.

    Raises
    ------
    ValueError
        For an unknown fault or handle.
    """
    if fault not in FAULTS:
        raise ValueError(f"fault: expected one of {', '.join(FAULTS)}, got {fault!r}")
    the_handle = load_handle(handle)
    places = list(FAULTS).index(fault), HANDLES.index(handle)
    rng = np.random.default_rng([SEED, *places, block])
    truths = list(islice(shared_poses(load_rig("paper_pair"), the_handle, rng), BLOCK))
    every = load_rig("raised_40deg")
    taken = [FAULTS[fault](Instant(every, the_handle, T), rng) for T in truths]
    found = {}
    for rig, count in RIGS.items():
        for estimator, deviations in _measured(taken, count, truths, the_handle).items():
            for name, value in _sums(deviations).items():
                found[f"{rig}/{estimator}/{name}"] = value
    return found


def _measured(
    taken: Sequence[Taken], count: int, truths: Sequence[RigidTransform], handle: Handle
) -> dict[str, list[Deviation]]:
    """Every estimator's deviations, with the first cameras; each instant may have a rig of its own."""
    found: dict[str, list[Deviation]] = {name: [] for name in EVERY}
    for one, T in zip(taken, truths, strict=True):
        rig = Rig(one.rig.cameras[:count])
        priors = [T] if len(handle.symmetries) > 1 else None
        measurements = measure_frames([one.frames[:count]], rig, handle, EVERY, priors)
        for name, (measurement,) in measurements.items():
            found[name].append(deviation(measurement.pose, T, handle))
    return found


SUMS = (
    "n",
    "measured",
    "wrong",
    *(
        f"{what}_{unit}"
        for unit in ("mm", "deg")
        for what in ("sum", "squares", "ratios", "largest")
    ),
)


def _sums(deviations: Sequence[Deviation]) -> dict[str, float]:
    """The quantities of `SUMS`; ``ratios`` are squares of error by sigma."""
    held = [one for one in deviations if one.measured]
    found = {
        "n": float(len(deviations)),
        "measured": float(len(held)),
        "wrong": float(sum(one.wrong for one in held)),
    }
    for unit in ("mm", "deg"):
        errors = np.array([getattr(one, unit) for one in held])
        sigmas = np.array([getattr(one, f"sigma_{unit}") for one in held])
        found[f"sum_{unit}"] = float(errors.sum())
        found[f"squares_{unit}"] = float((errors**2).sum())
        found[f"ratios_{unit}"] = float(((errors / sigmas) ** 2).sum())
        found[f"largest_{unit}"] = float(errors.max(initial=0.0))
    return found


def make_table(instants: int, workers: int, kept: Path | None) -> pd.DataFrame:
    """All faults and both handles, a row for each of them, each rig and each estimator.

    Parameters
    ----------
    instants : int
        Of a fault and handle; whole blocks are computed.
    workers : int
        Processes.
    kept : path, optional
        Folder that keeps finished blocks, see `sweep.runs.sweep`.

    Returns
    -------
    pandas.DataFrame
        Columns: `fault`, `rig`, `handle`, `estimator`; instants `n`, of them `measured`, and of
        these `wrong`, with `wrong_share_below`, the upper 95 % bound of the share of all instants;
        for mm and deg the mean of the error with its 95 % interval, the largest one, and the rms of
        error by reported sigma.

    Raises
    ------
    ValueError
        If a block fails.
    """
    grid = {
        "fault": list(FAULTS),
        "handle": list(HANDLES),
        "block": list(range(-(-instants // BLOCK))),
    }
    blocks = sweep(trial, grid, out=kept, workers=workers, yes=True)
    if len(bad := blocks[blocks["status"] != OK]):
        raise ValueError(f"stress: {len(bad)} blocks failed; the first: {bad['error'].iloc[0]}")
    rows = [
        {"fault": fault, "rig": rig, "handle": handle, "estimator": estimator}
        | _judged(part, f"{rig}/{estimator}")
        for (fault, handle), part in blocks.groupby(["fault", "handle"], sort=False)
        for rig in RIGS
        for estimator in ESTIMATORS
    ]
    return pd.DataFrame(rows)


def _judged(blocks: pd.DataFrame, name: str) -> dict[str, float]:
    """The row of some blocks."""
    total = {what: float(blocks[f"{name}/{what}"].sum()) for what in SUMS}
    n, held, wrong = (int(total[what]) for what in ("n", "measured", "wrong"))
    row = {"n": n, "measured": held, "wrong": wrong, "wrong_share_below": share_below(wrong, n)}
    for unit in ("mm", "deg"):
        mean = total[f"sum_{unit}"] / held if held else np.nan
        spread = np.sqrt(max(total[f"squares_{unit}"] / max(held, 1) - mean**2, 0.0) / max(held, 1))
        row[f"mean_{unit}"] = mean
        row[f"low_{unit}"], row[f"high_{unit}"] = mean - 1.96 * spread, mean + 1.96 * spread
        row[f"largest_{unit}"] = float(blocks[f"{name}/largest_{unit}"].max())
        row[f"error_by_sigma_{unit}"] = np.sqrt(total[f"ratios_{unit}"] / held) if held else np.nan
    return row


def share_below(count: int, n: int) -> float:
    """The upper 95 % bound of a share of which `count` of `n` were seen; for none of many about 3 / n.

    Clopper and Pearson 1934, one-sided (DOI 10.1093/biomet/26.4.404).
    """
    return float(beta.ppf(0.95, count + 1, n - count)) if count < n else 1.0
