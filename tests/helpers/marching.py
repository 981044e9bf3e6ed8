"""Where rays meet solids, by marching along them by the distance to the nearest one: another algorithm
than the ray caster's.
"""

import numpy as np


def body_distance(handle, points):
    """Distance of points of the handle's frame to the body."""
    x, y, z = points.T
    middle, half = handle.top_mm - handle.length_mm / 2, handle.length_mm / 2
    outside = np.stack([np.hypot(x, z) - handle.radius_mm, np.abs(y - middle) - half])
    return np.hypot(*np.maximum(outside, 0)) + np.minimum(outside.max(axis=0), 0)


def marched(distance, directions, steps=400, close=1e-3):
    """Depth along rays from the origin, of unit length, (n, 3), where `distance(points)` becomes 0,
    mm; infinity: never.
    """
    depth = np.zeros(len(directions))
    for _ in range(steps):
        gap = distance(depth[:, None] * directions)
        depth = np.minimum(depth + gap, 5000)
    return np.where(gap < close, depth, np.inf)  # it creeps where a ray grazes
