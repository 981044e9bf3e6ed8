"""Figures of sweeps: errors over what was varied, with the paper's working point."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike

from .plotting import COLOURS


def plot_factor(x: ArrayLike, panels: Mapping[str, Mapping[str, ArrayLike]], xlabel: str, paper: float) -> Figure:
    """Panels side by side, each named by its logarithmic y axis, with curves y (n,) > 0 over one x (n,).

    Parameters
    ----------
    x : array_like, shape (n,)
    panels : mapping
        From the name of a y axis to its curves, a mapping from their names; gaps where y is NaN.
    xlabel : str
    paper : float
        Where a dotted line marks the paper's working point.
    """
    figure, axes = plt.subplots(1, len(panels), figsize=(4.4 * len(panels), 3.0), squeeze=False, layout="constrained",
                                facecolor="white")
    for ax, (ylabel, curves) in zip(axes[0], panels.items(), strict=True):
        for (name, y), colour, style in zip(curves.items(), COLOURS, ("o-", "s--", "D-.", "^:", "v-", "P--"),
                                            strict=False):
            ax.plot(x, np.asarray(y, float), style, color=colour, label=name, markersize=4)
        ax.axvline(paper, color="black", linestyle=":", linewidth=1.2, label="the paper's working point")
        ax.set(xlabel=xlabel, ylabel=ylabel, yscale="log", facecolor="white")
        ax.yaxis.set(major_locator=LogLocator(subs=(1, 1.5, 2, 3, 5, 7)), major_formatter="{x:g}", minor_formatter="")
        ax.grid(axis="y", alpha=0.3)
        ax.legend(fontsize=7)
    return figure
