"""Moving things in front of the simulated bench's background: the light of handle and arm, and the
shadow they cast.

An image before blur and noise is ``over(foreground(...), background)``. Only the window around
handle and arm is ever computed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera
from ..checks import Array, as_transform
from ..handle import Handle
from .hand import (
    Arm,
    Capsules,
    capsule_corners,
    capsule_region,
    capsules,
    cast_capsules,
    in_camera,
    skin_grey,
)
from .optics import Bench, lambert
from .rays import (
    EMPTY,
    SIDE,
    Hits,
    body_corners,
    body_region,
    cast_rays,
    edge_pixels,
    hull_region,
    sample_offsets,
    to_rays,
)

_CHUNK = 16_384  # rays cast at once: their arrays stay in the cache
_ARM = -4  # label of what an arm hides, beside those of raycast
# a side of the square of samples at an edge between skin and background: nothing is measured there
_SKIN_SAMPLES = 4
# z of the wall in the world frame, a plane across the line of sight of a first camera
WALL_MM = 850.0
_PENUMBRA_MM = 12.0  # over which the shadow's edge fades


class Layer(NamedTuple):
    """A part of an image that lies before its background.

    Attributes
    ----------
    light : ndarray, shape (m, n)
        Grey that handle and arm add to each pixel of the window.
    cover : ndarray, shape (m, n)
        Share of each pixel's area that they hide.
    corner : (int, int)
        Column u and row v of the window's first pixel in the image; it may lie outside.
    """

    light: Array
    cover: Array
    corner: tuple[int, int]


class _View(NamedTuple):
    """One window with all that it shows: the handle and arm, and the pixels that may see them, bool
    (height, width).
    """

    camera: Camera
    handle: Handle
    T_world_handle: RigidTransform
    T_handle_cam: RigidTransform
    R_handle_cam: Array  # its rotation, as a matrix
    light_handle: Array  # towards the light, handle frame
    bench: Bench
    arm: Arm | None
    solids: Capsules | None  # of the arm, camera frame
    body_mask: np.ndarray
    arm_mask: np.ndarray


def foreground(
    camera: Camera,
    handle: Handle,
    T_world_handle: RigidTransform,
    bench: Bench,
    arm: Arm | None = None,
) -> Layer:
    """Handle and arm as a camera sees them, in the smallest window that holds them.

    Pixels that an edge may cross have many samples (see `Bench`), all others one at the centre.
    """
    view, corner = _view(camera, handle, as_transform(T_world_handle, "T_world_handle"), bench, arm)
    shape = view.body_mask.shape
    light = np.zeros(shape)
    cover = np.zeros(shape)
    labels = np.full(shape, EMPTY, np.int16)
    if light.size:
        _sample(view, view.body_mask | view.arm_mask, light, cover, labels, 1)
        counts = bench.supersampling, bench.marker_supersampling, _SKIN_SAMPLES
        for mask, count in zip(_edges(view, labels), counts, strict=True):
            _sample(view, mask, light, cover, None, count)
    return Layer(light, cover, corner)


def over(layer: Layer, behind: Array) -> Array:
    """The layer before an image of the whole background; shape of `behind`, which stays as it
    is.
    """
    image = np.array(behind, float)
    (u, v), (height, width) = layer.corner, layer.light.shape
    rows, columns = (
        slice(max(start, 0), max(start + length, 0)) for start, length in ((v, height), (u, width))
    )
    part = image[rows, columns]
    top = max(-v, 0)
    margin_left = max(-u, 0)
    own = slice(top, top + part.shape[0]), slice(margin_left, margin_left + part.shape[1])
    part *= 1 - layer.cover[own]
    part += layer.light[own]
    return image


def cropped(camera: Camera, corner: tuple[int, int], size: tuple[int, int]) -> Camera:
    """The camera of a window of the image, which may reach beyond it: same rays, its first pixel at
    `corner`.
    """
    matrix = camera.matrix.copy()
    matrix[:2, 2] -= corner
    return replace(camera, size=size, matrix=matrix)


def _view(
    camera: Camera, handle: Handle, T_world_handle: RigidTransform, bench: Bench, arm: Arm | None
) -> tuple[_View, tuple[int, int]]:
    """The view of the window, and the window's first pixel."""
    body = body_region(camera, handle, T_world_handle)
    solids = None if arm is None else in_camera(camera, capsules(arm, handle, T_world_handle))
    hand = np.zeros_like(body) if solids is None else capsule_region(camera, solids)
    rows, columns = _bounds(body | hand)
    corner = (columns.start, rows.start)
    size = (columns.stop - columns.start, rows.stop - rows.start)
    window = cropped(camera, corner, size) if min(size) > 0 else camera
    part = rows, columns
    T_handle_cam = (window.T_cam_world * T_world_handle).inv()
    view = _View(
        camera=window,
        handle=handle,
        T_world_handle=T_world_handle,
        T_handle_cam=T_handle_cam,
        R_handle_cam=T_handle_cam.rotation.as_matrix(),
        light_handle=T_world_handle.rotation.inv().apply(bench.light),
        bench=bench,
        arm=arm,
        solids=solids,
        body_mask=body[part],
        arm_mask=hand[part],
    )
    return view, corner


def _bounds(mask: np.ndarray) -> tuple[slice, slice]:
    """The rows and columns that hold all of a mask, and one more on each side where there is
    one.
    """
    bounds = []
    for axis in (1, 0):
        occupied = np.flatnonzero(mask.any(axis=axis))
        low, high = (occupied[0], occupied[-1] + 1) if len(occupied) else (0, -1)
        bounds.append(slice(int(max(low - 1, 0)), int(min(high + 1, mask.shape[1 - axis]))))
    return bounds[0], bounds[1]


def _edges(view: _View, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels that an edge may cross: of the body, of a marker, and of skin before the background
    alone.
    """
    body, markers = edge_pixels(view.camera, view.handle, view.T_world_handle, labels)
    square = np.ones((3, 3), np.uint8)
    highest = cv2.dilate(labels, square)
    lowest = cv2.erode(labels, square)
    skin = body & (highest == EMPTY) & (lowest == _ARM)
    hidden = highest == _ARM  # an outline that runs behind the arm
    return body & ~skin & ~hidden, markers & ~skin & ~hidden, skin


def _sample(
    view: _View, mask: np.ndarray, light: Array, cover: Array, labels: np.ndarray | None, count: int
) -> None:
    """Fill the pixels of `mask` with the mean of ``count ** 2`` samples; write what their centres
    see to `labels`.
    """
    offsets = sample_offsets(count)
    step = max(1, _CHUNK // len(offsets))
    rows, columns = np.nonzero(mask)
    body = view.body_mask[rows, columns]
    arm = view.arm_mask[rows, columns]
    for on_body, on_arm in ((True, False), (False, True), (True, True)):
        chosen = np.flatnonzero((body == on_body) & (arm == on_arm))
        for start in range(0, len(chosen), step):
            v, u = (index[chosen[start : start + step]] for index in (rows, columns))
            # column by column: NumPy is slow along an axis of two
            uv = np.column_stack(
                [np.add.outer(u, offsets[:, 0]).ravel(), np.add.outer(v, offsets[:, 1]).ravel()]
            )
            grey, materials = _look(view, uv, on_body, on_arm)
            hit = materials != EMPTY
            light[v, u] = np.where(hit, grey, 0).reshape(len(v), -1).mean(axis=1)
            cover[v, u] = hit.reshape(len(v), -1).mean(axis=1)
            if labels is not None:
                labels[v, u] = materials


def _look(view: _View, uv: Array, on_body: bool, on_arm: bool) -> tuple[Array, np.ndarray]:
    """Grey of what the rays through pixels meet first, and its label, shapes (n,); NaN where they
    meet nothing.
    """
    grey = np.full(len(uv), np.nan)
    labels = np.full(len(uv), EMPTY, np.int16)
    depths = np.full(len(uv), np.inf)
    rays = to_rays(view.camera.normalise(uv))
    if on_body:
        hits = cast_rays(view.handle, view.T_handle_cam.translation, view.R_handle_cam @ rays)
        grey = _surface_grey(view.handle, view.light_handle, view.bench, hits)
        labels = hits.labels
        depths = np.where(labels == EMPTY, np.inf, hits.depths)
    if on_arm and view.arm is not None and view.solids is not None:
        skin = cast_capsules(view.solids, rays)
        nearer = skin.depths < depths
        points = rays.T[nearer] * skin.depths[nearer, None]
        normals = skin.normals[nearer] @ view.camera.T_cam_world.rotation.as_matrix()
        grey[nearer] = skin_grey(view.arm, view.T_handle_cam.apply(points)) * lambert(
            view.bench, normals @ view.bench.light
        )
        labels[nearer] = _ARM
    return grey, labels


def _surface_grey(handle: Handle, light: Array, bench: Bench, hits: Hits) -> Array:
    """Grey of the surface at each hit, shape (n,); meaningless where a ray missed. `light` points
    towards the light, handle frame.
    """
    body, marker = (bench.body_grey, bench.marker_grey)[:: 1 if handle.markers == "bright" else -1]
    x, y, z = hits.points.T
    cap_cosine = np.where(y > (handle.top_mm + handle.bottom_mm) / 2, light[1], -light[1])
    on_side = (hits.labels == SIDE) | (hits.labels >= 0)
    cosine = np.where(on_side, (x * light[0] + z * light[2]) / handle.radius_mm, cap_cosine)
    return np.where(hits.labels >= 0, marker, body) * lambert(bench, cosine)


def shadow(
    camera: Camera,
    handle: Handle,
    T_world_handle: RigidTransform,
    bench: Bench,
    arm: Arm | None = None,
) -> np.ndarray:
    """Share of the wall's directed light that is missing in each pixel, float32 (height, width), 0
    to 1.

    The light comes from far away. Nothing where it does not shine towards the wall.
    """
    solids = [as_transform(T_world_handle, "T_world_handle").apply(body_corners(handle))]
    if arm is not None:
        solids += list(capsule_corners(capsules(arm, handle, T_world_handle)))
    dark = np.zeros(camera.size[::-1], bool)
    if bench.light[2] < -1e-3:
        for corners in solids:
            dark |= hull_region(camera, camera.T_cam_world.apply(_on_wall(corners, bench.light)))
    side = 1 + 2 * int(_PENUMBRA_MM * camera.focal.mean() / WALL_MM / 4)
    return cv2.blur(cv2.blur(dark.astype(np.float32), (side, side)), (side, side))


def _on_wall(points: Array, light: tuple[float, float, float]) -> Array:
    """The shadows of points on the wall, world frame, shape (n, 3), mm; points behind the wall stay
    where they are.
    """
    distance = np.maximum(WALL_MM - points[:, 2], 0) / -light[2]
    return points - distance[:, None] * np.array(light)
