"""The paper's estimate (Eq. 20-24) and its covariance.

The paper's chain ends with the pose. The covariance is computed at the first access. It contains
the noise of the centroids, their bias, which the paper's method does not remove, and all that
`uncertainty` assesses.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig, image_of
from ..checks import Array
from ..handle import Handle
from ..pose import Pose, fit_pose, fit_response
from ..sensitivity import motion_slopes

if TYPE_CHECKING:
    from ..uncertainty.assessment import LinearFit


def pose_of_centroids(
    uv: Array, rig: Rig, handle: Handle, max_slant_deg: float = 70.0, near: Rig | None = None
) -> Pose:
    """The paper's estimate with the covariance that centroids of wrapped markers give it.

    Parameters
    ----------
    uv, rig, handle, max_slant_deg
        As for `pose.fit_pose`.
    near : Rig, optional
        The rig that the pose is measured with, see `Identified`; by default the given one.

    Returns
    -------
    Pose
        That of `pose.fit_pose`. Its covariances are computed at the first access.
    """
    near = near or rig
    pose = fit_pose(uv, near, handle, max_slant_deg)
    T_world_handle = pose.T_world_handle
    if T_world_handle is None:
        return pose

    @cache
    def covariances() -> tuple[Array, Array]:
        # loaded now, so that the paper's chain runs without it
        from ..uncertainty.assessment import assess

        fit = linear_fit(uv, near, handle, T_world_handle, max_slant_deg)
        assessment = assess(fit, rig, handle, near)
        # the pose is not corrected
        kept = np.outer(assessment.correction, assessment.correction)
        return assessment.covariance_random, assessment.systematic + kept

    return replace(
        pose, covariance_random=lambda: covariances()[0], systematic=lambda: covariances()[1]
    )


def linear_fit(
    uv: Array, rig: Rig, handle: Handle, T_world_handle: RigidTransform, max_slant_deg: float
) -> LinearFit:
    """The paper's estimate to first order; parameters as for `pose_of_centroids`."""
    from ..uncertainty.assessment import LinearFit
    from ..uncertainty.centroids import NOISE_PX, by_light, by_slant
    from ..uncertainty.components import LIGHT

    T = T_world_handle
    sensitivity = fit_response(uv, rig, handle, max_slant_deg)
    k = len(sensitivity.points)
    predicted = np.empty((k, 2))
    for c, camera in enumerate(rig.cameras):
        mine = sensitivity.camera == c
        predicted[mine] = image_of(camera, sensitivity.points[mine])
    slant = by_slant(sensitivity, T, rig, handle)
    noise = NOISE_PX**2 * np.eye(2 * k) + np.outer(slant, slant)
    explained = motion_slopes(rig, sensitivity.camera, sensitivity.points, T.translation)
    return LinearFit(
        T,
        sensitivity.covariance_by(noise),
        sensitivity,
        uv[sensitivity.camera, sensitivity.marker] - predicted,
        noise,
        explained.reshape(2 * k, 6),
        (by_light(sensitivity, T, rig, handle), LIGHT),
        is_efficient=False,
    )
