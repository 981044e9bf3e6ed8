"""The variance components of a fit: the errors of the markers' places other than noise.

A component is a Gaussian with a shape and a size. Its shape is a matrix A, whose columns are shifts of
all places, px: its covariance is its size times A A'. A stated component has the size 1. Unstated sizes
have a prior, see `SILENT_RIG` and `FAULTS`, and are averaged over, given the images.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import prod
from typing import NamedTuple

import numpy as np

from ..camera import Rig, RigCovariance
from ..checks import Array, frozen
from ..default_covariance import PLACEMENT_MM, SCALE_SHARE
from ..handle import Handle
from ..sensitivity import Response, by_parameters, motion_slopes, slopes_at

ROWS_PX = 1000.0  # between which a rolling shutter's unit motion takes place
ROLLING_MM, ROLLING_RAD = 1.0, 0.005  # that motion: a hand's 100 mm/s and 0.5 rad/s for 10 ms


class Prior(NamedTuple):
    """The prior probabilities of a component's sizes.

    Attributes
    ----------
    sizes : ndarray, shape (n,)
        Variances, each as a multiple of the component's own covariance.
    log_weights : ndarray, shape (n,)
        Logarithms of their prior probabilities, up to a constant that all components share.
    """

    sizes: Array
    log_weights: Array


def half_cauchy(low: float, high: float, count: int, scale: float) -> Prior:
    """A half-Cauchy prior (Gelman 2006, DOI 10.1214/06-BA117A) on the square root of a size: flat
    below its scale, with a heavy tail above it.

    Parameters
    ----------
    low, high : float
        The least size and the largest one of the grid, which is even in the logarithm.
    count : int
        Of the grid's sizes.
    scale : float
        Of the square root of the size.
    """
    sizes = np.geomspace(low, high, count)
    density = np.sqrt(sizes) / (1 + sizes / scale**2)
    return Prior(frozen(sizes), frozen(np.log(density / density.sum())))


def any_size(low: float, high: float, count: int, share: float) -> Prior:
    """The prior of a fault that is present in a `share` of all cases, with all sizes equally likely;
    parameters as for `half_cauchy`.
    """
    sizes = np.geomspace(low, high, count)
    return Prior(frozen(sizes), frozen(np.full(count, np.log(share / count))))


# Where a file does not state them: the rig by its default covariance, the markers' places by
# `PLACEMENT_MM`. Chosen on the path-traced frames of `drawn_rigs`.
SILENT_RIG = half_cauchy(1e-4, 1e4, 17, scale=2.0)
SILENT_PLACEMENT = half_cauchy(1e-3, 1e2, 6, scale=1.0)
# The light on centroids, by `centroids.LIGHT`.
LIGHT = half_cauchy(1e-3, 1e3, 7, scale=0.5)
# Faults, of which there is at most one; with `NO_FAULT` the shares sum to 1. They are equal, since
# nothing is known of which fault is the more common. Chosen on the broken bench of `stress`.
NO_FAULT = 0.6
FAULTS: dict[str, Prior] = {
    "distorted images": any_size(1e-3, 1.0, 4, 0.08),
    "rolling shutter": any_size(1e-2, 1e2, 5, 0.08),
    "markers in rigid rows": any_size(1e-2, 1e2, 5, 0.08),
    "markers off their places": any_size(1e-3, 10.0, 5, 0.08),
    "another rig": any_size(1e-2, 1e4, 7, 0.08),
}


class Component(NamedTuple):
    """A component of the places of a fit.

    Attributes
    ----------
    shape : ndarray, shape (2 k, r)
        Columns of shifts, px; u and v of the first place come first.
    of_rig : ndarray, shape (15 C, r), or None
        The columns as displacements of the rig, see `camera.displaced`.
    """

    shape: Array
    of_rig: Array | None = None


def of_rig(places: Response, rig: Rig, known: RigCovariance) -> Component:
    """The errors of a rig of a known covariance."""
    root = _square_root(known.matrix.tobytes(), len(known.matrix))
    return Component(by_parameters(places, rig) @ root, root)


def _columns(shifts: Array) -> Array:
    """Shifts (k, 2, ...) of k places as a matrix (2 k, r)."""
    return shifts.reshape(2 * len(shifts), prod(shifts.shape[2:]))


@lru_cache(maxsize=8)
def _square_root(matrix: bytes, n: int) -> Array:
    """A matrix (n, r) that times its transpose is a covariance."""
    values, vectors = np.linalg.eigh(np.frombuffer(matrix).reshape(n, n))
    matters = values > 1e-12 * values[-1]
    return np.asarray(vectors[:, matters] * np.sqrt(values[matters]))


def of_placement(places: Response, rig: Rig, sigma_mm: float) -> Component:
    """An independent displacement of each marker along each axis."""
    by_points = sigma_mm * slopes_at(rig, places.camera, places.points)[1]
    same = places.marker[:, None] == np.unique(places.marker[places.marker >= 0])
    shape = by_points[:, :, None] * same[:, None, :, None]
    return Component(_columns(shape))


def of_scale(places: Response, rig: Rig) -> Component:
    """An error of the handle's scale about the middle of the visible markers; about the handle's origin
    it would also shift the pose by some hundredths of a millimetre.
    """
    by_points = slopes_at(rig, places.camera, places.points)[1]
    grown = SCALE_SHARE * (places.points - places.points.mean(axis=0))
    return Component((by_points @ grown[..., None]).reshape(-1, 1))


def of_rigid_rows(places: Response, rig: Rig, handle: Handle, origin: Array) -> Component:
    """A rigid motion of each row of markers, as by a bent handle: a shift by `PLACEMENT_MM`, and a turn
    of as much at the handle's radius.
    """
    units = np.repeat([PLACEMENT_MM, PLACEMENT_MM / handle.radius_mm], 3)
    moves = motion_slopes(rig, places.camera, places.points, origin) * units
    heights = np.round(handle.marker_centres[places.marker, 1], 3)
    mine = heights[:, None] == np.unique(heights)
    shape = moves[:, :, None] * mine[:, None, :, None]
    return Component(_columns(shape))


def of_distortion(places: Response, rig: Rig) -> Component:
    """A linear distortion of each image of the handle, of mean square 1 at its places, px^2."""
    k = len(places.points)
    shape = np.zeros((k, 2, len(rig.cameras), 2, 2))
    for c, camera in enumerate(rig.cameras):
        mine = np.flatnonzero(places.camera == c)
        if len(mine) == 0:
            continue
        uv = camera.project(places.points[mine])
        aside = uv - uv.mean(axis=0)
        aside = aside / np.sqrt(max((aside**2).sum() / len(mine), 1e-9))
        for axis in range(2):
            shape[mine, axis, c, axis] = aside
    return Component(_columns(shape))


def of_rolling_shutter(places: Response, rig: Rig, origin: Array) -> Component:
    """A steady motion of the handle during a rolling shutter that is the same in all cameras; the pose
    is that at the time of the principal points' rows.
    """
    rows = np.empty(len(places.points))
    for c, camera in enumerate(rig.cameras):
        mine = places.camera == c
        rows[mine] = camera.project(places.points[mine])[:, 1] - camera.principal_point[1]
    units = np.repeat([ROLLING_MM, ROLLING_RAD], 3) / ROWS_PX
    moves = motion_slopes(rig, places.camera, places.points, origin) * units
    return Component(_columns(rows[:, None, None] * moves))


def faults(
    places: Response, rig: Rig, handle: Handle, origin: Array, default: RigCovariance
) -> dict[str, Callable[[], Component]]:
    """The components of all faults of an instant, by the names of `FAULTS`; `default` is the covariance
    of a rig whose file is wrong.
    """
    return {
        "distorted images": lambda: of_distortion(places, rig),
        "rolling shutter": lambda: of_rolling_shutter(places, rig, origin),
        "markers in rigid rows": lambda: of_rigid_rows(places, rig, handle, origin),
        "markers off their places": lambda: of_placement(places, rig, PLACEMENT_MM),
        "another rig": lambda: of_rig(places, rig, default),
    }
