"""Windows along the body's outline, for the estimators that use it beside the markers.

The outline says nothing of the turn about the axis, but it fixes the axis across the line of sight over all of the
body's length. A hand may hide parts of it: each window is judged on its own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from .appearance import Views
from .camera import Camera, Rig
from .checks import Array
from .handle import Handle
from .patches import Patches, cut

SIDE_PX = 13
PLACES = 10  # along the body, on either side
CLEAR_MM = 2.0  # from a marker or an end


def outline_patches(images: Sequence[np.ndarray], rig: Rig, handle: Handle, T_world_handle: RigidTransform) -> Patches:
    """Windows on both sides of the body's outline in every image, away from markers and ends."""
    found = [_outline(camera, handle, T_world_handle) for camera in rig.cameras]
    camera = np.repeat(np.arange(len(found)), [len(angle) for angle, _ in found])
    angle, uv = (np.concatenate(part) for part in zip(*found, strict=True))
    turn = angle[:, None] - handle.marker_angles
    nearest = np.abs(turn - 2 * np.pi * np.round(turn / (2 * np.pi))).argmin(axis=1)
    return cut(images, rig, handle, T_world_handle, Views(camera, nearest), uv, SIDE_PX)


def _outline(camera: Camera, handle: Handle, T_world_handle: RigidTransform) -> tuple[Array, Array]:
    """Angles about the axis (n,) and pixels (n, 2) of places on the outline; none from within the endless cylinder."""
    x, _, z = T_world_handle.inv().apply(camera.centre)
    if np.hypot(x, z) <= handle.radius_mm:
        return np.empty(0), np.empty((0, 2))
    towards, half = np.arctan2(x, z), np.arccos(handle.radius_mm / np.hypot(x, z))
    angle, axial = (part.ravel() for part in np.meshgrid([towards - half, towards + half], _places(handle)))
    points = np.column_stack([handle.radius_mm * np.sin(angle), axial, handle.radius_mm * np.cos(angle)])
    return angle, camera.project(T_world_handle.apply(points))


def _places(handle: Handle) -> Array:
    """Axial coordinates of the windows, mm."""
    clear = handle.marker_diameter_mm / 2 + CLEAR_MM
    axial = np.linspace(handle.bottom_mm + CLEAR_MM, handle.top_mm - CLEAR_MM, PLACES)
    away = np.abs(axial[:, None] - handle.marker_centres[:, 1]).min(axis=1)
    return axial[away > clear]
