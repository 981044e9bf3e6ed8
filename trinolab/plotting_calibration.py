"""The figure of a calibration: where and how far projected and measured points differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from .checks import Array, as_array
from .plotting import COLOURS


def plot_residuals(uv: ArrayLike, residuals_px: ArrayLike, sizes: Sequence[tuple[int, int]], names: Sequence[str],
                   views: Sequence[str]) -> Figure:
    """Residuals as arrows in each camera's image, and their rms a view below.

    Parameters
    ----------
    uv : array_like, shape (cameras, views, n, 2)
        Measured points, px.
    residuals_px : array_like, shape (cameras, views, n, 2)
        Projected minus measured; NaN for what was not used.
    sizes : sequence of (int, int)
        Width and height of each camera's images.
    names, views : sequence of str
    """
    uv = as_array(uv, "uv", (len(names), len(views), None, 2), finite=False)
    off = as_array(residuals_px, "residuals_px", uv.shape, finite=False)
    figure = Figure(figsize=(max(4.2 * len(names), 8.4), 6.6), layout="constrained", facecolor="white")
    grid = figure.add_gridspec(2, len(names), height_ratios=(3, 2))
    for k, name in enumerate(names):
        _arrows(figure.add_subplot(grid[0, k]), uv[k], off[k], sizes[k], name, COLOURS[k % len(COLOURS)])
    _bars(figure.add_subplot(grid[1, :]), np.linalg.norm(off, axis=3), names, views)
    return figure


def _arrows(ax: Axes, uv: Array, off: Array, size: tuple[int, int], name: str, colour: str) -> None:
    """One camera's residuals, magnified by a power of ten; most are shorter than a tenth of the image's width."""
    used = np.isfinite(off).all(axis=2) & np.isfinite(uv).all(axis=2)
    start, arrow = uv[used], off[used]
    length = np.linalg.norm(arrow, axis=1)
    largest = np.quantile(length, 0.98) if len(length) and length.max() > 0 else 1.0
    factor = 10 ** np.floor(np.log10(0.1 * size[0] / largest))
    ax.quiver(*start.T, *(factor * arrow).T, color=colour, angles="xy", scale_units="xy", scale=1, width=0.002)
    rms = np.sqrt(np.mean(length**2)) if len(length) else np.nan
    ax.set(title=f"{name}: {rms:.3f} px rms, arrows x {factor:g}", xlim=(-0.5, size[0] - 0.5),
           ylim=(size[1] - 0.5, -0.5), aspect="equal", xlabel="u / px", ylabel="v / px", facecolor="white")


def _bars(ax: Axes, distances: Array, names: Sequence[str], views: Sequence[str]) -> None:
    """The rms of each camera's views, beside each other."""
    width, at = 0.8 / len(names), np.arange(len(views))
    count = np.isfinite(distances).sum(axis=2)
    rms = np.sqrt(np.nansum(distances**2, axis=2) / np.maximum(count, 1))
    for k, (name, heights) in enumerate(zip(names, rms, strict=True)):
        ax.bar(at + width * (k - (len(names) - 1) / 2), heights, width, color=COLOURS[k % len(COLOURS)], label=name)
    step = -(-len(views) // 25)
    ax.set_xticks(at[::step], [str(view) for view in views[::step]], rotation=60, ha="right", fontsize=7)
    ax.set(ylabel="rms / px", xlabel="view (no bar: not used)", facecolor="white")
    ax.legend(fontsize=8)
