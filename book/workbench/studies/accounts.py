"""Two accounts of Table 1's errors, each fitted to the table: the handle and its reference
misaligned, and the handle clamped anew for each pose (Sect. 6.4).

Both say that what was measured is right and what was set is not. A misalignment on both sides is
R_measured = C1 R_set C2, as in robot-world and hand-eye calibration (Zhuang, Roth and Sudhakar
1994, DOI 10.1109/70.313105). To first order every constant is a column of one linear model of the
rotation vectors, so that accounts can be tested against each other. Chapter 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.spatial.transform import RigidTransform

from trinolab.checks import Array, as_array

from .deviations import Errors, Source, euler_jacobian
from .pattern import rigid_field, without_field

CONSTANTS = {
    "reference": ("C1 x", "C1 y", "C1 z"),
    "mount": ("C2 x", "C2 y", "C2 z"),
    "angles": ("alpha", "beta", "gamma"),
}


class Fit(NamedTuple):
    """Constants fitted to rotation vectors.

    Attributes
    ----------
    values_deg : ndarray, shape (q,)
    covariance : ndarray, shape (q, q)
        deg^2, by the scatter that is left.
    rest_deg : ndarray, shape (n, 3)
        Rotation vectors without the constants.
    free : int
        Degrees of freedom of the scatter, 3 n - q.
    """

    values_deg: Array
    covariance: Array
    rest_deg: Array
    free: int

    @property
    def square(self) -> float:
        """Sum of the squares that are left, deg^2."""
        return float((self.rest_deg**2).sum())

    @property
    def sigma_deg(self) -> float:
        """Scatter that is left, an axis."""
        return float(np.sqrt(self.square / self.free))


class Interval(NamedTuple):
    """A number and its interval of 95 %."""

    value: float
    low: float
    high: float


class Clamping(NamedTuple):
    """The numbers of a handle that is clamped anew for each pose.

    Attributes
    ----------
    index_deg : tuple of Interval
        Constant errors of the set alpha, beta, gamma.
    repeat_deg : Interval
        Standard deviation of each set angle from pose to pose.
    place_mm : Interval
        Standard deviation of the handle's place from pose to pose, each coordinate.
    """

    index_deg: tuple[Interval, Interval, Interval]
    repeat_deg: Interval
    place_mm: Interval


def columns(truths: RigidTransform, kinds: Sequence[str]) -> Array:
    """What one degree of each constant does to the rotation vectors, shape (n, 3, q).

    Parameters
    ----------
    truths : RigidTransform of length n
        Set poses.
    kinds : sequence of {"reference", "mount", "angles"}
        A turn of the reference about the world's axes (C1), one of the handle in its mount about
        the handle's axes (C2), constants of the three Euler angles; see `CONSTANTS`.
    """
    if unknown := [kind for kind in kinds if kind not in CONSTANTS]:
        raise ValueError(f"kinds: expected some of {', '.join(CONSTANTS)}, got {unknown[0]!r}")
    all_kinds = {
        "reference": np.broadcast_to(np.eye(3), (len(truths), 3, 3)),
        "mount": truths.rotation.as_matrix(),
        "angles": np.linalg.inv(euler_jacobian(truths)),
    }
    return np.concatenate([all_kinds[kind] for kind in kinds], axis=2)


def fit_constants(turns_deg: ArrayLike, design: Array) -> Fit:
    """Constants by least squares.

    Parameters
    ----------
    turns_deg : array_like, shape (n, 3)
        Rotation vectors from set to measured orientations, world frame.
    design : ndarray, shape (n, 3, q)
        Of `columns`, or some of them. Raises ValueError where they do not determine the constants:
        one of alpha is a turn of the reference about z, one of gamma a turn of the mount about x.
    """
    n, _, q = design.shape
    turns = as_array(turns_deg, "turns_deg", (n, 3))
    A = design.reshape(3 * n, q)
    if np.linalg.matrix_rank(A) < q:
        raise ValueError("design: expected constants that can be told apart")
    values = np.linalg.lstsq(A, turns.reshape(-1))[0].astype(np.float64)
    rest = turns - design @ values
    free = 3 * n - q
    covariance = (rest**2).sum() / free * np.linalg.inv(A.T @ A)
    return Fit(values, covariance, rest, free)


def f_test(part: Fit, whole: Fit) -> tuple[float, float]:
    """F and p of the hypothesis that the constants which `whole` has beyond `part` are zero."""
    dropped = part.free - whole.free
    F = (part.square - whole.square) / dropped / (whole.square / whole.free)
    return F, float(stats.f.sf(F, dropped, whole.free))


def clamping(errors: Errors, truths: RigidTransform) -> Clamping:
    """The numbers of a handle that is clamped anew, from one table's errors (1, n, 3).

    Means with Student's interval; standard deviations with that of the chi square distribution, of
    positions without a rigid motion of all.
    """
    angles, places = errors.angles_deg[0], errors.position_mm[0]
    n = len(angles)
    reach = stats.t.ppf(0.975, n - 1) * angles.std(axis=0, ddof=1) / np.sqrt(n)
    alpha, beta, gamma = (
        Interval(float(mean), float(mean - r), float(mean + r))
        for mean, r in zip(angles.mean(axis=0), reach, strict=True)
    )
    repeat = sigma_interval(((angles - angles.mean(axis=0)) ** 2).sum(), 3 * (n - 1))
    rest = without_field(places, rigid_field(truths.translation))
    return Clamping((alpha, beta, gamma), repeat, sigma_interval((rest**2).sum(), 3 * n - 6))


def sigma_interval(square: float, free: int) -> Interval:
    """A standard deviation from a sum of squares with `free` degrees of freedom."""
    high, low = stats.chi2.ppf([0.025, 0.975], free)
    return Interval(*(float(np.sqrt(square / divisor)) for divisor in (free, low, high)))


def clamped_anew(errors: Errors, truths: RigidTransform) -> Source:
    """The account of the clamp as a source: its fitted numbers, and how well they are known."""
    clamped = clamping(errors, truths)
    n = len(truths)
    design = columns(truths, ["angles"])
    index = np.array([one.value for one in clamped.index_deg])
    fixed = np.zeros((n, 6))
    fixed[:, 3:] = design @ index
    unsure = np.zeros((n, 6, 3))
    unsure[:, 3:] = design * clamped.repeat_deg.value / np.sqrt(n)
    return Source(
        "clamped anew",
        1.0,
        "as fitted",
        fixed,
        np.concatenate(
            [unsure, _own(design * clamped.repeat_deg.value, clamped.place_mm.value)], axis=2
        ),
    )


def misaligned(errors: Errors, truths: RigidTransform) -> Source:
    """The account of a misalignment on both sides as a source: the fitted C1 and C2, how well they
    are known, and what they leave as scatter about any axis; positions as in `clamped_anew`.
    """
    n = len(truths)
    design = columns(truths, ["reference", "mount"])
    fit = fit_constants(errors.turns_deg[0], design)
    fixed = np.zeros((n, 6))
    fixed[:, 3:] = design @ fit.values_deg
    unsure = np.zeros((n, 6, 6))
    unsure[:, 3:] = design @ np.linalg.cholesky(fit.covariance)
    scatter = np.broadcast_to(fit.sigma_deg * np.eye(3), (n, 3, 3))
    place = clamping(errors, truths).place_mm.value
    return Source(
        "misaligned on both sides",
        1.0,
        "as fitted",
        fixed,
        np.concatenate([unsure, _own(scatter, place)], axis=2),
    )


def _own(turns: Array, place_mm: float) -> Array:
    """Roots (n, 6, 6 n) of poses that each have their own place and turn."""
    n = len(turns)
    roots = np.zeros((n, 6, n, 6))
    k = np.arange(n)
    roots[k, :3, k, :3] = place_mm * np.eye(3)
    roots[k, 3:, k, 3:] = turns
    return roots.reshape(n, 6, 6 * n)
