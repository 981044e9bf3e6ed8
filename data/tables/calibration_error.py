"""How good a calibration must be: Table 1's frames measured with rigs that are off by known amounts.

The frames are rendered once, with the true rig; every drawn rig and every estimator measures the same
ones. A draw has one direction of error, which the level scales: levels, rigs, handles and estimators are
compared on the same draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Camera, Rig
from trinolab.checks import Array
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.handle import Handle
from trinolab.measurement import Measurement
from trinolab.metrics import geodesic_deg, position_errors
from trinolab.pose import rigid_fit
from workbench.intervals import of_mean
from workbench.studies.broken import miscalibrated
from workbench.studies.calibration_error import (
    CENTRE_PX,
    DIRECTIONS,
    RIGS,
    SETTINGS,
    TURN_DEG,
    pattern,
)
from workbench.studies.carrier import Row, Table, means
from workbench.studies.replication import WRONG_DEG, WRONG_MM, estimates_and_truths, measure_frames

LEVELS = (0.1, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0)  # and 0, the exact rig
PLACE_MM = 0.02  # at level 1, each coordinate of the place of each camera but the first
PLACES = "places"  # these are off, at level 1 alone
DRAWS = 40
RESAMPLES = 9999  # of the bootstrap
SEED = 15  # of the draws
NOISE_SEED = 0  # of the frames
ENOUGH = 10  # poses of the twenty; a rig that measures fewer is no rig to judge by its errors
ERRORS = ("E_t_mm", "geodesic_deg", "registered_mm", "common_share", "smooth_share")
RESULTS = (*ERRORS, "measured", "off")


def drawn_rig(rig: Rig, changed: str, level: float, draw: int) -> Rig:
    """The rig as a file may have it.

    Parameters
    ----------
    rig : Rig
        The true one.
    changed : {"directions", "places"}
        Principal points and directions of all cameras, or the places of all but the first.
    level : float
        In units of `CENTRE_PX` and `TURN_DEG`, or of `PLACE_MM`; at 0 it is the true one, as it states
        itself.
    draw : int
        Which of the directions that an error may have. Cameras that two rigs have in common are off
        by the same.
    """
    if level == 0:
        return rig
    rng = np.random.default_rng([SEED, draw])
    if changed == DIRECTIONS:
        return miscalibrated(rig, level * CENTRE_PX, level * TURN_DEG, rng)
    first, *others = rig.cameras
    sigma = level * PLACE_MM
    return Rig((first, *(_moved(camera, sigma * rng.standard_normal(3)) for camera in others)))


def _moved(camera: Camera, shift_mm: Array) -> Camera:
    """The camera at another place, with the same directions."""
    back = RigidTransform.from_translation(-shift_mm)
    return replace(camera, T_cam_world=camera.T_cam_world * back)


def one_draw(changed: str, level: float, rig: str, handle: str, draw: int) -> list[Row]:
    """What one drawn rig does to Table 1's twenty poses: a row per estimator.

    Of the measured poses, up to the handle's symmetry: `E_t_mm` (Eq. 26); `geodesic_deg`, the mean;
    `registered_mm`, E_t after the measured positions were laid onto the true ones by one rigid
    motion; `common_share` and `smooth_share`, see `pattern`. Of all twenty: `measured`, the share
    that was measured, and `off`, the share that was measured and is more than 2 mm or 5 deg off. The
    first five are NaN if fewer than ten were measured.
    """
    believed = drawn_rig(load_rig(rig), changed, level, draw)
    turned = changed == DIRECTIONS
    sizes = {
        "centre_px": CENTRE_PX * level if turned else 0.0,
        "turn_deg": TURN_DEG * level if turned else 0.0,
        "place_mm": 0.0 if turned else PLACE_MM * level,
    }
    rod = load_handle(handle)
    by_estimator = measure_frames(rendered(rig, handle), believed, rod, SETTINGS)
    return [
        {**sizes, "estimator": estimator, **results(measurements, rod)}
        for estimator, measurements in by_estimator.items()
    ]


def results(measurements: list[Measurement], handle: Handle) -> dict[str, float]:
    poses = load_table1().set_poses
    estimates = [m.pose.T_world_handle for m in measurements]
    n = sum(T is not None for T in estimates)
    if n == 0:
        return dict.fromkeys(ERRORS, np.nan) | {"measured": 0.0, "off": 0.0}
    estimated, truths = estimates_and_truths(estimates, poses, handle)
    off = (position_errors(estimated, truths) > WRONG_MM) | (
        geodesic_deg(estimated, truths) > WRONG_DEG
    )
    errors = _errors(estimated, truths) if n >= ENOUGH else dict.fromkeys(ERRORS, np.nan)
    return errors | {"measured": n / len(poses), "off": float(off.sum() / len(poses))}


def _errors(found: RigidTransform, truths: RigidTransform) -> dict[str, float]:
    T = rigid_fit(found.translation, truths.translation)
    assert T is not None  # ten of Table 1's positions are never in line
    return {
        "E_t_mm": float(position_errors(found, truths).mean()),
        "geodesic_deg": float(geodesic_deg(found, truths).mean()),
        "registered_mm": float(position_errors(T * found, truths).mean()),
        **pattern(truths.translation, found.translation - truths.translation)._asdict(),
    }


@lru_cache(maxsize=1)
def rendered(rig: str, handle: str) -> list[list[np.ndarray]]:
    """The frames of Table 1's poses; those of one rig and handle are kept, 80 MB."""
    rng = np.random.default_rng(NOISE_SEED)
    poses = load_table1().set_poses
    return [render_rig(load_rig(rig), load_handle(handle), T, Bench(), rng) for T in poses]


def over_draws(runs: pd.DataFrame) -> Row:
    """Means over the draws that have a value, and how many of them measured ten poses or more."""
    held = int(runs["E_t_mm"].notna().sum())
    return {
        **{"n": len(runs), "seed": SEED, "n_held": held},
        **means(runs, RESULTS, lambda values: of_mean(values, SEED, RESAMPLES)),
    }


def grid(
    changed: str, levels: Sequence[float], handle: str = "paper", **fixed: Sequence
) -> dict[str, Sequence]:
    """A rig's runs follow one another, since they share its frames."""
    return {"changed": [changed], "handle": [handle], "rig": RIGS, "level": levels, **fixed}


TABLES = [
    Table(
        "calibration_error",
        one_draw,
        [
            grid(DIRECTIONS, [0.0], draw=[0]),
            grid(DIRECTIONS, LEVELS),
            grid(PLACES, [1.0]),
            # where identities begin to fail: a layout without symmetry
            grid(DIRECTIONS, [3.0], "coded"),
        ],
        by=(
            *("changed", "level", "centre_px", "turn_deg", "place_mm"),
            *("rig", "handle", "estimator"),
        ),
        draws=DRAWS,
        summary=over_draws,
        again={"changed": DIRECTIONS, "rig": "paper_pair", "handle": "paper", "level": 1.0},
    )
]
