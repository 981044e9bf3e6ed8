"""Pictures of Table 1: its errors in space, the error budget, and the pattern."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from trinolab.checks import as_points

from .basics import COLOURS, row_of_panels, subplots

if TYPE_CHECKING:
    import pandas as pd

COLUMN_IN = 6.9  # width of a page's column
_REFUSED, _KEPT, _FITTED = COLOURS[1], "white", "0.85"
_VIEWS = ((0, 1, "from the cameras"), (0, 2, "from above"))


def plot_errors_in_space(positions: ArrayLike, errors: ArrayLike, magnified: float) -> Figure:
    """Position errors as arrows at their positions, seen from the cameras and from above.

    Parameters
    ----------
    positions, errors : array_like, shape (n, 3)
        World frame, mm.
    magnified : float
        How many times longer the arrows are than the errors.
    """
    x = as_points(positions, "positions", 3)
    e = magnified * as_points(errors, "errors", 3)
    figure, panels = subplots(2, 1, figsize=(COLUMN_IN, 6.6))
    for ax, (i, j, name) in zip(panels, _VIEWS, strict=True):
        ax.quiver(
            x[:, i],
            x[:, j],
            e[:, i],
            e[:, j],
            angles="xy",
            scale_units="xy",
            scale=1.0,
            color=COLOURS[0],
            width=0.005,
        )
        ax.plot(x[:, i], x[:, j], "o", color="black", markersize=3)
        ends = np.concatenate([x, x + e])
        ax.set(
            title=name,
            xlabel=f"${'xyz'[i]}$ / mm",
            ylabel=f"${'xyz'[j]}$ / mm",
            xlim=(ends[:, i].min() - 12, ends[:, i].max() + 12),
            ylim=(ends[:, j].min() - 12, ends[:, j].max() + 12),
            aspect="equal",
        )
    panels[0].invert_yaxis()  # y points down
    return figure


def plot_pose_errors(
    position_mm: ArrayLike, angles_deg: ArrayLike, labels: Sequence[Any] | None = None
) -> Figure:
    """Position errors (n,) in mm and signed angle errors (n, 3) in deg, pose by pose, with their
    means.

    `labels` names the poses; 1, 2, ... without it. The dashed line is the mean absolute error
    (Eq. 26, 27), the dotted one the signed mean.
    """
    angles = as_points(angles_deg, "angles_deg", 3)
    panels = np.column_stack(
        [as_points(np.reshape(position_mm, (-1, 1)), "position_mm", 1), angles]
    )
    figure, axes = subplots(4, 1, figsize=(6.9, 6.4), sharex=True)
    titles = ("position / mm", r"$\alpha$ / deg", r"$\beta$ / deg", r"$\gamma$ / deg")
    ticks = np.arange(1, len(panels) + 1)
    for ax, values, title, colour in zip(axes, panels.T, titles, COLOURS, strict=False):
        ax.bar(ticks, values, color=colour)
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.axhline(np.mean(np.abs(values)), color="black", linestyle="--", label="mean absolute")
        ax.axhline(np.mean(values), color="black", linestyle=":", label="signed mean")
        ax.set(ylabel=title)
    axes[0].legend(ncols=2, fontsize=9)
    axes[-1].set_xticks(ticks, [str(label) for label in (ticks if labels is None else labels)])
    axes[-1].set_xlabel("pose")
    return figure


def plot_budget(table: pd.DataFrame, columns: Mapping[str, str]) -> Figure:
    """The error budget as bars, one row a source, one panel a quantity.

    Parameters
    ----------
    table : pandas.DataFrame
        A row per bar, from top to bottom; the index names it, `group` is what it belongs to.
    columns : mapping
        From the name of a column to that of its x axis. NaN has no bar.
    """
    groups = list(dict.fromkeys(table["group"]))
    colours = dict(zip(groups, COLOURS, strict=False))
    height = 0.29 * len(table) + 1.2
    figure, panels = row_of_panels(len(columns), (COLUMN_IN, height), sharey=True)
    places = np.arange(len(table))
    for ax, (column, xlabel) in zip(panels, columns.items(), strict=True):
        for group in groups:
            rows = np.flatnonzero(table["group"] == group)
            ax.barh(rows, table[column].iloc[rows], color=colours[group], label=group)
        for place, value in zip(places, table[column], strict=True):
            if np.isfinite(value):
                ax.annotate(
                    f"{value:.2g}", (value, place), (3, 0), textcoords="offset points",
                    va="center", fontsize=9,
                )  # fmt: skip
        ax.set(xlabel=xlabel, xlim=(0, 1.25 * np.nanmax(table[column])))
    panels[0].set_yticks(places, table.index)
    panels[0].invert_yaxis()
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=9
    )
    return figure


def plot_refused(table: pd.DataFrame, names: Mapping[str, str], level: float) -> Axes:
    """Corrected p values, a row per model and a column per statistic; refused ones are coloured.

    Parameters
    ----------
    table : pandas.DataFrame
        Columns model, statistic, p_holm and fitted; see `studies.pattern.pattern_table`.
    names : mapping
        What is written for a statistic, in the order of the columns.
    level : float
        A p value below is refused.
    """
    models = list(dict.fromkeys(table["model"]))
    by_place = table.set_index(["model", "statistic"])
    _, ax = subplots(figsize=(COLUMN_IN, 0.27 * len(models) + 0.9))
    for row, model in enumerate(models):
        for column, statistic in enumerate(names):
            cell = by_place.loc[(model, statistic)]
            refused = not cell["fitted"] and cell["p_holm"] < level
            colour = _FITTED if cell["fitted"] else _REFUSED if refused else _KEPT
            text = "fitted" if cell["fitted"] else _short(float(cell["p_holm"]))
            ax.add_patch(
                plt.Rectangle((column - 0.5, row - 0.5), 1, 1, facecolor=colour, edgecolor="0.6")
            )
            ax.text(column, row, text, ha="center", va="center", fontsize=9)
    ax.set(xlim=(-0.5, len(names) - 0.5), ylim=(len(models) - 0.5, -0.5))
    ax.set_xticks(range(len(names)), list(names.values()), fontsize=9)
    ax.set_yticks(range(len(models)), models, fontsize=9)
    ax.xaxis.tick_top()
    ax.tick_params(length=0)
    return ax


def plot_power(
    distances_mm: ArrayLike,
    moved_mm: ArrayLike,
    observed_mm: float,
    power: ArrayLike,
) -> Figure:
    """What a clamp at several distances would do, and how surely a test would find it.

    Parameters
    ----------
    distances_mm : array_like, shape (n,)
        Of the clamp from the origin.
    moved_mm : array_like, shape (n,)
        Mean position errors that it makes.
    observed_mm : float
        The mean position error of Table 1, a line.
    power : array_like, shape (n,)
        Share of tables in which the test finds the clamp.
    """
    figure, (left, right) = row_of_panels(2, (COLUMN_IN, 3.0))
    left.plot(distances_mm, moved_mm, color=COLOURS[0], label="the clamp alone")
    left.axhline(observed_mm, color="black", linestyle="--", label="Table 1")
    left.set(ylabel="mean position error / mm", ylim=(0, None))
    left.legend()
    right.plot(distances_mm, power, "o-", color=COLOURS[0], markersize=4)
    right.set(ylabel="share of tables that show it", ylim=(0, 1.03))
    for ax in (left, right):
        ax.set(xlabel="clamp's distance from the origin / mm", xlim=(0, None))
        ax.grid(alpha=0.3)
    return figure


def _short(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.1g}" if p < 0.01 else f"{p:.2f}"
