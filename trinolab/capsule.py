"""Viewing rays against capsules, the solids of which the simulated hand and forearm are made.

A capsule is all points within a radius of a line segment; a ray meets it in closed form.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .camera import Camera
from .checks import Array
from .raycast import hull_region


class Capsules(NamedTuple):
    """Points within ``radii`` (m,) of the segments from ``starts`` (m, 3) to ``ends`` (m, 3), mm, in one frame."""

    starts: Array
    ends: Array
    radii: Array


class CapsuleHits(NamedTuple):
    """Where rays first meet capsules: ``depths`` (n,), infinite for a miss, and the outward ``normals`` (n, 3)."""

    depths: Array
    normals: Array


def in_camera(camera: Camera, solids: Capsules) -> Capsules:
    """Capsules of the world frame in a camera's frame."""
    T = camera.T_cam_world
    return Capsules(T.apply(solids.starts), T.apply(solids.ends), solids.radii)


def capsule_region(camera: Camera, local: Capsules) -> np.ndarray:
    """Pixels that may see capsules of the camera's frame, bool (height, width); see `raycast.hull_region`."""
    region = np.zeros(camera.size[::-1], bool)
    for corners in capsule_corners(local):
        region |= hull_region(camera, corners)
    return region


def cast_capsules(local: Capsules, directions: Array) -> CapsuleHits:
    """Intersect rays from a camera's centre with capsules.

    Parameters
    ----------
    local : Capsules
        In the camera's frame.
    directions : ndarray, shape (3, n)
        In the camera's frame, of any length, z > 0. A depth counts in lengths of the direction: it is z where the
        direction's z is 1.
    """
    depths, normals = np.full(directions.shape[1], np.inf), np.zeros((directions.shape[1], 3))
    x, y, z = directions
    for start, end, radius, low, high in zip(*local, *_boxes(local), strict=True):
        near = np.flatnonzero((x >= low[0] * z) & (x <= high[0] * z) & (y >= low[1] * z) & (y <= high[1] * z))
        if not near.size:
            continue
        rays = directions[:, near]
        depth = _meet_capsule(start, end, radius, rays)
        closer = depth < depths[near]
        chosen = near[closer]
        depths[chosen] = depth[closer]
        normals[chosen] = _normals(start, end, radius, (depth[closer] * rays[:, closer]).T)
    return CapsuleHits(depths, normals)


def _ball(count: int = 100) -> Array:
    """Corners of a polyhedron that holds the unit ball, evenly spaced (Fibonacci's lattice), shape (count, 3)."""
    height = (2 * np.arange(count) + 1) / count - 1
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - height**2)
    return 1.08 * np.column_stack([across * np.cos(turn), across * np.sin(turn), height])


_BALL = _ball()


def capsule_corners(local: Capsules) -> Array:
    """Points whose convex hull holds each capsule, shape (m, n, 3), mm."""
    ball = local.radii[:, None, None] * _BALL
    return np.concatenate([local.starts[:, None] + ball, local.ends[:, None] + ball], axis=1)


def _boxes(local: Capsules) -> tuple[Array, Array]:
    """Lowest and highest x/z, y/z of each capsule, shapes (m, 2); no limits where one reaches behind the camera."""
    corners = capsule_corners(local)
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = corners[..., :2] / corners[..., 2:]
    low, high = xy.min(axis=1), xy.max(axis=1)
    low[(corners[..., 2] <= 0).any(axis=1)] = -np.inf
    high[(corners[..., 2] <= 0).any(axis=1)] = np.inf
    return low, high


def _meet_capsule(start: Array, end: Array, radius: float, rays: Array) -> Array:
    """Depth at which rays from the origin enter a capsule, shape (n,); infinity for a miss, or from within."""
    axis, squared = end - start, (rays**2).sum(axis=0)
    along, towards = axis @ rays, start @ rays
    length2, offset = axis @ axis, -start @ axis
    with np.errstate(divide="ignore", invalid="ignore"):
        a = length2 * squared - along**2
        b = -length2 * towards - offset * along
        c = length2 * (start @ start - radius**2) - offset**2
        depth = (-b - np.sqrt(b**2 - a * c)) / a
        height = offset + depth * along
        on_side = (height >= 0) & (height <= length2)
    depth[~on_side] = np.inf
    for centre in (start, end):
        depth = np.minimum(depth, _meet_ball(centre, radius, rays, squared))
    share = np.clip(offset / max(float(length2), 1e-12), 0, 1)
    within = np.linalg.norm(start + share * axis) < radius
    depth[~(depth > 0) | within] = np.inf
    return depth


def _meet_ball(centre: Array, radius: float, rays: Array, squared: Array) -> Array:
    """Depth at which rays from the origin enter a ball, shape (n,); infinity for a miss."""
    towards = centre @ rays
    with np.errstate(invalid="ignore"):
        depth = (towards - np.sqrt(towards**2 - squared * (centre @ centre - radius**2))) / squared
    depth[~(depth > 0)] = np.inf
    return depth


def _normals(start: Array, end: Array, radius: float, points: Array) -> Array:
    """Outward normals of a capsule at points of its surface, shape (n, 3)."""
    axis = end - start
    share = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0, 1)
    return (points - start - share[:, None] * axis) / radius
