"""The pose with the least reprojection error of the markers' centroids, over all views at once
(beyond Sect. 5.3).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..rigid import motion_between
from ..sensitivity import Response, response
from ..uncertainty.assessment import LinearFit
from ..uncertainty.centroids import pulled_alike
from .appearance import Views
from .centroids import predict_centroids, register
from .imagemodel import first_state, has_gloss, inverse, marker_is_shown, marker_shading, misfit
from .patches import patches
from .pixels import (
    FLOOR_PX,
    MOST_STEPS,
    Fit,
    both_in_world,
    fit_from,
    in_world,
    moved,
)

CONVERGED_PX = 0.05  # a shift after which the next one is a fifth of it
# A last step that is longer leads away: of 2,160 fits on the broken bench two had 32 and 43, and were 9 deg
# off; all others had 3.2 at most.
MOST_SIGMAS = 10.0


def fit_centroids(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    start: RigidTransform,
    max_slant_deg: float = 72.0,
    steps: int = 3,
) -> Fit | None:
    """The pose with the least reprojection error of the predicted centroids, over all views at
    once.

    Parameters and result as for `pixels.fit_patches`; `steps` is the least number of times that the
    centroids are measured, each time from the prediction of the previous pose. They are measured
    again as long as they move, because the fit begins far from the blur of a sharp image.
    """
    windows = patches(images, rig, handle, start, max_slant_deg)
    if len(np.unique(windows.views.marker)) < 3:
        return None
    state = first_state(start, rig)
    least = steps
    for k in range(MOST_STEPS):
        without_gloss = not has_gloss(state)
        state, registered = register(state, windows, rig, handle)
        if without_gloss and has_gloss(state):
            least = k + 3  # it moves the centroids
        spread_px = registered.covariance * np.maximum(misfit(registered.at), 1.0)[
            :, None, None
        ] + FLOOR_PX**2 * np.eye(2)
        shading = marker_shading(registered.at.greys)
        T, covariance = fit_pixels(
            registered.uv, spread_px, rig, handle, windows.views, state.T_world_handle, shading
        )
        if not np.isfinite(covariance).all():
            return None
        before = state.T_world_handle
        state = state._replace(T_world_handle=T)
        if k + 1 >= least and registered.usual_shift_px < CONVERGED_PX:
            break
    step = motion_between(T, before)
    if step @ np.linalg.solve(covariance, step) > 6 * MOST_SIGMAS**2:
        return None
    pose_response = response_of_pixels(
        registered.uv, spread_px, rig, handle, windows.views, T, shading
    )
    pulls = pulled_alike(*windows.views, registered.more_px2, T, rig, handle)
    predicted, by_motion = predict_centroids(rig, handle, T, windows.views, shading)
    residual = registered.uv - predicted
    visible = marker_is_shown(registered.at, handle)
    used = np.asarray(visible & np.isfinite(residual).all(axis=1))
    if not used.any():
        return None
    rows = used.repeat(2)
    linear = LinearFit(
        T,
        covariance + pose_response.covariance_by(pulls),
        pose_response.part(used),
        residual[used],
        block_diag(*spread_px[used]) + pulls[np.ix_(rows, rows)],
        by_motion[used].reshape(-1, 6),
    )
    residuals_px = np.linalg.norm(residual, axis=1)
    return fit_from(linear, windows.views, registered.at, visible, residuals_px)


def fit_pixels(
    uv: Array,
    covariance: Array,
    rig: Rig,
    handle: Handle,
    views: Views,
    start: RigidTransform,
    shading: Array | None = None,
    steps: int = 4,
    huber: float = 3.0,
) -> tuple[RigidTransform, Array]:
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
    shading : ndarray, shape (k, 3), optional
        As in `predict_centroids`.
    steps : int
        Gauss-Newton steps.
    huber : float
        Standard deviations beyond which a centroid counts for less (Huber 1964, DOI
        10.1214/aoms/1177703732).

    Returns
    -------
    T_world_handle : RigidTransform
    covariance : ndarray, shape (6, 6)
        Of position (mm) and rotation vector (rad), world frame; NaN where the centroids do not fix
        the pose.
    """
    T = start
    W = inverse(covariance)
    for _ in range(steps):
        predicted, J = predict_centroids(rig, handle, T, views, shading)
        residual, gain, spread = _normal(uv, W, predicted, J, huber)
        T = moved(T, np.nan_to_num(np.einsum("akd,kd->a", gain, residual)))
    return T, in_world(spread, T)


def _normal(
    uv: Array, W: Array, predicted: Array, J: Array, huber: float
) -> tuple[Array, Array, Array]:
    """Residuals (k, 2), the pose's derivatives by them (6, k, 2), and its covariance (6, 6), handle
    frame.
    """
    J = np.nan_to_num(J)
    residual = np.nan_to_num(uv - predicted)
    distance = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", residual, W, residual), 1e-12))
    counts = np.asarray(np.isfinite(predicted).all(axis=1)) * np.minimum(huber / distance, 1.0)
    weighted = W * counts[:, None, None]
    spread = inverse(np.einsum("kia,kij,kjb->ab", J, weighted, J))
    return residual, np.einsum("ab,kib,kij->akj", spread, J, weighted), spread


def response_of_pixels(
    uv: Array,
    covariance: Array,
    rig: Rig,
    handle: Handle,
    views: Views,
    T: RigidTransform,
    shading: Array | None = None,
    huber: float = 3.0,
) -> Response:
    """The derivative of the pose of `fit_pixels` by the centroids; parameters as there."""
    predicted, J = predict_centroids(rig, handle, T, views, shading)
    _, gain, _ = _normal(uv, inverse(covariance), predicted, J, huber)
    gain = np.einsum("ab,bkd->akd", both_in_world(T), gain)
    return response(gain, views.camera, views.marker, handle, T)
