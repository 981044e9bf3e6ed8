"""Figures of rigs: what changes with CCD3's place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .plotting import COLOURS

if TYPE_CHECKING:
    import pandas as pd

SHIPPED_DEG = {"raised_40deg": 40.0, "paper_trinocular": 90.0}
_STYLES = ("o-", "s--", "D-.", "^:", "v-")


def plot_elevation(table: pd.DataFrame, estimator: str) -> Figure:
    """Shared markers, errors by estimator, and poses kept with a camera hidden, over CCD3's elevation.

    Parameters
    ----------
    table : pandas.DataFrame
        As `elevation.sweep_elevation` gives it. The shipped rigs' elevations are marked.
    estimator : str
        Whose kept poses are shown.

    Raises
    ------
    ValueError
        If the table has no row of that estimator.
    """
    one = table[table["estimator"] == estimator]
    if one.empty:
        raise ValueError(f"estimator: expected one of {', '.join(table['estimator'].unique())}, got {estimator!r}")
    figure, axes = plt.subplots(2, 2, figsize=(9, 6), sharex=True, layout="constrained", facecolor="white")
    x, (shared, position, kept, angle) = one["elevation_deg"], axes.ravel()
    _curves(shared, {f"CCD{p[0]} and CCD{p[1]}": (x, one[f"shared_{p}"]) for p in ("12", "13", "23")})
    _curves(kept, {f"CCD{k} hidden": (x, one[f"kept_ccd{k}"]) for k in (1, 2, 3)})
    for ax, column in ((position, "E_t_mm"), (angle, "geodesic_mean_deg")):
        by_name = table.groupby("estimator", sort=False)
        _curves(ax, {name: (rows["elevation_deg"], rows[column]) for name, rows in by_name})
        ax.set(yscale="log")
    shared.set(ylabel="shared markers, mean", ylim=(0, None))
    position.set(ylabel="E_t / mm")
    kept.set(ylabel=f"poses kept, {estimator}", ylim=(-0.03, 1.03), xlabel="elevation of CCD3 / deg")
    angle.set(ylabel="geodesic angle / deg", xlabel="elevation of CCD3 / deg")
    return figure


def _curves(ax: Axes, curves: dict) -> None:
    """Named curves (x, y), with the shipped rigs marked."""
    for (name, (x, y)), colour, style in zip(curves.items(), COLOURS, _STYLES, strict=False):
        ax.plot(x, y, style, color=colour, label=name, markersize=4)
    for rig, elevation in SHIPPED_DEG.items():
        ax.axvline(elevation, color="black", linestyle=":", linewidth=1)
        ax.annotate(rig, (elevation, 1.0), xycoords=("data", "axes fraction"), xytext=(-3, -3), rotation=90,
                    textcoords="offset points", ha="right", va="top", fontsize=6)
    ax.set(facecolor="white")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7)
