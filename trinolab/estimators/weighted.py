"""The paper's pairs and fit from better centroids, each weighted by its covariance: what Eq. 20-24
can give.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..parameters import Parameters
from ..pose import LOST, Pose, measured_pose, weighted_fit
from ..rigid import motion_between, shifted
from ..triangulation import triangulate, triangulate_weighted
from .appearance import Views
from .centroids import CentrePixels, centre_pixels, predict_centroids
from .identified import Identified
from .pixels import FLOOR_PX

STEPS = np.repeat([0.1, 0.003], 3)  # mm, rad; a tenth of a pixel or two


def fit_weighted(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    start: RigidTransform,
    max_slant_deg: float = 72.0,
    rounds: int = 4,
) -> tuple[RigidTransform, Array, Array] | None:
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
    covariance : ndarray, shape (6, 6)
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
        (T, covariance) = fit
    settled = _settled(T, covariance, before, measured, rig, handle)
    return None if settled is None else (*settled, measured.uv)


def _settled(
    T: RigidTransform,
    covariance: Array,
    before: RigidTransform,
    centres: CentrePixels,
    rig: Rig,
    handle: Handle,
) -> tuple[RigidTransform, Array] | None:
    """The pose that finds itself, were the centres measured with it instead of the pose before, and
    its covariance.

    From centroid to centre it is as far as a pose says. If the pose found changes by M dT with the
    pose that said so, the one that finds itself lies (1 - M)^-1 times as far away, and all errors
    grow as much.
    """
    views = Views(*np.nonzero(np.isfinite(centres.uv[..., 0])))
    here = _to_centre(rig, handle, before, views)
    columns = []
    for k in range(6):
        uv = centres.uv.copy()
        uv[views] += (
            _to_centre(rig, handle, shifted(before, STEPS * (np.arange(6) == k)), views) - here
        )
        other = _fit(centres._replace(uv=uv), rig, handle)
        if other is None:
            return None
        columns.append(motion_between(other[0], T) / STEPS[k])
    grown = np.linalg.inv(np.eye(6) - np.column_stack(columns))
    return shifted(before, grown @ motion_between(T, before)), grown @ covariance @ grown.T


def _fit(centres: CentrePixels, rig: Rig, handle: Handle) -> tuple[RigidTransform, Array] | None:
    sigma_px = np.hypot(centres.sigma_px, FLOOR_PX)
    return weighted_fit(handle.marker_centres, *triangulate_weighted(rig, centres.uv, sigma_px))


def _to_centre(rig: Rig, handle: Handle, T: RigidTransform, views: Views) -> Array:
    """From predicted centroids to the images of the centres, (k, 2), px."""
    centres = np.stack([camera.project(T.apply(handle.marker_centres)) for camera in rig.cameras])
    return centres[views] - predict_centroids(rig, handle, T, views)[0]


def weighted_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    """The estimator ``weighted``: see `fit_weighted`."""
    fit = fit_weighted(instant.images, rig, handle, instant.T_world_handle, p.max_slant_deg)
    if fit is None:
        return LOST
    T, covariance, uv = fit
    return measured_pose(
        T, covariance, uv, np.asarray(np.isfinite(triangulate(rig, uv)).all(axis=1)), rig, handle
    )
