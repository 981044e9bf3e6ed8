"""Figures of the data sheet: narrow, so that they are read on a telephone at their own size."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike

from trinolab.checks import as_array, as_points
from workbench.plotting.basics import COLOURS

WIDTH_IN = 3.75  # 360 px of a page
_LEAST = 1e-9  # that a logarithmic axis shows
_SIZES: Any = {"font.size": 9, "axes.titlesize": 9, "axes.labelsize": 9, "legend.fontsize": 9}


def _subplots(rows: int = 1, columns: int = 1, height: float = 2.7, **options: Any) -> Any:
    """A figure that pyplot does not know, and its axes: nobody has to close it."""
    with matplotlib.rc_context(_SIZES):
        figure = Figure((WIDTH_IN, height), layout="constrained", facecolor="white")
        return figure, figure.subplots(rows, columns, **options)


def as_png(figure: Figure) -> bytes:
    """The figure as a PNG file, twice as fine as it is shown."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=192)
    return file.getvalue()


def plot_allan(curves: Sequence[tuple[ArrayLike, ArrayLike]], ylabel: str) -> Figure:
    """Allan deviations over the averaging time, one curve (taus, deviations) a place, one or more,
    and their root mean square over the times that all of them have, with a line that falls as white
    noise.
    """
    figure, ax = _subplots()
    pairs = [(np.asarray(tau), np.maximum(deviation, _LEAST)) for tau, deviation in curves]
    every = np.concatenate([deviation for _, deviation in pairs])
    ax.set(xscale="log", yscale="log", ylim=(every.min() / 1.5, 1.5 * every.max()))
    shortest = min(len(tau) for tau, _ in pairs)
    tau = pairs[0][0][:shortest]
    together = np.sqrt(np.mean([deviation[:shortest] ** 2 for _, deviation in pairs], axis=0))
    for k, (times, deviation) in enumerate(pairs):
        ax.plot(times, deviation, color="0.65", lw=1, label="a place" if k == 0 else None)
    ax.plot(tau, together, "o-", color=COLOURS[0], markersize=4, label="all places")
    white = together[0] * np.sqrt(tau[0] / tau)
    ax.plot(tau, white, "--", color="black", label="white noise")
    ax.legend()
    ax.set(xlabel="averaged over / s", ylabel=ylabel)
    ax.grid(alpha=0.3, which="both")
    _plain(ax)
    return figure


def plot_error_map(
    places: ArrayLike, errors: ArrayLike, labels: Sequence[str], colour_label: str
) -> Figure:
    """Errors (n,) > 0 at places (n, 2) as coloured dots, on a logarithmic scale that ends at the
    errors' 2 and 98 %.
    """
    at = as_points(places, "places", 2)
    values = np.maximum(as_array(errors, "errors", (len(at),)), _LEAST)
    figure, ax = _subplots(height=3.6)
    low, high = np.quantile(values, [0.02, 0.98])
    norm = LogNorm(low, max(high, 1.01 * low))
    order = np.argsort(values)  # large errors on top
    dots = ax.scatter(*at[order].T, c=values[order], s=12, cmap="viridis", norm=norm)
    bar = figure.colorbar(dots, ax=ax, label=colour_label, extend="both")
    bar.ax.yaxis.set(major_formatter="{x:.2g}", minor_formatter="{x:.2g}")
    bar.ax.tick_params(which="both", labelsize=8)
    ax.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")
    ax.grid(alpha=0.3)
    return figure


def plot_against(
    freedoms: ArrayLike, errors: ArrayLike, names: Sequence[str], ylabel: str, ranges: int
) -> Figure:
    """Errors (n,) > 0 over each of six degrees of freedom, columns of (n, 6), with the medians of
    so many ranges of equally many poses.
    """
    x = as_array(freedoms, "freedoms", (None, len(names)))
    y = np.maximum(as_array(errors, "errors", (len(x),)), _LEAST)
    figure, axes = _subplots(3, 2, height=5.4, sharey=True)
    axes[0, 0].set(yscale="log", ylim=(y.min() / 2, 2 * y.max()))
    for ax, column, name in zip(axes.flat, x.T, names, strict=True):
        ax.plot(column, y, ".", color=COLOURS[3], markersize=2.5, alpha=0.7)
        parts = np.array_split(np.argsort(column), ranges)
        middle = [(np.median(column[part]), np.median(y[part])) for part in parts if len(part)]
        ax.plot(*np.transpose(middle), "o-", color=COLOURS[4], markersize=3)
        ax.set(xlabel=name)
        ax.grid(alpha=0.3)
    figure.supylabel(ylabel, fontsize=9)
    return figure


def plot_explained(
    shares: ArrayLike, sure: ArrayLike, rows: Sequence[str], columns: Sequence[str]
) -> Figure:
    """A table of shares in per cent, (rows, columns), coloured by their size, with a frame where
    one is sure.
    """
    values = as_array(shares, "shares", (len(rows), len(columns)))
    framed = np.asarray(sure, bool)
    figure, ax = _subplots(height=3.4)
    ax.imshow(values, cmap="Blues", vmin=0, vmax=max(20.0, float(values.max())), aspect="auto")
    for (i, j), value in np.ndenumerate(values):
        dark = value > 0.6 * max(20.0, float(values.max()))
        ax.text(j, i, f"{max(value, 0):.0f}", ha="center", va="center", color="w" if dark else "k")
        if framed[i, j]:
            ax.add_patch(
                Rectangle((j - 0.46, i - 0.46), 0.92, 0.92, fill=False, color=COLOURS[4], lw=2)
            )
    ax.set_xticks(range(len(columns)), columns, rotation=35, ha="right")
    ax.set_yticks(range(len(rows)), rows)
    ax.set(xlabel="component of the error", ylabel="degree of freedom")
    return figure


def plot_over_speed(
    speeds: ArrayLike, errors: ArrayLike, limits: Sequence[float], ylabel: str
) -> Figure:
    """Errors (n,) over speeds (n,), m/s, with the root mean square in ranges of speed between
    limits.
    """
    x = as_array(speeds, "speeds", (None,))
    y = np.maximum(as_array(errors, "errors", (len(x),)), _LEAST)
    figure, ax = _subplots()
    # before anything is drawn: equal values would have no range
    ax.set(xscale="log", yscale="log", ylim=(np.quantile(y, 0.02) / 2, 2 * y.max()))
    ax.plot(x, y, ".", color=COLOURS[3], markersize=3, label="an instant")
    for k, (low, high) in enumerate(pairwise(limits)):
        in_range = (x >= low) & (x < high)
        if in_range.any():
            level = np.sqrt(np.mean(y[in_range] ** 2))
            name = "rms of a range" if k == 0 else None
            ax.plot([low, min(high, x.max())], [level] * 2, color=COLOURS[4], lw=2.5, label=name)
    ax.set(xlabel="speed / (m/s)", ylabel=ylabel)
    ax.grid(alpha=0.3, which="both")
    ax.legend(loc="upper left")
    _plain(ax)
    return figure


def plot_path(points: ArrayLike, off: ArrayLike, factor: float) -> Figure:
    """A commanded path (n, 2), mm, and how far the tool was off it, (n, 2), so many times as
    large.
    """
    path = as_points(points, "points", 2)
    away = as_array(off, "off", path.shape)
    figure, ax = _subplots(height=3.4)
    ax.plot(*path.T, ".", color="black", markersize=3, label="commanded")
    ends = path + factor * away
    name = f"mean of the tool, off {factor:g} times"
    ax.plot(*ends.T, "-", color=COLOURS[4], linewidth=1.2, label=name)
    ax.set(xlabel="mm", ylabel="mm", aspect="equal")
    ax.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=1)
    return figure


def plot_control_chart(
    names: Sequence[str], values: ArrayLike, intervals: ArrayLike, ylabel: str
) -> Figure:
    """A value (n,) a commit with its interval (n, 2), in their order; the band is the first one's
    interval.
    """
    y = as_array(values, "values", (len(names),))
    limits = as_array(intervals, "intervals", (len(names), 2))
    figure, ax = _subplots(height=2.8)
    x = np.arange(len(names))
    ax.axhspan(*limits[0], color=COLOURS[3], alpha=0.25, label="interval of the first")
    ax.errorbar(x, y, np.abs(limits.T - y), fmt="o", color=COLOURS[0], capsize=3, markersize=4)
    step = -(-len(names) // 10)
    ax.set_xticks(x[::step], list(names)[::step], rotation=45, ha="right")
    ax.set(ylabel=ylabel, xlim=(-0.5, max(len(names) - 0.5, 0.5)))
    ax.set_ylim(0, 1.25 * float(limits.max()))
    ax.grid(axis="y", alpha=0.3)
    ax.legend()
    return figure


def _plain(ax: Axes) -> None:
    """Numbers in place of powers of ten on logarithmic axes."""
    for axis in (ax.xaxis, ax.yaxis):
        low, high = axis.get_view_interval()
        subs = (1, 2, 5) if high < 300 * low else (1,)
        axis.set(major_locator=LogLocator(subs=subs), major_formatter="{x:g}", minor_formatter="")
