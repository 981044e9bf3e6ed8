"""Better poses from the same images (beyond the paper): the estimators by name.

``paper`` is the paper's own (Eq. 20-24, `pose.pose_of_centroids`); its check and each other one stand in a
module of this folder, which is loaded when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable

from ..camera import Rig
from ..handle import Handle
from ..methods import BEST, PAPER
from ..parameters import Parameters
from ..pose import Pose, pose_of_centroids
from .identified import Identified

__all__ = ["Identified", "estimate"]


def estimate(instant: Identified, rig: Rig, handle: Handle, parameters: Parameters) -> Pose:
    """The pose by the estimator that the parameters name, or else by the paper's.

    ``paper``: pairs, mean, rigid fit (Eq. 20-24), with `Parameters.check` checked against the pixels.
    ``reprojection``: all views at once, by predicted centroids. ``patches``: all views at once, by
    the pixels.

    Returns
    -------
    Pose
        With status ``measured``; `pose.LOST` if too little is seen, or what is seen is not what the
        pose predicts.
    """
    p = parameters
    name = p.estimator or PAPER
    if name == PAPER and not p.check:
        return pose_of_centroids(instant.uv, rig, handle, p.max_slant_deg)
    return _better(name)(instant, rig, handle, p)


def _better(name: str) -> Callable[[Identified, Rig, Handle, Parameters], Pose]:
    """The function of an estimator that reads pixels; its module is loaded now, so that the paper's
    chain runs without it.
    """
    if name == BEST:
        from .pixels import patches_pose as estimator
    elif name == PAPER:
        from .checked import checked_pose as estimator
    else:
        from .reprojection import reprojection_pose as estimator
    return estimator
