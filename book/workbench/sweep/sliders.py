"""Sliders in a live notebook: over a parameter that redraws a figure, and over a finished sweep."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.figure import Figure

from ..plotting.basics import subplots
from .figures import Levels, counts_of, draw_curve, is_grid, plot_sweep, results_of, varied
from .notebook import UNATTENDED

RESULT = "which result"  # no parameter has a name with a space
WHOLE = {"description_width": "initial"}  # a name is not cut off


def slide(draw: Callable[[float], Figure], name: str, values: Sequence[float], start: float) -> Any:
    """A slider over a parameter, and below it the figure at the chosen value, drawn anew with each
    move.

    Parameters
    ----------
    draw : callable
        From a value to its figure; what it prints stands above the figure. A reader waits for it.
    name : str
        Of the parameter, beside the slider.
    values : sequence of float
        The slider's stops.
    start : float
        Where it stands at first; a stop of its own if it is none of `values`.

    Returns
    -------
    ipywidgets.VBox or matplotlib.figure.Figure
        The figure at `start` where nobody can move a slider: in a built page, in a sweep.
    """
    if UNATTENDED in os.environ:
        return _closed(draw(start))
    import ipywidgets

    stops = [(f"{value:g}", value) for value in sorted({*values, start})]
    slider = ipywidgets.SelectionSlider(options=stops, value=start, description=name, style=WHOLE)

    def redraw(value: float) -> None:
        draw(value)
        plt.show()

    return ipywidgets.VBox([slider, ipywidgets.interactive_output(redraw, {"value": slider})])


def _closed(figure: Figure) -> Figure:
    """The figure, which a notebook would otherwise show twice: as an open one, and as what the cell
    gives.
    """
    plt.close(figure)
    return figure


def explore(found: pd.DataFrame, results: Sequence[str] | None = None) -> Any:
    """Sliders over a finished sweep, by ipywidgets. Nothing is computed again.

    Parameters
    ----------
    found : pandas.DataFrame
        As `runs.sweep` or `sweep.read_sweep` gives it.
    results : sequence of str, optional
        The columns to choose from; without it those that change, those of Eq. 26 and 27 first.

    Returns
    -------
    ipywidgets.VBox or matplotlib.figure.Figure
        The figure of `plot_sweep` where sliders are of no use: in a built page, whose kernel is
        gone; over fewer than two parameters; for runs that are no full grid.

    Raises
    ------
    ValueError
        For a column that is not there, or is no number.
    """
    names = found.attrs.get("parameters", [])
    columns = results_of(found, names, results)
    levels = varied(found, names)
    if UNATTENDED in os.environ or len(levels) < 2 or not columns or not is_grid(levels):
        return _closed(plot_sweep(found, results))
    import ipywidgets

    controls = {RESULT: ipywidgets.Dropdown(options=columns, description="result")}
    for level in levels[1:]:
        options = [(label, k) for k, label in enumerate(level.labels)]
        controls[level.name] = ipywidgets.SelectionSlider(
            options=options, description=level.name, style=WHOLE
        )

    def draw(**chosen: Any) -> None:
        plot_slice(found, chosen.pop(RESULT), levels, chosen)
        plt.show()

    return ipywidgets.VBox([*controls.values(), ipywidgets.interactive_output(draw, controls)])


def plot_slice(
    found: pd.DataFrame, result: str, levels: Sequence[Levels], at: Mapping[str, int]
) -> Figure:
    """A result over the first parameter, at the chosen values of the others (their places in
    `Levels.values`).

    The vertical axis is that of the whole sweep, so that curves can be compared.
    """
    matching = pd.Series(True, index=range(len(found))).to_numpy()
    for level in levels[1:]:
        matching = matching & (level.which == at[level.name])
    figure, ax = subplots(figsize=(6.5, 3.6))
    level = levels[0]._replace(which=levels[0].which[matching])
    counted = counts_of(found[matching], result, [level])
    draw_curve(ax, found[result].to_numpy(float)[matching], level, result, counted)
    low = found[result].min()
    high = found[result].max()
    margin = 0.05 * (high - low) or 0.5
    ax.set_ylim(low - margin, high + margin)
    return figure
