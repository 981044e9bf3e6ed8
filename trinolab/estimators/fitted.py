"""The estimators that fit pixels or centroids in all views at once, and the assessment of their fits."""

from __future__ import annotations

from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..handle import Handle
from ..parameters import Parameters
from ..pose import LOST, Pose
from ..uncertainty.assessment import Assessment, refitted
from .identified import Identified
from .pixels import Fit, fit_patches, judged
from .reprojection import fit_centroids


def fitted_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    """The pose by the estimator ``patches`` (see `pixels.fit_patches`) or ``reprojection`` (see
    `reprojection.fit_centroids`).
    """
    found = fitted(instant, rig, handle, p)
    return LOST if found is None else judged(*found)


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
