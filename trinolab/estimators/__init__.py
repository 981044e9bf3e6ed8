"""Better poses from the same images (beyond the paper): the estimators by name.

``paper`` is the paper's own (Eq. 20-24, `estimators.paper`). Its check and the other estimators are
modules of this folder that are loaded at first use.
"""

from __future__ import annotations

from ..camera import Rig
from ..handle import Handle
from ..methods import PAPER
from ..parameters import Parameters
from ..pose import Pose
from .identified import Identified
from .paper import pose_of_centroids

__all__ = ["Identified", "estimate"]


def estimate(instant: Identified, rig: Rig, handle: Handle, parameters: Parameters) -> Pose:
    """The pose by the estimator that the parameters name, or else by the paper's.

    ``paper``: pairs, mean, rigid fit (Eq. 20-24), with `Parameters.check` checked against the pixels.
    ``reprojection``: all views at once, by predicted centroids. ``patches``: all views at once, by
    the pixels.

    Returns
    -------
    Pose
        With status ``measured``; `pose.LOST` if too little is visible, or the images contradict the
        pose.
    """
    p = parameters
    name = p.estimator or PAPER
    if name != PAPER:
        # loaded now, so that the paper's chain runs without it
        from .fitted import fitted_pose

        return fitted_pose(instant, rig, handle, p)
    if p.check:
        from .checked import checked_pose

        return checked_pose(instant, rig, handle, p)
    return pose_of_centroids(instant.uv, rig, handle, p.max_slant_deg, instant.near)
