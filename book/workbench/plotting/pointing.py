"""Figures of a pointing task: throughput, movement time and errors over the delay (beyond the
paper).
"""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from .basics import COLOURS, row_of_panels

PANELS = {
    "throughput_bit_s": "throughput / bit/s",
    "movement_s": "movement time / s",
    "error_share": "trials beside the target / 1",
}


def plot_pointing(table: pd.DataFrame) -> Figure:
    """Throughput, movement time and errors over the delay, a curve a strategy and scale, with the
    intervals.

    Parameters
    ----------
    table : DataFrame
        Columns ``strategy``, ``scale``, ``delay_s``, and each of `PANELS` with ``_low`` and
        ``_high``.
    """
    figure, axes = row_of_panels(len(PANELS), (9.0, 3.2))
    scales = sorted(table["scale"].unique())
    for (strategy, scale), rows in table.groupby(["strategy", "scale"]):
        style = "-" if strategy == table["strategy"].iloc[0] else "--"
        colour = COLOURS[scales.index(scale) % len(COLOURS)]
        delay_ms = 1e3 * rows["delay_s"]
        for ax, name in zip(axes, PANELS, strict=True):
            ax.plot(delay_ms, rows[name], style, color=colour, label=f"{strategy}, {scale:g} : 1")
            ax.fill_between(
                delay_ms,
                rows[f"{name}_low"],
                rows[f"{name}_high"],
                color=colour,
                alpha=0.25,
                linewidth=0,
            )
    for ax, label in zip(axes, PANELS.values(), strict=True):
        ax.set(xlabel="added delay / ms", ylabel=label)
        ax.set_ylim(bottom=0)
        ax.grid(alpha=0.3)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8
    )
    return figure
