"""Emptiness, extent, volume and centroid of an intersection of solid cones, by planes that touch
the cones.

A solid cone is the intersection of the half-spaces that touch it along its generators, n(t) . (p -
apex) <= 0. Finitely many of them enclose the cones' intersection in a polyhedron. More planes are
added only where it sticks out of a cone: one plane at the worst place (the cutting planes of Kelley
1960) for the inscribed ball and the bounding box, and planes at equal steps for the volume.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

from ..checks import Array
from .cones import Cone

# For the ball and the box; lengths in units of the apexes' spread.
FARTHEST = 1e6  # half side of the box around everything
FIRST_PLANES = 24  # tangent planes a cone to begin with
TOLERANCE = 1e-10  # length that ball and box may be beyond a cone
# of cutting planes for the box; about 15 are needed, far bodies end in rounding before `TOLERANCE`
ROUNDS = 60

# For the volume.
FEWEST = 64  # tangent planes next to the body that a cone gets at least
FINEST = 2**40  # steps of a turn beyond which two planes are the same
MOST = 6000  # tangent planes of all cones; more take seconds
# relative difference of two extrapolated volumes that is small enough; the last one is better
ACCURACY = 1e-7
# length beyond a cone that is not worth a plane, in units of the inscribed ball's radius
FLAT = 1e-9
LITTLE = 0.01  # nor is what is so little of the farthest point's length: its planes may be coarser


class Turn(NamedTuple):
    """Some of a cone's tangent planes at equal steps: those at the angles ``2 pi k / steps``."""

    k: np.ndarray
    steps: int

    @property
    def angles(self) -> Array:
        return self.k * (2 * np.pi / self.steps)

    def halved(self, k: np.ndarray) -> Turn:
        """These planes and more, numbered by steps of half the angle."""
        return Turn(np.union1d(2 * self.k, k), 2 * self.steps)


def spread(cones: Sequence[Cone]) -> tuple[Array, float]:
    """Middle of the apexes, and the largest distance of one from it (1 mm if all are in one place),
    mm.
    """
    apexes = np.array([cone.apex for cone in cones])
    origin = apexes.mean(axis=0)
    return origin, float(np.linalg.norm(apexes - origin, axis=1).max()) or 1.0


def inscribed_ball(cones: Sequence[Cone]) -> tuple[Array, float]:
    """Centre and radius of the largest ball in all cones, mm.

    The linear programme over some of the planes can only find too large a ball: radius <= 0 proves
    that the cones share no ball at all. `FARTHEST` bounds the answer; a centre there means that the
    cones reach at least so far.
    """
    origin, unit = spread(cones)
    angles = _first_angles(cones)
    for _ in range(200):
        p, r = largest_ball(*_half_spaces(cones, angles, origin, unit))
        angles, missed = _cut(cones, angles, origin + unit * p[None, :], unit * (TOLERANCE - r))
        if r <= 0 or not missed:
            break
    return origin + unit * p, unit * r


def largest_ball(normals: Array, offsets: Array) -> tuple[Array, float]:
    """Centre and radius of the largest ball with normals . p + r <= offsets; r < 0 where there is
    none.

    Parameters
    ----------
    normals : ndarray, shape (n, 3), of length 1
    offsets : ndarray, shape (n,)
    """
    A = np.column_stack([normals, np.ones(len(normals))])
    result = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=A,
        b_ub=offsets,
        bounds=(-FARTHEST, FARTHEST),
        method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if result.x is None:
        raise ValueError(f"cones: the linear programme failed ({result.message})")
    return result.x[:3], float(result.x[3])


def bounding_box(cones: Sequence[Cone], centre: Array) -> Array:
    """Lowest and highest x, y, z over the intersection of the cones, shape (2, 3), mm.

    Parameters
    ----------
    centre : ndarray, shape (3,)
        A point inside all cones, mm.
    """
    _, unit = spread(cones)
    angles = _first_angles(cones)
    for _ in range(ROUNDS):
        points = centre + unit * _vertices(*_half_spaces(cones, angles, centre, unit), FARTHEST)
        box = np.array([points.min(axis=0), points.max(axis=0)])
        tips = points[np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])]
        angles, missed = _cut(cones, angles, tips, unit * TOLERANCE)
        if not missed:
            break
    return box


def volume_and_centroid(
    cones: Sequence[Cone], ball: tuple[Array, float], box: Array
) -> tuple[float, Array]:
    """Volume (mm^3) and centroid (mm) of the bounded intersection of cones.

    The polyhedron of tangent planes is too large by an error that grows as the square of the angle
    between them, so two of them, one with half the angle, tell what it would be without any: (4
    fine - coarse) / 3, after Richardson (1911). The angle is halved until that changes no more.
    Planes are added only where the polyhedron is beyond a cone: a small part of a wide cone gets
    its planes there.

    Parameters
    ----------
    ball : ndarray, shape (3,), and float
        Centre and radius of the largest ball inside, mm.
    box : ndarray, shape (2, 3)
        The bounding box, mm.
    """
    centre, unit = ball
    farthest = 2 * float(np.abs(box - centre).max()) / unit
    least = FLAT * unit + 1e-14 * spread(cones)[1]  # the second is what rounding leaves
    turns = [Turn(np.arange(FEWEST), FEWEST) for _ in cones]
    moments: list[Array] = []
    while True:
        y = _vertices(*_half_spaces(cones, [turn.angles for turn in turns], centre, unit), farthest)
        wanted = [
            _between(cone, turn, centre + unit * y, least)
            for cone, turn in zip(cones, turns, strict=True)
        ]
        few = [
            0 < len(k) < FEWEST and turn.steps < FINEST
            for k, turn in zip(wanted, turns, strict=True)
        ]
        if any(few):  # these cones first, and then all of them together
            moments = []
        else:
            moments.append(_moments(y))
            few = [True] * len(cones)
        turns = [
            turn.halved(k) if one else turn for turn, k, one in zip(turns, wanted, few, strict=True)
        ]
        if len(moments) > 2:
            before, best = (
                (4 * fine - coarse) / 3 for coarse, fine in itertools.pairwise(moments[-3:])
            )
            if (
                abs(best[0] - before[0]) <= ACCURACY * best[0]
                or sum(len(turn.k) for turn in turns) > MOST
            ):
                return float(best[0] * unit**3), centre + unit * best[1:] / best[0]


def share_direction(cones: Sequence[Cone], margin: float = 0.0) -> bool:
    """Whether some direction lies in all cones, each narrowed by `margin` (rad): then their
    intersection has no end.

    On the sphere of directions each cone is a cap smaller than a hemisphere, so what they share is
    convex. If it is not empty, its border is either the whole circle of one cap, and then that
    cap's axis lies in all of them; or it has a corner, where two circles meet. So axes and meeting
    points are all that must be tried.
    """
    angles = np.array([cone.half_angle for cone in cones]) - margin
    axes = np.array([cone.axis for cone in cones])
    tries = [axes] + [
        _circles_meet(axes[i], axes[j], angles[i], angles[j])
        for i in range(len(cones))
        for j in range(i)
    ]
    return bool(((np.vstack(tries) @ axes.T) >= np.cos(angles) - 1e-14).all(axis=1).any())


def _first_angles(cones: Sequence[Cone]) -> list[Array]:
    return [Turn(np.arange(FIRST_PLANES), FIRST_PLANES).angles for _ in cones]


def _half_spaces(
    cones: Sequence[Cone], angles: Sequence[Array], origin: Array, unit: float
) -> tuple[Array, Array]:
    """The cones' tangent planes at these angles: normals . y <= offsets for p = origin + unit y."""
    normals = [cone.normals(t) for cone, t in zip(cones, angles, strict=True)]
    offsets = [n @ ((cone.apex - origin) / unit) for cone, n in zip(cones, normals, strict=True)]
    return np.vstack(normals), np.concatenate(offsets)


def _vertices(normals: Array, offsets: Array, farthest: float) -> Array:
    """Corners of the polyhedron normals . y <= offsets, and no coordinate farther out, that has 0
    inside, (n, 3).
    """
    sides = np.column_stack([np.vstack([np.eye(3), -np.eye(3)]), np.full(6, -farthest)])
    return HalfspaceIntersection(
        np.vstack([np.column_stack([normals, -offsets]), sides]), np.zeros(3)
    ).intersections


def _moments(vertices: Array) -> Array:
    """Volume of a convex polyhedron with 0 inside, and the integral of y over it, shape (4,)."""
    hull = ConvexHull(vertices)
    corners = vertices[hull.simplices]  # (n, 3 corners, 3)
    volumes = np.abs(np.linalg.det(corners)) / 6  # of the tetrahedra from 0 to the triangles
    return np.append(volumes.sum(), volumes @ corners.sum(axis=1) / 4)


def _beyond(cone: Cone, points: Array) -> tuple[Array, Array]:
    """Distances of points beyond the nearest tangent plane of a cone (negative inside), and that
    plane's angle.
    """
    x = points - cone.apex
    across = x @ cone.across.T
    distance = np.cos(cone.half_angle) * np.hypot(*across.T) - np.sin(cone.half_angle) * (
        x @ cone.axis
    )
    return distance, np.arctan2(across[:, 1], across[:, 0])


def _cut(
    cones: Sequence[Cone], angles: Sequence[Array], points: Array, least: float
) -> tuple[list[Array], bool]:
    """Add the planes that points are beyond by more than `least`; also whether there were any."""
    beyond = [_beyond(cone, points) for cone in cones]
    more = [t[distance > least] for distance, t in beyond]
    return [np.append(old, new) for old, new in zip(angles, more, strict=True)], any(map(len, more))


def _between(cone: Cone, turn: Turn, points: Array, least: float) -> np.ndarray:
    """The planes next to points that are beyond a cone by more than `least`, numbered by half the
    angle of `turn`.

    The points are corners of the polyhedron. Those that are beyond the cone lie half way between
    two of its planes, but for those on a third cone's plane.
    """
    distance, t = _beyond(cone, points)
    t = t[distance > max(least, LITTLE * distance.max())]
    steps = 2 * turn.steps
    return np.unique(np.rint(t * (steps / (2 * np.pi))).astype(int) % steps)


def _circles_meet(axis1: Array, axis2: Array, angle1: float, angle2: float) -> Array:
    """Unit directions at angle1 from axis1 and angle2 from axis2, shape (2, 3), or (0, 3) where
    there is none.
    """
    normal = np.cross(axis1, axis2)
    g = float(axis1 @ axis2)
    sin2 = float(normal @ normal)
    if sin2 < 1e-20:
        return np.empty((0, 3))
    c1 = np.cos(angle1)
    c2 = np.cos(angle2)
    flat = ((c1 - c2 * g) * axis1 + (c2 - c1 * g) * axis2) / sin2
    rest = 1.0 - float(flat @ flat)
    if rest < -1e-14:
        return np.empty((0, 3))
    lift = np.sqrt(max(rest, 0.0) / sin2) * normal
    return np.stack([flat + lift, flat - lift])
