"""The uncertainty over the field by the covariance alone: what a pose that minimises the reprojection
error would be known to, with a good calibration.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Rig
from trinolab.checks import Array
from trinolab.handle import Handle, slant_angles
from trinolab.sensitivity import motion_slopes, response, systematic_covariance
from workbench.studies.broken import covariance_of_such

from .combined import CALIBRATION_DEG, CALIBRATION_PX, PLACEMENT_MM
from .setup import field_of

CENTRE_PX = 0.03  # to which the middle of a marker is found
MAX_SLANT_DEG = 65.0
TURNS_DEG = (0.0, 15.0, 30.0, 45.0)  # of the handle about its axis; at 60 it looks the same
PLACES = 24  # along the longer side of the field


class FieldMap(NamedTuple):
    """Standard uncertainties over x and z, in the middle of the field's height.

    Attributes
    ----------
    x_mm, z_mm : ndarray, shapes (m,) and (n,)
    depth_mm, across_mm : ndarray, shape (n, m)
        Along the first camera's axis, and of an axis across it; NaN outside the field.
    """

    x_mm: Array
    z_mm: Array
    depth_mm: Array
    across_mm: Array


def over_field(rig: Rig, handle: Handle) -> FieldMap:
    """The map of a rig and a handle that are known as well as one can."""
    known = replace(rig, covariance=covariance_of_such(rig, CALIBRATION_PX, CALIBRATION_DEG))
    placed = replace(handle, placement_sigma_mm=PLACEMENT_MM)
    field = field_of(rig, handle)
    step = np.ptp(field.points[:, [0, 2]], axis=0).max() / PLACES
    low, high = field.points.min(axis=0), field.points.max(axis=0)
    x, z = (np.arange(low[k], high[k], step) for k in (0, 2))
    middle = float(np.median(field.points[:, 1]))
    depth = np.full((len(z), len(x)), np.nan)
    across = depth.copy()
    for row, column in np.ndindex(*depth.shape):
        place = np.array([x[column], middle, z[row]])
        if not field.holds(place[None])[0]:
            continue
        C = np.mean([_at(place, turn, known, placed) for turn in TURNS_DEG], axis=0)
        axis = rig.cameras[0].axis
        along = axis @ C @ axis
        depth[row, column] = np.sqrt(along)
        across[row, column] = np.sqrt((np.trace(C) - along) / 2)
    rows, columns = (np.isfinite(depth).any(axis=k) for k in (1, 0))
    inside = np.ix_(rows, columns)
    return FieldMap(x[columns], z[rows], depth[inside], across[inside])


def _at(place: Array, turn_deg: float, rig: Rig, handle: Handle) -> Array:
    """The position's covariance (3, 3), mm^2, of a handle whose axis is the world's y."""
    turn = Rotation.from_euler("Y", 180.0 + turn_deg, degrees=True)  # towards the first camera
    T = RigidTransform.from_components(place, turn)
    return pose_covariance(T, rig, handle)[:3, :3]


def pose_covariance(T: RigidTransform, rig: Rig, handle: Handle) -> Array:
    """Covariance (6, 6) of position (mm) and rotation vector (rad), world frame, of a pose with least
    squares of all markers that are seen.
    """
    centres = T.apply(handle.marker_centres)
    normals = handle.marker_normals @ T.as_matrix()[:3, :3].T
    slants = np.stack([slant_angles(centres, normals, camera.centre) for camera in rig.cameras])
    camera, marker = np.nonzero(slants < np.deg2rad(MAX_SLANT_DEG))
    points = centres[marker]
    J = motion_slopes(rig, camera, points, T.translation).reshape(-1, 6)
    spread = np.linalg.inv(J.T @ J)
    gain = (spread @ J.T).reshape(6, -1, 2)
    common = systematic_covariance(response(gain, camera, marker, handle, T), rig, handle)
    return CENTRE_PX**2 * spread + common
