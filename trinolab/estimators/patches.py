"""Windows of pixels about markers, cut out of images."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len
from scipy.spatial.transform import RigidTransform

from ..camera import Rig, image_of
from ..checks import Array
from ..handle import Handle, angles_to
from ..identity.layout import views_of
from ..rigid import rotation_of, shifted
from ..sensitivity import motion_slopes
from .appearance import Views, Windows, windows

LARGEST_PX = 120.0  # a marker's image beyond which its window no longer grows
LONGEST_PX = 100.0  # motion blur beyond which it no longer grows
MARGIN_PX = 4.0  # of a window around its marker: the blur's reach, and the filter's border
BORDER_PX = 2.0  # of a window that the lens's blur does not reach from beyond
SATURATED = 250.0  # grey levels; a brighter pixel has no weight


class Grid(NamedTuple):
    """The division of windows into cells.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of cells.
    cell : (int, int)
        Pixels of a cell along u and v.
    border : (int, int)
        Cells along u and v by which the handle is drawn beyond a window on each side.
    """

    shape: tuple[int, int]
    cell: tuple[int, int] = (1, 1)
    border: tuple[int, int] = (0, 0)


class Patches(NamedTuple):
    """The pixels of windows.

    Attributes
    ----------
    views : Views
    at : Windows
    px_per_mm : ndarray, shape (k,)
        Pixels per millimetre across the line of sight.
    grey : ndarray, shape (k, p)
    valid : ndarray of bool, shape (k, p)
        Not saturated.
    points : ndarray, shape (k, 3)
        The point in the middle of each window, handle frame, mm.
    alone : ndarray, shape (k,)
        Weight of each window, below 1 where it shares its pixels with others that show the same.
    drawn : Windows
        The windows in which the handle is drawn: the same ones, or larger ones with the same
        middle, from which motion smears light into them.
    by_motion : ndarray, shape (k, 2, 6)
        Derivative of the middle point's pixel by a motion of the handle, mm and rad, world frame;
        zero where the handle is still.
    """

    views: Views
    at: Windows
    px_per_mm: Array
    grey: np.ndarray
    valid: np.ndarray
    points: Array
    alone: Array
    drawn: Windows
    by_motion: Array

    def ways_px(self, motion: Array) -> Array:
        """Displacement of each window's middle in the image, shape (k, 2), px, for a motion (6,) of
        the handle, mm and rad, world frame.
        """
        return self.by_motion @ motion


def patches(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    T_world_handle: RigidTransform,
    max_slant_deg: float,
) -> Patches:
    """Windows about all markers that a pose turns to a camera by at most a slant, as far as they
    lie in its image.
    """
    seen = _marker_views(rig, handle, T_world_handle)
    facing = seen.slant < np.deg2rad(max_slant_deg)
    side = 2 * int(np.ceil(min(seen.largest_px(facing, handle), LARGEST_PX) / 2 + MARGIN_PX)) + 1
    views = Views(*np.nonzero(facing))
    points = handle.marker_centres[views.marker]
    return cut(images, rig, seen, views, points, Grid((side, side)))


def moving_patches(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    T_world_handle: RigidTransform,
    max_slant_deg: float,
    motion: Array,
    most_cells: int,
) -> Patches:
    """Windows about all markers of a handle that moves while the shutter is open, by `motion` (6,),
    mm and rad, world frame.

    They have room for the smeared marker. The handle is drawn in larger ones, with at most
    `most_cells` cells in all: the longer the way, the coarser they are.
    """
    seen = _marker_views(rig, handle, T_world_handle)
    facing = seen.slant < np.deg2rad(max_slant_deg)
    largest = seen.largest_px(facing, handle)
    views = Views(*np.nonzero(facing))
    points = handle.marker_centres[views.marker]
    uv = seen.uv[views]
    after = shifted(T_world_handle, motion).apply(handle.marker_centres)
    ways = np.stack([image_of(camera, after) for camera in rig.cameras])[views] - uv
    way = np.minimum(np.abs(ways).max(axis=0, initial=0.0), LONGEST_PX)
    size = min(largest, LARGEST_PX) + 2 * MARGIN_PX + way
    cell = np.ones(2, dtype=int)
    while len(uv) * np.prod(np.ceil((size + way) / cell)) > most_cells:
        cell[np.argmax((way + 1) / cell)] += 1
    border = np.ceil((way / 2 + BORDER_PX) / cell).astype(int)
    drawn = np.array([next_fast_len(int(n)) for n in np.ceil(size / cell) + 2 * border])
    columns, rows = (drawn - 2 * border).tolist()
    grid = Grid((rows, columns), tuple(cell.tolist()), tuple(border.tolist()))
    here = cut(images, rig, seen, views, points, grid)
    places = T_world_handle.apply(here.points)
    by_motion = motion_slopes(rig, here.views.camera, places, T_world_handle.translation)
    return here._replace(alone=_alone(here), by_motion=by_motion)


class MarkerViews(NamedTuple):
    """A handle's markers as cameras see them: pixels (cameras, n, 2), slant, rad, and pixels per
    millimetre across the line of sight, (cameras, n).
    """

    uv: Array
    slant: Array
    px_per_mm: Array

    def largest_px(self, facing: np.ndarray, handle: Handle) -> float:
        """The diameter of the largest of the markers that are `facing`, px."""
        return float(handle.marker_diameter_mm * self.px_per_mm[facing].max(initial=0.0))


def _marker_views(rig: Rig, handle: Handle, T_world_handle: RigidTransform) -> MarkerViews:
    """The markers of a pose in all cameras, whatever hides them."""
    centres = T_world_handle.apply(handle.marker_centres)
    normals = handle.marker_normals @ rotation_of(T_world_handle).T
    uv = np.stack([image_of(camera, centres) for camera in rig.cameras])
    views = views_of(rig)
    depth = centres @ views.rotations[:, 2].T + views.translations[:, 2]  # (n, cameras)
    px_per_mm = views.focal.mean(axis=1)[:, None] / depth.T
    return MarkerViews(uv, angles_to(centres, normals, views.centres[:, None]), px_per_mm)


def cut(
    images: Sequence[np.ndarray],
    rig: Rig,
    seen: MarkerViews,
    views: Views,
    points: Array,
    grid: Grid,
) -> Patches:
    """Windows about markers, which lie at points (k, 3) of the handle; views whose window is not all
    inside the image are left out.
    """
    rows, columns = grid.shape
    half = np.array([columns, rows]) * grid.cell / 2
    sizes = np.array([camera.size for camera in rig.cameras])[views.camera]
    uv = seen.uv[views]
    inside = np.asarray(((uv > half) & (uv < sizes - half - 1)).all(axis=1))
    views = Views(views.camera[inside], views.marker[inside])
    uv = uv[inside]
    points = points[inside]
    at = windows(rig, views, uv, grid.shape, grid.cell)
    pixels = _pixels(images, views, at)
    grey = _of_cells(np.add, pixels, grid.cell) / at.pixels
    valid = _of_cells(np.maximum, pixels, grid.cell) < SATURATED
    beside_u, beside_v = grid.border
    larger = (rows + 2 * beside_v, columns + 2 * beside_u)
    drawn = windows(rig, views, uv, larger, grid.cell) if any(grid.border) else at
    still = np.zeros((len(uv), 2, 6))
    scale = seen.px_per_mm[views]
    return Patches(views, at, scale, grey, valid, points, np.ones(len(uv)), drawn, still)


def _pixels(images: Sequence[np.ndarray], views: Views, at: Windows) -> Array:
    """Grey levels of windows, shape (k, height, width)."""
    width, height = at.size_px.tolist()
    pixels = np.empty((len(at.corner), height, width))
    for window, c, (u, v) in zip(pixels, views.camera, at.corner.tolist(), strict=True):
        window[:] = images[c][v : v + height, u : u + width]
    return pixels


def _of_cells(combine: np.ufunc, pixels: Array, cell: tuple[int, int]) -> Array:
    """Sums over each cell's pixels, shape (k, p), of windows (k, height, width)."""
    width, height = cell
    # a slice for each pixel of a cell: NumPy is slow along axes of two or three
    parts = [pixels[:, v::height, u::width] for v in range(height) for u in range(width)]
    together = reduce(combine, parts)
    return together.reshape(len(pixels), np.prod(together.shape[1:], dtype=int))


def _alone(here: Patches) -> Array:
    """One by the mean number of windows that a window's pixels lie in, shape (k,)."""
    size = here.at.size_px
    same_camera = here.views.camera[:, None] == here.views.camera
    beside = np.abs(here.at.corner[:, None] - here.at.corner)
    shared = np.prod(np.maximum(1 - beside / size, 0.0), axis=2)
    return 1 / (shared * same_camera).sum(axis=1)
