"""Rigid motions: put together and taken apart, how far two are apart, and the rotation nearest to a
matrix.

SciPy checks and orthonormalises every matrix, which takes ten times as long as the computation
itself. Loops with many ticks per second use these functions instead.
"""

from __future__ import annotations

from math import atan2, copysign, hypot, sin

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from .checks import Array, as_array


def placed(position: Array, rotation: Array) -> RigidTransform:
    """The motion with a position (3,) and a rotation matrix (3, 3).

    The matrix is orthonormalised to second order, so that rounding does not add up over many ticks.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = 1.5 * rotation - 0.5 * rotation @ rotation.T @ rotation
    matrix[:3, 3] = position
    return RigidTransform(matrix, normalize=False, copy=False)


def rotation_of(motion: RigidTransform) -> Array:
    """The rotation matrix (3, 3) of one motion."""
    return np.asarray(motion.as_matrix()[:3, :3])


def quaternion(rotation: Array) -> tuple[float, float, float, float]:
    """The unit quaternion (w, x, y, z) of a rotation matrix, w >= 0.

    Its largest component is computed first, so that nothing cancels (Shepperd 1978,
    doi:10.2514/3.55767b).
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    trace = xx + yy + zz
    largest = max(trace, xx, yy, zz)
    if largest == trace:
        q = 1 + trace, zy - yz, xz - zx, yx - xy
    elif largest == xx:
        q = zy - yz, 1 + 2 * xx - trace, xy + yx, xz + zx
    elif largest == yy:
        q = xz - zx, xy + yx, 1 + 2 * yy - trace, yz + zy
    else:
        q = yx - xy, xz + zx, yz + zy, 1 + 2 * zz - trace
    length = copysign(hypot(*q), q[0])
    return q[0] / length, q[1] / length, q[2] / length, q[3] / length


def rotation_vector(rotation: Array) -> Array:
    """The axis of a rotation matrix times its angle, shape (3,), rad; no longer than pi."""
    w, *xyz = quaternion(rotation)
    sine = hypot(*xyz)  # of half the angle
    return (2 * atan2(sine, w) / sine if sine else 2.0) * np.array(xyz)


def rotation_matrix(vector: Array) -> Array:
    """The rotation matrix of a rotation vector (3,), rad, which `rotation_vector` undoes."""
    x, y, z = (float(component) for component in vector)
    W = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # `cross_matrices` is for many
    angle = hypot(x, y, z)
    if angle == 0:
        return np.eye(3)
    # Rodrigues' formula; 1 - cos(angle) = 2 sin(angle / 2)^2, without its cancellation
    return np.eye(3) + sin(angle) / angle * W + 2 * (sin(angle / 2) / angle) ** 2 * W @ W


def motion_between(a: RigidTransform, b: RigidTransform) -> Array:
    """The motion from pose b to pose a, shape (6,): position (mm) and rotation vector (rad), as in
    a pose's covariance.
    """
    turn = rotation_vector(rotation_of(a) @ rotation_of(b).T)
    return np.concatenate([a.translation - b.translation, turn])


def apart(a: RigidTransform, b: RigidTransform, most_mm: float, most_rad: float) -> bool:
    """Whether two poses differ by more than a distance or an angle."""
    away = motion_between(a, b)
    return bool(np.linalg.norm(away[:3]) > most_mm or np.linalg.norm(away[3:]) > most_rad)


def shifted(T: RigidTransform, motion: Array) -> RigidTransform:
    """A pose after a motion (6,), see `motion_between`, which it undoes."""
    return placed(T.translation + motion[:3], rotation_matrix(motion[3:]) @ rotation_of(T))


def cross_matrices(vectors: Array) -> Array:
    """Matrices [v]x with [v]x w = v x w, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vectors.shape, 3)


def left_jacobian(rotvec: Array) -> Array:
    """J with R(w + dw) = R(J dw) R(w) to first order, shape (3, 3), of a rotation vector (3,), rad."""
    angle = np.linalg.norm(rotvec)
    W = cross_matrices(rotvec)
    if angle < 1e-4:  # two terms of the series: the next is below rounding
        return np.eye(3) + W / 2 + W @ W / 6
    return (
        np.eye(3) + W * (1 - np.cos(angle)) / angle**2 + W @ W * (angle - np.sin(angle)) / angle**3
    )


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
