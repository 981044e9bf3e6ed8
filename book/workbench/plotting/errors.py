"""Figures of errors: over what was varied, over CCD3's place, over estimators, and of a
calibration.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import LogLocator
from matplotlib.typing import LineStyleType
from numpy.typing import ArrayLike

from trinolab.checks import Array, as_array, as_points

from .basics import COLOURS, row_of_panels, subplots

if TYPE_CHECKING:
    import pandas as pd

    from trinolab.calibration.adjust import Calibrated
    from trinolab.calibration.views import TargetViews

SHIPPED_DEG = {"raised_40deg": 40.0, "paper_trinocular": 90.0}
_STYLES = ("o-", "s--", "D-.", "^:", "v-")
_MARKERS = "osD^vPXh"
_EIGHT = (*COLOURS[:5], "#CC79A7", "black", "#7F7F7F")
_LINES: tuple[LineStyleType, ...] = ("solid", "dotted", "dashed")
COLUMN_IN = 7.0  # width of a page's column
_EXACT = 3.0  # how far to the left of the first level an exact rig is drawn
_CALIBRATION_PANELS = {
    "E_t_mm": "$E_t$ / mm",
    "geodesic_deg": "geodesic angle / deg",
    "measured": "measured",
    "off": "off by 2 mm or 5°",
}


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
    figure, axes = row_of_panels(len(panels), (COLUMN_IN, 3.2))
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


def plot_elevation(table: pd.DataFrame, estimator: str) -> Figure:
    """Shared markers, errors by estimator, and poses kept with a camera hidden, over CCD3's
    elevation.

    Parameters
    ----------
    table : pandas.DataFrame
        ``data/sweeps/elevation.csv``. The shipped rigs' elevations are marked.
    estimator : str
        Whose kept poses are shown.

    Raises
    ------
    ValueError
        If the table has no row of that estimator.
    """
    chosen = table[table["estimator"] == estimator]
    if chosen.empty:
        raise ValueError(
            f"estimator: expected one of {', '.join(table['estimator'].unique())}, got {estimator!r}"
        )
    figure, axes = subplots(2, 2, figsize=(COLUMN_IN, 6.2), sharex=True)
    x = chosen["elevation_deg"]
    (shared, position, kept, angle) = axes.ravel()
    _curves(
        shared, {f"CCD{p[0]} and CCD{p[1]}": (x, chosen[f"shared_{p}"]) for p in ("12", "13", "23")}
    )
    _curves(kept, {f"CCD{k} hidden": (x, chosen[f"kept_ccd{k}"]) for k in (1, 2, 3)})
    for ax, column in ((position, "E_t_mm"), (angle, "geodesic_mean_deg")):
        by_name = table.groupby("estimator", sort=False)
        _curves(ax, {name: (rows["elevation_deg"], rows[column]) for name, rows in by_name})
        ax.set(yscale="log")
        ax.yaxis.set(
            major_locator=LogLocator(subs=(1, 2, 5)), major_formatter="{x:g}", minor_formatter=""
        )
    shared.set(ylabel="shared markers, mean", ylim=(0, None))
    position.set(ylabel="$E_t$ / mm")
    kept.set(
        ylabel=f"poses kept, {estimator}", ylim=(-0.03, 1.03), xlabel="elevation of CCD3 / deg"
    )
    angle.set(ylabel="geodesic angle / deg", xlabel="elevation of CCD3 / deg")
    _name_rigs(shared)
    _name_rigs(position)
    return figure


def plot_calibration_error(table: pd.DataFrame, handle: str, limit_mm: float) -> Figure:
    """Pose errors, and the poses that are measured, over the error of the calibration: a colour a
    rig, a style an estimator, bands of 95 %.

    Parameters
    ----------
    table : pandas.DataFrame
        ``data/sweeps/calibration_error.csv``; what is changed are principal points and
        directions. The exact rig stands at the left edge.
    handle : str
        Whose rows are shown.
    limit_mm : float
        Of E_t, a dotted line.

    Raises
    ------
    ValueError
        If the table has no row of that handle.
    """
    rows = table[(table["handle"] == handle) & (table["changed"] == "directions")]
    if rows.empty:
        raise ValueError(
            f"handle: expected one of {', '.join(table['handle'].unique())}, got {handle!r}"
        )
    exact = rows.loc[rows["centre_px"] > 0, "centre_px"].min() / _EXACT
    with plt.rc_context({"font.size": 9}):
        figure, axes = subplots(
            2,
            2,
            figsize=(COLUMN_IN, 5.2),
            sharex=True,
            height_ratios=(2.2, 1),
        )
        for ax, (column, ylabel) in zip(axes.flat, _CALIBRATION_PANELS.items(), strict=True):
            for (rig, estimator), curve in rows.groupby(["rig", "estimator"], sort=False):
                colour = COLOURS[0 if rig == rows["rig"].iloc[0] else 4]
                style = "s--" if estimator == rows["estimator"].iloc[0] else "o-"
                x = curve["centre_px"].where(curve["centre_px"] > 0, exact)
                ax.plot(
                    x, curve[column], style, color=colour, label=f"{rig}, {estimator}", markersize=4
                )
                ax.fill_between(
                    x,
                    curve[f"{column}_low"],
                    curve[f"{column}_high"],
                    color=colour,
                    alpha=0.2,
                    lw=0,
                )
            ax.set(xscale="log", ylabel=ylabel)
            ax.grid(alpha=0.3)
        for ax in axes[0]:
            ax.set(yscale="log")
            ax.yaxis.set(major_formatter="{x:g}", minor_formatter="")
            above = ax.secondary_xaxis("top", functions=_between(rows))
            above.set(xlabel="each camera turned about an axis by / deg")
            above.set_xticks(
                ticks := [0.0005, 0.0015, 0.005, 0.015, 0.05], map("{:g}".format, ticks)
            )
            above.minorticks_off()
        axes[0, 0].axhline(limit_mm, color="black", linestyle=":", label=f"{limit_mm:g} mm")
        for ax in axes[1]:
            ax.set(xlabel="each principal point off by / px", ylim=(-0.03, 1.03))
        named = {exact: "exact"} | {px: f"{px:g}" for px in (0.01, 0.03, 0.1, 0.3, 1.0)}
        axes[1, 0].set_xticks(list(named), list(named.values()))
        axes[1, 0].minorticks_off()
        figure.legend(
            *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=9
        )
    return figure


def _between(rows: pd.DataFrame) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """From the principal points' error to the directions', and back."""
    last = rows.iloc[-1]
    ratio = last["turn_deg"] / last["centre_px"]
    return (lambda px: px * ratio, lambda deg: deg / ratio)


def _name_rigs(ax: Axes) -> None:
    """The names of the shipped rigs above a panel, where no curve is."""
    for rig, elevation in SHIPPED_DEG.items():
        ax.annotate(
            rig,
            (elevation, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="right" if elevation == max(SHIPPED_DEG.values()) else "center",
            va="bottom",
            fontsize=9,
        )


def _curves(ax: Axes, curves: dict) -> None:
    """Named curves (x, y), with the shipped rigs marked."""
    for (name, (x, y)), colour, style in zip(curves.items(), COLOURS, _STYLES, strict=False):
        ax.plot(x, y, style, color=colour, label=name, markersize=4)
    for elevation in SHIPPED_DEG.values():
        ax.axvline(elevation, color="black", linestyle=":", linewidth=1)
    ax.set(facecolor="white")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=9)


def plot_by_slant(errors: Mapping[str, pd.DataFrame], limit_px: float) -> Figure:
    """Errors of centroids along the slant and across it, over the slant: a dot per marker, one colour
    a method.

    Parameters
    ----------
    errors : mapping
        From the name of a method to its table, as `centroid_bias.centroid_errors` gives it; not
        more than two.
    limit_px : float
        Of the vertical axes; a dot beyond is drawn at the edge.
    """
    figure, axes = row_of_panels(2, (COLUMN_IN, 3.0))
    for ax, axis in zip(axes, ("along", "across"), strict=True):
        for (name, table), colour, marker in zip(
            errors.items(), COLOURS[1::-1], "x.", strict=False
        ):
            ax.plot(
                table["slant_deg"],
                table[axis].clip(-limit_px, limit_px),
                marker,
                color=colour,
                label=name,
                markersize=4,
            )
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.set(
            xlabel="slant / deg",
            ylabel=f"error {axis} the slant / px",
            ylim=(-1.03 * limit_px, 1.03 * limit_px),
        )
        ax.legend(fontsize=9)
    return figure


def plot_estimators(
    errors: Mapping[str, pd.DataFrame],
    lines: Mapping[str, pd.DataFrame],
    ends: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]] | None = None,
) -> Figure:
    """Errors of estimators on several rigs, a panel a quantity, with other values as short lines
    across each rig.

    Parameters
    ----------
    errors : mapping
        From the name of a y axis to a table with a row per rig and a column per estimator, all
        positive.
    lines : mapping
        From the name of a line to a table with a row per rig and a column per y axis; not more than
        three.
    ends : mapping, optional
        From the name of a y axis to the low and the high ends of intervals, tables like the errors'.
    """
    figure, axes = subplots(
        len(errors),
        1,
        figsize=(COLUMN_IN, 0.8 + 2.5 * len(errors)),
        sharex=True,
        squeeze=False,
    )
    for ax, (ylabel, table) in zip(axes[:, 0], errors.items(), strict=True):
        x = np.arange(len(table))
        for k, (name, colour, marker) in enumerate(zip(table, _EIGHT, _MARKERS, strict=False)):
            at = x + 0.13 * (k - (len(table.columns) - 1) / 2)
            ax.plot(at, table[name], marker, color=colour, label=name)
            if ends is not None:
                low, high = (end[name] for end in ends[ylabel])
                ax.vlines(at, low, high, color=colour, linewidth=1)
        for (name, values), style in zip(lines.items(), _LINES, strict=False):
            ax.hlines(values.loc[table.index, ylabel], x - 0.4, x + 0.4, "black", style, label=name)
        ax.set(ylabel=ylabel, yscale="log")
        ax.set_xticks(x, table.index)
        ax.yaxis.set(
            major_locator=LogLocator(subs=(1, 2, 5)), major_formatter="{x:g}", minor_formatter=""
        )
        ax.grid(axis="y", alpha=0.3)
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=9
    )
    return figure


def plot_shifts(
    panels: Mapping[str, tuple[ArrayLike, ArrayLike]],
    cameras: Mapping[str, Mapping[str, ArrayLike]],
    radius_mm: float,
    factor: float,
) -> Figure:
    """How far measured points lie beside their markers, in the section across a rod.

    Parameters
    ----------
    panels : mapping
        From a panel's title to the markers' places (n, 2) and the points' shifts (n, 2), mm.
    cameras : mapping
        From a panel's title to the directions (2,) in which its two cameras stand.
    radius_mm : float
        Of the rod.
    factor : float
        By which the shifts are drawn longer.
    """
    figure, axes = row_of_panels(len(panels), (COLUMN_IN, 3.7))
    for ax, (title, (at, shift)) in zip(axes, panels.items(), strict=True):
        start, arrow = as_points(at, "at", 2), factor * as_points(shift, "shift", 2)
        ax.add_patch(Circle((0, 0), radius_mm, facecolor="0.9", edgecolor="0.5"))
        ax.quiver(
            *start.T,
            *arrow.T,
            angles="xy",
            scale_units="xy",
            scale=1,
            width=0.006,
            headwidth=4,
            color=COLOURS[4],
            alpha=0.75,
        )
        ax.plot(*start.T, ".", color=COLOURS[0])
        mean = arrow.mean(axis=0) if len(arrow) else np.zeros(2)
        ax.plot(0, 0, ".", color="black")
        if np.linalg.norm(mean) > 0.1 * radius_mm:
            ax.annotate(
                "", (mean[0], mean[1]), (0, 0), arrowprops={"arrowstyle": "-|>", "linewidth": 2}
            )
        sides = zip(cameras[title].items(), ("right", "left"), strict=False)
        for (name, direction), side in sides:
            towards = as_array(direction, name, (2,)) / np.linalg.norm(direction)
            x, y = 1.5 * radius_mm * towards
            ax.text(x, y, name, ha=side, va="bottom")
            tip, tail = 1.12 * radius_mm * towards, 1.42 * radius_mm * towards
            style = {"arrowstyle": "-|>", "linestyle": ":"}
            ax.annotate("", (tip[0], tip[1]), (tail[0], tail[1]), arrowprops=style)
        ax.set(title=title, aspect="equal")
        ax.set(xlim=(-1.3 * radius_mm, 2 * radius_mm), ylim=(-1.1 * radius_mm, 1.7 * radius_mm))
        ax.axis("off")
    return figure


def plot_residuals(
    uv: ArrayLike,
    residuals_px: ArrayLike,
    sizes: Sequence[tuple[int, int]],
    names: Sequence[str],
    views: Sequence[str],
) -> Figure:
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
    figure = Figure(
        figsize=(max(4.2 * len(names), 8.4), 6.6), layout="constrained", facecolor="white"
    )
    grid = figure.add_gridspec(2, len(names), height_ratios=(3, 2))
    for k, name in enumerate(names):
        _arrows(
            figure.add_subplot(grid[0, k]), uv[k], off[k], sizes[k], name, COLOURS[k % len(COLOURS)]
        )
    _bars(figure.add_subplot(grid[1, :]), np.linalg.norm(off, axis=3), names, views)
    return figure


def picture_of_residuals(seen: TargetViews, calibrated: Calibrated) -> bytes:
    """The figure of `plot_residuals` as a PNG, for `calibrate_rig`."""
    figure = plot_residuals(seen.uv, calibrated.residuals_px, seen.sizes, seen.cameras, seen.views)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=120)
    return file.getvalue()


def _arrows(ax: Axes, uv: Array, off: Array, size: tuple[int, int], name: str, colour: str) -> None:
    """One camera's residuals, magnified by a power of ten; most are shorter than a tenth of the
    image's width.
    """
    used = np.isfinite(off).all(axis=2) & np.isfinite(uv).all(axis=2)
    start, arrow = uv[used], off[used]
    length = np.linalg.norm(arrow, axis=1)
    largest = np.quantile(length, 0.98) if len(length) and length.max() > 0 else 1.0
    factor = 10 ** np.floor(np.log10(0.1 * size[0] / largest))
    ax.quiver(
        *start.T,
        *(factor * arrow).T,
        color=colour,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.002,
    )
    rms = np.sqrt(np.mean(length**2)) if len(length) else np.nan
    ax.set(
        title=f"{name}: {rms:.3f} px rms, arrows x {factor:g}",
        xlim=(-0.5, size[0] - 0.5),
        ylim=(size[1] - 0.5, -0.5),
        aspect="equal",
        xlabel="u / px",
        ylabel="v / px",
    )


def _bars(ax: Axes, distances: Array, names: Sequence[str], views: Sequence[str]) -> None:
    """The rms of each camera's views, beside each other."""
    width = 0.8 / len(names)
    at = np.arange(len(views))
    count = np.isfinite(distances).sum(axis=2)
    rms = np.sqrt(np.nansum(distances**2, axis=2) / np.maximum(count, 1))
    for k, (name, heights) in enumerate(zip(names, rms, strict=True)):
        ax.bar(
            at + width * (k - (len(names) - 1) / 2),
            heights,
            width,
            color=COLOURS[k % len(COLOURS)],
            label=name,
        )
    step = -(-len(views) // 25)
    ax.set_xticks(
        at[::step], [str(view) for view in views[::step]], rotation=60, ha="right", fontsize=7
    )
    ax.set(ylabel="rms / px", xlabel="view (no bar: not used)")
    ax.legend(fontsize=8)
