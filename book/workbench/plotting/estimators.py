"""Figures of estimators: their errors by rig, by slant, and over CCD3's place."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import LogLocator
from matplotlib.typing import LineStyleType
from numpy.typing import ArrayLike

from trinolab.checks import as_array, as_points

from .basics import COLOURS, row_of_panels, subplots

if TYPE_CHECKING:
    import pandas as pd

SHIPPED_DEG = {"raised_40deg": 40.0, "paper_trinocular": 90.0}
_STYLES = ("o-", "s--", "D-.", "^:", "v-")
_MARKERS = "osD^vPXh"
_EIGHT = (*COLOURS[:5], "#CC79A7", "black", "#7F7F7F")
_LINES: tuple[LineStyleType, ...] = ("solid", "dotted", "dashed")
COLUMN_IN = 7.0  # width of a page's column


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
