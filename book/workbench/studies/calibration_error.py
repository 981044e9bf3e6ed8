"""How good a calibration must be: Table 1's frames measured with rigs that are off by known amounts.

    python -m workbench.studies calibration_error

makes ``calibration_error.csv`` again. The frames are rendered once, with the true rig; every drawn
rig and every estimator measures the same ones. A draw has one direction of error, which the level
scales: levels, rigs, handles and estimators are compared on the same draws.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Camera, Rig
from trinolab.checks import Array, as_number, as_points, as_whole
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.handle import Handle
from trinolab.measurement import Measurement
from trinolab.methods import BEST
from trinolab.metrics import geodesic_deg, position_errors
from trinolab.parameters import Parameters
from trinolab.pose import rigid_fit

from ..intervals import of_mean
from .broken import miscalibrated
from .carrier import all_runs, columns_of_mean
from .pattern import affine_field, without_field
from .replication import WRONG_DEG, WRONG_MM, estimates_and_truths, measure_frames

RIGS = ("paper_pair", "raised_40deg")
SETTINGS: Mapping[str, Parameters] = {name: Parameters(estimator=name) for name in ("paper", BEST)}
LEVELS = (0.1, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0)  # and 0, the exact rig
# Standard deviations at level 1 of what a rig file may have wrong.
CENTRE_PX = 0.1  # each coordinate of each principal point
TURN_DEG = 0.005  # each camera about each axis
PLACE_MM = 0.02  # each coordinate of the place of each camera but the first
DIRECTIONS = "directions"  # principal points and directions of all cameras are off
PLACES = "places"  # the places are, at level 1 alone
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
    if changed not in (DIRECTIONS, PLACES):
        raise ValueError(f"changed: expected {DIRECTIONS} or {PLACES}, got {changed!r}")
    s = as_number(level, "level", low=0.0)
    if s == 0:
        return rig
    rng = np.random.default_rng([SEED, draw])
    if changed == DIRECTIONS:
        return miscalibrated(rig, s * CENTRE_PX, s * TURN_DEG, rng)
    first, *others = rig.cameras
    return Rig(
        (first, *(_moved(camera, s * PLACE_MM * rng.standard_normal(3)) for camera in others))
    )


def _moved(camera: Camera, shift_mm: Array) -> Camera:
    """The camera at another place, with the same directions."""
    back = RigidTransform.from_translation(-shift_mm)
    return replace(camera, T_cam_world=camera.T_cam_world * back)


def one_draw(changed: str, level: float, rig: str, handle: str, draw: int) -> dict[str, float]:
    """What one drawn rig does to Table 1's twenty poses: `RESULTS` of each estimator.

    Parameters
    ----------
    changed, level, draw
        See `drawn_rig`.
    rig, handle : str
        Shipped ones.

    Returns
    -------
    dict
        Named as in ``E_t_mm_paper``. Of the measured poses, up to the handle's symmetry: `E_t_mm`
        (Eq. 26); `geodesic_deg`, the mean; `registered_mm`, E_t after the measured positions were
        laid onto the true ones by one rigid motion; `common_share` and `smooth_share`, see
        `pattern`. Of all twenty: `measured`, the share that was measured, and `off`, the share that
        was measured and is more than 2 mm or 5 deg off. The first five are NaN if fewer than ten
        were measured.
    """
    scene = rendered(rig, handle)
    believed = drawn_rig(scene.rig, changed, level, draw)
    by_estimator = measure_frames(scene.frames, believed, scene.handle, SETTINGS)
    return {
        f"{name}_{estimator}": value
        for estimator, measurements in by_estimator.items()
        for name, value in results(measurements, scene.handle).items()
    }


class Pattern(NamedTuple):
    """What position errors have in common.

    Attributes
    ----------
    common_share : float
        Share of their mean square that is one shift of all poses.
    smooth_share : float
        Share of the rest that is an affine function of the position; NaN if there is no rest.
    """

    common_share: float
    smooth_share: float


def pattern(positions: ArrayLike, errors: ArrayLike) -> Pattern:
    """How much of position errors is one shift, and how much of the rest is smooth.

    Errors that have nothing to do with one another and with the position give 1 / n and 3 / (n - 1)
    in the mean: 5 and 16 % for twenty.

    Parameters
    ----------
    positions, errors : array_like, shape (n, 3)
        mm; five positions or more that are not in a plane.
    """
    x = as_points(positions, "positions", 3)
    e = as_points(errors, "errors", 3)
    about_mean = e - e.mean(axis=0)
    residuals = without_field(e, affine_field(x))
    squares, scatter, rest = ((part**2).sum() for part in (e, about_mean, residuals))
    smooth = float(1.0 - rest / scatter) if scatter > 0 else np.nan
    return Pattern(float(1.0 - scatter / squares), smooth)


def make_table(draws: int, workers: int, kept: Path) -> pd.DataFrame:
    """The shipped table.

    Parameters
    ----------
    draws : int
        Of each level.
    workers : int
        Processes.
    kept : path
        Folder that keeps finished draws, see `sweep.runs.sweep`.

    Returns
    -------
    pandas.DataFrame
        A row for what is `changed`, `level`, rig, handle and estimator: `centre_px`, `turn_deg` and
        `place_mm`, the standard deviations of that level; `n` draws and their `seed`; `n_held`, how
        many of them measured ten poses or more; for each of `RESULTS` the mean over the draws and,
        as ``..._low`` and ``..._high``, its interval of 95 %.
    """
    rows = []
    for name, grid in grids(draws).items():
        print(name, file=sys.stderr)
        rows += summaries(all_runs(name, one_draw, grid, kept / name, workers))
    return pd.DataFrame(rows)


def grids(draws: int) -> dict[str, dict[str, Sequence]]:
    """The sweeps of `one_draw` by name; a rig's runs follow one another, since they share its
    frames.
    """
    paper = {"handle": ["paper"], "rig": RIGS}
    drawn = {"draw": range(as_whole(draws, "draws", low=1))}
    return {
        "exact": {"changed": [DIRECTIONS], **paper, "level": [0.0], "draw": [0]},
        "directions": {"changed": [DIRECTIONS], **paper, "level": LEVELS, **drawn},
        "places": {"changed": [PLACES], **paper, "level": [1.0], **drawn},
        # where identities begin to fail: a layout without symmetry
        "coded": {"changed": [DIRECTIONS], **paper, "handle": ["coded"], "level": [3.0], **drawn},
    }


def summaries(found: pd.DataFrame) -> list[dict[str, float | int | str]]:
    """The rows of `make_table` from those of `one_draw`."""
    rows = []
    for (changed, handle, rig, level), draws in found.groupby(
        ["changed", "handle", "rig", "level"], sort=False
    ):
        turned = changed == DIRECTIONS
        for estimator in SETTINGS:
            row = {
                "changed": changed,
                "level": level,
                "centre_px": CENTRE_PX * level if turned else 0.0,
                "turn_deg": TURN_DEG * level if turned else 0.0,
                "place_mm": 0.0 if turned else PLACE_MM * level,
                "rig": rig,
                "handle": handle,
                "estimator": estimator,
                "n": len(draws),
                "seed": SEED,
                "n_held": int(draws[f"E_t_mm_{estimator}"].notna().sum()),
            }
            for name in RESULTS:
                values = draws[f"{name}_{estimator}"].dropna().to_numpy()
                row |= columns_of_mean(name, values, of_mean(values, SEED, RESAMPLES))
            rows.append(row)
    return rows


def curve(table: pd.DataFrame, rig: str, estimator: str) -> pd.DataFrame:
    """Rows of the shipped table for one rig and estimator, by rising level: principal points and
    directions are off, the handle is the paper's.
    """
    where = (table["changed"] == DIRECTIONS) & (table["handle"] == "paper")
    return table[where & (table["rig"] == rig) & (table["estimator"] == estimator)]


def level_at(
    rows: pd.DataFrame, limit: float, column: str = "E_t_mm"
) -> tuple[float, float, float]:
    """The level at which an error reaches a limit, with its interval of 95 %.

    Parameters
    ----------
    rows : pandas.DataFrame
        Of `curve`. Between two levels the error is a power of the level.
    limit : float
    column : str
        Of `ERRORS`.

    Returns
    -------
    level, low, high : float
        Where the mean, the upper and the lower end of its interval reach the limit first; NaN where
        they do not.
    """
    limit = as_number(limit, "limit", low=0.0, open_low=True)
    drawn = rows[rows["level"] > 0]
    levels = drawn["level"].to_numpy()
    curves = (drawn[name].to_numpy() for name in (column, f"{column}_high", f"{column}_low"))
    level, low, high = (_first_crossing(levels, curve, limit) for curve in curves)
    return level, low, high


def _first_crossing(x: Array, y: Array, limit: float) -> float:
    k = int(np.argmax(y >= limit))
    if k == 0 or np.isnan(y[k - 1]):  # nowhere, before the first, or behind a gap
        return np.nan
    return float(
        np.exp(np.interp(np.log(limit), np.log(y[k - 1 : k + 1]), np.log(x[k - 1 : k + 1])))
    )


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


class _Shown(NamedTuple):
    """Who looks at what: the true rig, the handle, and the frames of Table 1's poses."""

    rig: Rig
    handle: Handle
    frames: list[list[np.ndarray]]


@lru_cache(maxsize=1)
def rendered(rig: str, handle: str) -> _Shown:
    """What is rendered; that of one rig and handle is kept, 80 MB."""
    rng = np.random.default_rng(NOISE_SEED)
    true, rod = load_rig(rig), load_handle(handle)
    frames = [render_rig(true, rod, T, Bench(), rng) for T in load_table1().set_poses]
    return _Shown(true, rod, frames)
