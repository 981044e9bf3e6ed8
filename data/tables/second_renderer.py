"""The estimators on frames of the second renderer, beside frames of our own bench at the same poses.

    python -m workbench.studies second_renderer

makes ``second_renderer.csv`` again: it renders the stored recipe of `satellites.second.recipe`, which
takes Mitsuba 3 and the better part of an hour, and measures.
"""

from __future__ import annotations

import hashlib
import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from stress import as_row

from satellites.second import recipe
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render
from trinolab.datasets import load_handle
from trinolab.files.poses import poses_by_frame, read_poses
from trinolab.files.recording import instants, open_folder
from trinolab.following.parameters import FollowParameters
from trinolab.following.posetracker import track_instants
from trinolab.methods import BEST
from workbench.intervals import of_mean
from workbench.studies.carrier import Row, Table
from workbench.studies.drawn_rigs import THIRD
from workbench.studies.replication import EVERY, deviation, measure_instant
from workbench.studies.second_renderer import FILM, OURS, SECOND

INSTANTS = recipe.THIRD_POSES  # as many as the stills


def trial(renderer: str, handle: str, instant: int, kept: str) -> list[Row]:
    """A still: a row per rig and estimator. A handle's look-alikes are told apart by the truth."""
    the_handle = load_handle(handle)
    images, T = seen(renderer, handle, instant, Path(kept))
    rows: list[Row] = []
    for name, rig in recipe.rigs().items():
        poses = measure_instant(recipe.by_rig(images, name), rig, the_handle, EVERY, T)
        for estimator, pose in poses.items():
            off = as_row(deviation(pose, T, the_handle))
            rows.append({"rig": name, "estimator": estimator, **off})
    return rows


@lru_cache(maxsize=1)  # the draws of an instant come one after the other
def seen(
    renderer: str, handle: str, instant: int, kept: Path
) -> tuple[list[np.ndarray], RigidTransform]:
    """The frames of the four cameras at an instant of the stills, or of the third set, and the true
    pose. Our own bench's are those of the standard scene; each has its own noise.
    """
    name = f"{'third' if renderer == THIRD else 'stills'}-{handle}"
    shooting = recipe.recordings()[name]
    T = shooting.truth[instant]
    if renderer != OURS:
        recording, _ = open_folder(recorded(name, kept))
        return next(instants(recording, instant)).images, T
    images = [
        render(
            camera, shooting.handle, T, Bench(), np.random.default_rng([recipe.SEED, instant, c])
        )
        for c, camera in enumerate(shooting.rig.cameras)
    ]
    return images, T


def recorded(name: str, kept: Path) -> Path:
    """The folder of a recording of the recipe, rendered if it is not there yet."""
    shooting = recipe.recordings()[name]
    key = hashlib.sha256(json.dumps(recipe.made_from(shooting)).encode()).hexdigest()[:12]
    folder = kept / f"{name}-{key}"
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        recipe.write_recording(shooting, folder)
    return folder


def followed(folder: Path) -> list[Row]:
    """The film's deviations, as the best estimator follows it; nothing tells where it begins."""
    recording, handle = open_folder(folder)
    truths = poses_by_frame(read_poses(folder / "truth.csv"))
    how = FollowParameters(estimator=BEST)
    return [
        as_row(deviation(tracked.measurement.pose, truths[now.frame], handle))
        for now, tracked in track_instants(instants(recording), recording.rig, handle, how)
    ]


def judged(rows: pd.DataFrame) -> Row:
    """What many instants say.

    Parameters
    ----------
    rows : pandas.DataFrame
        Of `stress.as_row`.

    Returns
    -------
    dict
        Instants `n`, of them `measured`, and of these `wrong` (off by more than 2 mm or 5 deg); for mm
        and deg the mean of the error with its 95 % interval, and the rms of error by reported sigma;
        the `seed`; the 95 % interval of that rms.
    """
    found = rows[rows["measured"]]
    row: dict[str, float] = {
        "n": len(rows),
        "measured": len(found),
        "wrong": int(found["wrong"].sum()),
    }
    ratios = {unit: (found[unit] / found[f"sigma_{unit}"]) ** 2 for unit in ("mm", "deg")}
    for unit, squares in ratios.items():
        row[f"mean_{unit}"] = found[unit].mean()
        row[f"low_{unit}"], row[f"high_{unit}"], _ = of_mean(found[unit])
        row[f"error_by_sigma_{unit}"] = np.sqrt(squares.mean())
    row["seed"] = recipe.SEED
    for unit, squares in ratios.items():
        low, high = np.sqrt(of_mean(squares)[:2])
        row[f"error_by_sigma_low_{unit}"], row[f"error_by_sigma_high_{unit}"] = low, high
    return row


def table(kept: Path) -> Table:
    """The rows of the stills, of the recordings in a folder."""
    return Table(
        "second_renderer",
        trial,
        [
            {
                "handle": recipe.HANDLES,
                "renderer": (SECOND, OURS),
                "instant": range(INSTANTS),
                "kept": [str(kept)],
            }
        ],
        by=("renderer", "rig", "handle", "estimator"),
        summary=judged,
        again={"renderer": OURS, "handle": "coded"},
    )


def make_table(workers: int, kept: Path) -> pd.DataFrame:
    """Render what is not there yet, then compute the table; the film, which the best estimator
    follows, is its last row.

    Raises
    ------
    ValueError
        If Mitsuba is not installed, or a recording cannot be written or read.
    """
    for handle in recipe.HANDLES:
        recorded(f"stills-{handle}", kept)
    film = {"renderer": SECOND, "rig": recipe.FILM_RIG, "handle": recipe.FILM_HANDLE}
    last = {**film, "estimator": FILM, **judged(pd.DataFrame(followed(recorded("film", kept))))}
    stills = table(kept).make(workers=workers, kept=kept)
    return pd.concat([stills, pd.DataFrame([last])], ignore_index=True)
