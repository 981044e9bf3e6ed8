"""The estimators that fit pixels or centroids in all views at once, and the assessment of their fits."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..handle import Handle
from ..parameters import Parameters
from ..pose import LOST, Pose
from ..uncertainty.assessment import Assessment, refitted
from .identified import Identified
from .pixels import Fit, fit_patches
from .reprojection import fit_centroids

# A pose is lost if it is a false one with a larger probability, see `uncertainty.Assessment.wrong`.
MOST_WRONG = 0.25


def fitted_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    """The pose by the estimator ``patches`` (see `pixels.fit_patches`) or ``reprojection`` (see
    `reprojection.fit_centroids`).
    """
    assessed = fitted(instant, rig, handle, p)
    return LOST if assessed is None else measured_pose(*assessed)


def fitted(
    instant: Identified, rig: Rig, handle: Handle, p: Parameters
) -> tuple[Fit, Assessment] | None:
    """The fit of an instant by the estimator that the parameters name, the best one where that is
    the paper's, and its assessment; None where too little is in view.
    """
    fit = fit_centroids if p.estimator == "reprojection" else fit_patches

    def fit_at(near: Rig, start: RigidTransform) -> Fit | None:
        return fit(instant.images, near, handle, start, p.max_slant_deg)

    return refitted(fit_at, instant.T_world_handle, rig, handle, instant.near)


def measured_pose(fit: Fit, assessment: Assessment) -> Pose:
    """The pose of a fit with its assessed covariance; `pose.LOST` if too few views show a marker to
    fix it, or it is likely to be a false one.
    """
    markers = len(np.unique(fit.views.marker[fit.shown]))
    if fit.shown.sum() < 4 or markers < 3 or assessment.wrong > MOST_WRONG:
        return LOST
    return Pose(
        "measured",
        assessment.T_world_handle,
        assessment.covariance_random,
        fit.residual_px,
        markers,
        len(np.unique(fit.views.camera[fit.shown])),
        assessment.systematic,
    )
