"""Rigid motions put together and taken apart in a few microseconds, for loops of many ticks a second.

SciPy checks and mends every matrix that it is given, which takes ten times as long as what is computed with it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from .checks import Array


def placed(position: Array, rotation: Rotation) -> RigidTransform:
    """The motion with a position (3,) and a rotation; nothing is checked."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.as_matrix()
    matrix[:3, 3] = position
    return RigidTransform(matrix, normalize=False, copy=False)


def rotation_of(motion: RigidTransform) -> Rotation:
    """The rotation of one motion."""
    return Rotation.from_matrix(motion.as_matrix()[:3, :3], assume_valid=True)
