"""Solid cones of view: membership, surface, and the cones of the paper's three cameras (Eq. 1-3).

A cone here is the convex solid of one nappe: all points whose direction from the apex is within the
half angle of the axis. Lengths mm, angles rad. Sect. 3's frame OXYZ: origin CCD1's centre, X along
the baseline, Z away from the cameras in the plane of the two optical axes, Y = Z x X, which points
down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..camera import Camera, Rig
from ..checks import Array, as_array, as_number, as_points, as_unit, frozen


@dataclass(frozen=True, eq=False)
class Cone:
    """A solid cone of one nappe.

    Attributes
    ----------
    apex : ndarray, shape (3,)
        mm.
    axis : ndarray, shape (3,)
        Into the cone; any length comes in, length 1 is stored.
    half_angle : float
        Between axis and surface, rad, more than 0 and less than pi / 2.
    """

    apex: Array
    axis: Array
    half_angle: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "apex", as_array(self.apex, "apex", (3,)))
        object.__setattr__(self, "axis", as_unit(self.axis, "axis"))
        object.__setattr__(self, "half_angle", _as_half_angle(self.half_angle, "half_angle"))

    @cached_property
    def across(self) -> Array:
        """Two directions across the axis, shape (2, 3), right-handed with it: Y x axis first, or X
        if that is Y.
        """
        first = np.cross([0.0, 1.0, 0.0], self.axis)
        if np.linalg.norm(first) < 1e-3:
            first = np.array([1.0, 0.0, 0.0]) - self.axis[0] * self.axis
        first /= np.linalg.norm(first)
        return frozen(np.stack([first, np.cross(self.axis, first)]))

    def radial(self, t: ArrayLike) -> Array:
        """Directions across the axis at angles t, shape (n, 3)."""
        t = as_array(t, "t", (None,))
        return np.column_stack([np.cos(t), np.sin(t)]) @ self.across

    def generators(self, t: ArrayLike) -> Array:
        """Directions along the surface from the apex at angles t, shape (n, 3), length 1."""
        return np.cos(self.half_angle) * self.axis + np.sin(self.half_angle) * self.radial(t)

    def normals(self, t: ArrayLike) -> Array:
        """Outward normals, the same all along the generator at angle t, shape (n, 3), length 1."""
        return np.cos(self.half_angle) * self.radial(t) - np.sin(self.half_angle) * self.axis


def inside(cones: Sequence[Cone], points: ArrayLike) -> np.ndarray:
    """Whether points lie in every solid cone, surface included: the workspace as a set (Eq. 4).

    Parameters
    ----------
    cones : sequence of Cone
    points : array_like, shape (n, 3)
        In the cones' frame, mm.

    Returns
    -------
    ndarray of bool, shape (n,)
        False for NaN rows.

    Raises
    ------
    ValueError
        If there is no cone.
    """
    points = as_points(points, "points", 3)
    result = np.ones(len(points), dtype=bool)
    for cone in as_cones(cones):
        x = points - cone.apex
        result &= x @ cone.axis >= np.cos(cone.half_angle) * np.linalg.norm(x, axis=1)
    return result


def chord(cone: Cone, start: Array, directions: Array) -> tuple[Array, Array]:
    """The part of each line ``start + s direction`` that lies inside a solid cone: s from `low` to
    `high`.

    Parameters
    ----------
    start : ndarray, shape (3,)
    directions : ndarray, shape (n, 3), of length 1

    Returns
    -------
    low, high : ndarray, shape (n,)
        In mm, infinite where the line stays inside; low > high where it misses the cone.
    """
    m = start - cone.apex
    cos2 = np.cos(cone.half_angle) ** 2
    along = directions @ cone.axis
    a = along**2 - cos2  # inside both nappes: a s^2 + 2 b s + c >= 0
    b = (m @ cone.axis) * along - cos2 * (directions @ m)
    c = (m @ cone.axis) ** 2 - cos2 * (m @ m)
    near, far = _roots(a, b, c)
    first = np.minimum(near, far)
    second = np.maximum(near, far)
    front = m @ cone.axis + near * along >= 0  # the nappe that both roots lie on, for a < 0
    low = np.where(a > 0, np.where(along > 0, second, -np.inf), np.where(front, first, np.inf))
    high = np.where(a > 0, np.where(along > 0, np.inf, first), np.where(front, second, -np.inf))
    return low, high


def cone_surface(cone: Cone, a: ArrayLike, t: ArrayLike) -> Array:
    """Points of a cone's surface in the paper's parameters: radius a about the axis, angle t
    (Eq. 1-3).

    Parameters
    ----------
    a, t : array_like, shape (n,)
        mm, at least 0; rad.

    Returns
    -------
    ndarray, shape (n, 3)
        ``apex + a radial(t) + a cot(half_angle) axis``.
    """
    a = as_array(a, "a", (None,))
    if (a < 0).any():
        raise ValueError(f"a: expected radii of at least 0, got {a.min():g}")
    t = as_array(t, "t", a.shape)
    return cone.apex + a[:, None] * (cone.radial(t) + cone.axis / np.tan(cone.half_angle))


def paper_cones(
    baseline: float, beta1: float, beta2: float, half_angle: float
) -> tuple[Cone, Cone, Cone]:
    """The cones of CCD1, CCD2, CCD3 in OXYZ, with the matrices turned as the text means them
    (Eq. 1-3).

    The axes of CCD1 and CCD2 meet at (x0, 0, z0). CCD3 is moved from there along +Y by CCD1's
    distance, as printed, and looks back along -Y. (Y points down: a camera above the work is the
    mirror image, of the same volume.)

    Parameters
    ----------
    baseline : float
        B, mm, positive.
    beta1, beta2 : float
        Angles between the baseline and the axes of CCD1 and CCD2, inside the triangle, rad, in (0,
        pi/2].
    half_angle : float
        omega, rad, in (0, pi/2); see `half_angle`.

    Raises
    ------
    ValueError
        For two right angles: the axes are parallel.
    """
    B = as_number(baseline, "baseline", low=0.0, open_low=True)
    beta1 = as_number(beta1, "beta1", low=0.0, high=np.pi / 2, open_low=True)
    beta2 = as_number(beta2, "beta2", low=0.0, high=np.pi / 2, open_low=True)
    if np.pi - beta1 - beta2 < 1e-12:
        raise ValueError("beta1, beta2: expected axes that meet, got two right angles")
    # CCD1 to the intersection: x0 = B tan b2 / (tan b1 + tan b2)
    reach = B * np.sin(beta2) / np.sin(beta1 + beta2)
    axis1 = np.array([np.cos(beta1), 0.0, np.sin(beta1)])
    third = reach * (axis1 + [0.0, 1.0, 0.0])
    return (
        Cone(np.zeros(3), axis1, half_angle),
        Cone(np.array([B, 0.0, 0.0]), np.array([-np.cos(beta2), 0.0, np.sin(beta2)]), half_angle),
        Cone(third, np.array([0.0, -1.0, 0.0]), half_angle),
    )


def half_angle(size: ArrayLike, focal: ArrayLike) -> float:
    """Half angle omega of the cone around an image whose principal point is its middle, rad
    (Sect. 3.2).

    Parameters
    ----------
    size : array_like, shape (2,)
        The sensor's whole sides T_x, T_y; the halves go into the formula.
    focal : float or array_like, shape (2,)
        In the unit of `size`; one for both directions, or one each.
    """
    sides = as_array(size, "size", (2,))
    lengths = as_array(
        np.broadcast_to(np.asarray(focal, dtype=float), (2,)) if np.ndim(focal) == 0 else focal,
        "focal",
        (2,),
    )
    for name, values in (("size", sides), ("focal", lengths)):
        if (values <= 0).any():
            raise ValueError(f"{name}: expected positive numbers, got {values.min():g}")
    return float(np.arctan(np.hypot(*(sides / 2 / lengths))))


def cones_of_rig(rig: Rig) -> tuple[Cone, ...]:
    """The cones around what each camera sees: about the optical axis, to the farthest corner of the
    image.

    Returns
    -------
    tuple of Cone
        In the world frame, one per camera.

    Raises
    ------
    ValueError
        If a lens model has no ray for a corner of the image.
    """
    return tuple(Cone(camera.centre, camera.axis, _corner_angle(camera)) for camera in rig.cameras)


def corners(camera: Camera) -> Array:
    """The image's outer corners in pixels, shape (4, 2), clockwise as seen: half a pixel outside
    the corner pixels.
    """
    width, height = camera.size
    return np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]) - 0.5


def as_cones(value: Sequence[Cone]) -> tuple[Cone, ...]:
    """Check a sequence of cones; ValueError if it is empty or holds something else."""
    cones = tuple(value)
    if not cones or not all(isinstance(cone, Cone) for cone in cones):
        raise ValueError(f"cones: expected one Cone or more, got {len(cones)} objects")
    return cones


def _roots(a: Array, b: Array, c: float) -> tuple[Array, Array]:
    """Both roots of a s^2 + 2 b s + c without cancellation, the smaller magnitude first; NaN where
    there is none.

    For a > 0 a line always meets both nappes, so that a negative discriminant is rounding. For a =
    0, a line along a generator, the second root is far away on the side where a slightly negative a
    would put it.
    """
    discriminant = np.where(a > 0, np.maximum(b * b - a * c, 0.0), b * b - a * c)
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -(b + np.copysign(np.sqrt(discriminant), b))
        return np.where(q == 0, 0.0, c / q), q / np.where(a == 0, -1e-30, a)


def _corner_angle(camera: Camera) -> float:
    cosines = camera.rays(corners(camera)) @ camera.axis
    if not np.isfinite(cosines).all():
        raise ValueError(
            f"camera {camera.name}: its distortion has no ray for a corner of the image"
        )
    return float(np.arccos(cosines.min()))


def _as_half_angle(value: float, name: str) -> float:
    angle = as_number(value, name, low=0.0, high=np.pi / 2, open_low=True)
    if angle >= np.pi / 2:
        raise ValueError(f"{name}: expected less than pi/2, got {angle!r}")
    return angle
