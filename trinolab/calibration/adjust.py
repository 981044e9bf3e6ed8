"""Cameras from views of a flat target: a start in closed form, Eq. 25, and the joint adjustment
(Sect. 6.2).

A target point P is at W = R_v P + t_v in the world, which is the first camera's frame, at L = R_c^T
(W - T_c) in camera c's, and from there goes through the lens. R_c, T_c are T_world_cam, the
direction of Eq. 25.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import CAMERA_PARAMETERS, Camera, Rig, RigCovariance
from ..checks import Array, as_array, as_number, as_points, frozen
from ..lens import project_with_slopes
from ..rigid import cross_matrices
from .eq25 import relative_pose
from .start import homography, intrinsics, target_pose

__all__ = [
    "TERMS",
    "Calibrated",
    "Layout",
    "Poses",
    "calibrate",
    "left_jacobian",
    "pack",
    "residuals",
    "slopes",
    "unpack",
]

Poses = list[RigidTransform | None]
TERMS = (0, 1, 2, 4, 5)  # numbers of distortion coefficients that make sense: k1, k2, (p1, p2), k3


class Layout(NamedTuple):
    """How the parameters stand in one vector: for each camera fx, fy, cx, cy and distortions; for
    each camera but the first T_c and the rotation vector of R_c; for each view t_v and the rotation
    vector of R_v.
    """

    cameras: int
    views: int
    terms: int

    def split(self, x: Array) -> tuple[Array, Array, Array]:
        """Lenses (cameras, 4 + terms), T_world_cam (cameras, 6) with zeros for the first,
        T_world_target (views, 6).
        """
        lenses = self.cameras * (4 + self.terms)
        others = 6 * (self.cameras - 1)
        poses = np.concatenate([np.zeros(6), x[lenses:]]).reshape(-1, 6)
        return (
            x[:lenses].reshape(self.cameras, -1),
            poses[: 1 + others // 6],
            poses[1 + others // 6 :],
        )

    def turns(self, x: Array, jacobian: Callable[[Array], Array]) -> Array:
        """Matrix (q, q) that takes changes of the cameras' rotation vectors in x to small rotations
        in the world.
        """
        lenses, poses, _ = self.split(x)
        return block_diag(
            np.eye(lenses.size), *(block_diag(np.eye(3), jacobian(pose[3:])) for pose in poses[1:])
        )


def pack(
    layout: Layout,
    matrices: Sequence[Array],
    T_world_cam: Sequence[RigidTransform],
    T_world_target: Sequence[RigidTransform],
) -> Array:
    """The parameters as a vector, with distortions of zero."""
    lenses = [[K[0, 0], K[1, 1], K[0, 2], K[1, 2]] + [0.0] * layout.terms for K in matrices]
    poses = [
        np.concatenate([T.translation, T.rotation.as_rotvec()])
        for T in [*T_world_cam[1:], *T_world_target]
    ]
    return np.concatenate([np.ravel(lenses), *poses])


def unpack(
    layout: Layout, x: Array
) -> tuple[list[Array], Array, list[RigidTransform], list[RigidTransform]]:
    """Intrinsic matrices, distortions (cameras, 5), T_world_cam and T_world_target from the
    vector.
    """
    lenses, cameras, views = layout.split(x)
    matrices = [np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]) for fx, fy, cx, cy in lenses[:, :4]]
    distortions = np.pad(lenses[:, 4:], ((0, 0), (0, 5 - layout.terms)))
    cams, targets = (
        [RigidTransform.from_components(p[:3], Rotation.from_rotvec(p[3:])) for p in poses]
        for poses in (cameras, views)
    )
    return matrices, distortions, cams, targets


def residuals(layout: Layout, target: Array, uv: Array, x: Array) -> Array:
    """Projected minus measured, shape (cameras, views, n, 2); NaN where nothing was measured."""
    lenses, cameras, views = layout.split(x)
    world = _moved(target, views)
    return (
        np.stack(
            [
                project_with_slopes(lens, _local(world, pose))[0]
                for lens, pose in zip(lenses, cameras, strict=True)
            ]
        )
        - uv
    )


def slopes(layout: Layout, target: Array, x: Array) -> Array:
    """Derivatives of the projected points by the parameters, shape (cameras, views, n, 2,
    parameters).
    """
    lenses, cameras, views = layout.split(x)
    world = _moved(target, views)
    arms = _moved(target, views) - views[:, None, :3]
    J = np.zeros((layout.cameras, layout.views, len(target), 2, len(x)))
    width = lenses.shape[1]
    first_view = lenses.size + 6 * (layout.cameras - 1)
    # d W / d rotvec
    turned = -cross_matrices(arms) @ np.stack([left_jacobian(pose[3:]) for pose in views])[:, None]
    for c, (lens, pose) in enumerate(zip(lenses, cameras, strict=True)):
        R_cam_world = Rotation.from_rotvec(pose[3:]).as_matrix().T
        _, by_lens, by_local = project_with_slopes(lens, _local(world, pose))
        J[c, ..., c * width : (c + 1) * width] = by_lens
        by_world = by_local @ R_cam_world  # (views, n, 2, 3)
        if c:
            at = lenses.size + 6 * (c - 1)
            J[c, ..., at : at + 3] = -by_world
            J[c, ..., at + 3 : at + 6] = (
                by_world @ cross_matrices(world - pose[:3]) @ left_jacobian(pose[3:])
            )
        for v in range(layout.views):
            at = first_view + 6 * v
            J[c, v, ..., at : at + 3] = by_world[v]
            J[c, v, ..., at + 3 : at + 6] = by_world[v] @ turned[v]
    return J


def left_jacobian(rotvec: Array) -> Array:
    """J with R(w + dw) = R(J dw) R(w) to first order, shape (3, 3)."""
    angle = np.linalg.norm(rotvec)
    W = cross_matrices(rotvec)
    if angle < 1e-4:  # two terms of the series: the next is below rounding
        return np.eye(3) + W / 2 + W @ W / 6
    return (
        np.eye(3) + W * (1 - np.cos(angle)) / angle**2 + W @ W * (angle - np.sin(angle)) / angle**3
    )


def _moved(points: Array, poses: Array) -> Array:
    """Points (n, 3) under motions (m, 6), shape (m, n, 3)."""
    return (
        points @ Rotation.from_rotvec(poses[:, 3:]).as_matrix().transpose(0, 2, 1)
        + poses[:, None, :3]
    )


def _local(world: Array, pose: Array) -> Array:
    """World points (..., 3) in the frame of a camera at the pose T_world_cam, (6,)."""
    return (world - pose[:3]) @ Rotation.from_rotvec(pose[3:]).as_matrix()


@dataclass(frozen=True, eq=False)
class Calibrated:
    """Cameras from views of a target.

    Attributes
    ----------
    cameras : tuple of Camera
        The world frame is the first camera's.
    T_world_target : tuple of RigidTransform or None
        One a view; None for a view that no camera had enough of.
    covariance : ndarray, shape (q, q)
        Of the cameras' parameters, to first order: for each camera fx, fy, cx, cy (px) and the
        fitted distortions, then for each camera but the first the translation (mm) and rotation
        vector (rad, world frame) of T_world_cam.
    distortion_terms : int
        How many distortions were fitted.
    residuals_px : ndarray, shape (cameras, views, n, 2)
        Projected minus measured; NaN for what was not measured or not used.
    sigma_px : float
        The noise of a pixel coordinate that the residuals speak for: their squares divided by the
        degrees of freedom.
    """

    cameras: tuple[Camera, ...]
    T_world_target: tuple[RigidTransform | None, ...]
    covariance: Array
    distortion_terms: int
    residuals_px: Array
    sigma_px: float

    @property
    def rig(self) -> Rig:
        """The cameras as a rig, with its covariance. ValueError if there is only one."""
        return Rig(self.cameras, self.rig_covariance)

    @property
    def rig_covariance(self) -> RigCovariance:
        """The covariance as that of a rig: what was fixed has zeros, the first camera's place is
        exact.
        """
        lens = 4 + self.distortion_terms
        n = len(self.cameras)
        size = len(CAMERA_PARAMETERS)
        into = np.zeros((n, size, len(self.covariance)))
        for c, camera in enumerate(self.cameras):
            into[c, :lens, c * lens : (c + 1) * lens] = np.eye(lens)
            if c:
                at = n * lens + 6 * (c - 1)
                into[c, 9:, at : at + 6] = _world_to_camera(camera.T_cam_world)
        flat = into.reshape(n * size, -1)
        matrix = flat @ self.covariance @ flat.T
        return RigCovariance(tuple(camera.name for camera in self.cameras), (matrix + matrix.T) / 2)

    @property
    def rms_px(self) -> float:
        """Rms distance of projected and measured corners, all cameras together."""
        return _rms(self.residuals_px, (0, 1, 2))[()]

    @property
    def view_rms_px(self) -> Array:
        """The same for each camera and view, shape (cameras, views); NaN where a view is
        missing.
        """
        return _rms(self.residuals_px, 2)

    @property
    def intrinsic_sigma(self) -> Array:
        """Standard deviations of fx, fy, cx, cy (px), k1, k2, p1, p2, k3, shape (cameras, 9); 0 for
        what is fixed.
        """
        width = 4 + self.distortion_terms
        sigma = np.zeros((len(self.cameras), 9))
        sigma[:, :width] = np.sqrt(np.diag(self.covariance))[: width * len(sigma)].reshape(
            -1, width
        )
        return sigma

    def relative_covariance(self, camera: int) -> Array:
        """Covariance (6, 6) of T_world_cam: translation (mm) and rotation vector (rad); 0 for the
        first camera.
        """
        if not 0 <= camera < len(self.cameras):
            raise ValueError(f"camera: expected 0 to {len(self.cameras) - 1}, got {camera!r}")
        start = (4 + self.distortion_terms) * len(self.cameras) + 6 * (camera - 1)
        return (
            np.zeros((6, 6))
            if camera == 0
            else self.covariance[start : start + 6, start : start + 6]
        )


def _world_to_camera(T_cam_world: RigidTransform) -> Array:
    """Matrix (6, 6) from translation and small rotation (world frame) of T_world_cam to small
    rotation (camera frame) and translation of T_cam_world.

    With R, t of T_cam_world, a turn w of the camera makes R exp(-w), which is exp(-R w) R; the
    camera's centre is -R^T t.
    """
    R = T_cam_world.rotation.as_matrix()
    t = T_cam_world.translation
    return np.block([[np.zeros((3, 3)), -R], [-R, cross_matrices(t) @ R]])


def calibrate(
    target: ArrayLike,
    uv: ArrayLike,
    sizes: Sequence[tuple[int, int]],
    names: Sequence[str] | None = None,
    distortion_terms: int = 5,
) -> Calibrated:
    """Cameras from views of a flat target: Zhang's start, then one least squares over everything
    (Sect. 6.2, Eq. 25).

    All intrinsic parameters, distortions, relative poses and the target's poses are adjusted
    together, until the sum of the squared distances between projected and measured corners is
    smallest. The relative poses start from Eq. 25.

    Parameters
    ----------
    target : array_like, shape (n, 3)
        Points of the target in its frame, mm; z = 0.
    uv : array_like, shape (cameras, views, n, 2)
        Where they were found, px; NaN for what was not found. A camera's view with fewer than four
        points, or with points on one line, is left out.
    sizes : sequence of (int, int)
        Width and height of each camera's images.
    names : sequence of str, optional
        Of the cameras; ccd1, ccd2, ... without it.
    distortion_terms : int
        How many of k1, k2, p1, p2, k3 are fitted, in this order: 0, 1, 2, 4 or 5. The others are
        zero.

    Returns
    -------
    Calibrated

    Raises
    ------
    ValueError
        For wrong shapes; a target that is not flat; a camera with fewer than three views; a camera
        that shares no view with the others, directly or through a third one; views that do not
        determine the parameters, as when the target was always tilted alike; pixels that no cameras
        explain.
    """
    target, uv = _checked(target, uv, sizes, distortion_terms)
    starts = [
        _start(target, views, size, k)
        for k, (views, size) in enumerate(zip(uv, sizes, strict=True))
    ]
    used = np.array([[pose is not None for pose in poses] for _, poses in starts])
    measured = np.where(used[:, :, None, None], uv, np.nan)
    seen = used.any(axis=0)
    layout = Layout(len(uv), int(seen.sum()), distortion_terms)
    T_world_cam, T_world_target = _chained([poses for _, poses in starts])
    x0 = pack(
        layout, [K for K, _ in starts], T_world_cam, [T for T in T_world_target if T is not None]
    )
    x, covariance, sigma_px = _adjusted(layout, target, measured[:, seen], x0)
    errors = np.full(uv.shape, np.nan)
    errors[:, seen] = residuals(layout, target, measured[:, seen], x)
    names = names or [f"ccd{k + 1}" for k in range(len(uv))]
    K, distortions, T_world_cam, found = unpack(layout, x)
    cameras = tuple(
        Camera(name, size, matrix, k, T.inv())
        for name, size, matrix, k, T in zip(names, sizes, K, distortions, T_world_cam, strict=True)
    )
    poses = iter(found)
    in_order = tuple(next(poses) if T is not None else None for T in T_world_target)
    return Calibrated(
        cameras, in_order, frozen(covariance), distortion_terms, frozen(errors), sigma_px
    )


def _checked(
    target: ArrayLike, uv: ArrayLike, sizes: Sequence[Any], terms: int
) -> tuple[Array, Array]:
    points = as_points(target, "target", 3, finite=True)
    if np.any(points[:, 2]):
        raise ValueError("target: expected a flat target with z = 0")
    pixels = as_array(uv, "uv", (None, None, len(points), 2), finite=False)
    if len(sizes) != len(pixels) or not len(pixels):
        raise ValueError(f"sizes: expected one for each of {len(pixels)} cameras, got {len(sizes)}")
    if as_number(terms, "distortion_terms") not in TERMS:
        raise ValueError(f"distortion_terms: expected one of {TERMS}, got {terms!r}")
    return points, pixels


def _start(target: Array, views: Array, size: tuple[int, int], k: int) -> tuple[Array, Poses]:
    """A camera's intrinsic matrix and the target's pose in each of its views, None where there is
    none.
    """
    H = [homography(target[:, :2], uv) for uv in views]
    homographies = [h for h in H if h is not None]
    if len(homographies) < 3:
        raise ValueError(f"uv: expected three or more views by camera {k}, got {len(homographies)}")
    try:
        K = intrinsics(np.stack(_well_seen(H, views)), size)
    except ValueError as error:
        raise ValueError(f"uv: camera {k}: {error}") from None
    return K, [None if h is None else target_pose(h, K) for h in H]


def _well_seen(H: list[Array | None], views: Array) -> list[Array]:
    """Homographies of views with two thirds of the most points or more: few points speak badly of
    the lens.
    """
    counts = np.isfinite(views).all(axis=2).sum(axis=1)
    enough = [
        h
        for h, count in zip(H, counts, strict=True)
        if h is not None and 3 * count >= 2 * counts.max()
    ]
    return enough if len(enough) >= 3 else [h for h in H if h is not None]


def _chained(T_cam_target: list[Poses]) -> tuple[list[RigidTransform], Poses]:
    """T_world_cam of each camera by Eq. 25 over the views shared with those known so far, and
    T_world_target.
    """
    T_world_cam = {0: RigidTransform.identity()}
    world = list(T_cam_target[0])
    while len(T_world_cam) < len(T_cam_target):
        shared = {
            c: [
                (a, b) for a, b in zip(world, poses, strict=True) if a is not None and b is not None
            ]
            for c, poses in enumerate(T_cam_target)
            if c not in T_world_cam
        }
        c = max(shared, key=lambda c: len(shared[c]))
        if not shared[c]:
            raise ValueError(f"uv: camera {c} shares no view with the others")
        each = relative_pose(
            *(RigidTransform.concatenate(side) for side in zip(*shared[c], strict=True))
        )
        T = RigidTransform.from_components(
            np.median(each.translation, axis=0), each.rotation.mean()
        )
        T_world_cam[c] = T
        world = [
            a if a is not None or b is None else T * b
            for a, b in zip(world, T_cam_target[c], strict=True)
        ]
    return [T_world_cam[c] for c in range(len(T_cam_target))], world


def _adjusted(layout: Layout, target: Array, uv: Array, x0: Array) -> tuple[Array, Array, float]:
    """The parameters of least squares, the covariance of the cameras' ones, and the pixel noise."""
    valid = np.isfinite(uv)
    if valid.sum() <= len(x0):
        raise ValueError(
            f"uv: expected more than {len(x0)} measured coordinates, got {valid.sum()}"
        )
    # MINPACK works with one thread; where a step leaves the lens model's range it is to be refused.
    # A step of 1e-12 is a ten-millionth of a parameter's sigma: more steps would follow rounding.
    solution = least_squares(
        lambda x: np.nan_to_num(residuals(layout, target, uv, x)[valid], nan=1e6),
        x0,
        jac=lambda x: slopes(layout, target, x)[valid],
        method="lm",
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-15,
        max_nfev=300,
    )
    lost = not np.isfinite(residuals(layout, target, uv, solution.x)[valid]).all()
    if lost or solution.status == 0 or (layout.split(solution.x)[0][:, :2] <= 0).any():
        raise ValueError(
            "uv: expected views of the target; no cameras were found that explain them"
        )
    scale = np.linalg.norm(solution.jac, axis=0)
    J = solution.jac / np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(J.T @ J)
    if values[0] < 1e-13 * values[-1]:
        raise ValueError(
            "uv: expected views that determine all parameters; these leave some of them free"
        )
    variance = 2 * solution.cost / (len(solution.fun) - len(x0))
    whole = (vectors / values) @ vectors.T / np.outer(scale, scale) * variance
    turn = layout.turns(solution.x, left_jacobian)
    return solution.x, turn @ whole[: len(turn), : len(turn)] @ turn.T, float(np.sqrt(variance))


def _rms(residuals: Array, axis: int | tuple[int, ...]) -> Any:
    """Rms distance over axes, NaN where nothing was measured."""
    square = (residuals**2).sum(axis=-1)
    count = np.isfinite(square).sum(axis=axis)
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.nansum(square, axis=axis) / count)
