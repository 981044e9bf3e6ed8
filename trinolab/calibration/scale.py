"""A check of the stated size of a target by the distance that follows from it (Sect. 6.2).

Images do not determine the scale. A square in metres where mm are expected gives a rig with correct
angles and a thousandth of the size.
"""

from __future__ import annotations

import logging

import numpy as np

from .adjust import Calibrated
from .start import target_poses
from .target import Target
from .views import TargetViews

log = logging.getLogger("trinolab")

# Distances from camera to target. No lens of a webcam or an industrial camera is sharp nearer than the
# first, or sees a target beyond the last one; between the middle ones are those of a bench or a room.
LEAST_MM, NEAR_MM, FAR_MM, MOST_MM = 10.0, 100.0, 20_000.0, 200_000.0
UNITS_MM = {"m": 1000.0, "cm": 10.0, "inches": 25.4, "micrometres": 1e-3}


def check_scale(seen: TargetViews, target: Target) -> None:
    """Refuse a size of a target that puts it at an impossible distance; log a question about one that
    puts it at an unusual distance.

    Raises
    ------
    ValueError
        States the distance of the target, and the unit in which its size was probably given.
    """
    poses = [
        [T for T in target_poses(target.points, uv, size) if T is not None]
        for uv, size in zip(seen.uv, seen.sizes, strict=True)
    ]
    distances = [np.median([T.translation[2] for T in of]) for of in poses if of]
    if not distances:
        return
    middle = float(np.median(distances))
    if NEAR_MM <= middle <= FAR_MM:
        return
    units = [unit for unit, mm in UNITS_MM.items() if NEAR_MM <= middle * mm <= FAR_MM]
    meant = " or ".join(f"--square {target.square_mm * UNITS_MM[unit]:g}" for unit in units)
    likely = f"; likely it is in {' or '.join(units)}, and {meant} is meant" if units else ""
    text = (
        f"square: with {target.square_mm:g} mm the target would be {middle:.3g} mm away from the cameras"
        f"{likely}"
    )
    if not LEAST_MM <= middle <= MOST_MM:
        raise ValueError(text)
    log.warning("%s; is it so?", text)


def distance_of_target(calibrated: Calibrated, target: Target) -> str:
    """A line about a calibration: the distances of cameras and target by the target's stated size."""
    first, *others = calibrated.cameras
    apart = ", ".join(
        f"{camera.name} {np.linalg.norm(camera.centre - first.centre):.4g} mm" for camera in others
    )
    middle = target.points.mean(axis=0)
    away = [np.linalg.norm(T.apply(middle)) for T in calibrated.T_world_target if T is not None]
    return (
        f"with squares of {target.square_mm:g} mm the distance from {first.name} is: {apart}, the target "
        f"{min(away):.3g} to {max(away):.3g} mm"
    )
