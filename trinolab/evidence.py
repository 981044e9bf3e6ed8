"""Evidence from real cameras: this package's functions on recordings made by others, beside their published results.

Each function returns None where its recording is not on this machine.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from .calibration import Calibrated, calibrate
from .camera import Rig
from .checks import Array, as_array, as_number
from .corners import find_corners
from .datasets import load_real_sets
from .markers import MarkerParameters, find_markers
from .pose import rigid_fit
from .realsets import load_caliscope, load_opencv_stereo, load_pymvg_mcsc, load_trackpy_particles
from .triangulation import mean_point, points_of_pairs, triangulate

PARTICLES = MarkerParameters(diameter_px=(2.5, 14.0), min_axis_ratio=0.3, min_fill=0.6, min_contrast=1.5)
"""What passes for a particle of `trackpy_particles`: 5 px across, and of 2 to 40 grey levels."""


def photographed_calibration(half_window_px: int = 7) -> Calibrated | None:
    """Calibrate OpenCV's 13 pairs of photographs of a chessboard; the smallest squares are 20 px across."""
    photographs = load_opencv_stereo()
    if photographs is None:
        return None
    uv = [[find_corners(image, photographs.board, half_window_px) for image in side] for side in photographs[:2]]
    height, width = photographs.left[0].shape
    return calibrate(photographs.board.points, np.array(uv), [(width, height)] * 2, ("left", "right"))


def led_errors_px() -> Array | None:
    """Reprojection errors of one LED in four cameras, 464 instants, points by Eq. 20-22; shape (cameras, n), px.

    In pixels without distortion and skew, which are up to a fifth larger than those that were taken.
    """
    tracks = load_pymvg_mcsc()
    return None if tracks is None else reprojection_px(tracks.rig, triangulate(tracks.rig, tracks.uv), tracks.uv)


def board_errors_mm(min_angle_deg: float = 30.0) -> Array | None:
    """Distances of a board's corners, triangulated from four webcams, from the board laid through them.

    Parameters
    ----------
    min_angle_deg : float
        Of `triangulate_steep`.

    Returns
    -------
    ndarray, shape (instants, corners), or None
        mm, after a rigid fit of the board an instant; NaN where a corner was not triangulated.
    """
    tracks = load_caliscope()
    if tracks is None or tracks.points is None:
        return None
    measured = triangulate_steep(tracks.rig, tracks.uv, min_angle_deg).reshape(-1, len(tracks.points), 3)
    errors = np.full(measured.shape[:2], np.nan)
    for row, points in zip(errors, measured, strict=True):
        T = rigid_fit(tracks.points, points)
        if T is not None:
            row[:] = np.linalg.norm(T.apply(np.array(tracks.points)) - points, axis=1)
    return errors


def particle_errors_px(window_px: int = 9) -> Array | None:
    """Distance of each position that trackpy gives from the nearest marker that `find_markers` finds; (344,), px.

    The image is bright with dark particles, and uneven; what is searched is its difference from the mean over a window
    as wide as a particle (9 px, as in the reference). A position without a marker of its own counts with its distance
    from the nearest other one.
    """
    particles = load_trackpy_particles()
    if particles is None:
        return None
    bright = 255.0 - particles.image
    difference = bright - cv2.blur(bright, (window_px, window_px))
    found = find_markers(difference, len(particles.uv), "bright", PARTICLES)
    return cKDTree(found.uv).query(particles.uv)[0]


def triangulate_steep(rig: Rig, uv: ArrayLike, min_angle_deg: float) -> Array:
    """Points by Eq. 20-22 without those pairs of cameras whose rays are too nearly parallel to measure (Eq. 20-22).

    A depth's error grows like 1/sin of the angle between the rays: at 30 deg, and for cameras that face each other at
    150 deg, it is twice that of a right angle. Eq. 22's plain mean would take such a pair for as good as any.

    Parameters
    ----------
    rig : Rig
    uv : array_like, shape (cameras, n, 2)
        Pixels as taken; NaN where a camera does not see the point.
    min_angle_deg : float
        Smallest angle between the rays, or between one and the other reversed, 0 to 90.

    Returns
    -------
    ndarray, shape (n, 3)
        World frame, mm; NaN where no pair is left.

    Raises
    ------
    ValueError
        If the shape does not fit the rig, or the angle is out of its range.
    """
    uv = as_array(uv, "uv", (len(rig.cameras), None, 2), finite=False)
    least = np.sin(np.deg2rad(as_number(min_angle_deg, "min_angle_deg", low=0.0, high=90.0)))
    rays = [camera.rays(pixels) for camera, pixels in zip(rig.cameras, uv, strict=True)]
    by_pair = points_of_pairs(rig, uv)
    sine = np.stack([np.linalg.norm(np.cross(rays[i], rays[j]), axis=1) for i, j in rig.pairs])
    with np.errstate(invalid="ignore"):
        by_pair[sine < least] = np.nan
    return mean_point(by_pair)


def reprojection_px(rig: Rig, points: ArrayLike, uv: ArrayLike) -> Array:
    """Distances of projected points (n, 3) from pixels (cameras, n, 2); shape (cameras, n), px, NaN where missing."""
    pixels = as_array(uv, "uv", (len(rig.cameras), None, 2), finite=False)
    return np.linalg.norm(np.stack([camera.project(points) for camera in rig.cameras]) - pixels, axis=2)


def baseline_difference_mm() -> float | None:
    """How far the photographed pair's baseline is from the stored reference for the same window of +-7 px, mm."""
    calibrated = photographed_calibration()
    if calibrated is None:
        return None
    reference = load_real_sets()["opencv_stereo"].reference["baseline_mm_win7"]
    return abs(float(np.linalg.norm(calibrated.cameras[1].centre)) - reference)


def led_median_px() -> float | None:
    """Median of `led_errors_px`."""
    errors = led_errors_px()
    return None if errors is None else float(np.nanmedian(errors))


def board_fit_mm() -> float | None:
    """Median over the instants of the median of `board_errors_mm` of an instant."""
    errors = board_errors_mm()
    return None if errors is None else float(np.nanmedian(np.nanmedian(errors, axis=1)))


def particle_median_px() -> float | None:
    """Median of `particle_errors_px`."""
    errors = particle_errors_px()
    return None if errors is None else float(np.median(errors))
