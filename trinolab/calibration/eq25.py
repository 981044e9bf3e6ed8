"""The relative pose of two cameras from the poses of one target in both (Sect. 6.2).

Eq. 25 means X_l = R_rl X_r + T_rl, right to left. In our names T_rl and R_rl are the motion
``T_left_right``, and the target's frame is what the equation calls the world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..checks import Array, frozen


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The relative pose of two cameras, averaged over the positions of a target.

    Attributes
    ----------
    T_left_right : RigidTransform
    covariance : ndarray, shape (6, 6)
        Of the mean: translation (mm) and rotation vector (rad), left camera's frame.
    positions : int
    """

    T_left_right: RigidTransform
    covariance: Array
    positions: int


def relative_pose(T_left_target: RigidTransform, T_right_target: RigidTransform) -> RigidTransform:
    """The relative pose of two cameras that see one target: R_rl = R_l R_r^-1, T_rl = T_l - R_rl
    T_r (Eq. 25).

    Parameters
    ----------
    T_left_target, T_right_target : RigidTransform, single or of one length
        R_l, T_l and R_r, T_r of the paper: the target's frame is its world.

    Returns
    -------
    RigidTransform
        T_left_right: X_l = R_rl X_r + T_rl; as many as were given.
    """
    for name, value in (("T_left_target", T_left_target), ("T_right_target", T_right_target)):
        if not isinstance(value, RigidTransform):
            raise ValueError(f"{name}: expected a RigidTransform, got {type(value).__name__}")
    if T_left_target.shape != T_right_target.shape:
        raise ValueError(
            f"T_right_target: expected shape {T_left_target.shape}, got {T_right_target.shape}"
        )
    R_rl = T_left_target.rotation * T_right_target.rotation.inv()
    T_rl = T_left_target.translation - R_rl.apply(T_right_target.translation)
    return RigidTransform.from_components(T_rl, R_rl)


def mean_relative_pose(
    T_left_target: RigidTransform, T_right_target: RigidTransform
) -> RelativePose:
    """Eq. 25 for each position of the target, and the mean, with the uncertainty that their scatter
    shows (Eq. 25).

    Parameters
    ----------
    T_left_target, T_right_target : RigidTransform of length n, at least 2

    Raises
    ------
    ValueError
        For fewer than two positions.
    """
    each = relative_pose(T_left_target, T_right_target)
    if each.single or len(each) < 2:
        raise ValueError(
            f"T_left_target: expected two or more positions, got {1 if each.single else len(each)}"
        )
    rotation = each.rotation.mean()
    mean = RigidTransform.from_components(each.translation.mean(axis=0), rotation)
    turns = (each.rotation * rotation.inv()).as_rotvec()
    scatter = np.cov(np.hstack([each.translation, turns]), rowvar=False)
    return RelativePose(mean, frozen(scatter / len(each)), len(each))
