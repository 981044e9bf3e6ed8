"""What it costs that the correction of a pose by its residuals may be wrong.

A pose is corrected by what its residuals say of the errors of the rig (`uncertainty.contradiction`).
What looks like an error of the rig may be something else, so the pose is a mean of the corrected one, with
a share w, and of the one by the noise, and how far they are apart is in its covariance. If the correction
was wrong, the pose is off by w of it, and by it alone the variance is w (1 - w) of its square: sqrt(w / (1 - w))
sigmas, which is five for w = 25/26. If it was right, as here, sigma is larger than the errors are.

All is linear: pixels, noise, errors of the rig that the file states rightly, and the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trinolab.checks import Array

from .silent_size import NOISE_PX, Seen, fit, pixel_covariance


class BySigma(NamedTuple):
    """The rms of error by reported sigma, of position and of rotation."""

    mm: float
    deg: float


def by_sigma(
    instants: Sequence[Seen],
    covariance: Array,
    share: float,
    rng: np.random.Generator,
    draws: int = 100,
    noise_px: float = NOISE_PX,
) -> BySigma:
    """What a pose says of itself that is corrected by a share.

    Parameters
    ----------
    instants : sequence of Seen
        Each is measured with so many drawn rigs.
    covariance : ndarray, shape (p, p)
        Of the rigs' parameters; the rigs state it.
    share : float
        Of the correction, which is made; the rest is not.
    rng : numpy.random.Generator
    draws : int
    noise_px : float
    """
    squares = []
    for one in instants:
        m, p = one.by_rig.shape
        errors = rng.multivariate_normal(np.zeros(p), covariance, draws, method="eigh")
        off = one.by_rig @ errors.T + noise_px * rng.standard_normal((m, draws))
        corrected, _ = fit(one, covariance, noise_px)
        by_noise, _ = fit(one, np.zeros_like(covariance), noise_px)
        gain = share * corrected + (1 - share) * by_noise
        own = np.diag(gain @ pixel_covariance(one, covariance, noise_px) @ gain.T)
        apart = share * (1 - share) * ((by_noise - corrected) @ off) ** 2
        variance = own[:, None] + apart
        of_parts = [(gain @ off) ** 2, variance]
        squares.append([part.reshape(2, 3, draws).sum(axis=1) for part in of_parts])
    errors_by_variance = [found / variance for found, variance in squares]
    return BySigma(*np.sqrt(np.mean(errors_by_variance, axis=(0, 2))).tolist())
