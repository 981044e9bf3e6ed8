"""The handle's pose from labelled markers: the rigid fit of Eq. 23-24, its covariance, and the
paper's estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from .camera import Rig, image_of
from .checks import Array, as_array, as_number, as_points, as_transform
from .handle import Handle, slants
from .rigid import cross_matrices, placed, rotation_of
from .sensitivity import NOTHING, Response, response, systematic_covariance
from .triangulation import (
    mean_of_pairs,
    mean_slopes,
    mean_with_covariance,
    pairs_with_slopes,
)

SMALLEST_MM = 1e-9  # points that are nearer to a line than that lie on it


class _Deferred:
    """A covariance, or a function that computes it when it is first asked for."""

    def __init__(self, default: Callable[[], Array] | None = None) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = f"_{name}"

    def __get__(self, pose: object, owner: type) -> Array:
        if pose is None:
            if self.default is None:
                raise AttributeError  # a field without a default
            return cast(Array, self.default)  # what a dataclass takes for the default
        value = pose.__dict__[self._name]
        if callable(value):
            value = pose.__dict__[self._name] = value()
        return value

    def __set__(self, pose: object, value: Array | Callable[[], Array]) -> None:
        pose.__dict__[self._name] = value


@dataclass(frozen=True, eq=False)
class Pose:
    """The measured pose at one instant.

    Attributes
    ----------
    status : str
        ``measured``, ``ambiguous`` (one of several equivalent poses), ``predicted`` or ``lost`` (no
        pose).
    T_world_handle : RigidTransform or None
    covariance_random : ndarray, shape (6, 6), or callable
        Of position (mm) and rotation vector (rad), both in the world frame, from the errors that
        are new in each instant; NaN without a pose. A function is called at the first access.
    residual_px : float
        Rms reprojection error of the markers used.
    markers, cameras : int
        How many were used.
    systematic : ndarray, shape (6, 6), or callable
        The same from the errors that all instants share, those of rig and marker layout; zeros
        where both are exact.

    Notes
    -----
    `covariance` is the total uncertainty of a single pose. Poses near each other share the
    systematic part, which cancels in their difference and does not average out over instants:
    differences and filters need `covariance_random`. For example, let x have a random standard
    uncertainty of 0.01 mm and a systematic one of 0.10 mm. That of one position is 0.1005 mm; that
    of the mean of a hundred instants of a handle at rest is 0.1000 mm, not 0.0101 mm; that of a
    step between two instants is 0.0141 mm, not 0.142 mm.
    """

    status: str
    T_world_handle: RigidTransform | None
    covariance_random: _Deferred = _Deferred()
    # mypy takes a descriptor for a default
    residual_px: float  # type: ignore[misc]
    markers: int  # type: ignore[misc]
    cameras: int  # type: ignore[misc]
    systematic: _Deferred = _Deferred(lambda: NOTHING)

    @property
    def covariance(self) -> Array:
        """Covariance of position (mm) and rotation vector (rad), world frame, by all that is known,
        shape (6, 6): `covariance_random` and `systematic`.
        """
        return self.covariance_random + self.systematic

    @property
    def sigma_mm(self) -> float:
        """Square root of the trace of the position's covariance."""
        return _spread(self.covariance)[0]

    @property
    def sigma_deg(self) -> float:
        """Square root of the trace of the rotation vector's covariance."""
        return _spread(self.covariance)[1]

    @property
    def systematic_mm(self) -> float:
        """The part of `sigma_mm` that all instants have in common."""
        return _spread(self.systematic)[0]

    @property
    def systematic_deg(self) -> float:
        """The part of `sigma_deg` that all instants have in common."""
        return _spread(self.systematic)[1]


def _spread(covariance: Array) -> tuple[float, float]:
    """Square roots of the traces of position and rotation vector, mm and deg."""
    variances = np.diag(covariance)
    return float(np.sqrt(variances[:3].sum())), float(np.rad2deg(np.sqrt(variances[3:].sum())))


LOST = Pose("lost", None, np.full((6, 6), np.nan), np.nan, 0, 0)


def rigid_fit(points_source: ArrayLike, points_target: ArrayLike) -> RigidTransform | None:
    """The rigid motion that carries one set of points onto another with least squares (Eq. 23, 24).

    Eq. 24 as printed asks for any 4 x 4 matrix; this one is kept a rotation and a translation
    (Kabsch 1976, with the guard against reflections of Umeyama 1991, DOI 10.1109/34.88573).

    Parameters
    ----------
    points_source, points_target : array_like, shape (n, 3)
        Row by row the same point, mm; rows with a NaN in either are left out.

    Returns
    -------
    RigidTransform or None
        T_target_source; None if fewer than three points are left or they lie on one line to a
        millionth of it.
    """
    source = as_points(points_source, "points_source", 3)
    target = as_array(points_target, "points_target", source.shape, finite=False)
    return rigid_motion(source, target)


def rigid_motion(source: Array, target: Array) -> RigidTransform | None:
    """`rigid_fit` of points (n, 3) that need no check (Eq. 23, 24)."""
    valid = np.isfinite(source).all(axis=1) & np.isfinite(target).all(axis=1)
    source, target = source[valid], target[valid]
    if _on_one_line(source) or _on_one_line(target):
        return None
    source_mean = source.mean(axis=0)
    target_mean = target.mean(axis=0)
    U, _, Vt = np.linalg.svd((target - target_mean).T @ (source - source_mean))
    guard = np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    rotation = U @ guard @ Vt
    return placed(target_mean - rotation @ source_mean, rotation)


def rigid_fit_covariance(
    points_source: ArrayLike, T_target_source: RigidTransform, covariances: ArrayLike
) -> Array:
    """Covariance of `rigid_fit` for independent errors of the target points, to first order.

    Parameters
    ----------
    points_source : array_like, shape (n, 3)
        mm; at least three, not on a line.
    T_target_source : RigidTransform
        The fit.
    covariances : array_like, shape (n, 3, 3)
        Of the target points, target frame, mm^2: symmetric, with no negative eigenvalue.

    Returns
    -------
    ndarray, shape (6, 6)
        Of position and rotation vector, target frame, mm and rad.

    Raises
    ------
    ValueError
        If the points lie on one line, or a matrix is no covariance.
    """
    source = as_points(points_source, "points_source", 3, finite=True)
    C = _as_covariances(covariances, len(source))
    if _on_one_line(source):
        raise ValueError("points_source: expected three or more points that are not on one line")
    return _fit_covariance(source, as_transform(T_target_source, "T_target_source"), C)


def _fit_covariance(source: Array, T_target_source: RigidTransform, covariances: Array) -> Array:
    """`rigid_fit_covariance` of points that need no check."""
    gain = _fit_gain(source, T_target_source)
    return (gain @ covariances @ gain.transpose(0, 2, 1)).sum(axis=0)


def rigid_fit_gain(points_source: ArrayLike, T_target_source: RigidTransform) -> Array:
    """Derivatives of `rigid_fit` by the target points.

    Parameters and errors as for `rigid_fit_covariance`.

    Returns
    -------
    ndarray, shape (n, 6, 3)
        Of position (mm) and rotation vector (rad), target frame, by each point, mm.
    """
    source = as_points(points_source, "points_source", 3, finite=True)
    T_target_source = as_transform(T_target_source, "T_target_source")
    if _on_one_line(source):
        raise ValueError("points_source: expected three or more points that are not on one line")
    return _fit_gain(source, T_target_source)


def _fit_gain(source: Array, T_target_source: RigidTransform) -> Array:
    """`rigid_fit_gain` of points (n, 3) that need no check."""
    arms = source @ rotation_of(T_target_source).T
    # (n, 3, 6)
    J = np.concatenate(
        [np.broadcast_to(np.eye(3), (len(arms), 3, 3)), -cross_matrices(arms)], axis=2
    )
    scale = np.repeat([1.0, np.abs(arms).max()], 3)  # mm and rad on one footing
    J_scaled = J / scale
    # (n, 6, 3)
    flat = J_scaled.reshape(-1, 6)
    gain = np.linalg.solve(flat.T @ flat, J_scaled.transpose(0, 2, 1))
    return gain / scale[:, None]


def weighted_fit(
    points_source: ArrayLike, points_target: ArrayLike, covariances: ArrayLike, steps: int = 5
) -> tuple[RigidTransform, Array] | None:
    """The rigid motion with least squares weighted by the target points' covariances (Eq. 23, 24,
    generalised).

    Parameters
    ----------
    points_source, points_target : array_like, shape (n, 3)
        Row by row the same point; rows that are not finite in either are left out.
    covariances : array_like, shape (n, 3, 3)
        Of the target points, target frame, mm^2.
    steps : int
        Gauss-Newton steps from `rigid_fit`.

    Returns
    -------
    T_target_source : RigidTransform
    covariance : ndarray, shape (6, 6)
        Of position and rotation vector, target frame, mm and rad. None instead of both where
        `rigid_fit` gives none, or the weights leave a motion free.
    """
    source = as_points(points_source, "points_source", 3)
    target = as_array(points_target, "points_target", source.shape, finite=False)
    C = as_array(covariances, "covariances", (len(source), 3, 3), finite=False)
    T = rigid_fit(source, target)
    if T is None:
        return None
    valid = np.isfinite(np.concatenate([source, target, C.reshape(-1, 9)], axis=1)).all(axis=1)
    source = source[valid]
    target = target[valid]
    W = np.linalg.inv(C[valid])
    for _ in range(steps):
        arms, JW, information = _normal(source, T, W)
        if np.linalg.matrix_rank(information) < 6:
            return None
        step = np.linalg.solve(
            information, (JW @ (target - arms - T.translation)[..., None]).sum(axis=0)[:, 0]
        )
        T = RigidTransform.from_components(
            T.translation + step[:3], Rotation.from_rotvec(step[3:]) * T.rotation
        )
    return T, np.linalg.inv(information)


def _normal(
    source: Array, T: RigidTransform, W: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arms (n, 3), weighted derivatives (n, 6, 3) and information (6, 6) of a weighted fit."""
    arms = source @ T.rotation.as_matrix().T
    J = np.concatenate(
        [np.broadcast_to(np.eye(3), (len(arms), 3, 3)), -cross_matrices(arms)], axis=2
    )
    JW = J.transpose(0, 2, 1) @ W
    return arms, JW, (JW @ J).sum(axis=0)


def _on_one_line(points: Array, ratio: float = 1e-6) -> bool:
    """Whether points have no extent across their longest direction (also: fewer than three
    points).
    """
    if len(points) < 3:
        return True
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    rounding = 1e-14 * np.abs(points).max()
    return bool(extent[1] <= max(ratio * extent[0], rounding, SMALLEST_MM))


def _as_covariances(value: ArrayLike, n: int) -> Array:
    C = as_array(value, "covariances", (n, 3, 3))
    size = np.abs(C).max(axis=(1, 2), initial=0.0)
    unit = C / np.maximum(size, np.finfo(float).tiny)[:, None, None]
    symmetric = np.abs(unit - unit.transpose(0, 2, 1)).max(initial=0.0) <= 1e-9
    if not symmetric or np.linalg.eigvalsh(unit).min(initial=0.0) < -1e-9:
        raise ValueError(
            "covariances: expected symmetric matrices without a negative eigenvalue, got another one"
        )
    return C


def fit_pose(
    uv: Array,
    rig: Rig,
    handle: Handle,
    max_slant_deg: float = 70.0,
    sigma_px: float = 0.1,
    known: RigidTransform | None = None,
) -> Pose:
    """The paper's estimate from labelled markers: pairs, mean, rigid fit (Eq. 20-24).

    Parameters
    ----------
    uv : ndarray, shape (cameras, markers, 2)
        Each marker's centroid in each image, px; NaN where it was not found.
        `identity.labelled_pixels` makes it.
    rig, handle
    max_slant_deg : float
        Markers turned further away are left out if four others remain.
    sigma_px : float
        Standard deviation of a pixel coordinate's noise, for the covariance. The bias of centroids
        is accounted for by `estimators.paper`.
    known : RigidTransform, optional
        T_world_handle from which their slant is computed; by default a fit to all of them.

    Returns
    -------
    Pose
        With status ``measured``; `LOST` if fewer than three markers that are not on a line were
        triangulated.
    """
    fitted = _fitted(uv, rig, handle, max_slant_deg, sigma_px, known)
    if fitted is None:
        return LOST
    T, uv_used, used, covariances, _ = fitted
    covariance = _fit_covariance(handle.marker_centres[used], T, covariances[used])
    systematic = systematic_covariance(_response(fitted, handle), rig, handle)
    return _measured_pose(T, covariance, uv_used, used, rig, handle, systematic)


def fit_response(uv: Array, rig: Rig, handle: Handle, max_slant_deg: float = 70.0) -> Response:
    """The response to the pixels of a pose that `fit_pose` has measured; parameters as there.

    Raises
    ------
    ValueError
        If it measures none.
    """
    fitted = _fitted(uv, rig, handle, max_slant_deg, 1.0, None)
    if fitted is None:
        raise ValueError("uv: expected pixels that fix a pose, got others")
    return _response(fitted, handle)


class _Fitted(NamedTuple):
    """A pose, the pixels (cameras, markers, 2), the markers that were used (markers,), the points'
    covariances (markers, 3, 3), and their derivatives by the pixels (markers, 3, 2 cameras).
    """

    T_world_handle: RigidTransform
    uv: Array
    used: np.ndarray
    covariances: Array
    by_pixel: Array


def _fitted(
    uv: Array,
    rig: Rig,
    handle: Handle,
    max_slant_deg: float,
    sigma_px: float,
    known: RigidTransform | None,
) -> _Fitted | None:
    sigma_px = as_number(sigma_px, "sigma_px", low=0.0, high=1e6, open_low=True)
    points, slopes = pairs_with_slopes(rig, uv, 1.0)
    T = rigid_motion(handle.marker_centres, mean_of_pairs(points)) if known is None else known
    if T is None:
        return None
    slant = np.stack([slants(handle, T, camera.centre) for camera in rig.cameras])
    facing = ~(slant > np.deg2rad(max_slant_deg))
    both_face = np.array([facing[i] & facing[j] for i, j in rig.pairs])
    of_facing = np.where(both_face[..., None], points, np.nan)
    if np.isfinite(mean_of_pairs(of_facing)).all(axis=1).sum() >= 4:
        points = of_facing
        uv = np.where(facing[..., None], uv, np.nan)
    means, covariances = mean_with_covariance(points, sigma_px * slopes)
    T = rigid_motion(handle.marker_centres, means)
    used = np.asarray(np.isfinite(means).all(axis=1))
    if T is None:
        return None
    return _Fitted(T, uv, used, covariances, mean_slopes(points, slopes))


def _response(fitted: _Fitted, handle: Handle) -> Response:
    T, _, used, _, by_pixel = fitted
    by_point = np.zeros((len(used), 6, 3))
    by_point[used] = rigid_fit_gain(handle.marker_centres[used], T)
    by_pixel = np.nan_to_num(by_pixel)
    # (6, markers, cameras, 2)
    gain = np.einsum("nai,nij->anj", by_point, by_pixel).reshape(6, len(by_point), -1, 2)
    marker, camera = np.nonzero(np.any(gain, axis=(0, 3)))
    return response(gain[:, marker, camera], camera, marker, handle, T)


def _measured_pose(
    T: RigidTransform,
    covariance: Array,
    uv: Array,
    used: np.ndarray,
    rig: Rig,
    handle: Handle,
    systematic: Array = NOTHING,
) -> Pose:
    """A measured pose, with the reprojection error of the markers that were used (markers,), those
    triangulated.
    """
    centres = T.apply(handle.marker_centres)
    error = np.stack([image_of(camera, centres) for camera in rig.cameras]) - uv
    seen = np.asarray(np.isfinite(error).all(axis=2)) & used
    residual = float(np.sqrt((error[seen] ** 2).sum(axis=1).mean()))
    cameras = int(seen.any(axis=1).sum())
    return Pose("measured", T, covariance, residual, int(used.sum()), cameras, systematic)
