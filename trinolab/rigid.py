"""Rigid motions: put together and taken apart, how far two are apart, and the rotation nearest to a
matrix.

SciPy checks and mends every matrix that it is given, which takes ten times as long as what is
computed with it. Loops of many ticks a second use these functions instead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from .checks import Array, as_array


def placed(position: Array, rotation: Rotation) -> RigidTransform:
    """The motion with a position (3,) and a rotation; nothing is checked."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.as_matrix()
    matrix[:3, 3] = position
    return RigidTransform(matrix, normalize=False, copy=False)


def rotation_of(motion: RigidTransform) -> Rotation:
    """The rotation of one motion."""
    return Rotation.from_matrix(motion.as_matrix()[:3, :3], assume_valid=True)


def motion_between(a: RigidTransform, b: RigidTransform) -> Array:
    """From pose b to pose a, shape (6,): position (mm) and rotation vector (rad), as in a pose's
    covariance.
    """
    turn = (rotation_of(a) * rotation_of(b).inv()).as_rotvec()
    return np.concatenate([a.translation - b.translation, turn])


def apart(a: RigidTransform, b: RigidTransform, most_mm: float, most_rad: float) -> bool:
    """Whether two poses differ by more than a distance or an angle."""
    away = motion_between(a, b)
    return bool(np.linalg.norm(away[:3]) > most_mm or np.linalg.norm(away[3:]) > most_rad)


def shifted(T: RigidTransform, motion: Array) -> RigidTransform:
    """A pose after a motion (6,), see `motion_between`, which it undoes."""
    turn = Rotation.from_rotvec(np.array(motion[3:]))  # SciPy wants a writable array
    return placed(T.translation + motion[:3], turn * rotation_of(T))


def cross_matrices(vectors: Array) -> Array:
    """Matrices [v]x with [v]x w = v x w, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vectors.shape, 3)


def nearest_rotation(matrix: ArrayLike) -> Rotation:
    """Return the rotation that is nearest to a 3 x 3 matrix in the Frobenius norm (by SVD).

    Raises
    ------
    ValueError
        For a matrix whose determinant is not positive: a reflection or a singular matrix has no
        rotation that could be meant.
    """
    array = as_array(matrix, "matrix", (3, 3))
    if np.linalg.det(array) <= 1e-12:
        raise ValueError(f"matrix: expected a positive determinant, got {np.linalg.det(array):.3g}")
    U, _, Vt = np.linalg.svd(array)
    return Rotation.from_matrix(U @ Vt)
