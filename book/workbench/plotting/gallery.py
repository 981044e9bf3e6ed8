"""The gallery's figure: errors over one parameter."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike

from trinolab.checks import Array

from .basics import COLOURS, row_of_panels


def plot_factor(
    x: ArrayLike,
    panels: Mapping[str, Mapping[str, ArrayLike]],
    xlabel: str,
    paper: float,
    xscale: str = "linear",
    counts: Collection[str] = (),
    mark: str = "the paper's working point",
) -> Figure:
    """Panels side by side, each named by its logarithmic y axis, with curves y > 0 over one x (n,),
    and one legend for all.

    Parameters
    ----------
    x : array_like, shape (n,)
    panels : mapping
        From the name of a y axis to its curves, a mapping from their names to y (n,), or to y, the
        lower and the upper end of its interval (3, n); gaps where y is NaN.
    xlabel : str
    paper : float
        Where a dotted line marks the paper's working point, or what `mark` says.
    xscale : {"linear", "log"}
    counts : collection of str
        Panels whose y axis is linear, from 0.
    mark : str
    """
    figure, axes = row_of_panels(len(panels), (7.0, 3.2))
    for ax, (ylabel, curves) in zip(axes, panels.items(), strict=True):
        highest = [
            _with_interval(ax, x, values, name, k)
            for k, (name, values) in enumerate(curves.items())
        ]
        ax.axvline(paper, color="black", linestyle=":", linewidth=1.2, label=mark)
        ax.set(xlabel=xlabel, ylabel=ylabel, xscale=xscale)
        if ylabel in counts:
            ax.set_ylim(0, 1.08 * max(*highest, 0.01))
        else:
            y = np.concatenate([np.atleast_2d(values)[0] for values in curves.values()])
            ax.set_yscale("log")
            ax.yaxis.set(
                major_locator=LogLocator(subs=_in_a_decade(y)),
                major_formatter="{x:g}",
                minor_formatter="",
            )
        if xscale == "log":
            ticks = np.asarray(x)[:: -(-np.size(x) // (12 // len(panels)))]
            ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            ax.minorticks_off()
        ax.grid(axis="y", alpha=0.3)
    named: dict[str, Any] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    named[mark] = named.pop(mark)  # the last one
    figure.legend(
        named.values(),
        named.keys(),
        loc="outside upper center",
        ncols=3,
        fontsize=9,
    )
    return figure


def _with_interval(ax: Axes, x: ArrayLike, values: ArrayLike, name: str, k: int) -> float:
    """The k-th curve of a panel, with a bar for each interval; the highest of its points."""
    rows = np.atleast_2d(np.asarray(values, float))
    colour = COLOURS[k % len(COLOURS)]
    style = ("o-", "s--", "D-.", "^:", "v-", "P--")[k % 6]
    ax.plot(x, rows[0], style, color=colour, label=name, markersize=4)
    if len(rows) == 3:
        _, low, high = rows
        ax.vlines(np.asarray(x), low, high, color=colour, linewidth=1.5, alpha=0.6)
    return float(np.nanmax(rows))


def _in_a_decade(y: Array) -> tuple[float, ...]:
    """The ticks of a logarithmic axis: at several numbers of a decade, or at powers of ten if there
    are many.
    """
    positive = y[y > 0]
    return (
        (1, 1.5, 2, 3, 5, 7)
        if len(positive) == 0 or positive.max() < 100 * positive.min()
        else (1,)
    )
