"""Poses joined with their truth on the frame, and the signs that the two do not belong together.

The numbers of a wrong join look like those of a right one: poses of frames 20 to 24 that are
numbered 0 to 4 err by half a hand's way, as if they had been measured badly.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from .outputs import time_text

FITS_MM = 2.0  # the median distance of poses that belong to their truth; a worse one is looked into
BETTER = 0.25  # another offset has to fit so much better, as a share of that distance
# frames by which a tracker may be late: a larger offset is a wrong join
DELAY = 5
FEWEST = 3  # poses that show an offset
MOST = 200  # poses that are held against the truth at every offset
_POSITION = ["x_mm", "y_mm", "z_mm"]

log = logging.getLogger("trinolab")


class Offset(NamedTuple):
    """Frames from the poses to the truth that they fit best, and the median distances there and
    without it, mm.
    """

    frames: int
    there_mm: float
    here_mm: float


def join(
    measured: pd.DataFrame, true: pd.DataFrame, poses: str | Path, truth: str | Path
) -> pd.DataFrame:
    """The rows of poses beside those of their truth, whose columns end in ``_true``.

    The log reports instants without a partner, poses that are late, and files that seem to be
    swapped.

    Parameters
    ----------
    measured, true : pandas.DataFrame
        Of `read_poses`.
    poses, truth : path
        Their files.

    Raises
    ------
    ValueError
        Names both files: no frame in common, times that disagree by half a frame or more, poses
        that fit the truth of frames far away.
    """
    true_poses = true[true["status"] != "lost"]
    both = measured.merge(true_poses, on="frame", suffixes=("", "_true"))
    if both.empty:
        raise ValueError(f"{poses}, {truth}: no frame in common")
    _check_times(both, f"{poses}, {truth}")
    _check_offset(best_offset(measured, true_poses), poses, truth)
    if alone := int((~measured["frame"].isin(true["frame"])).sum()):
        log.warning("%s: %d of %d frames have no truth in %s", poses, alone, len(measured), truth)
    if alone := int((~true_poses["frame"].isin(measured["frame"])).sum()):
        message = "%s: %d of %d instants have no row in %s, and count as lost"
        log.warning(message, truth, alone, len(true_poses), poses)
    if _has_sigma(true) and not _has_sigma(measured):
        log.warning(
            "%s has uncertainties, %s has none: is the truth given before the poses?", truth, poses
        )
    return both


def best_offset(measured: pd.DataFrame, true: pd.DataFrame) -> Offset | None:
    """The offset at which poses fit the truth far better than they do; None if they fit, or fit
    nowhere.

    Parameters
    ----------
    measured, true : pandas.DataFrame
        Of `read_poses`; each row of `true` has a pose.
    """
    with_pose = measured[measured["status"].isin(["measured", "ambiguous"])]
    if len(with_pose) < FEWEST:
        return None
    with_pose = with_pose.iloc[
        np.unique(np.linspace(0, len(with_pose) - 1, MOST).round().astype(int))
    ]
    true = true.sort_values("frame")
    unshifted = _distances(with_pose, true, 0)
    if len(unshifted) < FEWEST or np.median(unshifted) <= FITS_MM:
        return None
    # whatever the offset is, the middle one of the poses has a partner
    middle = int(with_pose["frame"].iloc[len(with_pose) // 2])
    best = Offset(0, float(np.median(unshifted)), float(np.median(unshifted)))
    for offset in (true["frame"] - middle).tolist():
        shifted = _distances(with_pose, true, offset)
        if len(shifted) >= max(FEWEST, 0.8 * len(unshifted)) and np.median(shifted) < best.there_mm:
            best = best._replace(frames=offset, there_mm=float(np.median(shifted)))
    fits = best.there_mm <= FITS_MM and best.there_mm <= BETTER * best.here_mm
    return best if fits else None


def _distances(held: pd.DataFrame, true: pd.DataFrame, offset: int) -> np.ndarray:
    """Distances of poses from the truth a number of frames later, mm; of those that have one."""
    frames = true["frame"].to_numpy()
    wanted = held["frame"].to_numpy() + offset
    place = np.minimum(np.searchsorted(frames, wanted), len(frames) - 1)
    has = frames[place] == wanted
    apart = held[_POSITION].to_numpy()[has] - true[_POSITION].to_numpy()[place[has]]
    return np.linalg.norm(apart, axis=1)


def _check_times(both: pd.DataFrame, where: str) -> None:
    """Refuse times that are half a frame or more apart; where one file has none they say
    nothing.
    """
    if not {"t_s", "t_s_true"} <= set(both):
        return
    timed = both[["frame", "t_s", "t_s_true"]].dropna().sort_values("frame")
    if len(timed) < 2:
        return
    period = float(np.median(np.diff(timed["t_s_true"]) / np.diff(timed["frame"])))
    apart = (timed["t_s"] - timed["t_s_true"]).abs()
    if period > 0 and (apart >= 0.5 * period).any():
        wrong = timed[apart >= 0.5 * period].iloc[0]
        raise ValueError(
            f"{where}: frame {int(wrong['frame'])} is at {time_text(wrong['t_s'])} s in the one and at "
            f"{time_text(wrong['t_s_true'])} s in the other; their frames do not belong together"
        )


def _check_offset(offset: Offset | None, poses: str | Path, truth: str | Path) -> None:
    if offset is None:
        return
    when = f"{abs(offset.frames)} frames {'later' if offset.frames > 0 else 'earlier'}"
    message = (
        f"the poses fit the truth {when} far better (median {offset.there_mm:.3g} mm instead of "
        f"{offset.here_mm:.3g})"
    )
    if abs(offset.frames) > DELAY:
        raise ValueError(f"{poses}, {truth}: {message}; their frames do not belong together")
    log.warning("%s: %s: they are delayed, or numbered otherwise than %s", poses, message, truth)


def _has_sigma(table: pd.DataFrame) -> bool:
    """Whether a table says how sure its poses are, as an estimate does and a truth does not."""
    return "sigma_mm" in table and bool((table["sigma_mm"] > 0).any())
