"""The perspective-three-point problem: how far away are three points with known distances, seen
along three rays?
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..checks import Array, as_array


@np.errstate(all="ignore")  # what has no solution shows in the result
def three_point_depths(rays: ArrayLike, sides: ArrayLike, steps: int = 5) -> Array:
    """Distances of three points along three rays, by the distances between them; two solutions for
    each triangle.

    A triangle that is small against its distance looks the same as its mirror image in depth.
    Without perspective the two have a closed form (Alter 1994, DOI 10.1109/34.310681); from each
    Newton's method goes on to the solution with perspective. Further solutions of the three-point
    problem are ignored.

    Parameters
    ----------
    rays : array_like, shape (3, 3)
        Directions of length 1 as rows.
    sides : array_like, shape (k, 3)
        Distances between the points 0 and 1, 1 and 2, 2 and 0, mm.
    steps : int
        Of Newton's method.

    Returns
    -------
    ndarray, shape (2 k, 3)
        mm: the first solution of each triangle, then the second. Rows that are no solution (their
        points do not have the sides to a millionth) are NaN.
    """
    rays = as_array(rays, "rays", (3, 3))
    sides = as_array(sides, "sides", (None, 3))
    cosine = (rays * np.roll(rays, -1, axis=0)).sum(axis=1)
    depths = _without_perspective(rays, sides)
    wanted = np.concatenate([sides, sides])
    for _ in range(steps):
        depths = depths - _newton_step(depths, wanted, cosine)
    after = np.roll(depths, -1, axis=1)
    lengths = np.sqrt(depths**2 + after**2 - 2 * depths * after * cosine)
    solved = (np.abs(lengths - wanted) < 1e-6 * wanted).all(axis=1)
    solved &= (depths > 0).all(axis=1)
    return np.where(solved[:, None], depths, np.nan)


def _without_perspective(rays: Array, sides: Array) -> Array:
    """Alter's two solutions: the image's triangle and the model's give the scale, and how deep each
    side leans.
    """
    d01, d12, d02 = ((rays - np.roll(rays, -1, axis=0)) ** 2).sum(axis=1)  # squared, at depth 1
    r01, r12, r02 = (sides**2).T
    a = 4 * r01 * r02 - (r01 + r02 - r12) ** 2  # 16 times the area squared
    b = d01 * (r02 + r12 - r01) + d02 * (r01 + r12 - r02) + d12 * (r01 + r02 - r12)
    c = 4 * d01 * d02 - (d01 + d02 - d12) ** 2
    depth2 = a / (b + np.sqrt(np.maximum(b * b - a * c, 0.0)))
    lean1 = np.sqrt(np.maximum(r01 - d01 * depth2, 0.0))
    lean2 = np.sqrt(np.maximum(r02 - d02 * depth2, 0.0))
    same_way = (d01 + d02 - d12) * depth2 <= r01 + r02 - r12
    relief = np.column_stack([np.zeros_like(lean1), lean1, np.where(same_way, lean2, -lean2)])
    depth = np.sqrt(depth2)[:, None]
    return np.concatenate([depth + relief, depth - relief])


def _newton_step(depths: Array, sides: Array, cosine: Array) -> Array:
    """Step (k, 3) of Newton's method for the squared sides by the law of cosines.

    The system is [a0 b0 0; 0 a1 b1; b2 0 a2] step = error: each side depends on its two ends.
    """
    after = np.roll(depths, -1, axis=1)
    e = (depths**2 + after**2 - 2 * depths * after * cosine - sides**2).T
    a = 2 * (depths - after * cosine).T
    b = 2 * (after - depths * cosine).T
    step = [
        a[(k + 1) % 3] * a[(k + 2) % 3] * e[k]
        - b[k] * a[(k + 2) % 3] * e[(k + 1) % 3]
        + b[k] * b[(k + 1) % 3] * e[(k + 2) % 3]
        for k in range(3)
    ]
    return np.stack(step, axis=1) / (a.prod(axis=0) + b.prod(axis=0))[:, None]
