"""The image of a wrapped marker: windows of pixels about markers, and the light of each pixel
before the blur.

A pixel's ray meets the cylinder in closed form; distances from the marker's edge and from the
body's outline give the share of the pixel's area that each covers (`loops.draw`). A view is a
marker in a camera's image; arrays have one row per view.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig
from ..checks import Array
from ..handle import Handle
from ..rigid import rotation_of


class Views(NamedTuple):
    """Pairs of image and marker: index of the camera and of the marker, each of shape (k,)."""

    camera: np.ndarray
    marker: np.ndarray


class Windows(NamedTuple):
    """Windows of cells, one per view, all of one shape. A cell is a pixel, or a block of pixels
    that its mean represents.

    Attributes
    ----------
    corner : ndarray of int, shape (k, 2)
        Column and row of the first pixel.
    shape : (int, int)
        Rows and columns of cells.
    cell : (int, int)
        Pixels of a cell along u and along v.
    xy : ndarray, shape (2, k, p)
        Normalised ideal coordinates of the cells' centres, row by row.
    xy_per_cell : ndarray, shape (k, 2, 2)
        Their derivatives by the cells along u and v in the middle of the window.
    """

    corner: np.ndarray
    shape: tuple[int, int]
    cell: tuple[int, int]
    xy: np.ndarray
    xy_per_cell: np.ndarray

    @property
    def pixels(self) -> int:
        """The number of pixels of a cell."""
        return self.cell[0] * self.cell[1]

    @property
    def size_px(self) -> np.ndarray:
        """Width and height of a window, px, shape (2,)."""
        return np.array(self.shape[::-1]) * self.cell


class Geometry(NamedTuple):
    """Rays and markers of windows as `loops.draw` takes them: all arguments behind the coordinates.

    Attributes
    ----------
    R : ndarray, shape (k, 3, 3)
        From the camera's frame to the handle's.
    start : ndarray, shape (k, 3)
        The camera's centre in the handle's frame, mm.
    by_u, by_v : ndarray, shape (k, 3)
        Derivatives of the ray by a cell along u and v, handle frame.
    marker : ndarray, shape (k, 4)
    others : ndarray, shape (k, 2, 3)
    body : ndarray, shape (4,)
    """

    R: Array
    start: Array
    by_u: Array
    by_v: Array
    marker: Array
    others: Array
    body: Array


def windows(
    rig: Rig, views: Views, uv: Array, shape: tuple[int, int], cell: tuple[int, int] = (1, 1)
) -> Windows:
    """Windows with pixels uv, shape (k, 2), in their middle. They may reach beyond the image."""
    rows, columns = shape
    size = np.array([columns, rows]) * cell
    corner = np.round(uv).astype(int) - size // 2
    grid = np.stack(np.divmod(np.arange(rows * columns), columns)[::-1])  # (2, p): column, row
    scale = np.array(cell)[:, None]
    grid = scale * grid + (scale - 1) / 2
    xy = np.empty((2, len(uv), rows * columns))
    xy_per_px = np.empty((len(uv), 2, 2))
    for c, camera in enumerate(rig.cameras):
        mine = np.flatnonzero(views.camera == c)
        pixels = corner[mine].T[:, :, None] + grid[:, None]  # (2, k, p)
        if camera.distortions.any():
            xy[:, mine], xy_per_px[mine] = _through_lens(camera, pixels, uv[mine])
        else:
            xy[:, mine] = (pixels - camera.principal_point[:, None, None]) / camera.focal[
                :, None, None
            ]
            xy_per_px[mine] = np.diag(1 / camera.focal)
    return Windows(corner, shape, cell, xy, xy_per_px * cell)


def _through_lens(camera: Camera, pixels: Array, uv: Array) -> tuple[Array, Array]:
    """Ideal coordinates (2, k, p), and their derivatives by pixels (k, 2, 2), of windows with pixels
    (2, k, p) and middles uv (k, 2), for a lens with distortion.
    """
    steps = 0.5 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    every = np.concatenate([pixels.transpose(1, 2, 0), uv[:, None] + steps], axis=1)
    ideal = camera.normalise(every.reshape(-1, 2)).reshape(len(uv), -1, 2)
    # central differences over a pixel: exact but for the lens's curvature
    by_px = np.stack([ideal[:, -4] - ideal[:, -3], ideal[:, -2] - ideal[:, -1]], axis=2)
    return ideal[:, :-4].transpose(2, 0, 1), by_px


def shading_basis(turn: Array) -> Array:
    """Functions of the angle from a marker's middle that make up the brightness around the body,
    (4, ``*turn.shape``).

    The first is 1, the others vanish in the middle. The next two represent any distant light; the
    last one approximates light that ends within the window.
    """
    s = np.sin(turn)
    c = 1 - np.cos(turn)
    return np.stack([np.ones_like(turn), s, c, s * c])


def geometry_of(
    rig: Rig, handle: Handle, T_world_handle: RigidTransform, views: Views, at: Windows
) -> Geometry:
    """The rays of windows, and the markers in them."""
    R_handle_world = rotation_of(T_world_handle).T
    turns, centres = _cameras(rig)
    R = (R_handle_world @ turns)[views.camera]
    steps = R[:, :, :2] @ at.xy_per_cell
    starts = (centres - T_world_handle.translation) @ R_handle_world.T
    marker, body = _layout(handle)
    others = marker[_neighbours(handle)[views.marker]][..., :3]
    return Geometry(
        R,
        starts[views.camera],
        np.ascontiguousarray(steps[..., 0]),
        np.ascontiguousarray(steps[..., 1]),
        marker[views.marker],
        others,
        body,
    )


@lru_cache(maxsize=8)
def _cameras(rig: Rig) -> tuple[Array, Array]:
    """Rotations from the cameras' frames to the world's (cameras, 3, 3), and their centres, mm."""
    turns = np.stack([camera.T_world_cam.as_matrix()[:3, :3] for camera in rig.cameras])
    return turns, np.stack([camera.centre for camera in rig.cameras])


@lru_cache(maxsize=8)
def _layout(handle: Handle) -> tuple[Array, Array]:
    """Markers (n, 4) and body (4,) as `loops.draw` takes them."""
    turn = handle.marker_angles
    columns = [np.cos(turn), np.sin(turn), handle.marker_centres[:, 1], handle.marker_radii]
    body = [handle.radius_mm, handle.top_mm, handle.bottom_mm, handle.marker_diameter_mm / 2]
    return np.stack(columns, axis=1), np.array(body)


@lru_cache(maxsize=8)
def _neighbours(handle: Handle, nearest: int = 2) -> np.ndarray:
    """Indices (markers, nearest) of each marker's nearest neighbours on the surface."""
    theta = handle.marker_angles
    axial = handle.marker_centres[:, 1]
    turn = theta[:, None] - theta
    turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
    gap = np.hypot(handle.radius_mm * turn, axial[:, None] - axial)
    np.fill_diagonal(gap, np.inf)
    return gap.argsort(axis=1)[:, :nearest]
