"""The blur of square windows of pixels: a Gaussian in both directions, and how it changes them."""

from __future__ import annotations

import numpy as np

from .checks import Array


def blur_matrices(side: int, blur_px2: Array) -> Array:
    """Matrices (n, side, side) that blur a row of pixels by a Gaussian; its weights at a border sum up to 1, too."""
    x = np.arange(side)
    weight = np.exp(-0.5 * (x[:, None] - x) ** 2 / blur_px2[:, None, None])
    return weight / weight.sum(axis=2, keepdims=True)


def blurred(B: Array, stack: Array) -> Array:
    """Windows (k, m, p) blurred in both directions by their matrices (k, side, side)."""
    k, m, p = stack.shape
    side = B.shape[1]
    rows = (stack.reshape(k, m * side, side) @ B.transpose(0, 2, 1)).reshape(k, m, side, side)
    return np.matmul(B[:, None], rows).reshape(k, m, p)


def half_laplacian(grey: Array, side: int) -> Array:
    """Derivative of blurred windows (k, p) by the blur's variance: the heat equation."""
    window = grey.reshape(-1, side, side)
    result = np.zeros_like(window)
    result[:, 1:-1, 1:-1] = (window[:, 2:, 1:-1] + window[:, :-2, 1:-1] + window[:, 1:-1, 2:] + window[:, 1:-1, :-2]
                             - 4 * window[:, 1:-1, 1:-1]) / 2
    return result.reshape(grey.shape)
