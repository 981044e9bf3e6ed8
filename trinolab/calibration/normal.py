"""Normal equations of common unknowns and of many poses: the elimination of the poses, and damped steps
until the cost falls no more.

A Gauss-Newton step of a bundle adjustment solves

    [ A    E  ] [ dg ]   [ a ]
    [ E^T  D  ] [ dp ] = [ b ]

for the step dg of the common unknowns and dp of the poses. D consists of a block of 6 x 6 for each
pose, since an image knows one pose alone. The poses are eliminated (Schur complement): (A - E D^-1
E^T) dg = a - E D^-1 b, then dp = D^-1 (b - E^T dg). So the system's size does not grow with the number
of poses. The inverse of the Schur complement is the covariance of the common unknowns with the poses
unknown (Triggs, McLauchlan, Hartley and Fitzgibbon 2000, *Bundle adjustment*, DOI
10.1007/3-540-44480-7_21, sect. 6.1).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..checks import Array

MOST_STEPS = 300
FIRST_DAMPING, MOST_DAMPING = 1e-6, 1e6


class Normal(NamedTuple):
    """Normal equations of q common unknowns and n poses.

    Attributes
    ----------
    A : ndarray, shape (q, q)
    a : ndarray, shape (q,)
    E : ndarray, shape (n, 6, q)
        Pose by pose E^T of the module's text.
    D : ndarray, shape (n, 6, 6)
    b : ndarray, shape (n, 6)
    """

    A: Array
    a: Array
    E: Array
    D: Array
    b: Array

    def without(self, held: int) -> Normal:
        """The equations with the first `held` common unknowns fixed."""
        return self._replace(A=self.A[held:, held:], a=self.a[held:], E=self.E[:, :, held:])


class Reduced(NamedTuple):
    """Normal equations of the common unknowns alone, and the matrices that give the poses' steps.

    Attributes
    ----------
    S : ndarray, shape (q, q)
        The Schur complement.
    s : ndarray, shape (q,)
    poses_covariance : ndarray, shape (n, 6, 6)
        D^-1: the covariance of each pose if the common unknowns were known.
    E, b
        As in `Normal`.
    """

    S: Array
    s: Array
    poses_covariance: Array
    E: Array
    b: Array

    def pose_steps(self, common: Array) -> Array:
        """The steps (n, 6) of the poses that belong to a step (q,) of the common unknowns."""
        steps: Array = self.poses_covariance @ (self.b - self.E @ common)[..., None]
        return steps[..., 0]


class Descent(NamedTuple):
    """The result of damped steps: the state, its linearisation and its cost, and whether the steps
    converged.
    """

    state: Any
    linear: Any
    cost: float
    at_rest: bool


def eliminated(normal: Normal) -> Reduced:
    """The normal equations without the poses. Raises numpy.linalg.LinAlgError if a pose is free."""
    poses_covariance = np.asarray(np.linalg.inv(normal.D), dtype=float)
    gain = (poses_covariance @ normal.E).transpose(0, 2, 1)  # E D^-1
    # pose by pose, since BLAS would start its threads for one large product
    S = normal.A - (gain @ normal.E).sum(axis=0)
    s = normal.a - (gain @ normal.b[..., None]).sum(axis=0)[:, 0]
    return Reduced(S, s, poses_covariance, normal.E, normal.b)


def damped(matrices: Array, damping: float) -> Array:
    """Matrices (..., m, m) with a larger diagonal, for shorter steps (Marquardt)."""
    diagonal = np.arange(matrices.shape[-1])
    longer = matrices.copy()
    longer[..., diagonal, diagonal] *= 1 + damping
    return longer


def solved(normal: Normal, damping: float) -> tuple[Array, Array]:
    """The damped steps of the common unknowns, (q,), and of the poses, (n, 6)."""
    reduced = eliminated(normal._replace(A=damped(normal.A, damping), D=damped(normal.D, damping)))
    common = np.asarray(np.linalg.solve(reduced.S, reduced.s), dtype=float)
    return common, reduced.pose_steps(common)


def rows(blocks: Array) -> Array:
    """Blocks (k, m, q) below each other, (k m, q)."""
    return blocks.reshape(-1, blocks.shape[-1])


def descended(
    state: Any,
    linearised: Callable[[Any], tuple[Any, float]],
    stepped: Callable[[Any, Any, float], Any],
    rest: float,
) -> Descent:
    """Damped Gauss-Newton steps until the cost falls no more (Levenberg and Marquardt; Triggs et
    al. 2000, sect. 4.2).

    Parameters
    ----------
    state
        Where they start.
    linearised : callable
        Of a state its linearisation and its cost, which may be NaN: such a step is not taken.
    stepped : callable
        Of a state, its linearisation and a damping the next state.
    rest : float
        Share of the cost by which the last step lowers it.
    """
    linear, cost = linearised(state)
    if not np.isfinite(cost):
        return Descent(state, linear, cost, False)
    damping, growth = FIRST_DAMPING, 2.0
    for _ in range(MOST_STEPS):
        further = stepped(state, linear, damping)
        further_linear, lower = linearised(further)
        if not lower < cost:  # not a number, either
            damping *= growth
            growth *= 2  # ever more: the right damping may be far from this one
            if damping > MOST_DAMPING:
                return Descent(state, linear, cost, True)
            continue
        fallen = (cost - lower) / cost
        state, linear, cost = further, further_linear, lower
        if fallen < rest:
            return Descent(state, linear, cost, True)
        damping /= 10 if growth == 2 else 3  # after a failure in small steps: it is near its bound
        growth = 2.0
    return Descent(state, linear, cost, False)
