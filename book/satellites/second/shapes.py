"""Triangle meshes with normals and texture coordinates: the handle's side and caps, panels,
capsules.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.checks import Array
from trinolab.handle import Handle

SIDES = 720  # of a tube: the chord of one lies 0.05 um below a radius of 5 mm
_RINGS = 32  # of a capsule, an even number
_TEXEL_MM = 0.02  # of the markers' texture: a tenth of a pixel


class Mesh(NamedTuple):
    """A surface of triangles.

    Attributes
    ----------
    points, normals : ndarray, shape (n, 3)
        mm, in one frame; the normals have length 1.
    uv : ndarray, shape (n, 2)
        Texture coordinates, 0 to 1.
    faces : ndarray of int, shape (m, 3)
    """

    points: Array
    normals: Array
    uv: Array
    faces: np.ndarray


def moved(mesh: Mesh, T: RigidTransform) -> Mesh:
    """The mesh in another frame."""
    return mesh._replace(points=T.apply(mesh.points), normals=T.rotation.apply(mesh.normals))


def tube(radius: float, low: float, high: float) -> Mesh:
    """The side of a cylinder about y, from `low` to `high`; u goes round it from z to x, v along it."""
    share = np.linspace(0, 1, SIDES + 1)
    ring = np.column_stack(
        [np.sin(2 * np.pi * share), np.zeros_like(share), np.cos(2 * np.pi * share)]
    )
    points = np.concatenate([radius * ring + [0, low, 0], radius * ring + [0, high, 0]])
    uv = np.concatenate([np.column_stack([share, np.full_like(share, v)]) for v in (0.0, 1.0)])
    return Mesh(points, np.concatenate([ring, ring]), uv, _strip(SIDES + 1))


def disc(radius: float, axial: float, up: bool) -> Mesh:
    """A disc across y, seen from above (+y) or from below."""
    theta = np.linspace(0, 2 * np.pi, SIDES, endpoint=False)
    rim = radius * np.column_stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)])
    points = np.concatenate([rim, np.zeros((1, 3))]) + [0, axial, 0]
    k = np.arange(SIDES)
    faces = np.column_stack([k, (k + 1) % SIDES, np.full(SIDES, SIDES)])
    normals = np.tile([0.0, 1.0 if up else -1.0, 0.0], (SIDES + 1, 1))
    return Mesh(points, normals, np.zeros((SIDES + 1, 2)), faces if up else faces[:, ::-1])


def panel(middle: ArrayLike, right: ArrayLike, down: ArrayLike) -> Mesh:
    """A parallelogram about its middle; `right` and `down` are half of its sides, and its normal is
    ``down x right``.
    """
    sides = np.array([right, down], float)
    signs = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
    normal = np.cross(sides[1], sides[0])
    normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
    faces = np.array([[0, 2, 1], [1, 2, 3]])
    return Mesh(np.array(middle, float) + signs @ sides, normals, (signs + 1) / 2, faces)


def capsule(start: ArrayLike, end: ArrayLike, radius: float) -> Mesh:
    """All points at a distance from a segment."""
    first, last = np.array(start, float), np.array(end, float)
    axis, _ = Rotation.align_vectors([last - first], [[0.0, 1.0, 0.0]])
    length = float(np.linalg.norm(last - first))
    polar = np.pi * np.linspace(0, 1, _RINGS)
    height = np.where(polar < np.pi / 2, length, 0.0)
    turn = np.linspace(0, 2 * np.pi, 2 * _RINGS)
    normals = np.stack(
        [
            np.sin(polar)[:, None] * np.sin(turn),
            np.cos(polar)[:, None] + 0 * turn,
            np.sin(polar)[:, None] * np.cos(turn),
        ],
        axis=-1,
    ).reshape(-1, 3)
    points = radius * normals + np.repeat(height, len(turn))[:, None] * [0.0, 1.0, 0.0]
    rows = [_strip(len(turn))[:, ::-1] + k * len(turn) for k in range(_RINGS - 1)]
    uv = np.zeros((len(points), 2))
    return Mesh(first + axis.apply(points), axis.apply(normals), uv, np.concatenate(rows))


def band(handle: Handle) -> tuple[float, float]:
    """The axial coordinates between which all markers lie, with a little to spare, mm."""
    axial = handle.marker_centres[:, 1]
    reach = handle.marker_diameter_mm / 2 + 0.5
    return max(axial.min() - reach, handle.bottom_mm), min(axial.max() + reach, handle.top_mm)


def marker_texture(handle: Handle) -> np.ndarray:
    """Which share of each texel of the band belongs to a marker, float32; row 0 is at its low end.

    The file's marker is a flat disc that is wrapped on the body: a circle on the unrolled surface.
    """
    low, high = band(handle)
    around = round(2 * np.pi * handle.radius_mm / _TEXEL_MM)
    along = round((high - low) / _TEXEL_MM)
    theta = 2 * np.pi * (np.arange(around) + 0.5) / around
    axial = low + (high - low) * (np.arange(along) + 0.5) / along
    share = np.zeros((along, around), np.float32)
    for angle, middle in zip(handle.marker_angles, handle.marker_centres[:, 1], strict=True):
        turn = (theta - angle + np.pi) % (2 * np.pi) - np.pi
        distance = np.hypot(handle.radius_mm * turn, (axial - middle)[:, None])
        inside = (handle.marker_diameter_mm / 2 - distance) / _TEXEL_MM + 0.5
        share = np.maximum(share, np.clip(inside, 0, 1).astype(np.float32))
    return share


def _strip(count: int) -> np.ndarray:
    """The faces between two rows of `count` points each."""
    k = np.arange(count - 1)
    lower = np.column_stack([k, k + 1, k + count + 1])
    upper = np.column_stack([k, k + count + 1, k + count])
    return np.concatenate([lower, upper])
