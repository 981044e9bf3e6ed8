"""Figures of sweeps: errors over what was varied, with the paper's working point."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike

from .checks import Array
from .plotting import COLOURS


def plot_factor(x: ArrayLike, panels: Mapping[str, Mapping[str, ArrayLike]], xlabel: str, paper: float,
                xscale: str = "linear", counts: Collection[str] = (),
                mark: str = "the paper's working point") -> Figure:
    """Panels side by side, each named by its logarithmic y axis, with curves y (n,) > 0 over one x (n,).

    Parameters
    ----------
    x : array_like, shape (n,)
    panels : mapping
        From the name of a y axis to its curves, a mapping from their names; gaps where y is NaN.
    xlabel : str
    paper : float
        Where a dotted line marks the paper's working point, or what `mark` says.
    xscale : {"linear", "log"}
    counts : collection of str
        Panels whose y axis is linear, from 0.
    mark : str
    """
    width = min(4.4 * len(panels), 10.5)
    figure, axes = plt.subplots(1, len(panels), figsize=(width, 3.0), squeeze=False, layout="constrained",
                                facecolor="white")
    for ax, (ylabel, curves) in zip(axes[0], panels.items(), strict=True):
        for (name, y), colour, style in zip(curves.items(), COLOURS, ("o-", "s--", "D-.", "^:", "v-", "P--"),
                                            strict=False):
            ax.plot(x, np.asarray(y, float), style, color=colour, label=name, markersize=4)
        ax.axvline(paper, color="black", linestyle=":", linewidth=1.2, label=mark)
        ax.set(xlabel=xlabel, ylabel=ylabel, xscale=xscale, facecolor="white")
        y = np.concatenate([np.asarray(values, float) for values in curves.values()])
        if ylabel in counts:
            ax.set_ylim(0, 1.08 * max(np.nanmax(y), 1))
        else:
            ax.set_yscale("log")
            ax.yaxis.set(major_locator=LogLocator(subs=_in_a_decade(y)), major_formatter="{x:g}", minor_formatter="")
        if xscale == "log":
            some = np.asarray(x)[::-(-np.size(x) // 7)]  # at most seven
            ax.set_xticks(some, [f"{tick:g}" for tick in some])
            ax.minorticks_off()
        ax.grid(axis="y", alpha=0.3)
        ax.legend(fontsize=7)
    return figure


def _in_a_decade(y: Array) -> tuple[float, ...]:
    """The ticks of a logarithmic axis: at several numbers of a decade, or at powers of ten if there are many."""
    positive = y[y > 0]
    return (1, 1.5, 2, 3, 5, 7) if len(positive) == 0 or positive.max() < 100 * positive.min() else (1,)
