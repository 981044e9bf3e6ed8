"""The pose that fits all views at once, beyond the paper: by the markers' pixels, or by their centroids (Sect. 5.3).

Both start from a pose that is right to about a pixel. `fit_patches` minimises the misfit of the pixels themselves,
`fit_centroids` the distance of measured centroids from those that the pose predicts. No pair of cameras is needed: a
marker that a single camera sees counts as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from .appearance import Views
from .camera import Rig
from .centroids import predict_centroids
from .checks import Array
from .handle import Handle
from .patches import (
    Linear,
    Reduced,
    State,
    advanced,
    first_state,
    inverse,
    limited,
    linearise,
    marker_is_shown,
    misfit,
    noise_of,
    patches,
    reduce,
)
from .registration import register

FLOOR_PX = 0.004  # by so much the image model moves markers of the simulated bench, shading and all


class Fit(NamedTuple):
    """A pose that fits all views.

    Attributes
    ----------
    T_world_handle : RigidTransform
    covariance : ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame.
    views : Views
    misfit : ndarray, shape (k,)
        Reduced chi-square of each view: about 1 where it shows what the pose predicts.
    shown : ndarray of bool, shape (k,)
        Whether there is a marker like the others at all.
    residual_px : float
        Rms distance of the markers shown from where the pose predicts them.
    """

    T_world_handle: RigidTransform
    covariance: Array
    views: Views
    misfit: Array
    shown: np.ndarray
    residual_px: float


def fit_patches(images: Sequence[np.ndarray], rig: Rig, handle: Handle, start: RigidTransform,
                max_slant_deg: float = 72.0, steps: int = 2, floor_px: float = FLOOR_PX) -> Fit | None:
    """Improve a pose by the pixels about all markers that it shows.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
        Grey levels 0 to 255, one image a camera.
    rig : Rig
    handle : Handle
    start : RigidTransform
        T_world_handle, right to about a pixel in every image.
    max_slant_deg : float
        Markers turned further away are left out.
    steps : int
        Gauss-Newton steps.
    floor_px : float
        By how much a marker may seem to lie elsewhere because of what the image model leaves unsaid.

    Returns
    -------
    Fit or None
        None if too little is in view to fix a pose.
    """
    here = patches(images, rig, handle, start, max_slant_deg)
    if len(np.unique(here.views.marker)) < 3:
        return None
    state, scale = first_state(start, rig), _px_per_mm(rig, handle, start, here.views)
    for _ in range(steps):
        at = linearise(state, here, rig, handle)
        normal = reduce(at.by_pose, at)
        trust = _trust(at, normal.information, scale, floor_px)
        information, gradient = _assembled(normal, trust, here.views.camera, rig)
        step = inverse(information) @ gradient
        own = np.column_stack([np.broadcast_to(step[:6], (len(trust), 6)), step[6 + here.views.camera]])
        after = advanced(at, at.by_pose, normal, own)
        T = state.T_world_handle * _motion(step[:6])
        state = State(T, after.greys, limited(state.blur_px2, step[6:]), noise_of(after))
    shown = marker_is_shown(after, handle)
    left = _distances(normal, step[:6]) * scale
    spread = float(np.median(misfit(after)[shown])) if shown.any() else 1.0  # the noise was estimated before the step
    covariance = _in_world(spread * inverse(information)[:6, :6], state.T_world_handle)
    return _fit(state.T_world_handle, covariance, here.views, after, shown, left)


def fit_centroids(images: Sequence[np.ndarray], rig: Rig, handle: Handle, start: RigidTransform,
                  max_slant_deg: float = 72.0, steps: int = 2, floor_px: float = FLOOR_PX) -> Fit | None:
    """The pose with the least reprojection error of the predicted centroids, over all views at once.

    Parameters and result as for `fit_patches`; `steps` is the number of times that the centroids are measured, each
    time about the pose found before.
    """
    here = patches(images, rig, handle, start, max_slant_deg)
    if len(np.unique(here.views.marker)) < 3:
        return None
    state = first_state(start, rig)
    for _ in range(steps):
        state, found = register(state, here, rig, handle)
        covariance = found.covariance * np.maximum(misfit(found.at), 1.0)[:, None, None] + floor_px**2 * np.eye(2)
        shading = found.at.greys[:, 2:5]
        T, covariance = fit_pixels(found.uv, covariance, rig, handle, here.views, state.T_world_handle, shading)
        state = state._replace(T_world_handle=T)
    left = np.linalg.norm(found.uv - predict_centroids(rig, handle, T, here.views, shading)[0], axis=1)
    return _fit(T, covariance, here.views, found.at, marker_is_shown(found.at, handle), left)


def fit_pixels(uv: Array, covariance: Array, rig: Rig, handle: Handle, views: Views, start: RigidTransform,
               shading: Array | None = None, steps: int = 4, huber: float = 3.0) -> tuple[RigidTransform, Array]:
    """The pose whose predicted centroids lie nearest to measured ones, robust to a wrong match.

    Parameters
    ----------
    uv : ndarray, shape (k, 2)
        Measured centroids, px.
    covariance : ndarray, shape (k, 2, 2)
        Of each, px^2.
    rig, handle, views
    start : RigidTransform
        T_world_handle.
    shading : ndarray, shape (k, 2), optional
        As in `predict_centroids`.
    steps : int
        Gauss-Newton steps.
    huber : float
        Standard deviations beyond which a centroid counts for less (Huber 1964, DOI 10.1214/aoms/1177703732).

    Returns
    -------
    T_world_handle : RigidTransform
    covariance : ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame.
    """
    T, W = start, inverse(covariance)
    for _ in range(steps):
        predicted, J = predict_centroids(rig, handle, T, views, shading)
        residual = np.nan_to_num(uv - predicted)
        distance = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", residual, W, residual), 1e-12))
        counts = np.asarray(np.isfinite(predicted).all(axis=1)) * np.minimum(huber / distance, 1.0)
        weighted = W * counts[:, None, None]
        information = np.einsum("kia,kij,kjb->ab", J, weighted, J)
        step = np.linalg.solve(information, np.einsum("kia,kij,kj->a", J, weighted, residual))
        T = T * _motion(step)
    return T, _in_world(inverse(information), T)


def _fit(T_world_handle: RigidTransform, covariance: Array, views: Views, at: Linear, shown: np.ndarray,
         left_px: Array) -> Fit:
    residual = float(np.sqrt(np.mean(left_px[shown] ** 2))) if shown.any() else np.nan
    return Fit(T_world_handle, covariance, views, misfit(at), shown, residual)


def _motion(step: Array) -> RigidTransform:
    """A small motion (nu mm, omega rad)."""
    return RigidTransform.from_components(step[:3], Rotation.from_rotvec(step[3:]))


def _distances(normal: Reduced, step: Array) -> Array:
    """How far each window alone would still move the handle after a step, shape (k,), mm."""
    gradient = normal.gradient[:, :3] - normal.information[:, :3, :6] @ step
    along = np.linalg.pinv(normal.information[:, :3, :3], rcond=1e-2, hermitian=True)
    return np.linalg.norm((along @ gradient[..., None])[..., 0], axis=1)


def _trust(at: Linear, information: Array, px_per_mm: Array, floor_px: float) -> Array:
    """Weight of each window, shape (k,): less where it does not fit, or claims to know its place to below the floor."""
    per_px2 = np.trace(information[:, :3, :3], axis1=1, axis2=2) / (2 * px_per_mm**2)
    return 1 / np.maximum(misfit(at), 1.0) / (1 + floor_px**2 * per_px2)


def _px_per_mm(rig: Rig, handle: Handle, T_world_handle: RigidTransform, views: Views) -> Array:
    """Pixels to a millimetre across the line of sight at each view, shape (k,)."""
    centres = T_world_handle.apply(handle.marker_centres)
    scale = np.stack([camera.focal.mean() / camera.T_cam_world.apply(centres)[:, 2] for camera in rig.cameras])
    return scale[views]


def _assembled(normal: Reduced, trust: Array, camera: np.ndarray, rig: Rig) -> tuple[Array, Array]:
    """Normal equations of the pose (6) and the cameras' blurs from those of the windows (7 each)."""
    n = 6 + len(rig.cameras)
    total, right = 1e-12 * np.eye(n), np.zeros(n)
    for c in range(len(rig.cameras)):
        mine, own = camera == c, np.r_[0:6, 6 + c]
        total[np.ix_(own, own)] += np.tensordot(trust[mine], normal.information[mine], 1)
        right[own] += trust[mine] @ normal.gradient[mine]
    return total, right


def _in_world(covariance: Array, T_world_handle: RigidTransform) -> Array:
    """A covariance of a small motion in the handle's frame as one of position and rotation vector in the world's."""
    turn = np.kron(np.eye(2), T_world_handle.rotation.as_matrix())
    return turn @ covariance @ turn.T
