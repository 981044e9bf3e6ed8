"""The lens: checks of the intrinsic numbers, and distortion on normalised coordinates with its
inverse.

The model is that of Brown (1971) as OpenCV writes it: radial terms k1, k2, k3, tangential terms p1,
p2, in the order k1, k2, p1, p2, k3. Three more, k4, k5, k6, divide the radial polynomial by another one
(OpenCV's rational model), for wide lenses.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .checks import Array, as_array, as_number, whole_rows

LARGEST_PX = 65535  # side of an image


def as_size(value: Any) -> tuple[int, int]:
    """Check width and height of an image, px."""
    size = as_array(value, "size", (2,))
    if (size < 1).any() or (size > LARGEST_PX).any() or (size != np.round(size)).any():
        raise ValueError(
            f"size: expected width and height as whole numbers from 1 to {LARGEST_PX}, "
            f"got {size.tolist()}"
        )
    return int(size[0]), int(size[1])


def as_intrinsics(value: ArrayLike) -> Array:
    """Check an intrinsic matrix: no skew, focal lengths from 1e-6 to 1e9 px, a principal point up
    to 1e9 px.
    """
    matrix = as_array(value, "matrix", (3, 3))
    for k, name in enumerate(("fx", "fy")):
        as_number(matrix[k, k], f"matrix: {name}", low=1e-6, high=1e9)
        as_number(matrix[k, 2], f"matrix: c{name[1]}", low=-1e9, high=1e9)
    rest = matrix - np.diag(np.diag(matrix))
    rest[:2, 2] = 0
    if np.any(rest) or matrix[2, 2] != 1:
        raise ValueError(
            f"matrix: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {matrix.tolist()}"
        )
    return matrix


def distort(xy: Array, k: Array) -> tuple[Array, Array]:
    """Apply lens distortion to normalised coordinates.

    Parameters
    ----------
    xy : ndarray, shape (n, 2)
    k : ndarray, shape (5,) or (8,)
        k1, k2, p1, p2, k3 and perhaps k4, k5, k6 (OpenCV's order).

    Returns
    -------
    distorted : ndarray, shape (n, 2)
        NaN for missing points, and beyond the radius at which the distorted radius stops growing.
    jacobian : ndarray, shape (n, 2, 2)
    """
    if not np.any(k):
        return whole_rows(np.array(xy, dtype=float)), np.broadcast_to(np.eye(2), (len(xy), 2, 2))
    k1, k2, p1, p2, k3 = k[:5]
    x, y = xy[:, 0], xy[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2 * k2 + 3 * r2 * k3)  # d radial / d r2
    if len(k) > 5:
        k4, k5, k6 = k[5:]
        with np.errstate(all="ignore"):  # at a pole, and far beyond it
            below = _denominator(r2, k)
            radial /= below
            slope = (slope - radial * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) / below
    out = np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ]
    )
    cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    jacobian = np.stack(
        [
            radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
            cross,
            cross,
            radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
        ],
        axis=1,
    ).reshape(-1, 2, 2)
    out[r2 > _fold_radius2(k)] = np.nan
    return whole_rows(out), jacobian


@np.errstate(all="ignore")  # a step of Newton's method may lead anywhere; that shows in the result
def undistort(xy: Array, k: Array, iterations: int = 20) -> Array:
    """Invert `distort` by Newton's method; shape (n, 2), NaN where it does not converge to
    1e-12.
    """
    xy = whole_rows(np.array(xy, dtype=float))
    if not np.any(k):
        return xy
    ideal = xy.copy()
    for _ in range(iterations):
        out, jacobian = distort(ideal, k)
        residual = out - xy
        if not np.nanmax(np.abs(residual), initial=0.0) > 1e-14:
            break
        ideal -= _solve2(jacobian, residual)
    residual = distort(ideal, k)[0] - xy
    ideal[~(np.abs(residual).max(axis=1, initial=0.0) < 1e-12)] = np.nan
    return ideal


def project_with_slopes(lens: Array, local: Array) -> tuple[Array, Array, Array]:
    """Project points of a camera's frame, with the derivatives of their pixels.

    Parameters
    ----------
    lens : ndarray, shape (4 + m,)
        fx, fy, cx, cy (px) and the first m of k1, k2, p1, p2, k3, k4, k5, k6; the others are zero.
    local : ndarray, shape (..., 3)
        Camera frame, mm.

    Returns
    -------
    uv : ndarray, shape (..., 2)
        NaN for points that are not in front of the camera, and where `distort` gives none.
    by_lens : ndarray, shape (..., 2, 4 + m)
    by_local : ndarray, shape (..., 2, 3)
    """
    depth = np.where(local[..., 2] > 0, local[..., 2], np.nan)[..., None]
    xy = local[..., :2] / depth
    distortions = np.zeros(max(5, len(lens) - 4))
    distortions[: len(lens) - 4] = lens[4:]
    distorted, by_xy = (
        a.reshape(*xy.shape[:-1], *a.shape[1:]) for a in distort(xy.reshape(-1, 2), distortions)
    )
    focal = lens[:2]
    identity = np.broadcast_to(np.eye(2), (*xy.shape[:-1], 2, 2))
    by_lens = np.concatenate(
        [
            identity * distorted[..., None],
            identity,
            _by_distortions(xy, distortions)[..., : len(lens) - 4] * focal[:, None],
        ],
        axis=-1,
    )
    by_local = np.concatenate([identity, -xy[..., None]], axis=-1) / depth[..., None]
    return distorted * focal + lens[2:4], by_lens, (focal[:, None] * by_xy) @ by_local


def _by_distortions(xy: Array, k: Array) -> Array:
    """Slopes of the distorted coordinates by the distortions, shape (..., 2, 5) or (..., 2, 8): without
    k4, k5, k6 the model is linear in them.
    """
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    tangential = np.stack(
        [np.stack([2 * x * y, r2 + 2 * x * x], -1), np.stack([r2 + 2 * y * y, 2 * x * y], -1)], -2
    )
    radial = xy[..., None] * np.stack([r2, r2**2, r2**3], -1)[..., None, :]
    by_five = [radial[..., :2], tangential, radial[..., 2:]]
    if len(k) == 5:
        return np.concatenate(by_five, axis=-1)
    below = _denominator(r2, k)[..., None, None]
    factor = (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4])))[..., None, None] / below
    by_five[0], by_five[2] = by_five[0] / below, by_five[2] / below
    return np.concatenate([*by_five, -factor / below * radial], axis=-1)


def _denominator(r2: Array, k: Array) -> Array:
    """The polynomial that divides the radial one, of squared radii."""
    return np.asarray(1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])))


def _fold_radius2(k: Array) -> float:
    """Squared radius at which r N(r^2) / D(r^2) stops growing, with N = 1 + k1 r^2 + k2 r^4 + k3 r^6 and D
    of k4, k5, k6, or has a pole; infinity if it never does.
    """
    above = np.array([1.0, k[0], k[1], k[4]])
    below = np.array([1.0, *k[5:]])
    odd, even = (1.0, 3.0, 5.0, 7.0), np.arange(0.0, 2.0 * len(below), 2.0)
    growth = np.convolve(odd * above, below) - np.convolve(above, even * below)
    # of 1 / r^2, so that a tiny coefficient divides nothing
    roots = np.concatenate([np.roots(growth), np.roots(below)])
    real = roots.real[(np.abs(roots.imag) < 1e-12 * np.abs(roots)) & (roots.real > 0)]
    return 1.0 / float(real.max()) if real.size else np.inf


def _solve2(A: Array, b: Array) -> Array:
    """Solve n systems of two equations; a singular one gives infinities, which `undistort` turns
    into NaN.
    """
    det = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]
    return (
        np.column_stack(
            [
                A[:, 1, 1] * b[:, 0] - A[:, 0, 1] * b[:, 1],
                A[:, 0, 0] * b[:, 1] - A[:, 1, 0] * b[:, 0],
            ]
        )
        / det[:, None]
    )
