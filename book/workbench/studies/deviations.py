"""Deviations of measured poses from true ones, to first order: what causes them, how they add up,
what they average to.

A deviation is a position error (mm) and a rotation vector (deg) from the true pose to the measured
one, world frame. A table holds one for each of n poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.checks import Array, as_rng, as_whole
from trinolab.metrics import angle_differences_deg
from trinolab.rigid import cross_matrices

MEANS = ("E_t_mm", "E_alpha_deg", "E_beta_deg", "E_gamma_deg", "geodesic_deg")


class Source(NamedTuple):
    """One source of error: ``deviation = fixed + roots @ z`` with independent standard normal
    numbers z.

    Attributes
    ----------
    name : str
    size : float
        How large it is taken, in `unit`.
    unit : str
    fixed : ndarray, shape (n, 6)
        The same in every table.
    roots : ndarray, shape (n, 6, q)
        What differs from table to table; a number that moves several poses is one that they share.
    """

    name: str
    size: float
    unit: str
    fixed: Array
    roots: Array


class Errors(NamedTuple):
    """Errors of tables of n poses, each of shape (..., n, 3), measured minus true.

    Attributes
    ----------
    position_mm : ndarray
    angles_deg : ndarray
        Of alpha, beta, gamma, wrapped.
    turns_deg : ndarray
        Rotation vectors, world frame.
    """

    position_mm: Array
    angles_deg: Array
    turns_deg: Array


def deviations(estimates: RigidTransform, truths: RigidTransform) -> Array:
    """Position errors, mm, and rotation vectors, deg, from truths to estimates, shape (n, 6), world
    frame.
    """
    turns = (estimates.rotation * truths.rotation.inv()).as_rotvec(degrees=True)
    return np.column_stack([estimates.translation - truths.translation, turns])


def euler_jacobian(poses: RigidTransform) -> Array:
    """Derivative of (alpha, beta, gamma) by a small rotation vector in the world frame, shape (n,
    3, 3).

    Turned back by alpha, a rotation vector is (d gamma cos beta, d beta, d alpha - d gamma sin
    beta).
    """
    alpha, beta, _ = poses.rotation.as_euler("ZYX").T
    zero = np.zeros_like(beta)
    ones = np.ones_like(beta)
    rates = np.stack(
        [[np.tan(beta), zero, ones], [zero, ones, zero], [1 / np.cos(beta), zero, zero]]
    )
    back = Rotation.from_euler("Z", -alpha[:, None]).as_matrix()
    return np.einsum("ijn,njk->nik", rates, back)


def together(sources: Sequence[Source], name: str) -> Source:
    """All sources at once, as one."""
    return Source(
        name,
        float(len(sources)),
        "sources",
        np.sum([s.fixed for s in sources], axis=0),
        np.concatenate([s.roots for s in sources], axis=2),
    )


def drawn(source: Source, count: int, rng: np.random.Generator) -> Array:
    """`count` tables of deviations, shape (count, n, 6)."""
    z = as_rng(rng).standard_normal((as_whole(count, "count", low=1), source.roots.shape[2]))
    return source.fixed + np.einsum("niq,dq->dni", source.roots, z)


def registered(tables: Array, truths: RigidTransform, rows: Sequence[int]) -> Array:
    """What is left of deviations (..., n, 6) once the positions at `rows` have been laid onto the
    true ones.

    That is a rigid fit, to first order; it takes away what all poses share, and adds what it makes
    of the errors at `rows`. Without rows nothing happens.

    Raises
    ------
    ValueError
        If the positions at `rows` do not determine a motion.
    """
    if len(rows) == 0:
        return tables
    arms = truths.translation - truths.translation.mean(axis=0)
    # (n, 3, 6)
    A = np.concatenate(
        [np.broadcast_to(np.eye(3), (len(arms), 3, 3)), -cross_matrices(arms)], axis=2
    )
    used = A[list(rows)].reshape(-1, 6)
    if np.linalg.matrix_rank(used) < 6:
        raise ValueError("rows: expected three or more positions that are not on a line")
    # (..., 6) mm, rad
    motion = tables[..., list(rows), :3].reshape(*tables.shape[:-2], -1) @ np.linalg.pinv(used).T
    turn = np.broadcast_to(np.rad2deg(motion[..., None, 3:]), (*tables.shape[:-1], 3))
    return tables - np.concatenate([np.einsum("nij,...j->...ni", A, motion), turn], axis=-1)


def first_order(tables: Array, truths: RigidTransform) -> Errors:
    """The errors that deviations (..., n, 6) mean, to first order."""
    return Errors(
        tables[..., :3],
        np.einsum("nij,...nj->...ni", euler_jacobian(truths), tables[..., 3:]),
        tables[..., 3:],
    )


def exact(estimates: Sequence[RigidTransform], truths: RigidTransform) -> Errors:
    """The errors of one or more tables of measured poses."""
    tables = np.array([deviations(poses, truths) for poses in estimates])
    angles = np.array([angle_differences_deg(poses, truths) for poses in estimates])
    return Errors(tables[..., :3], angles, tables[..., 3:])


def means(errors: Errors) -> Array:
    """E_t, E_alpha, E_beta, E_gamma and the mean geodesic angle, over all poses and tables, shape
    (5,) (Eq. 26-27).
    """
    return np.array(
        [
            np.linalg.norm(errors.position_mm, axis=-1).mean(),
            *np.abs(errors.angles_deg).reshape(-1, 3).mean(axis=0),
            np.linalg.norm(errors.turns_deg, axis=-1).mean(),
        ]
    )


def rms(errors: Errors) -> Array:
    """Roots of the mean squares of the same five, shape (5,)."""
    return np.sqrt(
        [
            (errors.position_mm**2).sum(axis=-1).mean(),
            *(errors.angles_deg**2).reshape(-1, 3).mean(axis=0),
            (errors.turns_deg**2).sum(axis=-1).mean(),
        ]
    )
