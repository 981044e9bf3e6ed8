"""Figures of the better estimators: centroids beside their predictions, errors beside targets and bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from .plotting import COLOURS

if TYPE_CHECKING:
    import pandas as pd

_MARKERS = "osD^vP"


def plot_by_slant(errors: Mapping[str, pd.DataFrame], limit_px: float) -> Figure:
    """Errors of centroids along the slant and across it, over the slant: a dot a marker, one colour a method.

    Parameters
    ----------
    errors : mapping
        From the name of a method to its table, as `centroid_trial.centroid_errors` gives it; not more than two.
    limit_px : float
        Of the vertical axes; a dot beyond is drawn at the edge.
    """
    figure, axes = plt.subplots(1, 2, figsize=(9.2, 3.2), layout="constrained", facecolor="white")
    for ax, axis in zip(axes, ("along", "across"), strict=True):
        for (name, table), colour, marker in zip(errors.items(), COLOURS[1::-1], "x.", strict=False):
            ax.plot(table["slant_deg"], table[axis].clip(-limit_px, limit_px), marker, color=colour, label=name,
                    markersize=4)
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.set(xlabel="slant / deg", ylabel=f"error {axis} the slant / px", ylim=(-1.03 * limit_px, 1.03 * limit_px),
               facecolor="white")
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
        ax.yaxis.set(major_locator=LogLocator(subs=(1, 2, 5)), major_formatter="{x:g}", minor_formatter="")
        ax.grid(axis="y", alpha=0.3)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=8)
    return figure
