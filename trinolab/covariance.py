"""Covariances: their check, their root, and the normal distribution's bound that they set."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from .checks import Array, as_array, frozen

RELATIVE_ATOL = 1e-9  # of a correlation: far above rounding, far below what a mistake makes
TINY = 1e-290  # a smaller variance is zero: its square root times another one is no precise number any more


def covariance_root(value: ArrayLike, name: str, n: int) -> Array:
    """A square root A of a covariance, A A^T = C, after the check that C is one.

    Rows and columns are scaled to correlations first, so that px beside px/s^2 costs no digits.

    Parameters
    ----------
    value : array_like, shape (n, n)
    name : str
        For the message.
    n : int

    Returns
    -------
    ndarray, shape (n, n)

    Raises
    ------
    ValueError
        For a wrong shape, NaN or infinity, or a matrix that is not symmetric and positive semi-definite to 1e-9 of its
        own scale.
    """
    C = as_array(value, name, (n, n))
    scale = np.sqrt(np.maximum(C.diagonal(), TINY))
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is above 1, or NaN
        correlation = C / scale[:, None] / scale
        skewness = np.abs(correlation - correlation.T).max(initial=0)
    if not (np.abs(correlation).max(initial=0) <= 1 + RELATIVE_ATOL and skewness <= RELATIVE_ATOL):
        raise ValueError(f"{name}: expected a symmetric, positive semi-definite matrix, got {C.tolist()}")
    values, vectors = np.linalg.eigh(correlation)
    if values.min(initial=0) < -RELATIVE_ATOL:
        raise ValueError(f"{name}: expected a positive semi-definite matrix, got an eigenvalue of {values.min():.2g} "
                         "of its correlations")
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0))


def solve_covariance(C: Array, right: Array, name: str) -> Array:
    """C^-1 right by a Cholesky factor; ValueError if C is not positive definite, or the result overflows."""
    try:
        solution = cho_solve(cho_factor(C, lower=True), right)
    except (LinAlgError, ValueError):  # SciPy: not positive definite; not finite
        raise ValueError(f"{name}: expected a positive definite covariance, got {np.asarray(C).tolist()}") from None
    if not np.isfinite(solution).all():
        raise ValueError(f"{name}: expected a covariance that can be inverted, got {np.asarray(C).tolist()}")
    return solution


def gram(root: Array, name: str) -> Array:
    """The covariance of a root (n, k), read-only; symmetric, and not negative by rounding.

    Raises ValueError if it overflows.
    """
    with np.errstate(all="ignore"):
        C = root @ root.T
    if not np.isfinite(C).all():
        raise ValueError(f"{name}: expected numbers that can be squared, got an overflow")
    return frozen((C + C.T) / 2)
