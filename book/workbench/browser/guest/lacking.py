"""What OpenCV.js lacks and a chapter needs, in NumPy and SciPy: for the cases that the chapters have.

A rival that runs by one of these is no longer OpenCV's own code: it is the same criterion, minimised
by SciPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class StereoPair(NamedTuple):
    """Two cameras calibrated at once: matrices (3, 3), and the motion from the first one's frame
    to the second one's; the rms is in px.
    """

    rms: float
    first: np.ndarray
    second: np.ndarray
    R: np.ndarray
    T: np.ndarray


def triangulated(
    first: np.ndarray, second: np.ndarray, uv_first: np.ndarray, uv_second: np.ndarray
) -> np.ndarray:
    """Homogeneous points (4, n): of each the smallest singular vector of its four equations.

    Parameters
    ----------
    first, second : ndarray, shape (3, 4)
        Projections.
    uv_first, uv_second : ndarray, shape (2, n)
        Pixels.
    """
    equations = np.stack(
        [
            uv[axis, :, None] * P[2] - P[axis]
            for P, uv in ((first, uv_first), (second, uv_second))
            for axis in (0, 1)
        ],
        axis=1,
    )  # (n, 4, 4)
    return np.linalg.svd(equations)[2][:, -1].T


def four_of_a_grid(points: np.ndarray) -> np.ndarray | None:
    """Four blobs that can be the corners of a grid of two by two, (4, 2); None if there are none.

    As OpenCV's search by clusters: the nearest clusters are joined until one has four points. If it
    has just four, and they are the corners of their hull, they are the grid.
    """
    if len(points) < 4:
        return None
    clusters = [[k] for k in range(len(points))]
    offsets = points[:, None] - points[None]
    distances = np.hypot(offsets[..., 0], offsets[..., 1])
    np.fill_diagonal(distances, np.inf)
    latest = clusters[0]
    while len(points) > 4 and len(latest) < 4:
        low, high = sorted(np.unravel_index(np.argmin(distances), distances.shape))
        nearest = np.minimum(distances[low], distances[high])
        distances[low], distances[:, low] = nearest, nearest
        distances[high], distances[:, high] = np.inf, np.inf
        distances[low, low] = np.inf
        clusters[low] += clusters[high]
        latest = clusters[low]
    chosen = points if len(points) == 4 else points[latest]
    return chosen if len(chosen) == 4 and _is_convex(chosen) else None


def _is_convex(four: np.ndarray) -> bool:
    """Whether none of four points lies in the triangle of the others, or on its side."""
    for k in range(4):
        a, b, c = np.delete(four, k, axis=0)
        sides = [_side(four[k], *side) for side in ((a, b), (b, c), (c, a))]
        if min(sides) >= 0 or max(sides) <= 0:
            return False
    return True


def _side(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Twice the signed area of the triangle that a point makes with a side."""
    along, off = b - a, point - a
    return float(along[0] * off[1] - along[1] * off[0])


def stereo_pair(
    points: Sequence[np.ndarray],
    uv: Sequence[Sequence[np.ndarray]],
    matrices: tuple[np.ndarray, np.ndarray],
    poses: Sequence[tuple[np.ndarray, np.ndarray]],
    relative: tuple[np.ndarray, np.ndarray],
    free: bool,
) -> StereoPair:
    """The cameras and the motion between them that fit all pixels best, without distortion.

    Parameters
    ----------
    points : sequence of ndarray, shape (n, 3)
        Of the target, a view each.
    uv : two sequences of ndarray, shape (n, 2)
        Its pixels in the first and in the second camera.
    matrices : two ndarray, shape (3, 3)
        To start with, or to keep.
    poses : sequence of (rvec, tvec)
        Of the target in the first camera, to start with.
    relative : (rvec, tvec)
        From the first camera's frame to the second one's, to start with.
    free : bool
        Whether focal lengths and principal points are fitted as well.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    lenses = np.array([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]] for K in matrices])

    def moved(six: np.ndarray, X: np.ndarray) -> np.ndarray:
        return Rotation.from_rotvec(six[:3]).apply(X) + six[3:]

    def pixels(lens: np.ndarray, X: np.ndarray) -> np.ndarray:
        return lens[:2] * X[:, :2] / X[:, 2:] + lens[2:]

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        two = unknowns[6:14].reshape(2, 4) if free else lenses
        errors = []
        for k, six in enumerate(unknowns[14 if free else 6 :].reshape(-1, 6)):
            in_first = moved(six, points[k])
            errors.append(pixels(two[0], in_first) - uv[0][k])
            errors.append(pixels(two[1], moved(unknowns[:6], in_first)) - uv[1][k])
        return np.concatenate(errors).ravel()

    start = [np.concatenate([np.ravel(part) for part in relative])]
    start += [lenses.ravel()] if free else []
    start += [np.concatenate([np.ravel(part) for part in pose]) for pose in poses]
    best = least_squares(
        residuals, np.concatenate(start), method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    two = best.x[6:14].reshape(2, 4) if free else lenses
    first, second = (np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]) for fx, fy, cx, cy in two)
    rms = float(np.sqrt((best.fun**2).sum() / (len(best.fun) / 2)))
    R = Rotation.from_rotvec(best.x[:3]).as_matrix()
    return StereoPair(rms, first, second, R, best.x[3:6].reshape(3, 1))
