"""The effect of unsynchronised clocks on the poses of a track, and the lines about it.

A camera that is late by tau shows the handle after a further motion of v tau. Its image is shifted
by v tau times the derivative of its pixels by the position, and the estimated position moves by the
least-squares solution of these shifts. Two cameras side by side take a shift along their baseline
for an error of the distance that is five or ten times as large, and a handle at a wrong distance is
turned until its image has its size.

A rig that states its uncertainty, or that it is exact, does not account for that. For a rig that
states nothing, the size of its errors is estimated in each instant (`uncertainty.assess`), these
included.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..camera import Rig
from ..checks import Array
from ..default_covariance import known_covariance
from ..sensitivity import pixel_slopes
from .sync import Offsets, significant

# By how much a handle turns for a share of its distance that it is wrong by: 1 to 3 on simulated
# recordings.
TURN_BY_SHARE = 2.0
PLACE = ["x_mm", "y_mm", "z_mm"]


def late_lines(offsets: Offsets, rig: Rig) -> list[str]:
    """A line for each camera whose clock differs from the first one's, where the markers show that."""
    late_ms = 1e3 * offsets.offset_s
    sigma_ms = np.maximum(1e3 * offsets.sigma_s, 0.1)
    return [
        f"{rig.names[c]}: {abs(late_ms[c]):.1f} ms (+- {sigma_ms[c]:.1f}) "
        f"{'later' if late_ms[c] > 0 else 'earlier'} than {rig.names[0]}; the cameras are not "
        "synchronised: what moves is measured wrongly, as far as its sigma says; trigger them together, "
        "or hold the handle still"
        for c in np.flatnonzero(significant(offsets))
    ]


def widened(table: pd.DataFrame, offsets: Offsets, rig: Rig) -> pd.DataFrame:
    """A track whose standard deviations count what late cameras do to it.

    Parameters
    ----------
    table : pandas.DataFrame
        Of `files.poses.POSE_COLUMNS`.
    offsets : Offsets
        Those that are not significant do not count.
    rig : Rig
        If it states no uncertainty the table is unchanged.
    """
    late_s = np.where(significant(offsets), offsets.offset_s, 0.0)
    posed = np.flatnonzero(np.isfinite(table[PLACE]).all(axis=1))
    if not late_s.any() or len(posed) < 2 or np.isfinite(known_covariance(rig).freedom):
        return table
    places = table[PLACE].to_numpy(float)[posed]
    velocities = np.gradient(places, table["t_s"].to_numpy(float)[posed], axis=0)
    off_mm = np.linalg.norm(shifts_mm(places, velocities, late_s, rig), axis=1)
    distances = np.linalg.norm(places - rig.cameras[0].centre, axis=1)
    off_deg = np.rad2deg(TURN_BY_SHARE * off_mm / distances)
    result = table.copy()
    for name, off in (("mm", off_mm), ("deg", off_deg)):
        for kind in ("sigma", "systematic"):
            values = result[f"{kind}_{name}"].to_numpy(float).copy()
            values[posed] = np.hypot(values[posed], off)
            result[f"{kind}_{name}"] = values
    return result


def shifts_mm(places: Array, velocities: Array, late_s: Array, rig: Rig) -> Array:
    """Errors of measured positions (n, 3), mm, of handles at places (n, 3), mm, that move at
    velocities (n, 3), mm/s, if the cameras are late by (C,), s; world frame.
    """
    slopes = np.stack([pixel_slopes(camera, places)[1] for camera in rig.cameras], axis=1)
    # (n, C, 2)
    moved = (slopes @ velocities[:, None, :, None])[..., 0] * late_s[:, None]
    n = len(places)
    return np.asarray((np.linalg.pinv(slopes.reshape(n, -1, 3)) @ moved.reshape(n, -1, 1))[..., 0])
