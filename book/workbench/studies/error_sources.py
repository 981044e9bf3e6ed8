"""What each source of error does to the measured poses, to first order: the entries of Table 1's
error budget.

All come from exact projections of the markers: pixels, markers or cameras are changed, and the pose
is measured again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Camera, Rig, T_between
from trinolab.checks import Array, as_array, as_number
from trinolab.datasets import load_calibration
from trinolab.handle import Handle, facing_pixels
from trinolab.kalman import covariance_root
from trinolab.parameters import Parameters
from trinolab.pose import Pose, fit_pose, rigid_fit
from trinolab.rigid import nearest_rotation

from ..paper.errata.pose import printed_points
from .deviations import Source, deviations, euler_jacobian


class Trial(NamedTuple):
    """Poses, who looks at them, and the exact pixels; all sources are changes of this.

    Attributes
    ----------
    rig : Rig
    handle : Handle
    truths : RigidTransform of length n
        T_world_handle.
    uv : ndarray, shape (n, cameras, markers, 2)
        Images of the markers' centres, NaN for those turned away.
    parameters : Parameters
        Of the estimator.
    """

    rig: Rig
    handle: Handle
    truths: RigidTransform
    uv: Array
    parameters: Parameters


def make_trial(
    rig: Rig, handle: Handle, truths: RigidTransform, parameters: Parameters | None = None
) -> Trial:
    """Exact pixels of the markers that are turned from a camera by at most `max_slant_deg` of the
    parameters.
    """
    p = parameters or Parameters()
    uv = np.array(
        [
            [facing_pixels(handle, camera, T, p.max_slant_deg) for camera in rig.cameras]
            for T in truths
        ]
    )
    return Trial(rig, handle, truths, uv, p)


def response(trial: Trial, uv: ArrayLike | None = None, rig: Rig | None = None) -> Array:
    """Deviations if the estimator is given other pixels or believes in another rig, shape (n, 6).

    Raises
    ------
    ValueError
        If the pixels have another shape, or leave a pose without an estimate.
    """
    responses = [
        pose.T_world_handle
        for pose in _estimates(trial, uv, rig)
        if pose.T_world_handle is not None
    ]
    if len(responses) < len(trial.truths):
        raise ValueError(
            f"uv: expected markers enough for {len(trial.truths)} poses, got enough for {len(responses)}"
        )
    return deviations(RigidTransform.concatenate(responses), trial.truths)


def pixel_noise(trial: Trial, sigma_px: float) -> Source:
    """Independent noise of every pixel coordinate, by the covariance that the estimator states."""
    p = replace(trial.parameters, sigma_px=sigma_px)
    scale = np.repeat([1.0, np.rad2deg(1.0)], 3)
    blocks = [
        scale[:, None] * covariance_root(pose.covariance_random, "covariance", 6)
        for pose in _estimates(trial._replace(parameters=p))
    ]
    return Source("pixel noise", sigma_px, "px", _nothing(trial), _each_its_own(np.array(blocks)))


def centroid_bias(trial: Trial, uv: ArrayLike) -> Source:
    """Pixels (n, cameras, markers, 2) of centroids without noise, in place of the centres'
    images.
    """
    pixels = as_array(uv, "uv", trial.uv.shape, finite=False)
    both = np.where(np.isfinite(pixels), pixels, np.nan) + 0 * trial.uv
    rms = np.sqrt(np.nanmean(((both - trial.uv) ** 2).sum(axis=-1)))
    return Source("centroid bias", float(rms), "px rms", response(trial, both), _none(trial))


def calibration(trial: Trial, covariance: ArrayLike) -> Source:
    """Cameras whose parameters are wrong by a calibration's covariance, see `Calibrated`; without
    distortions.
    """
    root = covariance_root(covariance, "covariance", 10 * len(trial.rig.cameras) - 6)
    return Source("calibration", 1.0, "sigma", _nothing(trial), _to_shifts(trial, root))


def turned_camera(trial: Trial, sigma_deg: float) -> Source:
    """The last camera turned since the calibration, by `sigma_deg` about each of its axes."""
    shifts = np.zeros((10 * len(trial.rig.cameras) - 6, 3))
    shifts[-3:] = np.deg2rad(sigma_deg) * trial.rig.cameras[-1].T_world_cam.rotation.as_matrix()
    return Source(
        "turned camera", sigma_deg, "deg an axis", _nothing(trial), _to_shifts(trial, shifts)
    )


def shifted_rig(rig: Rig, x: ArrayLike) -> Rig:
    """A rig with changed parameters, in the order of `Calibrated.covariance` without distortions.

    Parameters
    ----------
    x : array_like, shape (10 cameras - 6,)
        For each camera changes of fx, fy, cx, cy (px), then for each but the first the shift (mm)
        and turn (rad, world frame) of T_world_cam.
    """
    m = len(rig.cameras)
    x = as_array(x, "x", (10 * m - 6,))
    inner = x[: 4 * m].reshape(m, 4)
    outer = np.vstack([np.zeros(6), x[4 * m :].reshape(m - 1, 6)])
    cameras = [_shifted(*each) for each in zip(rig.cameras, inner, outer, strict=True)]
    return replace(rig, cameras=tuple(cameras))


def printed_matrix(trial: Trial) -> Source:
    """The paper's pair with R_rl as printed, which is no rotation, its transpose as its inverse
    (Eq. 20, 24, 25).
    """
    printed = load_calibration().R_rl
    skewness = printed - nearest_rotation(printed).as_matrix()
    estimates = by_matrix(trial, trial.uv, trial.rig, skewness)
    largest = float(np.abs(skewness).max())
    return Source(
        "R_rl as printed",
        largest,
        "in one entry",
        deviations(estimates, trial.truths),
        _none(trial),
    )


def by_matrix(trial: Trial, uv: Array, rig: Rig, skewness: Array) -> RigidTransform:
    """Poses by the first form of Eq. 20 and a rigid fit, for a pair whose R_rl is no rotation by
    `skewness` (3, 3).
    """
    left, right = rig.cameras
    T = T_between(left, right)
    R_rl = T.rotation.as_matrix() + skewness
    fits = [
        rigid_fit(
            trial.handle.marker_centres,
            left.T_world_cam.apply(
                printed_points(
                    left.normalise(views[0]),
                    right.normalise(views[1]),
                    R_rl.T,
                    -R_rl.T @ T.translation,
                )
            ),
        )
        for views in uv
    ]
    return RigidTransform.concatenate([fit for fit in fits if fit is not None])


def one_focal_length(trial: Trial) -> Source:
    """One focal length a camera, the mean of its two, as Eq. 20 has it."""
    spread = 100 * max(
        np.abs(camera.focal / camera.focal.mean() - 1).max() for camera in trial.rig.cameras
    )
    changed = response(trial, rig=with_one_focal(trial.rig))
    return Source("one focal length", float(spread), "% an axis", changed, _none(trial))


def with_one_focal(rig: Rig) -> Rig:
    """The rig with the mean of f_x and f_y for both, in each camera."""
    cameras = []
    for camera in rig.cameras:
        matrix = camera.matrix.copy()
        matrix[[0, 1], [0, 1]] = camera.focal.mean()
        cameras.append(replace(camera, matrix=matrix))
    return replace(rig, cameras=tuple(cameras))


def platform(trial: Trial, accuracy_mm: float = 0.02) -> Source:
    """A stage that is off by up to `accuracy_mm` an axis, uniformly; its angles are taken for
    exact.
    """
    block = np.diag(
        np.repeat([as_number(accuracy_mm, "accuracy_mm", low=0.0) / np.sqrt(3), 0.0], 3)
    )
    return Source(
        "platform",
        accuracy_mm,
        "mm",
        _nothing(trial),
        _each_its_own(np.broadcast_to(block, (len(trial.truths), 6, 6))),
    )


def printed_digits(trial: Trial, step_mm: float = 0.01, step_deg: float = 0.1) -> Source:
    """Table 1's rounding, of the measured and of the set numbers."""
    sigma = np.sqrt(2 / 12)
    blocks = np.zeros((len(trial.truths), 6, 6))
    blocks[:, :3, :3] = step_mm * sigma * np.eye(3)
    blocks[:, 3:, 3:] = step_deg * sigma * np.linalg.inv(euler_jacobian(trial.truths))
    return Source("printed digits", step_deg, "deg", _nothing(trial), _each_its_own(blocks))


def set_scatter(trial: Trial, sigma_deg: float) -> Source:
    """Set angles alpha, beta, gamma that are each off by `sigma_deg`, in every pose anew."""
    digits = printed_digits(trial, 0.0, sigma_deg * np.sqrt(12 / 2))
    return digits._replace(name="scatter of the set angles", size=sigma_deg, unit="deg an angle")


def lens_distortion(trial: Trial, k1: float) -> Source:
    """A radial distortion of which the measurement knows nothing."""
    lenses = [replace(camera, distortions=k1 * np.eye(5)[0]) for camera in trial.rig.cameras]
    uv = np.array(
        [
            [
                lens.to_pixels(camera.normalise(pixels))
                for lens, camera, pixels in zip(lenses, trial.rig.cameras, views, strict=True)
            ]
            for views in trial.uv
        ]
    )
    return Source("lens distortion", k1, "k1", response(trial, uv), _none(trial))


def marker_places(trial: Trial, sigma_mm: float) -> Source:
    """Markers that sit beside their places by `sigma_mm` along the axis and around it, the same in
    all poses.
    """
    along = np.broadcast_to([0.0, 1.0, 0.0], trial.handle.marker_centres.shape)
    around = np.cross(along, trial.handle.marker_normals)
    columns = [
        _moved_marker(trial, k, direction[k] * sigma_mm)
        for direction in (along, around)
        for k in range(len(along))
    ]
    return Source(
        "places of the markers", sigma_mm, "mm", _nothing(trial), np.stack(columns, axis=2)
    )


def askew(trial: Trial, sigma_deg: float) -> Source:
    """A handle that is fixed to the platform askew, by `sigma_deg` about each of its axes, the same
    in all poses.
    """
    roots = np.zeros((len(trial.truths), 6, 3))
    roots[:, 3:] = sigma_deg * trial.truths.rotation.as_matrix()
    return Source("handle set askew", sigma_deg, "deg an axis", _nothing(trial), roots)


def turned_reference(trial: Trial, sigma_deg: float) -> Source:
    """A reference of the angles that is turned before the cameras, by `sigma_deg` about each axis
    of the world, the same in all poses; the positions' reference is not.
    """
    roots = np.zeros((len(trial.truths), 6, 3))
    roots[:, 3:] = sigma_deg * np.eye(3)
    return Source("reference turned", sigma_deg, "deg an axis", _nothing(trial), roots)


def set_angles(trial: Trial, sigma_deg: float) -> Source:
    """Zeros of the three axes that set alpha, beta and gamma, each off by `sigma_deg`, the same in
    all poses.
    """
    roots = np.zeros((len(trial.truths), 6, 3))
    roots[:, 3:] = sigma_deg * np.linalg.inv(euler_jacobian(trial.truths))
    return Source("zeros of the set angles", sigma_deg, "deg an angle", _nothing(trial), roots)


def _estimates(trial: Trial, uv: ArrayLike | None = None, rig: Rig | None = None) -> list[Pose]:
    pixels = trial.uv if uv is None else as_array(uv, "uv", trial.uv.shape, finite=False)
    every_deg = 90.0  # the markers are chosen already, once for all sources
    return [
        fit_pose(views, rig or trial.rig, trial.handle, every_deg, trial.parameters.sigma_px)
        for views in pixels
    ]


def _to_shifts(trial: Trial, shifts: Array) -> Array:
    """Responses (n, 6, q) to each column of shifts (parameters, q) of the rig, see
    `shifted_rig`.
    """
    columns = [
        (
            response(trial, rig=shifted_rig(trial.rig, x))
            - response(trial, rig=shifted_rig(trial.rig, -x))
        )
        / 2
        for x in shifts.T
    ]
    return np.stack(columns, axis=2)


def _shifted(camera: Camera, inner: Array, outer: Array) -> Camera:
    matrix = camera.matrix + np.array([[inner[0], 0, inner[2]], [0, inner[1], inner[3]], [0, 0, 0]])
    T = camera.T_world_cam
    moved = RigidTransform.from_components(
        T.translation + outer[:3], Rotation.from_rotvec(outer[3:]) * T.rotation
    )
    return replace(camera, matrix=matrix, T_cam_world=moved.inv())


def _moved_marker(trial: Trial, k: int, shift_mm: Array) -> Array:
    """Half the difference that a marker makes which is moved one way and the other, shape (n,
    6).
    """
    centre = trial.handle.marker_centres[k]
    uv = np.array([trial.uv, trial.uv])
    for side, sign in zip(uv, (1, -1), strict=True):
        for views, T in zip(side, trial.truths, strict=True):
            point = T.apply(centre + sign * shift_mm)[None]
            views[:, k] = [camera.project(point)[0] for camera in trial.rig.cameras] + 0 * views[
                :, k
            ]
    return (response(trial, uv[0]) - response(trial, uv[1])) / 2


def _each_its_own(blocks: Array) -> Array:
    """Roots (n, 6, 6 n) of poses whose errors have nothing to do with one another, from each one's
    (6, 6).
    """
    n = len(blocks)
    roots = np.zeros((n, 6, n, 6))
    roots[np.arange(n), :, np.arange(n)] = blocks
    return roots.reshape(n, 6, 6 * n)


def _nothing(trial: Trial) -> Array:
    return np.zeros((len(trial.truths), 6))


def _none(trial: Trial) -> Array:
    return np.zeros((len(trial.truths), 6, 0))
