"""Figures of what moves: windows in an image, and what a detection finds, misses and takes for moving (Fig. 6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import ArrayLike

from .checks import as_array
from .plotting import COLOURS
from .window import Window

_VERDICTS = {"background": "white", "found": "silver", "false": "#D55E00", "missed": "#0072B2"}


def mark_window(ax: Axes, window: Window, label: str = "", colour: str = COLOURS[1], style: str = "-") -> None:
    """Draw a window into an image's axes, around all of its pixels."""
    ax.add_patch(Rectangle((window.u - 0.5, window.v - 0.5), window.width, window.height, fill=False,
                           edgecolor=colour, linestyle=style, linewidth=1.5, label=label))


def show_verdict(mask: ArrayLike, inside: ArrayLike, outside: ArrayLike, title: str, ax: Axes) -> None:
    """Show which pixels count as moving, and which of them rightly.

    Parameters
    ----------
    mask : array_like of bool, shape (height, width)
        The detection.
    inside, outside : array_like of bool, shape (height, width)
        Pixels that truly moved, and that truly did not. What is neither is never false or missed.
    title : str
    ax : Axes
    """
    found, moved, still = (np.asarray(part, dtype=bool) for part in (mask, inside, outside))
    kind = 1 * found + 1 * (found & still) + 3 * (~found & moved)
    ax.imshow(kind, cmap=ListedColormap(list(_VERDICTS.values())), vmin=0, vmax=3, interpolation="nearest")
    ax.set(title=title, xlabel="u / px", ylabel="v / px")
    patches = [Patch(facecolor=colour, edgecolor="black", label=name) for name, colour in _VERDICTS.items()]
    ax.legend(handles=patches, fontsize=8, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.18))


def show_table(values: ArrayLike, rows: Sequence[float], columns: Sequence[float], names: tuple[str, str], title: str,
               ax: Axes) -> None:
    """Show numbers from 0 to 100, one for each of `rows` and `columns`, the darker the larger.

    `names` are those of the rows and of the columns.
    """
    table = as_array(values, "values", (len(rows), len(columns)))
    ax.imshow(table, cmap="Blues", vmin=0, vmax=100, aspect="auto")
    for (i, j), value in np.ndenumerate(table):
        ax.text(j, i, f"{value:.2f}", ha="center", va="center", color="white" if value > 55 else "black")
    ax.set(title=title, xlabel=names[1], ylabel=names[0])
    ax.set_xticks(range(len(columns)), [f"{column:g}" for column in columns])
    ax.set_yticks(range(len(rows)), [f"{row:g}" for row in rows])


def plot_shares(t_s: ArrayLike, panels: Mapping[str, Mapping[str, ArrayLike]], log: bool = False) -> Figure:
    """Shares from 0 to 1 over time, as per cent: panels side by side by their titles, curves (n,) by their names.

    `log` spreads what is small: the axis is logarithmic from 1 % on and linear below.
    """
    figure, axes = plt.subplots(1, len(panels), figsize=(5.5 * len(panels), 3.8), sharey=True, squeeze=False,
                                layout="constrained", facecolor="white")
    for ax, (title, curves) in zip(axes[0], panels.items(), strict=True):
        for (name, share), colour in zip(curves.items(), COLOURS, strict=False):
            ax.plot(t_s, 100 * np.asarray(share), color=colour, label=name)
        ax.set(title=title, xlabel="t / s", yscale="symlog" if log else "linear", ylim=(-0.2 if log else -2, 105))
        ax.yaxis.set(major_formatter="{x:g}")
        ax.grid(axis="y", alpha=0.3)
    axes[0, 0].set_ylabel("share / %")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(COLOURS))
    return figure
