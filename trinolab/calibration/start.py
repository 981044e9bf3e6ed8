"""Starting values of a calibration in closed form: homographies, the intrinsic matrix, the target's
poses (Sect. 6.2).

After Zhang (2000), without skew and without lens distortion; `adjust` refines all of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from ..checks import Array, as_array, as_points, frozen
from ..rigid import nearest_rotation


def homography(xy: ArrayLike, uv: ArrayLike) -> Array | None:
    """The homography that takes points of a plane to pixels, by the normalised direct linear
    transformation.

    Parameters
    ----------
    xy, uv : array_like, shape (n, 2)
        Corresponding points, in the plane and in the image; rows with NaN in either are left out.

    Returns
    -------
    ndarray, shape (3, 3), or None
        ``[u, v, 1] ~ H [x, y, 1]``, scaled so that the points have positive third coordinates; None
        if fewer than four points are left, or if too many of them lie on one line to determine it.
    """
    xy = as_points(xy, "xy", 2)
    uv = as_array(uv, "uv", xy.shape, finite=False)
    valid = np.isfinite(xy).all(axis=1) & np.isfinite(uv).all(axis=1)
    if valid.sum() < 4:
        return None
    (p, N) = _normalised(xy[valid])
    (q, M) = _normalised(uv[valid])
    zero = np.zeros_like(p)
    A = np.concatenate([np.hstack([p, zero, -q[:, :1] * p]), np.hstack([zero, p, -q[:, 1:2] * p])])
    # four points give eight rows, of which the ninth vector is the null space
    values, Vt = np.linalg.svd(A, full_matrices=len(A) < 9)[1:]
    if values[7] < 1e-9 * values[0]:
        return None
    H: Array = np.linalg.inv(M) @ Vt[8].reshape(3, 3) @ N
    return frozen(H * np.sign((H[2, :2] @ xy[valid].mean(axis=0)) + H[2, 2]))


def intrinsics(homographies: ArrayLike, size: tuple[int, int]) -> Array:
    """The intrinsic matrix from the homographies of three or more positions of a plane, in closed
    form.

    Each homography ``H = K [r1 r2 t]`` gives two equations for ``B = K^-T K^-1``, because r1 and r2
    are perpendicular and of one length. If, because of noise, the solution is no camera or its
    principal point lies outside the image, the image's centre becomes the principal point, and only the
    focal lengths are solved for.

    Parameters
    ----------
    homographies : array_like, shape (m, 3, 3)
    size : (int, int)
        Width and height of the image, px.

    Returns
    -------
    ndarray, shape (3, 3)

    Raises
    ------
    ValueError
        If there are fewer than three homographies, or the positions do not determine the focal
        lengths, as when the plane was always parallel to the image.
    """
    H = as_array(homographies, "homographies", (None, 3, 3))
    if len(H) < 3:
        raise ValueError(f"homographies: expected three or more, got {len(H)}")
    scale = float(max(size))
    N = np.array(
        [
            [1 / scale, 0, (1 - size[0]) / 2 / scale],
            [0, 1 / scale, (1 - size[1]) / 2 / scale],
            [0, 0, 1],
        ]
    )
    H = N @ H
    equations = _equations(H / np.linalg.norm(H, axis=(1, 2), keepdims=True))
    K = _from_conic(np.linalg.svd(equations)[2][-1])
    if K is None or (np.abs(K[:2, 2]) > np.array(size) / 2 / scale).any():
        K = _from_conic(_centred(equations))
    if K is None:
        raise ValueError(
            "homographies: expected positions of different tilt; these do not determine the focal lengths"
        )
    return frozen(np.linalg.inv(N) @ K)


def target_pose(H: ArrayLike, K: ArrayLike) -> RigidTransform:
    """The pose T_cam_target of a plane from its homography and the intrinsic matrix, in the plane's
    unit of length.

    Raises
    ------
    ValueError
        If a matrix is singular.
    """
    H = as_array(H, "H", (3, 3))
    K = as_array(K, "K", (3, 3))
    if (
        min(abs(np.linalg.det(H / np.linalg.norm(H))), abs(np.linalg.det(K / np.linalg.norm(K))))
        < 1e-14
    ):
        raise ValueError("H, K: expected invertible matrices")
    columns = np.linalg.solve(K, H)
    columns /= np.linalg.norm(columns[:, :2], axis=0).mean() * (np.sign(columns[2, 2]) or 1.0)
    r1, r2, t = columns.T
    return RigidTransform.from_components(
        t, nearest_rotation(np.column_stack([r1, r2, np.cross(r1, r2)]))
    )


def target_poses(points: Array, views: Array, size: tuple[int, int]) -> list[RigidTransform | None]:
    """T_cam_target in each view of a camera of unknown lens; None for a view without a pose, and for
    all views where these do not determine the lens.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Of the target, z = 0.
    views : ndarray, shape (views, n, 2)
        Their pixels; NaN for a point that was not detected.
    size : (int, int)
        Width and height of the images, px.
    """
    H = [homography(points[:, :2], uv) for uv in views]
    try:
        K = intrinsics([h for h in H if h is not None], size)
        return [None if h is None else target_pose(h, K) for h in H]
    except (ValueError, np.linalg.LinAlgError):
        return [None] * len(H)


def _normalised(points: Array) -> tuple[Array, Array]:
    """Points moved to mean 0 and rms distance sqrt 2, with a 1 beside them, (n, 3), and the matrix
    that does it.
    """
    mean = points.mean(axis=0)
    spread = np.sqrt(((points - mean) ** 2).sum(axis=1).mean())
    scale = np.sqrt(2) / spread if spread > 0 else 1.0
    N = np.array([[scale, 0, -scale * mean[0]], [0, scale, -scale * mean[1]], [0, 0, 1]])
    return np.column_stack([points, np.ones(len(points))]) @ N.T, N


def _equations(H: Array) -> Array:
    """Two rows per homography for b = (B11, B22, B13, B23, B33), shape (2 m, 5)."""

    def row(i: int, j: int) -> Array:
        a, b = H[:, :, i], H[:, :, j]
        return np.stack(
            [
                a[:, 0] * b[:, 0],
                a[:, 1] * b[:, 1],
                a[:, 2] * b[:, 0] + a[:, 0] * b[:, 2],
                a[:, 2] * b[:, 1] + a[:, 1] * b[:, 2],
                a[:, 2] * b[:, 2],
            ],
            axis=1,
        )

    return np.concatenate([row(0, 1), row(0, 0) - row(1, 1)])


def _centred(equations: Array) -> Array:
    """b of a principal point at the origin: B13 = B23 = 0, B33 = 1."""
    focal = np.linalg.lstsq(equations[:, :2], -equations[:, 4], rcond=None)[0]
    return np.array([focal[0], focal[1], 0.0, 0.0, 1.0])


def _from_conic(b: Array) -> Array | None:
    """The intrinsic matrix K with K^-T K^-1 ~ B, or None if B is not definite (to rounding)."""
    B11, B22, B13, B23, B33 = b
    if min(abs(B11), abs(B22)) < 1e-9 * np.abs(b).max():
        return None
    cx, cy = -B13 / B11, -B23 / B22
    level = B33 - B13**2 / B11 - B23**2 / B22
    squares = np.array([level / B11, level / B22])
    if not (squares > 1e-6).all():
        return None
    fx, fy = np.sqrt(squares)
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
