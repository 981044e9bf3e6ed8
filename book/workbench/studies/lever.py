"""The lever of Table 1's angle errors: a handle that is clamped askew swings its origin about the
clamp.

With the clamp at a on the handle, an askew rotation vector w_i moves the origin of pose i by
-w_i x (R_i a). That is linear in a, so that least squares find the clamp, and an F test asks whether
there is a lever at all; how sure it would have found one is its power. The same linear model holds
constants of the angles and what cameras do beside the lever. Chapter 9.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, stats
from scipy.spatial.transform import Rotation

from trinolab.checks import Array, as_array, as_number, as_rng, as_whole


class Part(NamedTuple):
    """What some columns of a linear model explain beyond all others.

    Attributes
    ----------
    values, sigmas : ndarray, shape (q,)
        Coefficients and their standard deviations.
    F, p : float
        Of the hypothesis that all q are zero.
    share, low, high : float
        Of the squares of those numbers that the columns touch, less what chance alone would give
        to q columns, and its interval of 95 %.
    """

    values: Array
    sigmas: Array
    F: float
    p: float
    share: float
    low: float
    high: float


def lever_field(turns_deg: ArrayLike, orientations: Rotation) -> Array:
    """What a clamp one millimetre from the origin along each of the handle's axes does to the
    origins, shape (n, 3, 3), mm/mm.

    Parameters
    ----------
    turns_deg : array_like, shape (n, 3)
        Rotation vectors of the askew handle, world frame.
    orientations : Rotation of length n
        R_world_handle.
    """
    turns = np.deg2rad(as_array(turns_deg, "turns_deg", (len(orientations), 3)))
    axes = np.moveaxis(orientations.as_matrix(), 2, 1)  # (n, axis, xyz)
    return np.moveaxis(-np.cross(turns[:, None], axes), 1, 2)


def part_tests(parts: Mapping[str, Array], observed: ArrayLike) -> dict[str, Part]:
    """Fit all parts at once, and test each of them against the model without it.

    Parameters
    ----------
    parts : mapping
        From a name to columns (m, q), in units of the observed numbers' standard deviation.
    observed : array_like, shape (m,)

    Raises
    ------
    ValueError
        If the columns cannot be told apart, or leave no degree of freedom.
    """
    y = as_array(observed, "observed", (None,))
    whole = np.column_stack(list(parts.values()))
    free = len(y) - whole.shape[1]
    if free < 1 or np.linalg.matrix_rank(whole) < whole.shape[1]:
        raise ValueError("parts: expected columns that can be told apart, fewer than the numbers")
    values, square = _fitted(whole, y)
    variance = square / free
    sigmas = np.sqrt(variance * np.diag(np.linalg.inv(whole.T @ whole)))
    tests = {}
    begin = 0
    for name, columns in parts.items():
        q = columns.shape[1]
        own = slice(begin, begin + q)
        _, without = _fitted(np.delete(whole, own, axis=1), y)
        F = float((without - square) / q / variance)
        touched = y[columns.any(axis=1)]
        total = float(touched @ touched / variance)
        share = max(F - stats.f.mean(q, free), 0.0) * q / total
        p = float(stats.f.sf(F, q, free))
        interval = share_interval(F, q, free, total)
        tests[name] = Part(values[own], sigmas[own], F, p, float(share), *interval)
        begin += q
    return tests


def share_interval(F: float, q: int, free: int, total: float) -> tuple[float, float]:
    """The interval of 95 % of the share that q columns have in a sum of squares, by the
    noncentral F distribution; `total` is that sum by the variance.

    An F that is smaller than chance's median would give an upper end that is too low, or none. Its
    place takes the median, so that luck cannot exclude what the test could not see (a
    power-constrained limit: Cowan, Cranmer, Gross and Vitells 2011, arXiv:1105.3166).
    """

    def noncentrality(at: float, level: float) -> float:
        """With which an F up to `at` has the probability `level`; 0 where none has."""

        def excess(size: float) -> float:
            return float(stats.ncf.cdf(at, q, free, size)) - level

        if stats.f.cdf(at, q, free) <= level:  # even without any
            return 0.0
        return float(optimize.brentq(excess, 0.0, 10 * at * q + 100.0))

    least = float(stats.f.median(q, free))
    return noncentrality(F, 0.975) / total, noncentrality(max(F, least), 0.025) / total


def power(
    lever: Array,
    others: Array,
    clamp_mm: ArrayLike,
    sigma_mm: float,
    level: float,
    draws: int,
    rng: np.random.Generator,
) -> float:
    """How often the F test finds a clamp: the share of drawn tables in which it refuses "no lever".

    Parameters
    ----------
    lever : ndarray, shape (n, 3, q)
        Of `lever_field`, or some of its columns.
    others : ndarray, shape (n, 3, k)
        What is fitted beside it.
    clamp_mm : array_like, shape (q,)
        Where the clamp is.
    sigma_mm : float
        Scatter of each coordinate that is no lever's.
    level : float
        Of the test.
    draws : int
    rng : Generator
    """
    n, _, q = lever.shape
    clamp = as_array(clamp_mm, "clamp_mm", (q,))
    noise = as_number(sigma_mm, "sigma_mm", low=0.0) * as_rng(rng).standard_normal(
        (as_whole(draws, "draws", low=1), 3 * n)
    )
    tables = (lever @ clamp).reshape(3 * n) + noise
    part = others.reshape(3 * n, -1)
    whole = np.column_stack([part, lever.reshape(3 * n, q)])
    free = 3 * n - whole.shape[1]
    without, square = (_left(A, tables) for A in (part, whole))
    F = (without - square) / q / (square / free)
    return float(np.mean(stats.f.sf(F, q, free) < level))


def _fitted(A: Array, y: Array) -> tuple[Array, float]:
    """Coefficients, and the sum of the squares that they leave."""
    values = np.linalg.lstsq(A, y)[0].astype(np.float64)
    return values, float(((y - A @ values) ** 2).sum())


def _left(A: Array, tables: Array) -> Array:
    """Sums of squares that columns leave of each table (draws, m)."""
    basis, _ = np.linalg.qr(A)
    return (tables**2).sum(axis=1) - ((tables @ basis) ** 2).sum(axis=1)
