"""The estimators on frames of the second renderer, beside frames of our own bench at the same poses.

    python -m workbench.studies second_renderer

makes ``second_renderer.csv`` again: it renders the stored recipe of `satellites.second.recipe`, which
takes Mitsuba 3 and the better part of an hour, and measures.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from satellites.second import recipe
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render
from trinolab.files.poses import poses_by_frame, read_poses
from trinolab.files.recording import instants, open_folder
from trinolab.following.parameters import FollowParameters
from trinolab.following.posetracker import track_instants
from trinolab.handle import Handle
from trinolab.methods import BEST
from workbench.intervals import of_mean
from workbench.studies.replication import EVERY, Deviation, deviation, measure_instant
from workbench.studies.second_renderer import FILM, OURS, SECOND


def make_table(kept: Path) -> pd.DataFrame:
    """Render what is not there yet, measure, and judge.

    Parameters
    ----------
    kept : Path
        Folder of the recordings; a call that was stopped goes on with them.

    Returns
    -------
    pandas.DataFrame
        A row for each renderer, rig, handle and estimator; the film has one of its own, `track` with
        the best estimator. Columns: instants `n`, of them `measured`, and of these `wrong` (off by
        more than 2 mm or 5 deg); for mm and deg the mean of the error with its 95 % interval, and
        the rms of error by reported sigma; the `seed`; the 95 % interval of that rms.

    Raises
    ------
    ValueError
        If Mitsuba is not installed, or a recording cannot be written or read.
    """
    rows = []
    for handle_name in recipe.HANDLES:
        folder = recorded(f"stills-{handle_name}", kept)
        _, handle = open_folder(folder)
        truths = list(poses_by_frame(read_poses(folder / "truth.csv")).values())
        for renderer, frames in ((SECOND, read(folder)), (OURS, ours(truths, handle))):
            deviations = measured(frames, truths, handle)
            rows += [
                {"renderer": renderer, "rig": rig, "handle": handle_name, "estimator": estimator}
                | judged(deviations[rig, estimator])
                for rig in recipe.RIGS
                for estimator in EVERY
            ]
    film = {"renderer": SECOND, "rig": recipe.FILM_RIG, "handle": recipe.FILM_HANDLE}
    rows.append({**film, "estimator": FILM} | judged(followed(recorded("film", kept))))
    return pd.DataFrame(rows)


def recorded(name: str, kept: Path) -> Path:
    """The folder of a recording of the recipe, rendered if it is not there yet."""
    shooting = recipe.recordings()[name]
    key = hashlib.sha256(json.dumps(recipe.made_from(shooting)).encode()).hexdigest()[:12]
    folder = kept / f"{name}-{key}"
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        recipe.write_recording(shooting, folder)
    return folder


def followed(folder: Path) -> list[Deviation]:
    """The film's deviations, as the best estimator follows it; nothing tells where it begins."""
    recording, handle = open_folder(folder)
    truths = poses_by_frame(read_poses(folder / "truth.csv"))
    how = FollowParameters(estimator=BEST)
    return [
        deviation(tracked.measurement.pose, truths[now.frame], handle)
        for now, tracked in track_instants(instants(recording), recording.rig, handle, how)
    ]


def judged(deviations: Sequence[Deviation]) -> dict[str, float]:
    """What many deviations say: see `make_table`."""
    measured_ones = [one for one in deviations if one.measured]
    row: dict[str, float] = {
        "n": len(deviations),
        "measured": len(measured_ones),
        "wrong": sum(one.wrong for one in measured_ones),
    }
    ratios = {}
    for unit in ("mm", "deg"):
        errors = np.array([getattr(one, unit) for one in measured_ones])
        sigmas = np.array([getattr(one, f"sigma_{unit}") for one in measured_ones])
        ratios[unit] = (errors / sigmas) ** 2
        row[f"mean_{unit}"] = float(errors.mean()) if measured_ones else np.nan
        row[f"low_{unit}"], row[f"high_{unit}"], _ = of_mean(errors)
        row[f"error_by_sigma_{unit}"] = (
            float(np.sqrt(ratios[unit].mean())) if measured_ones else np.nan
        )
    row["seed"] = recipe.SEED
    for unit, squares in ratios.items():
        low, high = np.sqrt(of_mean(squares)[:2])
        row[f"error_by_sigma_low_{unit}"], row[f"error_by_sigma_high_{unit}"] = low, high
    return row


def read(folder: Path) -> Iterator[list[np.ndarray]]:
    recording, _ = open_folder(folder)
    return (now.images for now in instants(recording))


def ours(truths: Sequence[RigidTransform], handle: Handle) -> Iterator[list[np.ndarray]]:
    """Frames of the standard scene, one for each of the recipe's cameras; each has its own noise."""
    for k, T in enumerate(truths):
        yield our_instant(k, T, handle)


def our_instant(k: int, T_world_handle: RigidTransform, handle: Handle) -> list[np.ndarray]:
    """The frames of the k-th of `ours`."""
    return [
        render(camera, handle, T_world_handle, Bench(), np.random.default_rng([recipe.SEED, k, c]))
        for c, camera in enumerate(recipe.four_cameras().cameras)
    ]


def measured(
    frames: Iterator[list[np.ndarray]], truths: Sequence[RigidTransform], handle: Handle
) -> dict[tuple[str, str], list[Deviation]]:
    """Deviations by rig and estimator; a handle's look-alikes are told apart by the truth."""
    rigs = recipe.rigs()
    deviations: dict[tuple[str, str], list[Deviation]] = {}
    for images, T in zip(frames, truths, strict=True):
        for name, rig in rigs.items():
            seen = recipe.by_rig(images, name)
            for estimator, pose in measure_instant(seen, rig, handle, EVERY, T).items():
                deviations.setdefault((name, estimator), []).append(deviation(pose, T, handle))
    return deviations
