"""Figures of the markers: counts of contours over the threshold, centroid errors over the slant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from .checks import Array
from .plotting import COLOURS, show_image


def plot_thresholds(images: Mapping[str, np.ndarray], uv: Sequence[Array], counts: Sequence[ArrayLike],
                    steps: Sequence[ArrayLike], wanted: float) -> Figure:
    """Images with the spots found in them; below each its number of contours at every threshold.

    Parameters
    ----------
    images : mapping
        By name.
    uv : sequence of ndarray, shape (n, 2)
        Spots, px, one array an image.
    counts : sequence of array_like, shape (256,)
        Contours at the thresholds 0, 1, ...; none is drawn as 0.5.
    steps : sequence of array_like, shape (k, 2)
        The bisection's thresholds and counts.
    wanted : float
        The number that it looks for.
    """
    figure, axes = plt.subplots(2, len(images), figsize=(13, 6), layout="constrained", facecolor="white")
    for (name, image), spots, count, way, (top, bottom) in zip(images.items(), uv, counts, steps, axes.T, strict=True):
        show_image(image, spots, title=name, ax=top)
        bottom.semilogy(np.maximum(count, 0.5), color="grey")
        bottom.axhline(wanted, color=COLOURS[4], linestyle="--")
        bottom.plot(*np.transpose(way), "o-", linewidth=0.5, markersize=4, color=COLOURS[0])
        bottom.set(xlabel="threshold / grey levels", ylabel="contours")
    return figure


def plot_over_slant(dots: Mapping[str, tuple[ArrayLike, ArrayLike]], line: tuple[ArrayLike, ArrayLike],
                    named: str) -> Axes:
    """Distances of centroids from their centres (px, logarithmic) over the slant (deg): dots by name, and one line."""
    _, ax = plt.subplots(figsize=(6.5, 3.6), layout="constrained", facecolor="white")
    for (name, (slant, error)), symbol, colour in zip(dots.items(), "ox", COLOURS, strict=False):
        ax.semilogy(slant, error, symbol, color=colour, markersize=3, label=name)
    ax.plot(*line, color=COLOURS[2], label=named)
    ax.set(xlabel="slant / deg", ylabel="centroid beside the centre / px")
    ax.yaxis.set(major_formatter="{x:g}")
    ax.legend(fontsize=8)
    return ax
