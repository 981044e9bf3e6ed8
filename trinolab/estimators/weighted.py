"""The paper's pairs and fit from better centroids, each weighted by its covariance: what Eq. 20-24
can give.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..parameters import Parameters
from ..pose import (
    LOST,
    Pose,
    measured_pose,
    response_of_points,
    weighted_fit,
    weighted_fit_gain,
)
from ..rigid import motion_between, shifted
from ..triangulation import triangulate, triangulate_weighted, weighted_slopes
from ..uncertainty.centroids import pulled_alike
from ..uncertainty.contradiction import Honest, honest
from ..uncertainty.size import Residuals
from ..uncertainty.systematic import NOTHING, contradict, is_uncertain
from .appearance import Views
from .centroids import CentrePixels, centre_pixels, predict_centroids
from .identified import Identified
from .pixels import FLOOR_PX

__all__ = ["fit_weighted", "honest_fit", "weighted_pose"]

STEPS = np.repeat([0.1, 0.003], 3)  # mm, rad; a tenth of a pixel or two


def fit_weighted(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    start: RigidTransform,
    max_slant_deg: float = 72.0,
    rounds: int = 4,
) -> tuple[RigidTransform, Honest, Array] | None:
    """The weighted fit to weighted points, from registered centroids that their model moves to the
    markers' centres.

    On plain centroids the weights do harm: they trust the pixels across the line of sight, and so
    the bias there.

    Parameters
    ----------
    images, rig, handle, start, max_slant_deg
        As for `pixels.fit_patches`.
    rounds : int
        Times that the centres are measured, each by what the pose found before predicts.

    Returns
    -------
    T_world_handle : RigidTransform
    covariances : Honest
        Of position (mm) and rotation vector (rad), world frame.
    uv : ndarray, shape (cameras, markers, 2)
        The centres' pixels. None instead of all three where too little is in view.
    """
    T = start
    for _ in range(rounds):
        centres = centre_pixels(images, rig, handle, T, max_slant_deg)
        fit = None if centres is None else _fit(centres, rig, handle)
        if centres is None or fit is None:
            return None
        before = T
        measured = centres
        T = fit
    grown = _grown(T, before, measured, rig, handle)
    if grown is None:
        return None
    T = shifted(before, grown @ motion_between(T, before))
    found = honest_fit(T, grown, measured, rig, handle)
    return found.T_world_handle, found, measured.uv


def honest_fit(
    T: RigidTransform, grown: Array, centres: CentrePixels, rig: Rig, handle: Handle
) -> Honest:
    """The fit to centres with its covariances, all of whose errors are `grown` (6, 6)."""
    sigma_px = _sigma_px(centres)
    _, covariances = triangulate_weighted(rig, centres.uv, sigma_px)
    by_point = grown @ weighted_fit_gain(handle.marker_centres, T, covariances)
    by_pixel = weighted_slopes(rig, centres.uv, sigma_px)
    response = response_of_points(T, by_point, by_pixel, handle)
    at = response.camera, response.marker
    expected = T.apply(handle.marker_centres)
    projected = np.stack([camera.project(expected) for camera in rig.cameras])
    residuals = (centres.uv - projected)[at]
    noise = centres.covariance[at] + FLOOR_PX**2 * np.eye(2)
    pulls = pulled_alike(*at, centres.more_px2[at], T, rig, handle)
    # the fit weighs by one sigma a centre, which is less sure around the axis than along it
    covariance = response.covariance_by(block_diag(*noise) + pulls)
    information = np.linalg.inv(noise)
    chi_square = float(np.einsum("ki,kij,kj->", residuals, information, residuals))
    if not (is_uncertain(rig, handle) or contradict(chi_square, residuals.size - 6)):
        return Honest(covariance, NOTHING, False, rig, T, None)
    left = Residuals(residuals, information, pulls)
    return honest(covariance, response, left, T, rig, handle)


def _grown(
    T: RigidTransform, before: RigidTransform, centres: CentrePixels, rig: Rig, handle: Handle
) -> Array | None:
    """By what matrix (6, 6) the pose that finds itself, were the centres measured with it instead
    of the pose before, lies further away than the one that was found.

    From centroid to centre it is as far as a pose says. If the pose found changes by M dT with the
    pose that said so, the one that finds itself lies (1 - M)^-1 times as far away, and all errors
    grow as much.
    """
    views = Views(*np.nonzero(np.isfinite(centres.uv[..., 0])))
    moved_centres = _to_centre(rig, handle, before, views)
    columns = []
    for k in range(6):
        uv = centres.uv.copy()
        uv[views] += (
            _to_centre(rig, handle, shifted(before, STEPS * (np.arange(6) == k)), views)
            - moved_centres
        )
        refit = _fit(centres._replace(uv=uv), rig, handle)
        if refit is None:
            return None
        columns.append(motion_between(refit, T) / STEPS[k])
    return np.linalg.inv(np.eye(6) - np.column_stack(columns))


def _fit(centres: CentrePixels, rig: Rig, handle: Handle) -> RigidTransform | None:
    points = triangulate_weighted(rig, centres.uv, _sigma_px(centres))
    fit = weighted_fit(handle.marker_centres, *points)
    return None if fit is None else fit[0]


def _sigma_px(centres: CentrePixels) -> Array:
    """By which each centre is weighed, in all directions alike."""
    return np.hypot(centres.sigma_px, FLOOR_PX)


def _to_centre(rig: Rig, handle: Handle, T: RigidTransform, views: Views) -> Array:
    """From predicted centroids to the images of the centres, (k, 2), px."""
    centres = np.stack([camera.project(T.apply(handle.marker_centres)) for camera in rig.cameras])
    return centres[views] - predict_centroids(rig, handle, T, views)[0]


def weighted_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    """The estimator ``weighted``: see `fit_weighted`."""
    fit = fit_weighted(instant.images, rig, handle, instant.T_world_handle, p.max_slant_deg)
    if fit is None:
        return LOST
    T, centres, uv = fit
    if centres.refused:
        return LOST
    used = np.asarray(np.isfinite(triangulate(rig, uv)).all(axis=1))
    return measured_pose(T, centres.covariance, uv, used, rig, handle, centres.systematic)
