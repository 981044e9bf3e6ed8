"""Cameras from views of a flat target: a start in closed form, Eq. 25, and the joint adjustment
(Sect. 6.2).

`model` says where the cameras see the target; `normal` eliminates its poses from the equations of a
step.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig, RigCovariance, lengthened, of_one_model
from ..checks import Array, as_array, as_number, as_points, frozen
from ..rigid import cross_matrices
from .eq25 import relative_pose
from .model import State, images, normal_equations, stepped, stepped_views
from .normal import Normal, damped, descended, eliminated, solved
from .start import homography, intrinsics, target_pose

Poses = list[RigidTransform | None]
# numbers of distortion coefficients that make sense: k1, k2, (p1, p2), k3, (k4, k5, k6)
TERMS = (0, 1, 2, 4, 5, 8)
PLUMB_BOB = 5  # the most of them without the rational model
FEWEST_VIEWS = 3
# Share of the sum of squares by which the last step lowers it: what is left to go is a millionth of
# a parameter's sigma.
REST = 1e-12
SMALLEST_SHARE = 1e-13  # of the largest eigenvalue: below, rounding decides
FREE = "uv: expected views that determine all parameters; these leave some of them free"
UNEXPLAINED = "uv: expected views of the target; no cameras were found that explain them"


@dataclass(frozen=True, eq=False)
class Calibrated:
    """Cameras from views of a target.

    Attributes
    ----------
    cameras : tuple of Camera
        The world frame is the first camera's.
    T_world_target : tuple of RigidTransform or None
        One per view; None for a view in which no camera saw enough points.
    covariance : ndarray, shape (q, q)
        Of the cameras' parameters, to first order: for each camera fx, fy, cx, cy (px) and the
        fitted distortions, then for each camera but the first the translation (mm) and rotation
        vector (rad, world frame) of T_world_cam.
    distortion_terms : int
        How many distortions were fitted.
    residuals_px : ndarray, shape (cameras, views, n, 2)
        Projected minus measured; NaN for what was not measured or not used.
    sigma_px : float
        The noise of a pixel coordinate by the residuals: the root of the sum of their squares divided
        by the degrees of freedom.
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
        """The covariance in the form of a rig's: fixed parameters have zeros, and the first camera's
        place is exact.
        """
        lens = 4 + self.distortion_terms
        n = len(self.cameras)
        size = len(self.cameras[0].parameters)
        into = np.zeros((n, size, len(self.covariance)))
        for c, camera in enumerate(self.cameras):
            into[c, :lens, c * lens : (c + 1) * lens] = np.eye(lens)
            if c:
                at = n * lens + 6 * (c - 1)
                into[c, -6:, at : at + 6] = _world_to_camera(camera.T_cam_world)
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
        """Standard deviations of fx, fy, cx, cy (px) and the distortions, shape (cameras, 9) or
        (cameras, 12); 0 for what is fixed.
        """
        width = 4 + self.distortion_terms
        sigma = np.zeros((len(self.cameras), len(self.cameras[0].parameters) - 6))
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
    start: Calibrated | None = None,
    lenses: Sequence[Camera] | None = None,
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
        Their measured pixels; NaN for a point that was not detected. A view with fewer than four
        points, or with all points on one line, is left out.
    sizes : sequence of (int, int)
        Width and height of each camera's images.
    names : sequence of str, optional
        Of the cameras; ccd1, ccd2, ... without it.
    distortion_terms : int
        How many of k1, k2, p1, p2, k3, k4, k5, k6 are fitted, in this order: 0, 1, 2, 4, 5 or 8. The
        others are zero.
    start : Calibrated, optional
        A calibration of the same views, or of more, perhaps with other distortions, that replaces
        Zhang's start. Views that it did not use are left out.
    lenses : sequence of Camera, optional
        Cameras whose matrices and distortions are known and held; only the places are adjusted.
        Requires as many `distortion_terms` as they have, and no `start`.

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
    if lenses is not None:
        lenses = of_one_model(lenses)
        most = len(lenses[0].distortions)
        if len(lenses) != len(uv) or start is not None or distortion_terms != most:
            raise ValueError(
                f"lenses: expected {len(uv)} cameras, {most} distortion_terms and no start, got {len(lenses)}"
            )
        state, used = _with_lenses(target, uv, lenses)
    elif start is None:
        state, used = _in_closed_form(target, uv, sizes, distortion_terms)
    else:
        state, used = _as_before(start, uv, distortion_terms)
    measured = np.where(used[:, :, None, None], uv, np.nan)
    seen = np.array(used.any(axis=0))
    held = 0 if lenses is None else state.lenses.size
    state, covariance, sigma_px = _adjusted(target, measured[:, seen], state, held)
    errors = np.full(uv.shape, np.nan)
    errors[:, seen] = images(state, target).uv - measured[:, seen]
    names = names or [f"ccd{k + 1}" for k in range(len(uv))]
    T_world_cam = RigidTransform.from_matrix(state.T_world_cam)
    cameras = tuple(
        camera_of(name, size, lens, T)
        for name, size, lens, T in zip(names, sizes, state.lenses, T_world_cam, strict=True)
    )
    poses = iter(RigidTransform.from_matrix(state.T_world_target))
    in_order = tuple(next(poses) if of_view else None for of_view in seen)
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


def camera_of(name: str, size: tuple[int, int], lens: Array, T_world_cam: RigidTransform) -> Camera:
    """A camera of one lens of `model.State`."""
    fx, fy, cx, cy = lens[:4]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return Camera(name, size, matrix, lengthened(lens[4:], PLUMB_BOB), T_world_cam.inv())


def _in_closed_form(
    target: Array, uv: Array, sizes: Sequence[tuple[int, int]], terms: int
) -> tuple[State, np.ndarray]:
    """Zhang's start without distortions, and which views it uses, bool (cameras, views)."""
    starts = [
        _start(target, views, size, k)
        for k, (views, size) in enumerate(zip(uv, sizes, strict=True))
    ]
    used = np.array([[pose is not None for pose in poses] for _, poses in starts])
    T_world_cam, T_world_target = _chained([poses for _, poses in starts])
    lenses = np.zeros((len(uv), 4 + terms))
    lenses[:, :4] = [[K[0, 0], K[1, 1], K[0, 2], K[1, 2]] for K, _ in starts]
    return State(lenses, matrices(T_world_cam), matrices(T_world_target)), used


def _with_lenses(target: Array, uv: Array, lenses: Sequence[Camera]) -> tuple[State, np.ndarray]:
    """The start with known lenses, and which views it uses, bool (cameras, views)."""
    poses = list[Poses]()
    for k, (views, camera) in enumerate(zip(uv, lenses, strict=True)):
        H = [homography(target[:, :2], camera.ideal_pixels(view)) for view in views]
        _check_count(k, sum(h is not None for h in H))
        poses.append([None if h is None else target_pose(h, camera.matrix) for h in H])
    used = np.array([[pose is not None for pose in of] for of in poses])
    T_world_cam, T_world_target = _chained(poses)
    known = lenses_of(lenses, len(lenses[0].distortions))
    return State(known, matrices(T_world_cam), matrices(T_world_target)), used


def _as_before(start: Calibrated, uv: Array, terms: int) -> tuple[State, np.ndarray]:
    """The start from another calibration, and which views it uses, bool (cameras, views)."""
    if start.residuals_px.shape != uv.shape:
        raise ValueError(f"start: expected one of pixels of shape {uv.shape}")
    used = np.isfinite(start.view_rms_px) & np.isfinite(uv).any(axis=(2, 3))
    for k, count in enumerate(used.sum(axis=1)):
        _check_count(k, count)
    seen = np.array(used.any(axis=0))
    views = matrices(T for T, of_view in zip(start.T_world_target, seen, strict=True) if of_view)
    cameras = matrices(camera.T_world_cam for camera in start.cameras)
    return State(lenses_of(start.cameras, terms), cameras, views), used


def _check_count(k: int, views: int) -> None:
    if views < FEWEST_VIEWS:
        raise ValueError(f"uv: expected three or more views by camera {k}, got {views}")


def lenses_of(cameras: Sequence[Camera], terms: int) -> Array:
    """The `lenses` of a `model.State`: fx, fy, cx, cy and distortions."""
    return np.array(
        [
            [*camera.focal, *camera.principal_point, *lengthened(camera.distortions, terms)[:terms]]
            for camera in cameras
        ]
    )


def matrices(poses: Iterable[RigidTransform | None]) -> Array:
    """The matrices of poses, (m, 4, 4)."""
    return np.stack([T.as_matrix() for T in poses if T is not None])


def _start(target: Array, views: Array, size: tuple[int, int], k: int) -> tuple[Array, Poses]:
    """A camera's intrinsic matrix and the target's pose in each of its views, None where there is
    none.
    """
    H = [homography(target[:, :2], uv) for uv in views]
    _check_count(k, sum(h is not None for h in H))
    try:
        K = intrinsics(np.stack(_well_seen(H, views)), size)
    except ValueError as error:
        raise ValueError(f"uv: camera {k}: {error}") from None
    return K, [None if h is None else target_pose(h, K) for h in H]


def _well_seen(H: list[Array | None], views: Array) -> list[Array]:
    """The homographies of views with at least two thirds of the largest number of points: those of
    fewer points determine the lens poorly.
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


def _adjusted(target: Array, uv: Array, start: State, held: int = 0) -> tuple[State, Array, float]:
    """The least-squares state, the covariance of its common unknowns and the pixel noise; the first
    `held` of the common unknowns stay as they are.
    """
    measured = int(np.isfinite(uv).sum())
    unknowns = start.common - held + 6 * len(start.T_world_target)
    if measured <= unknowns:
        raise ValueError(f"uv: expected more than {unknowns} measured coordinates, got {measured}")

    def linearised(state: State) -> tuple[Normal, float]:
        at = images(state, target)
        return normal_equations(at, uv).without(held), _cost(at.uv, uv)

    def further(state: State, normal: Normal, damping: float) -> State:
        common, views = solved(normal, damping)
        return stepped(state, np.pad(common, (held, 0)), views)

    try:
        with np.errstate(all="ignore"):  # a step may lead anywhere; that shows in its cost
            descent = descended(start, linearised, further, REST)
        of_unit_noise = inverse(descent.linear)
    except np.linalg.LinAlgError:
        raise ValueError(FREE) from None
    if not (
        descent.at_rest and np.isfinite(descent.cost) and (descent.state.lenses[:, :2] > 0).all()
    ):
        raise ValueError(UNEXPLAINED)
    variance = 2 * descent.cost / (measured - unknowns)
    covariance = np.pad(of_unit_noise * variance, (held, 0))
    return descent.state, covariance, float(np.sqrt(variance))


def inverse(normal: Normal) -> Array:
    """The covariance (q, q) of the common unknowns for unit noise: the inverse of the Schur complement.

    Raises
    ------
    ValueError
        If the views leave some of the unknowns free.
    """
    S = eliminated(normal).S
    if not len(S):
        return S
    squares = np.diag(normal.A)  # of the slopes by each unknown, which bring all to one scale
    scale = np.sqrt(np.where(squares > 0, squares, 1.0))
    values, vectors = np.linalg.eigh(S / np.outer(scale, scale))
    if not values[0] > SMALLEST_SHARE * values[-1]:
        raise ValueError(FREE)
    return np.asarray((vectors / values) @ vectors.T / np.outer(scale, scale), dtype=float)


def posed(
    calibrated: Calibrated, target: Array, uv: Array, T_world_target: Sequence[RigidTransform]
) -> Array:
    """The residuals (projected minus measured) of a target's best poses, with the cameras held.

    Parameters
    ----------
    calibrated : Calibrated
    target : ndarray, shape (n, 3)
    uv : ndarray, shape (cameras, views, n, 2)
        px; NaN for a point that was not detected. At least four points per view.
    T_world_target : sequence of RigidTransform
        Of each view, right to about a degree.

    Returns
    -------
    ndarray, shape (cameras, views, n, 2)

    Raises
    ------
    ValueError
        If cameras cannot see what was measured: beyond the range of their lens models.
    """
    lenses = lenses_of(calibrated.cameras, calibrated.distortion_terms)
    cameras = matrices(camera.T_world_cam for camera in calibrated.cameras)

    def linearised(state: State) -> tuple[Normal, float]:
        at = images(state, target)
        return normal_equations(at, uv), _cost(at.uv, uv)

    def further(state: State, normal: Normal, damping: float) -> State:
        steps = np.linalg.solve(damped(normal.D, damping), normal.b[..., None])
        return stepped_views(state, np.asarray(steps[..., 0], dtype=float))

    start = State(lenses, cameras, matrices(T_world_target))
    descent = descended(start, linearised, further, REST)
    if not np.isfinite(descent.cost):
        raise ValueError(UNEXPLAINED)
    return images(descent.state, target).uv - uv


def _cost(uv: Array, measured: Array) -> float:
    """Half the sum of squared residuals; NaN if a measured point is outside a camera's model."""
    return float(((uv - measured)[np.isfinite(measured)] ** 2).sum()) / 2


def _rms(residuals: Array, axis: int | tuple[int, ...]) -> Any:
    """Rms distance over axes, NaN where nothing was measured."""
    square = (residuals**2).sum(axis=-1)
    count = np.isfinite(square).sum(axis=axis)
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.nansum(square, axis=axis) / count)
