"""What the centroids of wrapped markers do to a pose: their noise, and a bias that all views of all
markers have in common.

A piece of a marker counts by the area of its image, so that the side which is turned to the camera
counts for more. Seen from afar, the centroid is the image of the mean of all pieces, each weighted
by the cosine between its normal and the line of sight. On a disc of radius a, wrapped on a cylinder
of radius r and seen at an angle phi around the axis, that mean lies from the marker's centre, with
``A(k) = 2 J1(k a / r) / (k a / r)``,

    along the normal        r ((1 + A(2)) / (2 A(1)) - 1)        about -a^2 / 8 r
    around the axis         r (1 - A(2)) / (2 A(1)) tan(phi)     about a^2 / 4 r tan(phi)

wherever along the axis the camera stands. That is no noise: two cameras side by side have nearly the
same bias, and so have neighbouring columns. Together it makes the cylinder look thinner by a
thirtieth.

Light does the same: a marker that is brighter on one side has its centroid nearer to it. Light from
afar that falls by Lambert's law on a surface makes, in place of tan(phi), that of its own angle; it
comes from one direction for all markers, of which nothing is known.

What varnish mirrors is narrower: it lies on one column of markers and not on the next, and pulls all
views of that column around the axis alike. (On path-traced frames of a varnished handle the product
of the pulls of two neighbouring views is 0.94 of their square, of the two rows of a column 0.95, and
of a view 40 or 90 deg higher 0.54; 270 to 360 pairs each.) No two columns tell of each other. So it
grows with the noise, where what is left over is larger than that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.special import j1

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from .systematic import (
    Response,
    is_uncertain,
    known_errors,
    motion_slopes,
    slopes_at,
    students_factor,
)

__all__ = [
    "NOISE_PX",
    "Bias",
    "centroid_bias",
    "centroid_covariance",
    "common_bias",
    "same_column",
]

NOISE_PX = 0.015  # of a centroid, in each direction, where nothing says that it is more
# The pull of the light by that of an angle of 45 deg: less than 1, since not all light has one
# direction. On images of the simulated bench 0.4 would do, on path-traced ones 0.7.
LIGHT = 0.5
HIGHLIGHT = (
    0.6  # the pull of what a column mirrors by that of the light, where there is no more noise
)


class Bias(NamedTuple):
    """By how much centroids lie beside the images of the markers' centres, px.

    Attributes
    ----------
    foreshortening : ndarray, shape (k, 2)
        What is known of it: by the angle at which each marker is seen.
    light : ndarray, shape (k, 2, 2)
        What is not: one standard deviation of light from each of two directions across the axis.
    around : ndarray, shape (k, 2)
        What each of them pulls around the axis: one standard deviation of light from 45 deg.
    """

    foreshortening: Array
    light: Array
    around: Array


def centroid_bias(
    camera: np.ndarray, marker: np.ndarray, T_world_handle: RigidTransform, rig: Rig, handle: Handle
) -> Bias:
    """The bias of the centroids of k views of markers, shapes (k,) and (k,)."""
    R = T_world_handle.as_matrix()[:3, :3]
    normal = handle.marker_normals[marker] @ R.T
    tangent = np.cross(R[:, 1], normal)
    points = T_world_handle.apply(handle.marker_centres)[marker]
    towards = np.stack([one.centre for one in rig.cameras])[camera] - points
    radius = handle.marker_radii[marker]
    share = handle.marker_diameter_mm / 2 / radius
    first, second = (2 * j1(k * share) / (k * share) for k in (1, 2))
    # a marker that is turned away further is cut off by the outline
    facing = np.maximum((towards * normal).sum(axis=1), 1e-9)
    slope = np.clip((towards * tangent).sum(axis=1) / facing, -1 / share, 1 / share)
    inwards = radius * ((1 + second) / (2 * first) - 1)
    aside = radius * (1 - second) / (2 * first)
    offset = inwards[:, None] * normal + (aside * slope)[:, None] * tangent
    by_points = slopes_at(rig, camera, points)[1]
    around = handle.marker_angles[marker]
    two_lights = np.stack([np.cos(around), np.sin(around)], axis=1)
    by_tangent = np.einsum("kij,kj->ki", by_points, LIGHT * aside[:, None] * tangent)
    return Bias(
        np.einsum("kij,kj->ki", by_points, offset),
        by_tangent[:, :, None] * two_lights[:, None],
        by_tangent,
    )


def centroid_covariance(
    found: Response, residuals_px: Array, T_world_handle: RigidTransform, rig: Rig, handle: Handle
) -> Array:
    """Covariance of a pose by the noise and the bias of the centroids that it was measured from.

    The bias stays in the pose: its square belongs to the mean square of the error. The noise, and with
    it the pull of highlights, is taken to be as large as what pose, bias, rig and layout do not
    explain, and never below `NOISE_PX`: what is half hidden moves single centroids.

    Parameters
    ----------
    found : Response
    residuals_px : ndarray, shape (k, 2)
        Centroids minus the images of the centres, in the order of `found`.
    T_world_handle : RigidTransform
    rig, handle

    Returns
    -------
    ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame.
    """
    columns = _columns(found, T_world_handle, rig, handle)
    common = columns @ columns.T
    noise = NOISE_PX**2 * np.eye(residuals_px.size)
    noise += _highlights(found, T_world_handle, rig, handle)
    freedom = residuals_px.size - 6
    if freedom > 0:
        V = common + noise
        if is_uncertain(rig, handle):
            V += known_errors(found, rig, handle)
        chi_square = _left_over(V, residuals_px, found, T_world_handle, rig)
        noise *= max(students_factor(freedom) * chi_square / freedom, 1.0)
    gain = found.gain.reshape(6, -1)
    return np.asarray(gain @ (common + noise) @ gain.T)


def common_bias(found: Response, T_world_handle: RigidTransform, rig: Rig, handle: Handle) -> Array:
    """Covariance of the places (2 k, 2 k) by the bias that they have in common, and by the pull of
    highlights, px^2.
    """
    columns = _columns(found, T_world_handle, rig, handle)
    return np.asarray(columns @ columns.T + _highlights(found, T_world_handle, rig, handle))


def same_column(marker: np.ndarray, handle: Handle) -> np.ndarray:
    """Which markers (k,) stand in one column with which, bool (k, k)."""
    around = handle.marker_angles[marker]
    return np.asarray(np.isclose(np.cos(around[:, None] - around), 1.0))


def _highlights(found: Response, T_world_handle: RigidTransform, rig: Rig, handle: Handle) -> Array:
    """Covariance of the places (2 k, 2 k) by what each column of markers mirrors, px^2."""
    around = centroid_bias(found.camera, found.marker, T_world_handle, rig, handle).around.ravel()
    alike = same_column(found.marker, handle).repeat(2, 0).repeat(2, 1)
    return HIGHLIGHT**2 * alike * np.outer(around, around)


def _columns(found: Response, T_world_handle: RigidTransform, rig: Rig, handle: Handle) -> Array:
    """The standard deviations of the common bias (2 k, 3), px: by the slant and by two lights."""
    bias = centroid_bias(found.camera, found.marker, T_world_handle, rig, handle)
    return np.column_stack([bias.foreshortening.ravel(), bias.light.reshape(-1, 2)])


def _left_over(
    V: Array, residuals_px: Array, found: Response, T_world_handle: RigidTransform, rig: Rig
) -> float:
    """Chi-square of residuals with the covariance V that no motion of the handle explains."""
    by_pose = motion_slopes(rig, found.camera, found.points, T_world_handle.translation)
    rows = np.column_stack([by_pose.reshape(-1, 6), residuals_px.ravel()])
    white = np.linalg.solve(np.linalg.cholesky(V), rows)
    explained = np.linalg.qr(white[:, :6])[0]
    rest = white[:, 6] - explained @ (explained.T @ white[:, 6])
    return float(rest @ rest)
