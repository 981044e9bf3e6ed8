"""The noise of pixels, estimated from what a fit of an image model leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .checks import Array

ENOUGH = 30  # pixels for a variance


class Noise(NamedTuple):
    """Variance of a pixel, ``base + slope * grey``, and of the background's texture; grey levels squared."""

    base: float = 4.0
    slope: float = 0.05
    texture: float = 100.0


def estimate_noise(residual: Array, predicted: Array, used: np.ndarray, marker: Array, body: Array) -> Noise:
    """Estimate the noise from residuals on the body and on markers, away from all edges.

    Parameters
    ----------
    residual, predicted : ndarray, shape (...)
        Grey levels.
    used : ndarray of bool, shape (...)
    marker, body : ndarray, shape (...)
        Share of each pixel that the marker, and the body, covers.

    Returns
    -------
    Noise
        From medians, so that wrong pixels do not count; what too few pixels show is left at a usual value.
    """
    dark, bright = (used & (body > 0.99) & part for part in (marker < 0.01, marker > 0.99))
    if min(dark.sum(), bright.sum()) < ENOUGH:
        return Noise()
    low, high = _robust_variance(residual[dark]), _robust_variance(residual[bright])
    level, higher = float(predicted[dark].mean()), float(predicted[bright].mean())
    slope = min(max((high - low) / (higher - level or 1.0), 0.0), 0.7 * low / max(level, 1.0))
    beyond = residual[used & (body < 0.05)]
    texture = max(_robust_variance(beyond) - low, 25.0) if beyond.size >= ENOUGH else Noise().texture
    return Noise(max(low - slope * level, 0.01), slope, texture)


def _robust_variance(residual: Array) -> float:
    """From the median of sizes, for a normal distribution; grey levels squared."""
    return float((1.4826 * np.median(np.abs(residual))) ** 2)
