"""Viewing rays against the handle: which surface point and which part of the handle a pixel sees.

The body is the finite cylinder, a ray meets it in closed form; a marker is the set of surface
points whose distance from the marker's centre, measured on the unrolled surface, is at most half
the marker's diameter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from ..camera import Camera
from ..checks import Array, as_transform
from ..handle import Handle, on_cylinder

# labels of what is no marker; marker k has the label k
EMPTY = -3
SIDE = -2
CAP = -1
_SQUARE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True)
class OvalHandle(Handle):
    """A handle as it was made: its markers are ovals on the unrolled surface.

    Attributes
    ----------
    marker_length_mm : float
        Of a marker along the axis; `marker_diameter_mm` is that around the body.
    """

    marker_length_mm: float = 3.0


class Hits(NamedTuple):
    """First points where rays meet the handle.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Handle frame, mm; NaN where a ray misses.
    labels : ndarray of int16, shape (n,)
        `EMPTY` (missed), `SIDE`, `CAP`, or the number of a marker.
    depths : ndarray, shape (n,)
        z in the camera's frame, mm; NaN where a ray misses.
    """

    points: Array
    labels: np.ndarray
    depths: Array


def cast(camera: Camera, handle: Handle, T_world_handle: RigidTransform, uv: ArrayLike) -> Hits:
    """Intersect the viewing rays through pixels with the handle.

    Parameters
    ----------
    camera : Camera
    handle : Handle
    T_world_handle : RigidTransform
    uv : array_like, shape (n, 2)
        Pixels of the distorted image.

    Returns
    -------
    Hits
        The nearest point in front of the camera on each ray. A ray misses where `Camera.normalise`
        gives none. A camera inside the body sees nothing of it.
    """
    T_handle_cam = (camera.T_cam_world * as_transform(T_world_handle, "T_world_handle")).inv()
    directions = T_handle_cam.rotation.as_matrix() @ to_rays(camera.normalise(uv))
    return cast_rays(handle, T_handle_cam.translation, directions)


def to_rays(xy: Array) -> Array:
    """Directions of the rays through normalised coordinates (x/z, y/z), shape (n, 2), camera frame,
    with z = 1; shape (3, n).
    """
    return np.stack([xy[:, 0], xy[:, 1], np.ones(len(xy))])


def cast_rays(handle: Handle, origin: Array, directions: Array) -> Hits:
    """Intersect rays of the handle's frame, from one origin (3,), with the handle; see `cast`.

    Directions are as long as the way to where z has grown by 1 in the camera's frame, shape (3, n).
    """
    depth, on_cap = _first_meeting(handle, origin, directions)
    points = (origin[:, None] + depth * directions).T
    labels = np.where(np.isnan(depth), EMPTY, np.where(on_cap, CAP, SIDE)).astype(np.int16)
    _label_markers(handle, origin, directions, points, labels)
    return Hits(points, labels, depth)


def body_region(camera: Camera, handle: Handle, T_world_handle: RigidTransform) -> np.ndarray:
    """Pixels that may see the handle, bool (height, width); see `hull_region`."""
    return hull_region(camera, (camera.T_cam_world * T_world_handle).apply(body_corners(handle)))


def hull_region(camera: Camera, local: Array) -> np.ndarray:
    """Pixels that may see the convex hull of points, bool (height, width): its image, with two
    pixels to spare.

    `local` are points of the camera's frame, shape (n, 3), mm. All of the image where the outline
    has no simple shape: the hull reaches behind the camera, or so far aside that the distortion
    model folds back. Nothing where all of it lies behind the camera.
    """
    width, height = camera.size
    if (local[:, 2] <= 0).all():
        return np.zeros((height, width), bool)
    if (local[:, 2] < 1e-3 * np.abs(local).max()).any():
        return np.ones((height, width), bool)
    uv = camera.to_pixels(
        _subdivided(cv2.convexHull((local[:, :2] / local[:, 2:]).astype(np.float32))[:, 0])
    )
    if not (np.abs(uv) < 2e4).all():
        return np.ones((height, width), bool)
    region = np.zeros((height, width), np.uint8)
    low = np.clip(np.floor(uv.min(axis=0)).astype(int) - 4, 0, (width, height))
    high = np.clip(np.ceil(uv.max(axis=0)).astype(int) + 5, 0, (width, height))
    part = np.zeros((high - low)[::-1], np.uint8)
    if part.size:
        cv2.fillPoly(part, [np.round(16 * (uv - low)).astype(np.int32)], 1, shift=4)
        region[low[1] : high[1], low[0] : high[0]] = cv2.dilate(part, np.ones((5, 5), np.uint8))
    return region.astype(bool)


def edge_pixels(
    camera: Camera, handle: Handle, T_world_handle: RigidTransform, labels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels that an edge may cross.

    They are those with a neighbour of another label, and those that the projected outline of the
    body or of a marker passes, which finds slivers thinner than a pixel.

    Parameters
    ----------
    labels : ndarray of int16, shape (height, width)
        The part of the handle that each pixel's centre sees.

    Returns
    -------
    body, markers : ndarray of bool, shape (height, width)
        Edges of markers, and all others; no pixel is in both.
    """
    maps = labels, np.maximum(labels, CAP)
    body, markers = (cv2.dilate(part, _SQUARE) != cv2.erode(part, _SQUARE) for part in maps)
    for mask, points in zip(
        (body, markers), _outlines(camera, handle, T_world_handle), strict=True
    ):
        uv = camera.project(T_world_handle.apply(points))
        u, v = (
            np.round(uv[((uv > -0.5) & (uv < np.array(camera.size) - 0.5)).all(axis=1)])
            .astype(int)
            .T
        )
        mask[v, u] = True
    return body & ~markers, markers


def marker_outline(handle: Handle, index: int, count: int = 64, scale: float = 1.0) -> Array:
    """Points on the edge of a marker (or on a circle `scale` times as large), evenly spaced on the
    unrolled surface.

    Returns
    -------
    ndarray, shape (count, 3)
        Handle frame, mm.
    """
    phi = 2 * np.pi * np.arange(count) / count
    around, along = (scale * half for half in _half_axes(handle))
    radius = handle.marker_radii[index]
    theta = handle.marker_angles[index] + around / radius * np.cos(phi)
    axial = handle.marker_centres[index, 1] + along * np.sin(phi)
    return on_cylinder(radius, theta, axial)


def _half_axes(handle: Handle) -> tuple[float, float]:
    """Half axes of a marker, around the body and along the axis, mm."""
    around = handle.marker_diameter_mm / 2
    return around, handle.marker_length_mm / 2 if isinstance(handle, OvalHandle) else around


def facing(handle: Handle, points: Array, viewpoint: Array) -> np.ndarray:
    """Whether the side of the body at its surface points, shape (n, 3), looks towards a viewpoint
    (handle frame).
    """
    return points[:, [0, 2]] @ viewpoint[[0, 2]] > handle.radius_mm**2


def marker_area(handle: Handle, index: int) -> Array:
    """Points of a marker, each for an equal share of its area, handle frame, shape (n, 3), mm."""
    return np.concatenate(
        [
            marker_outline(handle, index, scale=scale)
            for scale in np.sqrt((np.arange(16) + 0.5) / 16)
        ]
    )


def sample_offsets(count: int) -> Array:
    """Sampling points of a pixel, relative to its centre, px: the centres of count x count cells,
    (count ** 2, 2).
    """
    steps = (np.arange(count) + 0.5) / count - 0.5
    return np.column_stack([np.tile(steps, count), np.repeat(steps, count)])


def _first_meeting(handle: Handle, origin: Array, directions: Array) -> tuple[Array, np.ndarray]:
    """Ray parameter of the first surface point, NaN where a ray misses, and whether an end cap is
    met; shapes (n,).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        side_in, side_out = _side_interval(handle.radius_mm, origin, directions)
        ends = (np.array([[handle.bottom_mm], [handle.top_mm]]) - origin[1]) / directions[1]
        slab_in = ends.min(axis=0)
        slab_out = ends.max(axis=0)
        first = np.maximum(side_in, slab_in)
        hit = (first < np.minimum(side_out, slab_out)) & (first > 0)
        return np.where(hit, first, np.nan), slab_in > side_in


def _side_interval(radius: float, origin: Array, directions: Array) -> tuple[Array, Array]:
    """Ray parameters of entry into and exit from the endless cylinder, shapes (n,); NaN for rays
    that miss it.

    The distance between ray and axis comes from a cross product, which keeps 1e-12 mm where the
    textbook discriminant of the quadratic cancels.
    """
    (ox, _, oz), (dx, _, dz) = origin, directions
    a = dx * dx + dz * dz
    middle = -(ox * dx + oz * dz) / a
    half = np.sqrt((radius**2 - (ox * dz - oz * dx) ** 2 / a) / a)
    along = a == 0  # parallel to the axis
    if along.any():
        middle[along] = 0.0
        half[along] = np.inf if np.hypot(ox, oz) <= radius else np.nan
    return middle - half, middle + half


def _label_markers(
    handle: Handle, origin: Array, directions: Array, points: Array, labels: np.ndarray
) -> None:
    """Write the numbers of the markers into `labels` where a ray that meets the side meets one.

    A marker whose own place is off the body's surface is met there, where it lies.
    """
    around, along = _half_axes(handle)
    shrunk = around / along  # by which an oval shrinks along the axis to a circle
    axial = handle.marker_centres[:, 1]
    reach = along + np.abs(handle.marker_radii - handle.radius_mm).max()
    near = (points[:, 1] >= axial.min() - reach) & (points[:, 1] <= axial.max() + reach)
    chosen = np.flatnonzero(near & (labels == SIDE))
    x, y, z = points[chosen].T
    on_body = np.arctan2(x, z), y
    for k in _within_view(handle, origin):
        radius = handle.marker_radii[k]
        theta, height = on_body
        if radius != handle.radius_mm:
            theta, height = _on_cylinder(radius, origin, directions[:, chosen])
        level = np.flatnonzero(np.abs(height - axial[k]) <= along)  # a belt around the body
        turn = theta[level] - handle.marker_angles[k]
        turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
        inside = (radius * turn) ** 2 + (shrunk * (height[level] - axial[k])) ** 2 <= around**2
        labels[chosen[level[inside]]] = k


def _within_view(handle: Handle, origin: Array) -> np.ndarray:
    """Numbers of the markers that a ray from the origin, handle frame, may meet, shape (k,).

    From outside an endless cylinder a ray enters it on the side that faces the origin. A marker is
    left out if all of it lies on the far side; rounding has a milliradian to spare.
    """
    radii = handle.marker_radii
    distance = np.hypot(origin[0], origin[2])
    if distance <= radii.max():  # an origin within a cylinder
        return np.arange(len(radii))
    visible = np.arccos(radii / distance)
    half_marker = _half_axes(handle)[0] / radii
    turn = handle.marker_angles - np.arctan2(origin[0], origin[2])
    turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
    return np.flatnonzero(np.abs(turn) <= visible + half_marker + 1e-3)


def _on_cylinder(radius: float, origin: Array, directions: Array) -> tuple[Array, Array]:
    """Angle about the axis and axial coordinate where rays enter an endless cylinder, shapes (n,);
    NaN where they miss it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        depth, _ = _side_interval(radius, origin, directions)
    x, y, z = origin[:, None] + depth * directions
    return np.arctan2(x, z), y


def body_corners(handle: Handle, sides: int = 64) -> Array:
    """Corners of a prism that holds the body, handle frame, shape (2 sides, 3), mm."""
    theta = 2 * np.pi * np.arange(sides) / sides
    circle = (
        np.column_stack([np.sin(theta), np.zeros(sides), np.cos(theta)])
        * handle.radius_mm
        / np.cos(np.pi / sides)
    )
    return np.concatenate([circle + [0, handle.bottom_mm, 0], circle + [0, handle.top_mm, 0]])


def _subdivided(polygon: np.ndarray, parts: int = 8) -> Array:
    """A closed polygon, shape (n, 2), with each side cut into equal parts; shape (n parts, 2)."""
    weight = np.arange(parts)[:, None] / parts
    after = np.roll(polygon, -1, axis=0)
    return ((1 - weight) * polygon[:, None] + weight * after[:, None]).reshape(-1, 2)


def _outlines(
    camera: Camera, handle: Handle, T_world_handle: RigidTransform
) -> tuple[Array, Array]:
    """Points a quarter of a pixel apart on the edges that a camera may see: the body's, (n, 3), the
    markers', (m, 3).

    Handle frame, mm. Of a marker only what the body does not hide.
    """
    T_cam_handle = camera.T_cam_world * T_world_handle
    viewpoint = T_cam_handle.inv().translation
    depth = T_cam_handle.apply(body_corners(handle))[:, 2].min()
    step = 0.25 * max(depth, 20.0) / camera.focal.max()
    around, along, small = (
        int(min(length / step, 20_000)) + 8
        for length in (
            2 * np.pi * handle.radius_mm,
            handle.length_mm,
            np.pi * handle.marker_diameter_mm,
        )
    )
    theta = np.linspace(0, 2 * np.pi, around)
    axial = np.linspace(handle.bottom_mm, handle.top_mm, along)
    body = [
        on_cylinder(handle.radius_mm, theta, handle.bottom_mm),
        on_cylinder(handle.radius_mm, theta, handle.top_mm),
    ]
    body += [
        on_cylinder(handle.radius_mm, side, axial) for side in _silhouette_angles(handle, viewpoint)
    ]
    markers = np.concatenate(
        [marker_outline(handle, k, small) for k in range(len(handle.marker_angles))]
    )
    return np.concatenate(body), markers[facing(handle, markers, viewpoint)]


def _silhouette_angles(handle: Handle, viewpoint: Array) -> tuple[float, ...]:
    """Angles about the axis at which the side turns away from a viewpoint; none from within the
    endless cylinder.
    """
    distance = np.hypot(viewpoint[0], viewpoint[2])
    if distance <= handle.radius_mm:
        return ()
    towards = np.arctan2(viewpoint[0], viewpoint[2])
    half = np.arccos(handle.radius_mm / distance)
    return float(towards - half), float(towards + half)
