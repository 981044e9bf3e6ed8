"""The paper's estimate checked against the pixels: hidden markers are left out, the covariance
knows of the bias.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..parameters import Parameters
from ..pose import LOST, Pose, fit_response, pose_of_centroids
from ..rigid import apart, motion_between
from ..uncertainty.systematic import Response, is_uncertain, known_errors
from .identified import Identified
from .pixels import fit_patches, judged

APART_MM = 1.5  # a little less than what a measured pose may be off
APART_RAD = np.deg2rad(4.0)  # likewise


def checked_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    """The paper's estimate, without markers that something hides in part: where the image model
    shows that, see `Fit`.

    The paper has no test of a pose. Here it is lost if the image model, where it applies, leads far
    away from it. How large its centroids' bias may be is in its covariance; where the image model
    applies, the bias itself is known: the mean square of the error is that of the better pose, and the
    square of the way from there.
    """
    check = fit_patches(instant.images, rig, handle, instant.T_world_handle, p.max_slant_deg)
    if check is not None and check.refused:
        return LOST
    if check is None or not check.shown.any():
        return pose_of_centroids(instant.uv, rig, handle, p.max_slant_deg)
    uv = instant.uv.copy()
    uv[check.views.camera[~check.shown], check.views.marker[~check.shown]] = np.nan
    pose = pose_of_centroids(uv, rig, handle, p.max_slant_deg)
    better = judged(check)
    if pose.T_world_handle is None or better.T_world_handle is None:
        return pose
    # the rig's errors move both alike, until one of them is corrected by what its residuals say
    T_alike = better.T_world_handle if check.T_by_noise is None else check.T_by_noise
    if apart(pose.T_world_handle, T_alike, APART_MM, APART_RAD):
        return LOST
    away = motion_between(pose.T_world_handle, better.T_world_handle)
    systematic = better.systematic
    if check.answers is not None and check.rig is not None and is_uncertain(rig, handle):
        response = fit_response(uv, rig, handle, p.max_slant_deg)
        away, learnt = _told(away, response, check.answers, pose, better, check.rig, handle)
        systematic = systematic - learnt
    return replace(
        pose,
        covariance_random=better.covariance_random + np.outer(away, away),
        systematic=systematic,
    )


def _told(
    away: Array,
    found: Response,
    answers: Response,
    pose: Pose,
    better: Pose,
    rig: Rig,
    handle: Handle,
) -> tuple[Array, Array]:
    """What the way from the better pose to the paper's says of the errors of rig and layout, which
    move both: the way from where the truth is to be expected then, and by how much less the better
    pose owes to them (the mean and the covariance of a normal distribution, given another's value).
    """
    both = Response(
        np.concatenate([found.gain, answers.gain], axis=1),
        *(np.concatenate(parts) for parts in zip(found[1:], answers[1:], strict=True)),
    )
    V = known_errors(both, rig, handle)
    ours = answers.gain.reshape(6, -1)
    of_better = np.hstack([np.zeros((6, len(V) - ours.shape[1])), ours])
    of_way = np.hstack([found.gain.reshape(6, -1), -ours])
    common = of_better @ V @ of_way.T
    total = pose.covariance_random + better.covariance_random + of_way @ V @ of_way.T
    gain = np.linalg.solve(total, common.T).T
    return away + gain @ away, gain @ common.T
