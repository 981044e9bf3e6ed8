"""The paper's estimate checked against the pixels: hidden markers are left out, and the covariance
knows of the bias.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import Rig, displaced
from ..handle import Handle
from ..parameters import Parameters
from ..pose import LOST, Pose, fit_pose
from ..rigid import apart, motion_between
from .fitted import fitted, measured_pose
from .identified import Identified
from .paper import pose_of_centroids

APART_MM = 1.5  # a little less than what a measured pose may be off
APART_RAD = np.deg2rad(4.0)  # likewise


def checked_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    """The paper's estimate, without markers that something hides in part: where the image model
    shows that, see `Fit`.

    The paper has no test of a pose. Here it is lost if the image model, where it applies, leads far
    away from it with the same rig. Where the image model applies, the pose is known better: the mean
    square of the error is that of the better pose, and the square of the way from there.
    """
    assessed = fitted(instant, rig, handle, p)
    if assessed is None:
        return pose_of_centroids(instant.uv, rig, handle, p.max_slant_deg, instant.near)
    fit, assessment = assessed
    better = measured_pose(fit, assessment)
    uv = instant.uv.copy()
    hidden = ~fit.shown
    uv[fit.views.camera[hidden], fit.views.marker[hidden]] = np.nan
    pose = pose_of_centroids(uv, rig, handle, p.max_slant_deg, instant.near)
    if pose.T_world_handle is None or better.T_world_handle is None:
        return pose
    there = fit_pose(uv, displaced(rig, assessment.displacement), handle, p.max_slant_deg)
    T_there = there.T_world_handle
    if T_there is None or apart(T_there, fit.T_world_handle, APART_MM, APART_RAD):
        return LOST
    away = motion_between(pose.T_world_handle, better.T_world_handle)
    return replace(
        pose,
        covariance_random=better.covariance_random + np.outer(away, away),
        systematic=better.systematic,
    )
