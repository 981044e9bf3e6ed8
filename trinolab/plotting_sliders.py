"""A finished sweep in a live notebook: one parameter along the axis, a slider for each other one."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from .notebookrun import UNATTENDED
from .plotting_sweep import Levels, draw_curve, is_grid, plot_sweep, results_of, varied

RESULT = "which result"  # no parameter has a name with a space


def explore(found: pd.DataFrame, results: Sequence[str] | None = None) -> Any:
    """Sliders over a finished sweep, by ipywidgets. Nothing is computed again.

    Parameters
    ----------
    found : pandas.DataFrame
        As `sweep.sweep` or `sweep.read_sweep` gives it.
    results : sequence of str, optional
        The columns to choose from; without it those that `plot_sweep` shows.

    Returns
    -------
    ipywidgets.VBox or matplotlib.figure.Figure
        The figure of `plot_sweep` where sliders are of no use: in a built page, whose kernel is gone; over fewer than
        two parameters; for runs that are no full grid.

    Raises
    ------
    ValueError
        For a column that is not there, or is no number.
    """
    names = found.attrs.get("parameters", [])
    shown, levels = results_of(found, names, results), varied(found, names)
    if UNATTENDED in os.environ or len(levels) < 2 or not shown or not is_grid(levels):
        figure = plot_sweep(found, results)
        plt.close(figure)  # or a notebook shows it twice: as an open figure, and as what the cell gives
        return figure
    import ipywidgets

    controls = {RESULT: ipywidgets.Dropdown(options=shown, description="result")}
    for level in levels[1:]:
        options = [(label, k) for k, label in enumerate(level.labels)]
        controls[level.name] = ipywidgets.SelectionSlider(options=options, description=level.name)

    def draw(**chosen: Any) -> None:
        plot_slice(found, chosen.pop(RESULT), levels, chosen)
        plt.show()

    return ipywidgets.VBox([*controls.values(), ipywidgets.interactive_output(draw, controls)])


def plot_slice(found: pd.DataFrame, result: str, levels: Sequence[Levels], at: Mapping[str, int]) -> Figure:
    """A result over the first parameter, at the chosen values of the others (their places in `Levels.values`).

    The vertical axis is that of the whole sweep, so that curves can be compared.
    """
    here = pd.Series(True, index=range(len(found))).to_numpy()
    for level in levels[1:]:
        here = here & (level.which == at[level.name])
    figure, ax = plt.subplots(figsize=(6.5, 3.6), layout="constrained", facecolor="white")
    draw_curve(ax, found[result].to_numpy(float)[here], levels[0]._replace(which=levels[0].which[here]), result)
    low, high = found[result].min(), found[result].max()
    margin = 0.05 * (high - low) or 0.5
    ax.set_ylim(low - margin, high + margin)
    return figure
