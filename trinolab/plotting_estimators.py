"""Figures of the better estimators: centroids beside their predictions, errors beside targets and bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from .plotting import COLOURS

if TYPE_CHECKING:
    import pandas as pd

_MARKERS = "osD^v"


def plot_differences(panels: Mapping[str, Mapping[str, tuple[ArrayLike, ArrayLike]]], xlabel: str,
                     limit: float) -> Figure:
    """Panels side by side, each named by its y axis, with series (x, y) of dots about a line at zero.

    All panels show y from -limit to limit; a dot beyond is drawn at the edge.
    """
    figure, axes = plt.subplots(1, len(panels), figsize=(4.6 * len(panels), 3.2), squeeze=False, layout="constrained",
                                facecolor="white")
    for ax, (ylabel, series) in zip(axes[0], panels.items(), strict=True):
        for (name, (x, y)), colour, marker in zip(series.items(), COLOURS[1::-1], "x.", strict=False):
            ax.plot(x, np.clip(np.asarray(y), -limit, limit), marker, color=colour, label=name, markersize=4)
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.set(xlabel=xlabel, ylabel=ylabel, ylim=(-1.03 * limit, 1.03 * limit), facecolor="white")
        ax.legend(fontsize=8)
    return figure


def plot_estimators(errors: Mapping[str, pd.DataFrame], lines: Mapping[str, pd.DataFrame]) -> Figure:
    """Errors of estimators on several rigs, a panel a quantity, with other values as short lines across each rig.

    Parameters
    ----------
    errors : mapping
        From the name of a y axis to a table with a row a rig and a column an estimator, all positive.
    lines : mapping
        From the name of a line to a table with a row a rig and a column a y axis; not more than three.
    """
    figure, axes = plt.subplots(1, len(errors), figsize=(4.8 * len(errors), 3.6), squeeze=False, layout="constrained",
                                facecolor="white")
    for ax, (ylabel, table) in zip(axes[0], errors.items(), strict=True):
        x = np.arange(len(table))
        for k, (name, colour, marker) in enumerate(zip(table, COLOURS, _MARKERS, strict=False)):
            ax.plot(x + 0.13 * (k - (len(table.columns) - 1) / 2), table[name], marker, color=colour, label=name)
        for (name, values), style in zip(lines.items(), ("solid", "dotted", "dashed"), strict=False):
            ax.hlines(values.loc[table.index, ylabel], x - 0.4, x + 0.4, "black", style, label=name)
        ax.set(ylabel=ylabel, yscale="log", facecolor="white")
        ax.set_xticks(x, table.index)
        ax.grid(axis="y", alpha=0.3)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(COLOURS) + 1, fontsize=8)
    return figure
