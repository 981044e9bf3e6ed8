"""The workspace: the intersection of solid cones of view, its extent, volume and surface; the true
fields of view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection

from ..camera import Camera, Rig
from ..checks import Array, as_array, as_number, frozen
from .cones import Cone, as_cones, chord, corners
from .extent import (
    FARTHEST,
    bounding_box,
    inscribed_ball,
    largest_ball,
    share_direction,
    spread,
    volume_and_centroid,
)

# radius of the inscribed ball, relative to the apexes' spread, that counts as none
EMPTY_BELOW = 1e-9


@dataclass(frozen=True, eq=False)
class Workspace:
    """The intersection of solid cones; arrays in the cones' frame, NaN where a quantity is not
    defined.

    Attributes
    ----------
    cones : tuple of Cone
        As given.
    status : {"bounded", "empty", "unbounded"}
        Empty also where the cones touch without sharing a volume; unbounded also where they reach
        farther than a hundred thousand times their apexes' distance.
    bounding_box : ndarray, shape (2, 3)
        Lowest and highest x, y, z, mm.
    centre : ndarray, shape (3,)
        Of the largest ball inside, mm; `radius` is its radius.
    volume : float
        mm^3: 0 if empty, infinite if unbounded.
    centroid : ndarray, shape (3,)
        mm.
    """

    cones: tuple[Cone, ...]
    status: str
    bounding_box: Array
    centre: Array
    radius: float
    volume: float
    centroid: Array


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """The common field of view of all cameras of a rig: `status` as in `Workspace`, corners (k, 3)
    in mm, triangles (m, 3), mm^3.
    """

    status: str
    vertices: Array
    triangles: np.ndarray
    volume: float


def intersect(cones: Sequence[Cone]) -> Workspace:
    """Intersect any number of solid cones (Eq. 4).

    The volume is right to 1e-7, and the centroid to that part of the length. That holds for needles
    and for cones that only just overlap, too, as long as the part that they share is less than a
    million times as long as thick.

    Raises
    ------
    ValueError
        If there is no cone.
    """
    given = as_cones(cones)
    if share_direction(given, margin=1e-9):
        return _without_extent(given, "unbounded")
    _, size = spread(given)
    centre, radius = inscribed_ball(given)
    if radius <= EMPTY_BELOW * size:
        return _without_extent(given, "empty")
    if share_direction(given, margin=-1e-9):
        return _without_extent(given, "unbounded")
    box = bounding_box(given, centre)
    if np.abs(box - centre).max() > FARTHEST / 2 * size:
        return _without_extent(given, "unbounded")
    volume, centroid = volume_and_centroid(given, (centre, radius), box)
    return Workspace(
        given, "bounded", frozen(box), frozen(centre), radius, volume, frozen(centroid)
    )


def is_unbounded(cones: Sequence[Cone]) -> bool:
    """Whether the intersection of solid cones has no end, see `Workspace`."""
    return intersect(cones).status == "unbounded"


def surface_mesh(cones: Sequence[Cone], centre: Array, n: int = 4000) -> tuple[Array, np.ndarray]:
    """Triangles over the surface of a bounded intersection of cones, seen from a point inside it.

    Parameters
    ----------
    cones : sequence of Cone
    centre : array_like, shape (3,)
        Inside all of them, mm: `Workspace.centre`.
    n : int
        Number of vertices, at least 4; they are spread evenly over the directions.

    Returns
    -------
    vertices : ndarray, shape (n, 3)
        On the surface, mm.
    triangles : ndarray of int, shape (2 n - 4, 3)
        Counter-clockwise seen from outside.

    Raises
    ------
    ValueError
        If `centre` is not inside, or the intersection has no end.
    """
    cones = as_cones(cones)
    centre = as_array(centre, "centre", (3,))
    directions = _spread(int(as_number(n, "n", low=4)))
    ends = [chord(cone, centre, directions) for cone in cones]
    distance = np.min([high for _, high in ends], axis=0)
    if np.max([low for low, _ in ends]) >= 0 or not (distance > 0).all():
        raise ValueError(f"centre: expected a point inside all cones, got {centre.tolist()}")
    if not np.isfinite(distance).all():
        raise ValueError("cones: expected a bounded intersection, got one without an end")
    return centre + distance[:, None] * directions, _outward(directions, ConvexHull(directions))


def mesh_volume(vertices: Array, triangles: np.ndarray) -> float:
    """Volume inside a closed mesh whose triangles are counter-clockwise seen from outside, mm^3."""
    a, b, c = (vertices[triangles[:, k]] - vertices.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def view_volume(rig: Rig, farthest_mm: float | None = None) -> Polyhedron:
    """The true common field of view: the intersection of the pyramids that the images' edges span.

    Parameters
    ----------
    rig : Rig
    farthest_mm : float, optional
        The pyramids end at this depth before each camera; without it they have no end.

    Raises
    ------
    ValueError
        If a camera has lens distortion: its field of view has curved sides.
    """
    planes = np.vstack([_pyramid(camera) for camera in rig.cameras])
    if farthest_mm is not None:
        depth = as_number(farthest_mm, "farthest_mm", low=0.0, open_low=True)
        # the plane at that depth before each camera
        ends = [np.append(one.axis, -one.axis @ one.centre - depth) for one in rig.cameras]
        planes = np.vstack([planes, *ends])
    scale = (
        max(float(np.linalg.norm(camera.centre - rig.cameras[0].centre)) for camera in rig.cameras)
        or 1.0
    )
    if farthest_mm is not None:
        scale = max(scale, farthest_mm)  # within which all lies
    p, r = largest_ball(planes[:, :3], -planes[:, 3] / scale)
    if r <= EMPTY_BELOW:
        return Polyhedron("empty", np.empty((0, 3)), np.empty((0, 3), dtype=int), 0.0)
    if np.abs(p).max() > FARTHEST / 10:
        return Polyhedron("unbounded", np.empty((0, 3)), np.empty((0, 3), dtype=int), np.inf)
    points = HalfspaceIntersection(planes, scale * p).intersections
    hull = ConvexHull(points)
    return Polyhedron("bounded", frozen(points), frozen(_outward(points, hull)), float(hull.volume))


def _pyramid(camera: Camera) -> Array:
    """The four sides of what a camera sees, shape (4, 4): normal . p + offset <= 0 inside."""
    if np.any(camera.distortions):
        raise ValueError(
            f"camera {camera.name}: expected no lens distortion, got {camera.distortions.tolist()}"
        )
    rays = camera.rays(corners(camera))
    normals = np.cross(np.roll(rays, -1, axis=0), rays)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.column_stack([normals, -normals @ camera.centre])


def _outward(points: Array, hull: ConvexHull) -> np.ndarray:
    """The hull's triangles with their corners counter-clockwise seen from outside."""
    triangles = hull.simplices.copy()
    a, b, c = (points[triangles[:, k]] for k in range(3))
    wrong = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    triangles[wrong] = triangles[wrong][:, ::-1]
    return triangles


def _spread(n: int) -> Array:
    """n directions, evenly spread along a spiral, shape (n, 3)."""
    k = np.arange(n) + 0.5
    z = 1 - 2 * k / n
    turn = np.pi * (1 + np.sqrt(5)) * k
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])


def _without_extent(cones: tuple[Cone, ...], status: str) -> Workspace:
    nan = frozen(np.full(3, np.nan))
    volume = 0.0 if status == "empty" else np.inf
    return Workspace(cones, status, frozen(np.full((2, 3), np.nan)), nan, np.nan, volume, nan)
