"""Volume and centroid of an intersection of solid cones, by integrals over its conic faces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks import Array
from .cones import Cone

PIECES = 64  # of a turn, that the integral over a cone's generators is split into anyway
MOST_CHANGES = 256  # more than these are rounding noise, not edges between faces


def _tanh_sinh(reach: float = 3.1, n: int = 63) -> Array:
    """Nodes and weights on [-1, 1], shape (2, n), that roots and kinks at the ends do not disturb."""
    u = np.linspace(-reach, reach, n)
    step = u[1] - u[0]
    v = np.pi / 2 * np.sinh(u)
    return np.array([np.tanh(v), step * np.pi / 2 * np.cosh(u) / np.cosh(v) ** 2])


TANH_SINH = _tanh_sinh()


def chord(cone: Cone, start: Array, directions: Array) -> tuple[Array, Array]:
    """The part of each line ``start + s direction`` that lies inside a solid cone: s from `low` to `high`.

    Parameters
    ----------
    start : ndarray, shape (3,)
    directions : ndarray, shape (n, 3), of length 1

    Returns
    -------
    low, high : ndarray, shape (n,)
        In mm, infinite where the line stays inside; low > high where it misses the cone.
    """
    m, cos2 = start - cone.apex, np.cos(cone.half_angle) ** 2
    along = directions @ cone.axis
    a = along**2 - cos2  # inside both nappes: a s^2 + 2 b s + c >= 0
    b = (m @ cone.axis) * along - cos2 * (directions @ m)
    c = (m @ cone.axis) ** 2 - cos2 * (m @ m)
    near, far = _roots(a, b, c)
    first, second = np.minimum(near, far), np.maximum(near, far)
    front = m @ cone.axis + near * along >= 0  # the nappe that both roots lie on, for a < 0
    low = np.where(a > 0, np.where(along > 0, second, -np.inf), np.where(front, first, np.inf))
    high = np.where(a > 0, np.where(along > 0, np.inf, first), np.where(front, second, -np.inf))
    return low, high


def moments(cones: Sequence[Cone], reference: Array, nodes: int) -> tuple[float, Array]:
    """Volume (mm^3) of the cones' intersection, and the integral of ``p - reference`` over it (mm^4, shape (3,)).

    By the divergence theorem over the conic faces. Along the generator g at angle t of one cone the normal n is
    constant, the part inside all other cones is an interval [s0, s1], (p - reference) . n is (apex - reference) . n,
    and the area is s sin(half_angle) ds dt; what is left is an integral over t. Where another cone takes over as the
    limit, the integrand has a kink, a root or a jump: `nodes` generators find these, and the integral is split there.
    """
    volume, first = 0.0, np.zeros(3)
    for k, cone in enumerate(cones):
        others = [*cones[:k], *cones[k + 1:]]
        t, weights = _quadrature(cone, others, nodes)
        low, high, limits = _part_inside(cone, others, t)
        t, weights, low, high = (value[limits >= 0] for value in (t, weights, low, high))
        m = cone.apex - reference
        weights = weights * np.sin(cone.half_angle) * (cone.normals(t) @ m)
        area, arm = (high**2 - low**2) / 2, (high**3 - low**3) / 3
        volume += float(weights @ area) / 3
        first += (weights @ area * m + (weights * arm) @ cone.generators(t)) / 4
    return volume, first


def _part_inside(cone: Cone, others: Sequence[Cone], t: Array) -> tuple[Array, Array, np.ndarray]:
    """The part of each generator inside all other cones: s0, s1, and which two of them end it (-1: no part)."""
    chords = [chord(other, cone.apex, cone.generators(t)) for other in others]
    starts = np.array([np.zeros(len(t)), *(start for start, _ in chords)])
    ends = np.array([end for _, end in chords])
    limits = starts.argmax(axis=0) * len(chords) + ends.argmin(axis=0)
    low, high = starts.max(axis=0), ends.min(axis=0)
    return low, high, np.where(low < high, limits, -1)


def _quadrature(cone: Cone, others: Sequence[Cone], nodes: int) -> tuple[Array, Array]:
    """Angles and weights for an integral over a cone's generators: tanh-sinh between the places of `_changes`."""
    grid: Array = np.linspace(0, 2 * np.pi, nodes, endpoint=False)
    changes = _changes(cone, others, grid)
    if len(changes) > MOST_CHANGES:  # two cones that tie along a curve: rounding chooses, and nothing is to be split
        return grid, np.full(nodes, 2 * np.pi / nodes)
    edges = np.unique(np.concatenate([np.linspace(0, 2 * np.pi, PIECES + 1), changes % (2 * np.pi)]))
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    return (middle[:, None] + half[:, None] * TANH_SINH[0]).ravel(), (half[:, None] * TANH_SINH[1]).ravel()


def _changes(cone: Cone, others: Sequence[Cone], grid: Array) -> Array:
    """Angles where the integrand is not smooth: another cone limits it, the part is shortest, an apex is passed."""
    low, high, limits = _part_inside(cone, others, grid)
    length, step, far = np.where(limits >= 0, high - low, 0.0), grid[1], max(1, len(grid) // 256)
    near = [np.roll(length, k) for k in (-1, 1, -far, far)]
    short = grid[(length > 0) & (length <= np.minimum(*near[:2])) & (length < 0.999 * np.maximum(*near[2:]))]
    k = np.flatnonzero(limits != np.roll(limits, -1))
    if len(k) + len(short) > MOST_CHANGES:
        return grid
    apexes = np.array([other.apex - cone.apex for other in others])
    return np.concatenate([_first_change(cone, others, grid[k], grid[k] + step),
                           _first_change(cone, others, grid[k] + step, grid[k]),
                           _shortest(cone, others, short - step, short + step),
                           np.arctan2(apexes @ cone.across[1], apexes @ cone.across[0])])


def _first_change(cone: Cone, others: Sequence[Cone], a: Array, b: Array) -> Array:
    """Where between angles a and b the limits of `_part_inside` first differ from those at a, by halving."""
    limits = _part_inside(cone, others, a)[2]
    for _ in range(48):
        middle = (a + b) / 2
        same = _part_inside(cone, others, middle)[2] == limits
        a, b = np.where(same, middle, a), np.where(same, b, middle)
    return b


def _shortest(cone: Cone, others: Sequence[Cone], a: Array, b: Array) -> Array:
    """Where between angles a and b the part inside all other cones is shortest, by thirds."""
    for _ in range(85):
        one, two = a + (b - a) / 3, b - (b - a) / 3
        left, right = (np.subtract(*_part_inside(cone, others, t)[1::-1]) for t in (one, two))
        a, b = np.where(left > right, one, a), np.where(left > right, b, two)
    return (a + b) / 2


def _roots(a: Array, b: Array, c: float) -> tuple[Array, Array]:
    """Both roots of a s^2 + 2 b s + c without cancellation, the smaller magnitude first; NaN where there is none.

    For a > 0 a line always meets both nappes, so that a negative discriminant is rounding. For a = 0, a line along a
    generator, the second root is far away on the side where a slightly negative a would put it.
    """
    discriminant = np.where(a > 0, np.maximum(b * b - a * c, 0.0), b * b - a * c)
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -(b + np.copysign(np.sqrt(discriminant), b))
        return np.where(q == 0, 0.0, c / q), q / np.where(a == 0, -1e-30, a)
