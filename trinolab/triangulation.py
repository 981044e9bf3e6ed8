"""Points from matched pixels: Eq. 20 for each pair of cameras, the change of frame, and the mean
(Sect. 5.3).

Eq. 20 as printed needs X_r = R X_l + T, left to right, and one focal length per camera. Here R, T
come from the cameras (`camera.T_between`), each image axis is divided by its own focal length, and
lens distortion is removed first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .camera import Camera, Rig, T_between, as_rig, ideal_coordinates
from .checks import Array, as_array, as_number, as_points, as_transform, whole_rows


def depth_forms(
    xy_left: ArrayLike, xy_right: ArrayLike, T_right_left: RigidTransform
) -> tuple[Array, Array]:
    """Numerators and denominators of the two forms of z (Eq. 20).

    Parameters
    ----------
    xy_left, xy_right : array_like, shape (n, 2)
        Normalised ideal coordinates X/f, Y/f.
    T_right_left : RigidTransform
        R and T of Eq. 20, left to right, mm.

    Returns
    -------
    numerator, denominator : ndarray, shape (n, 2)
        ``numerator / denominator`` is z in the left camera's frame, mm: first by the X, second by
        the Y coordinates. A form fails where the baseline has no component along its axis: both
        parts are then near zero. NaN for missing coordinates.
    """
    left = as_points(xy_left, "xy_left", 2)
    right = as_array(xy_right, "xy_right", left.shape, finite=False)
    return two_forms(left, right, as_transform(T_right_left, "T_right_left"))


def two_forms(left: Array, right: Array, T_right_left: RigidTransform) -> tuple[Array, Array]:
    """`depth_forms` of coordinates (n, 2) that need no check (Eq. 20)."""
    R, t = np.split(T_right_left.as_matrix()[:3], [3], axis=1)
    t, turned = t[:, 0], left @ R[:, :2].T + R[:, 2]
    return t[:2] - right * t[2], right * turned[:, 2:] - turned[:, :2]


def triangulate_pair(left: Camera, right: Camera, uv_left: ArrayLike, uv_right: ArrayLike) -> Array:
    """Points from one binocular system, in the world frame (Eq. 20, 21).

    The two forms of z are solved together by least squares, which takes the one that the baseline
    supports. x and y follow from the left ray, as the paper does it; the point therefore lies on
    the left ray exactly.

    Parameters
    ----------
    left, right : Camera
    uv_left, uv_right : array_like, shape (n, 2)
        Pixels as taken (distorted), row by row the same marker.

    Returns
    -------
    ndarray, shape (n, 3)
        World frame, mm. NaN where a pixel is missing, where the rays are parallel, or where the
        point would lie behind either camera.

    Raises
    ------
    ValueError
        If both cameras stand in one place.
    """
    uv_left = as_points(uv_left, "uv_left", 2)
    uv_right = as_array(uv_right, "uv_right", uv_left.shape, finite=False)
    return points_of_pair(left, right, uv_left, uv_right)


def points_of_pair(left: Camera, right: Camera, uv_left: Array, uv_right: Array) -> Array:
    """`triangulate_pair` of pixels (n, 2) that need no check (Eq. 20, 21)."""
    T_right_left = T_between(right, left)
    if np.linalg.norm(T_right_left.translation) < 1e-9:
        raise ValueError(
            f"cameras {left.name} and {right.name}: expected two places, got one (no baseline)"
        )
    xy_left = ideal_coordinates(left, uv_left)
    xy_right = ideal_coordinates(right, uv_right)
    numerator, denominator = two_forms(xy_left, xy_right, T_right_left)
    square = (denominator**2).sum(axis=1)
    z = (numerator * denominator).sum(axis=1) / np.where(square > 1e-18, square, np.nan)
    local = np.column_stack([xy_left, np.ones(len(z))]) * z[:, None]
    behind = ~((z > 0) & (T_right_left.apply(local)[:, 2] > 0))
    local[behind] = np.nan
    return from_left_camera(left, local)


def from_left_camera(left: Camera, points: Array) -> Array:
    """Points (n, 3) of the left camera's frame in the world's (Eq. 21)."""
    return whole_rows(left.T_world_cam.apply(points))


def triangulate(rig: Rig, uv: ArrayLike) -> Array:
    """Points from all binocular systems of a rig, averaged (Eq. 20-22).

    Parameters
    ----------
    rig : Rig
    uv : array_like, shape (cameras, n, 2)
        Pixels as taken; NaN where a camera does not see a marker.

    Returns
    -------
    ndarray, shape (n, 3)
        World frame, mm: the mean over the pairs that see the marker; NaN where none has a point
        (`triangulate_pair`).

    Raises
    ------
    ValueError
        If `rig` is none, or two of its cameras stand in one place.
    """
    return mean_of_pairs(points_of_pairs(as_rig(rig), uv))


def points_of_pairs(rig: Rig, uv: ArrayLike) -> Array:
    """Points from each binocular system of a rig, in the order of `Rig.pairs`, shape (pairs, n, 3)
    (Eq. 20, 21).

    Parameters and errors as for `triangulate`; NaN where a pair has no point (`triangulate_pair`).
    """
    return by_pairs(rig, as_array(uv, "uv", (len(rig.cameras), None, 2), finite=False))


def by_pairs(rig: Rig, uv: Array) -> Array:
    """`points_of_pairs` of pixels (cameras, n, 2) that need no check (Eq. 20, 21)."""
    cameras = rig.cameras
    return np.stack([points_of_pair(cameras[i], cameras[j], uv[i], uv[j]) for i, j in rig.pairs])


def mean_point(points: ArrayLike) -> Array:
    """Mean over the binocular systems, ignoring those that have no point (Eq. 22).

    The mean averages noise, but not the bias of the centroids of wrapped markers. A pair of cameras
    far apart sees its common markers near the limb, which shifts their points by 0.1 mm; those of
    other pairs are not shifted. With CCD3 the mean therefore rotates the handle by more than the
    pair alone (chapter 10). `triangulate_weighted` on centroids without bias avoids this.

    Parameters
    ----------
    points : array_like, shape (pairs, n, 3)
        One frame for all, mm; NaN rows for missing points.

    Returns
    -------
    ndarray, shape (n, 3)
        NaN where all are missing.
    """
    return mean_of_pairs(as_array(points, "points", (None, None, 3), finite=False))


def mean_of_pairs(points: Array) -> Array:
    """`mean_point` of points (pairs, n, 3) that need no check (Eq. 22)."""
    valid = np.asarray(np.isfinite(points).all(axis=2))
    return np.where(valid[..., None], points, 0.0).sum(axis=0) / _counts(valid)[:, None]


def _counts(valid: np.ndarray) -> Array:
    """Numbers of pairs (pairs, n) that have a point, shape (n,); NaN for none."""
    count = valid.sum(axis=0)
    return np.where(count > 0, count, np.nan)


def triangulation_covariance(
    rig: Rig, uv: ArrayLike, sigma_px: float, step_px: float = 1e-3
) -> Array:
    """Covariance of `triangulate` for independent pixel noise, by central differences.

    Parameters
    ----------
    rig : Rig
    uv : array_like, shape (cameras, n, 2)
    sigma_px : float
        Standard deviation of each pixel coordinate, at most 1e6.
    step_px : float
        Of the differences, 1e-6 to 1; the function is smooth over pixels, so 1e-3 px is far from
        both rounding and curvature.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        mm^2, world frame; NaN where there is no point, there or a step beside it.

    Raises
    ------
    ValueError
        If two of the rig's cameras stand in one place.
    """
    return triangulate_with_covariance(rig, uv, sigma_px, step_px)[1]


def triangulate_with_covariance(
    rig: Rig, uv: ArrayLike, sigma_px: float, step_px: float = 1e-3
) -> tuple[Array, Array]:
    """The results of `triangulate` and `triangulation_covariance`, in half the time of both."""
    return mean_with_covariance(*pairs_with_slopes(rig, uv, sigma_px, step_px))


def mean_with_covariance(points: Array, slopes: Array) -> tuple[Array, Array]:
    """The mean over the pairs that have a point, (n, 3), and its covariance, (n, 3, 3), from what
    `pairs_with_slopes` gives.
    """
    mean = mean_slopes(points, slopes)
    return mean_of_pairs(points), mean @ mean.transpose(0, 2, 1)


def mean_slopes(points: Array, slopes: Array) -> Array:
    """Derivatives of `mean_of_pairs` by the pixels, (n, 3, 2 C), from what `pairs_with_slopes` gives: u
    and v of the first camera come first. NaN where there is no point.
    """
    valid = np.asarray(np.isfinite(points).all(axis=2))
    mean = np.where(valid[..., None, None], slopes, 0.0).sum(axis=0)
    return mean / _counts(valid)[:, None, None]


def triangulate_weighted(rig: Rig, uv: ArrayLike, sigma_px: ArrayLike) -> tuple[Array, Array]:
    """Points from all binocular systems, each weighted by the inverse of its covariance, instead of
    Eq. 22's mean.

    Parameters and errors as for `triangulation_covariance`; `sigma_px` may be of shape (cameras,
    n), one per pixel.

    Returns
    -------
    points : ndarray, shape (n, 3)
        World frame, mm; NaN where no pair has a point.
    covariances : ndarray, shape (n, 3, 3)
        mm^2. The correlation of pairs that share pixels is included here, though not in the
        weights.
    """
    points, slopes = pairs_with_slopes(rig, uv, sigma_px)
    valid = np.asarray(np.isfinite(points).all(axis=2) & np.isfinite(slopes).all(axis=(2, 3)))
    points = np.where(valid[..., None], points, 0.0)
    slopes = np.where(valid[..., None, None], slopes, 0.0)
    eye = np.eye(3)
    seen = np.asarray(valid.any(axis=0))
    own = slopes @ slopes.transpose(0, 1, 3, 2) + np.where(valid[..., None, None], 0.0, eye)
    weights = np.where(valid[..., None, None], np.linalg.inv(own), 0.0)
    # (pairs, n, 3, 3)
    share = np.linalg.inv(weights.sum(axis=0) + np.where(seen[:, None, None], 0.0, eye)) @ weights
    combined = (share @ slopes).sum(axis=0)
    point = (share @ points[..., None]).sum(axis=0)[..., 0]
    covariances = np.where(seen[:, None, None], combined @ combined.mT, np.nan)
    return np.where(seen[:, None], point, np.nan), covariances


def pairs_with_slopes(
    rig: Rig, uv: ArrayLike, sigma_px: ArrayLike, step_px: float = 1e-3
) -> tuple[Array, Array]:
    """Points of each pair, and how they move with the pixels; parameters as for
    `triangulate_weighted` and `triangulation_covariance`.

    Returns
    -------
    points : ndarray, shape (pairs, n, 3)
        World frame, mm; NaN where a pair has none.
    slopes : ndarray, shape (pairs, n, 3, 2 cameras)
        Their displacement per standard deviation of each coordinate, mm.
    """
    uv = as_array(uv, "uv", (len(rig.cameras), None, 2), finite=False)
    C, n = uv.shape[:2]
    if np.ndim(sigma_px) == 0:
        sigma_px = np.full(
            (C, n), as_number(sigma_px, "sigma_px", low=0.0, high=1e6, open_low=True)
        )
    # (n, 1, 2 C)
    sigma = np.repeat(as_array(sigma_px, "sigma_px", (C, n), finite=False).T, 2, axis=1)[:, None]
    step_px = as_number(step_px, "step_px", low=1e-6, high=1.0)
    steps = step_px * np.eye(2 * C).reshape(2 * C, C, 1, 2)
    # (1 + 4 C, C, n, 2): one call for all is quick
    every = np.concatenate([uv[None], uv + steps, uv - steps])
    points = by_pairs(rig, every.swapaxes(0, 1).reshape(C, -1, 2)).reshape(
        len(rig.pairs), 1 + 4 * C, n, 3
    )
    ahead = points[:, 1 : 1 + 2 * C]
    behind = points[:, 1 + 2 * C :]
    slopes = (ahead - behind).transpose(0, 2, 3, 1) / (2 * step_px)
    # a pair does not ask for others' pixels
    return points[:, 0], np.where(slopes == 0, 0.0, sigma * slopes)
