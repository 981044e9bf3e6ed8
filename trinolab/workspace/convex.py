"""Emptiness and extent of an intersection of solid cones: common directions, and cutting planes (Kelley 1960).

A solid cone is the intersection of the half-spaces that touch it along its generators, n(t) . (p - apex) <= 0: linear
programmes over as many of these planes as it takes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linprog

from ..checks import Array
from .cones import Cone

BOX = 1e6  # half side of the box around the linear programmes, in the unit of `Planes`
FIRST_PLANES = 24  # tangent planes a cone to begin with
TOLERANCE = 1e-10  # violation at which the cutting planes are enough, in the unit of `Planes`


class Planes:
    """Half-spaces normal . p <= offset that contain the solid cones; `add` makes them tighter where a point violates.

    Lengths are in the unit `scale` (mm) from `origin`, so that tolerances are relative.
    """

    def __init__(self, cones: Sequence[Cone]) -> None:
        self.cones = cones
        self.origin, self.scale = _frame(cones)
        self.apexes = [(cone.apex - self.origin) / self.scale for cone in cones]
        t = np.arange(FIRST_PLANES) * (2 * np.pi / FIRST_PLANES)
        self.normals = np.vstack([cone.normals(t) for cone in cones])
        self.offsets = np.concatenate([cone.normals(t) @ apex for cone, apex in zip(cones, self.apexes, strict=True)])

    def add(self, p: Array, r: float) -> float:
        """Add each cone's plane that the ball about p of radius r violates most; return the largest violation."""
        worst = -np.inf
        for cone, apex in zip(self.cones, self.apexes, strict=True):
            x = p - apex
            t = np.arctan2(x @ cone.across[1], x @ cone.across[0])
            normal = cone.normals([t])
            self.normals = np.vstack([self.normals, normal])
            self.offsets = np.append(self.offsets, normal @ apex)
            worst = max(worst, float(normal[0] @ x) + r)
        return worst


def inscribed_ball(planes: Planes) -> tuple[Array, float]:
    """Centre and radius of the largest ball in all cones, in the units of `planes`.

    The linear programme over some of the planes can only find too large a ball: radius <= 0 proves that the cones
    share no ball at all. `BOX` bounds the answer; a centre there means that the cones reach at least so far.
    """
    for _ in range(200):
        p, r = largest_ball(planes.normals, planes.offsets)
        if r <= 0 or planes.add(p, r) <= TOLERANCE:
            break
    return p, r


def largest_ball(normals: Array, offsets: Array, box: float = BOX) -> tuple[Array, float]:
    """Centre and radius of the largest ball with normals . p + r <= offsets; r < 0 where there is none.

    Parameters
    ----------
    normals : ndarray, shape (n, 3), of length 1
    offsets : ndarray, shape (n,)
    """
    A = np.column_stack([normals, np.ones(len(normals))])
    solution = _solve([0.0, 0.0, 0.0, -1.0], A, offsets, [(-box, box)] * 3 + [(-box, box)])
    return solution[:3], float(solution[3])


def support(planes: Planes, direction: Array) -> float:
    """The largest direction . p over the intersection of the cones, in the units of `planes`."""
    for _ in range(200):
        p = _solve(-direction, planes.normals, planes.offsets, [(-BOX, BOX)] * 3)
        if planes.add(p, 0.0) <= TOLERANCE:
            break
    return float(direction @ p)


def bounds(planes: Planes) -> Array:
    """Lowest and highest x, y, z over the intersection of the cones, shape (2, 3), in the units of `planes`."""
    return np.array([[sign * support(planes, sign * axis) for axis in np.eye(3)] for sign in (-1.0, 1.0)])


def share_direction(cones: Sequence[Cone], margin: float = 0.0) -> bool:
    """Whether some direction lies in all cones, each narrowed by `margin` (rad): then their intersection has no end.

    On the sphere of directions each cone is a cap smaller than a hemisphere, so what they share is convex. If it is
    not empty, its border is either the whole circle of one cap, and then that cap's axis lies in all of them; or it
    has a corner, where two circles meet. So axes and meeting points are all that must be tried.
    """
    angles = np.array([cone.half_angle for cone in cones]) - margin
    axes = np.array([cone.axis for cone in cones])
    tries = [axes] + [_circles_meet(axes[i], axes[j], angles[i], angles[j])
                      for i in range(len(cones)) for j in range(i)]
    return bool(((np.vstack(tries) @ axes.T) >= np.cos(angles) - 1e-14).all(axis=1).any())


def _frame(cones: Sequence[Cone]) -> tuple[Array, float]:
    """Middle of the apexes, and the largest distance of one from it (1 mm if all are in one place)."""
    apexes = np.array([cone.apex for cone in cones])
    origin = apexes.mean(axis=0)
    return origin, float(np.linalg.norm(apexes - origin, axis=1).max()) or 1.0


def _solve(cost: Sequence[float] | Array, A: Array, b: Array, bounds: list[tuple[float, float]]) -> Array:
    result = linprog(cost, A_ub=A, b_ub=b, bounds=bounds, method="highs-ds",
                     options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10})
    if result.x is None:
        raise ValueError(f"cones: the linear programme failed ({result.message})")
    return result.x


def _circles_meet(axis1: Array, axis2: Array, angle1: float, angle2: float) -> Array:
    """Unit directions at angle1 from axis1 and angle2 from axis2, shape (2, 3), or (0, 3) where there is none."""
    normal, g = np.cross(axis1, axis2), float(axis1 @ axis2)
    sin2 = float(normal @ normal)
    if sin2 < 1e-20:
        return np.empty((0, 3))
    c1, c2 = np.cos(angle1), np.cos(angle2)
    flat = ((c1 - c2 * g) * axis1 + (c2 - c1 * g) * axis2) / sin2
    rest = 1.0 - float(flat @ flat)
    if rest < -1e-14:
        return np.empty((0, 3))
    lift = np.sqrt(max(rest, 0.0) / sin2) * normal
    return np.stack([flat + lift, flat - lift])
