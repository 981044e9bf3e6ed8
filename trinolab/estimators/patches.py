"""Windows of pixels cut out of images: about markers, and along the body's outline.

The outline says nothing of the turn about the axis, but it fixes the axis across the line of sight
over all of the body's length. A hand may hide parts of it: each window is judged on its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig
from ..checks import Array
from ..handle import Handle, slant_angles
from .appearance import Views, Windows, windows

__all__ = ["Patches", "cut", "outline_patches", "patches"]

LARGEST_PX = 120.0  # a marker's image beyond which its window no longer grows
MARGIN_PX = 4.0  # of a window around its marker: the blur's reach, and the filter's border
SATURATED = 250.0  # grey levels; a brighter pixel has no weight
SIDE_PX = 13
PLACES = 10  # along the body, on either side
CLEAR_MM = 2.0  # from a marker or an end


class Patches(NamedTuple):
    """The pixels of windows.

    Attributes
    ----------
    views : Views
    at : Windows
    px_per_mm : ndarray, shape (k,)
        Pixels to a millimetre across the line of sight.
    grey : ndarray, shape (k, p)
    valid : ndarray of bool, shape (k, p)
        Not saturated.
    points : ndarray, shape (k, 3)
        What lies in the middle, handle frame, mm.
    alone : ndarray, shape (k,)
        What share of it a window counts: less where it has its pixels in common with others that
        show the same.
    """

    views: Views
    at: Windows
    px_per_mm: Array
    grey: np.ndarray
    valid: np.ndarray
    points: Array
    alone: Array


def patches(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    T_world_handle: RigidTransform,
    max_slant_deg: float,
    motion_blur: Array | None = None,
) -> Patches:
    """Windows about all markers that a pose turns to a camera by at most a slant, as far as they
    lie in its image.

    `motion_blur` (6,) is the handle's motion while the shutter is open (mm, rad): they are as much
    larger.
    """
    centres = T_world_handle.apply(handle.marker_centres)
    normals = handle.marker_normals @ T_world_handle.as_matrix()[:3, :3].T
    slant = np.stack([slant_angles(centres, normals, camera.centre) for camera in rig.cameras])
    facing = slant < np.deg2rad(max_slant_deg)
    uv = np.stack([camera.project(centres) for camera in rig.cameras])
    scale = np.stack(
        [camera.focal.mean() / camera.T_cam_world.apply(centres)[:, 2] for camera in rig.cameras]
    )
    largest = handle.marker_diameter_mm * scale[facing].max(initial=0.0)
    moved = (
        0.0
        if motion_blur is None
        else np.linalg.norm(motion_blur[:3]) * scale[facing].max(initial=0.0)
    )
    side = 2 * int(np.ceil(min(largest + moved, LARGEST_PX) / 2 + MARGIN_PX)) + 1
    views = Views(*np.nonzero(facing))
    points = handle.marker_centres[views.marker]
    windows_here = cut(images, rig, handle, T_world_handle, views, points, uv[views], side)
    return (
        windows_here
        if motion_blur is None
        else windows_here._replace(alone=_alone(windows_here, images))
    )


def cut(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    T_world_handle: RigidTransform,
    views: Views,
    points: Array,
    uv: Array,
    side: int,
) -> Patches:
    """Windows of an odd side about points (k, 3) of the handle, which pixels uv (k, 2) show; views
    whose window is not all inside the image are left out.
    """
    room = np.array([camera.size for camera in rig.cameras])[views.camera] - side / 2 - 1
    inside = np.asarray(((uv > side / 2) & (uv < room)).all(axis=1))
    views = Views(views.camera[inside], views.marker[inside])
    uv = uv[inside]
    points = points[inside]
    at = windows(rig, views, uv, side)
    grey = np.array(
        [
            images[c][v : v + side, u : u + side]
            for c, (u, v) in zip(views.camera, at.corner, strict=True)
        ],
        dtype=float,
    ).reshape(len(at.corner), side * side)
    centres = T_world_handle.apply(handle.marker_centres)
    scale = np.stack(
        [camera.focal.mean() / camera.T_cam_world.apply(centres)[:, 2] for camera in rig.cameras]
    )
    return Patches(views, at, scale[views], grey, grey < SATURATED, points, np.ones(len(uv)))


def _alone(here: Patches, images: Sequence[np.ndarray]) -> Array:
    """One by the mean number of windows that a window's pixels lie in, shape (k,)."""
    side = here.at.side
    counts = [np.zeros(image.shape, np.uint8) for image in images]
    places = list(zip(here.views.camera, here.at.corner, strict=True))
    for c, (u, v) in places:
        counts[c][v : v + side, u : u + side] += 1
    return np.array([1 / counts[c][v : v + side, u : u + side].mean() for c, (u, v) in places])


def outline_patches(
    images: Sequence[np.ndarray], rig: Rig, handle: Handle, T_world_handle: RigidTransform
) -> Patches:
    """Windows on both sides of the body's outline in every image, away from markers and ends."""
    outlines = [_outline(camera, handle, T_world_handle) for camera in rig.cameras]
    camera = np.repeat(np.arange(len(outlines)), [len(angle) for angle, _, _ in outlines])
    angle, points, uv = (np.concatenate(part) for part in zip(*outlines, strict=True))
    turn = angle[:, None] - handle.marker_angles
    nearest = np.abs(turn - 2 * np.pi * np.round(turn / (2 * np.pi))).argmin(axis=1)
    views = Views(camera, nearest)
    return cut(images, rig, handle, T_world_handle, views, points, uv, SIDE_PX)


def _outline(
    camera: Camera, handle: Handle, T_world_handle: RigidTransform
) -> tuple[Array, Array, Array]:
    """Angles about the axis (n,), points (n, 3) of the handle and pixels (n, 2) of places on the
    outline; none from within the endless cylinder.
    """
    x, _, z = T_world_handle.inv().apply(camera.centre)
    if np.hypot(x, z) <= handle.radius_mm:
        return np.empty(0), np.empty((0, 3)), np.empty((0, 2))
    towards = np.arctan2(x, z)
    half = np.arccos(handle.radius_mm / np.hypot(x, z))
    angle, axial = (
        part.ravel() for part in np.meshgrid([towards - half, towards + half], _places(handle))
    )
    points = np.column_stack(
        [handle.radius_mm * np.sin(angle), axial, handle.radius_mm * np.cos(angle)]
    )
    return angle, points, camera.project(T_world_handle.apply(points))


def _places(handle: Handle) -> Array:
    """Axial coordinates of the windows, mm."""
    clear = handle.marker_diameter_mm / 2 + CLEAR_MM
    axial = np.linspace(handle.bottom_mm + CLEAR_MM, handle.top_mm - CLEAR_MM, PLACES)
    away = np.abs(axial[:, None] - handle.marker_centres[:, 1]).min(axis=1)
    return axial[away > clear]
