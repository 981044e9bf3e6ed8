"""What a wrapped marker's image looks like: windows of pixels about markers, and what each pixel shows before the blur.

A pixel's ray meets the cylinder in closed form; distances from the marker's edge and from the body's outline give the
share of the pixel's area that each covers. A view is a marker in a camera's image; arrays have one row a view, vectors
their three components first.

After a small motion of the handle (nu mm, omega rad, handle frame) the ray o + t d is, seen from the handle,
(o - nu - omega x o) + t (d - omega x d). All derivatives follow from that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from .camera import Rig
from .checks import Array
from .handle import Handle

GRAZING = 0.05  # cosine of ray and normal: a surface that is turned away further counts as this oblique


class Views(NamedTuple):
    """Which markers in which images: index of the camera and of the marker, each of shape (k,)."""

    camera: np.ndarray
    marker: np.ndarray


class Windows(NamedTuple):
    """Square windows of pixels, one a view, all of one side.

    Attributes
    ----------
    corner : ndarray of int, shape (k, 2)
        Column and row of the first pixel.
    side : int
    xy : ndarray, shape (2, k, p)
        Normalised ideal coordinates of the ``p = side ** 2`` pixels' centres, row by row.
    xy_per_px : ndarray, shape (k, 2, 2)
        Their derivatives by u and v in the middle of the window.
    """

    corner: np.ndarray
    side: int
    xy: np.ndarray
    xy_per_px: np.ndarray


class Layers(NamedTuple):
    """What the pixels of windows show, before the blur.

    Attributes
    ----------
    marker, body : ndarray, shape (k, p)
        Share of the pixel's area that the view's marker covers, and that all of the body does.
    d_marker, d_body : ndarray, shape (k, 6, p)
        Their derivatives by a small motion of the handle (nu mm, omega rad; handle frame).
    turn : ndarray, shape (k, p)
        Angle about the axis from the marker's column, rad.
    clear_px : ndarray, shape (k, p)
        Distance from whatever else is there, another marker's edge or the body's end; negative inside it.
    """

    marker: Array
    body: Array
    d_marker: Array
    d_body: Array
    turn: Array
    clear_px: Array


class _Rays(NamedTuple):
    """Rays in the handle's frame: start (3, k, 1), direction (3, k, p), its derivatives by u and v (3, k, 1)."""

    start: Array
    direction: Array
    by_u: Array
    by_v: Array


def windows(rig: Rig, views: Views, uv: Array, side: int) -> Windows:
    """Windows with pixels uv, shape (k, 2), in their middle; `side` is odd. They may reach beyond the image."""
    corner = np.round(uv).astype(int) - side // 2
    v, u = np.divmod(np.arange(side * side), side)
    xy, xy_per_px = np.empty((2, len(uv), side * side), np.float32), np.empty((len(uv), 2, 2), np.float32)
    steps = 0.5 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    for c, camera in enumerate(rig.cameras):
        mine = np.flatnonzero(views.camera == c)
        pixels = np.concatenate([corner[mine, None] + np.column_stack([u, v]), uv[mine, None] + steps], axis=1)
        found = camera.normalise(pixels.reshape(-1, 2)).reshape(len(mine), side * side + 4, 2)
        xy[:, mine] = found[:, :-4].transpose(2, 0, 1)
        # central differences over a pixel: exact but for the lens's curvature
        xy_per_px[mine] = np.stack([found[:, -4] - found[:, -3], found[:, -2] - found[:, -1]], axis=2)
    return Windows(corner, side, xy, xy_per_px)


def layers(rig: Rig, handle: Handle, T_world_handle: RigidTransform, views: Views, at: Windows) -> Layers:
    """What each pixel of windows shows of the handle at a pose (see `Layers`)."""
    rays = _rays(rig, T_world_handle, views, at)
    outside, body, d_body = _body(handle, rays)
    depth, X, normal = _surface(handle, rays, outside)
    turn, inside, gradient = _marker(handle, views.marker, X)
    facing = np.minimum(_dot(normal, rays.direction), -GRAZING)
    slope = gradient - normal * (_dot(gradient, rays.direction) / facing)
    by_u, by_v = depth * _dot(slope, rays.by_u), depth * _dot(slope, rays.by_v)
    marker, d_marker = _coverage(inside, by_u, by_v, -slope, -_cross(X, slope))
    d_marker = d_marker * body[:, None] + marker[:, None] * d_body
    clear = np.minimum(_beside(handle, views.marker, X), np.minimum(handle.top_mm - X[1], X[1] - handle.bottom_mm))
    return Layers(marker * body, body, d_marker, d_body, turn, clear / np.hypot(by_u, by_v))


def shading_basis(turn: Array) -> Array:
    """Functions of the angle from a marker's middle that make up the brightness around the body, (4, *shape of turn).

    The first is 1, the others vanish in the middle. With the next two any distant light is met, with the last nearly
    so where that light ends within the window.
    """
    s, c = np.sin(turn), 1 - np.cos(turn)
    return np.stack([np.ones_like(turn), s, c, s * c])


def _rays(rig: Rig, T_world_handle: RigidTransform, views: Views, at: Windows) -> _Rays:
    R_handle_world = T_world_handle.rotation.as_matrix().T
    turns = [R_handle_world @ camera.T_world_cam.rotation.as_matrix() for camera in rig.cameras]
    starts = [R_handle_world @ (camera.centre - T_world_handle.translation) for camera in rig.cameras]
    R = np.stack(turns, dtype=np.float32)[views.camera].transpose(2, 1, 0)[..., None]
    start = np.stack(starts, dtype=np.float32)[views.camera].T[..., None]
    by_u, by_v = (R[0] * at.xy_per_px[:, 0, k, None] + R[1] * at.xy_per_px[:, 1, k, None] for k in (0, 1))
    return _Rays(start, R[0] * at.xy[0] + R[1] * at.xy[1] + R[2], by_u, by_v)


def _body(handle: Handle, rays: _Rays) -> tuple[Array, Array, Array]:
    """How far rays pass the axis, signed (k, p) mm; the body's share of their pixels, and its derivatives."""
    (ox, oy, oz), (dx, _, dz) = rays.start, rays.direction
    length2 = dx * dx + dz * dz
    length = np.sqrt(length2)
    passing = (ox * dz - oz * dx) / length
    # derivatives of `passing` by the ray's start and direction; the y component of both is zero
    sx, sz = dz / length, -dx / length
    tx, tz = (-oz + passing * sz) / length, (ox - passing * sx) / length
    sign = -np.sign(passing)
    by_u, by_v = tx * rays.by_u[0] + tz * rays.by_u[2], tx * rays.by_v[0] + tz * rays.by_v[2]
    dy = rays.direction[1]
    by_nu = np.stack([-sx, np.zeros_like(sx), -sz])
    by_omega = -np.stack([oy * sz + dy * tz, oz * sx - ox * sz + dz * tx - dx * tz, -oy * sx - dy * tx])
    return passing, *_coverage(handle.radius_mm - np.abs(passing), by_u, by_v, sign * by_nu, sign * by_omega)


def _surface(handle: Handle, rays: _Rays, passing: Array) -> tuple[Array, Array, Array]:
    """Depth (k, p), point (3, k, p) and normal of the body's side where a ray meets it, or passes it nearest by."""
    (ox, _, oz), (dx, _, dz) = rays.start, rays.direction
    length2 = dx * dx + dz * dz
    half = np.sqrt(np.maximum(handle.radius_mm**2 - passing**2, 0.0) / length2)
    depth = -(ox * dx + oz * dz) / length2 - half
    X = rays.start + depth * rays.direction
    normal = X * np.array([1, 0, 1], np.float32)[:, None, None] / np.hypot(X[0], X[2])
    return depth, X, normal


def _marker(handle: Handle, markers: np.ndarray, X: Array) -> tuple[Array, Array, Array]:
    """Angle from a marker's column (k, p), distance into the marker from its edge, mm, and its gradient (3, k, p)."""
    angles, axial = (column.astype(np.float32)[markers, None] for column in (
        handle.marker_angles, handle.marker_centres[:, 1]))
    turn = np.arctan2(X[0], X[2]) - angles
    turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
    across, along = handle.radius_mm * turn, X[1] - axial
    distance = np.maximum(np.hypot(across, along), 1e-9)
    gradient = -np.stack([across * X[2] / handle.radius_mm, along, -across * X[0] / handle.radius_mm]) / distance
    return turn, handle.marker_diameter_mm / 2 - distance, gradient


def _beside(handle: Handle, markers: np.ndarray, X: Array, nearest: int = 2) -> Array:
    """Distance (k, p) on the surface from the edges of a marker's nearest neighbours, mm."""
    theta, axial = handle.marker_angles, handle.marker_centres[:, 1]
    gap = np.hypot(handle.radius_mm * _wrapped(theta[:, None] - theta), axial[:, None] - axial)
    np.fill_diagonal(gap, np.inf)
    others = gap.argsort(axis=1)[markers, :nearest].T[..., None]  # (nearest, k, 1)
    theta, axial = theta.astype(np.float32), axial.astype(np.float32)
    angle = np.arctan2(X[0], X[2])
    distance = np.hypot(handle.radius_mm * _wrapped(angle - theta[others]), X[1] - axial[others]).min(axis=0)
    return distance - handle.marker_diameter_mm / 2


def _coverage(inside: Array, by_u: Array, by_v: Array, by_nu: Array, by_omega: Array) -> tuple[Array, Array]:
    """Share (k, p) of a pixel's area on the inner side of an edge, and its derivatives (k, 6, p).

    The edge is straight within a pixel: `inside` mm away, with derivatives `by_u`, `by_v` by the pixel (k, p) and
    `by_nu`, `by_omega` by the motion (3, k, p). The share is then the integral of a trapezoid.
    """
    long, short = np.maximum(np.abs(by_u), np.abs(by_v)), np.maximum(np.minimum(np.abs(by_u), np.abs(by_v)), 1e-12)
    away = np.abs(inside)
    left = np.maximum((long + short) / 2 - away, 0.0)  # to where the edge leaves the pixel
    corner = left < short  # it cuts off no more than a corner
    outer = np.where(corner, left**2 / (2 * long * short), 0.5 - away / long)
    rate = np.where(corner, left / (long * short), 1 / long)
    return np.where(inside > 0, 1 - outer, outer), np.concatenate([by_nu * rate, by_omega * rate]).transpose(1, 0, 2)


def _wrapped(angle: Array) -> Array:
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


def _dot(a: Array, b: Array) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
