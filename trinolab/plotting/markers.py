"""Figures of what is found in images: moving windows, markers, centroids, and a target followed
(Fig. 6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import ArrayLike

from ..checks import Array, as_array
from ..window import Window
from .basics import COLOURS, show_image

_VERDICTS = {"background": "white", "found": "silver", "false": "#D55E00", "missed": "#0072B2"}
MARGIN_PX = 150


def plot_thresholds(
    images: Mapping[str, np.ndarray],
    uv: Sequence[Array],
    counts: Sequence[ArrayLike],
    steps: Sequence[ArrayLike],
    wanted: float,
) -> Figure:
    """Images with the spots found in them; below each its number of contours at every threshold.

    Parameters
    ----------
    images : mapping
        By name.
    uv : sequence of ndarray, shape (n, 2)
        Spots, px, one array an image.
    counts : sequence of array_like, shape (256,)
        Contours at the thresholds 0, 1, ...; none is drawn as 0.5.
    steps : sequence of array_like, shape (k, 2)
        The bisection's thresholds and counts.
    wanted : float
        The number that it looks for.
    """
    figure, axes = plt.subplots(
        2, len(images), figsize=(13, 6), layout="constrained", facecolor="white"
    )
    for (name, image), spots, count, way, (top, bottom) in zip(
        images.items(), uv, counts, steps, axes.T, strict=True
    ):
        show_image(image, spots, title=name, ax=top)
        bottom.semilogy(np.maximum(count, 0.5), color="grey")
        bottom.axhline(wanted, color=COLOURS[4], linestyle="--")
        bottom.plot(*np.transpose(way), "o-", linewidth=0.5, markersize=4, color=COLOURS[0])
        bottom.set(xlabel="threshold / grey levels", ylabel="contours")
    return figure


def plot_over_slant(
    dots: Mapping[str, tuple[ArrayLike, ArrayLike]], line: tuple[ArrayLike, ArrayLike], named: str
) -> Axes:
    """Distances of centroids from their centres (px, logarithmic) over the slant (deg): dots by
    name, and one line.
    """
    _, ax = plt.subplots(figsize=(6.5, 3.6), layout="constrained", facecolor="white")
    for (name, (slant, error)), symbol, colour in zip(dots.items(), "ox", COLOURS, strict=False):
        ax.semilogy(slant, error, symbol, color=colour, markersize=3, label=name)
    ax.plot(*line, color=COLOURS[2], label=named)
    ax.set(xlabel="slant / deg", ylabel="centroid beside the centre / px")
    ax.yaxis.set(major_formatter="{x:g}")
    ax.legend(fontsize=8)
    return ax


def mark_window(
    ax: Axes, window: Window, label: str = "", colour: str = COLOURS[1], style: str = "-"
) -> None:
    """Draw a window into an image's axes, around all of its pixels."""
    ax.add_patch(
        Rectangle(
            (window.u - 0.5, window.v - 0.5),
            window.width,
            window.height,
            fill=False,
            edgecolor=colour,
            linestyle=style,
            linewidth=1.5,
            label=label,
        )
    )


def show_verdict(
    mask: ArrayLike, inside: ArrayLike, outside: ArrayLike, title: str, ax: Axes
) -> None:
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
    ax.imshow(
        kind, cmap=ListedColormap(list(_VERDICTS.values())), vmin=0, vmax=3, interpolation="nearest"
    )
    ax.set(title=title, xlabel="u / px", ylabel="v / px")
    patches = [
        Patch(facecolor=colour, edgecolor="black", label=name) for name, colour in _VERDICTS.items()
    ]
    ax.legend(handles=patches, fontsize=8, ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.18))


def show_table(
    values: ArrayLike,
    rows: Sequence[float],
    columns: Sequence[float],
    names: tuple[str, str],
    title: str,
    ax: Axes,
) -> None:
    """Show numbers from 0 to 100, one for each of `rows` and `columns`, the darker the larger.

    `names` are those of the rows and of the columns.
    """
    table = as_array(values, "values", (len(rows), len(columns)))
    ax.imshow(table, cmap="Blues", vmin=0, vmax=100, aspect="auto")
    for (i, j), value in np.ndenumerate(table):
        ax.text(
            j, i, f"{value:.2f}", ha="center", va="center", color="white" if value > 55 else "black"
        )
    ax.set(title=title, xlabel=names[1], ylabel=names[0])
    ax.set_xticks(range(len(columns)), [f"{column:g}" for column in columns])
    ax.set_yticks(range(len(rows)), [f"{row:g}" for row in rows])


def plot_shares(
    t_s: ArrayLike, panels: Mapping[str, Mapping[str, ArrayLike]], log: bool = False
) -> Figure:
    """Shares from 0 to 1 over time, as per cent: panels side by side by their titles, curves (n,)
    by their names.

    `log` spreads what is small: the axis is logarithmic from 1 % on and linear below.
    """
    figure, axes = plt.subplots(
        1,
        len(panels),
        figsize=(5.5 * len(panels), 3.8),
        sharey=True,
        squeeze=False,
        layout="constrained",
        facecolor="white",
    )
    for ax, (title, curves) in zip(axes[0], panels.items(), strict=True):
        for (name, share), colour in zip(curves.items(), COLOURS, strict=False):
            ax.plot(t_s, 100 * np.asarray(share), color=colour, label=name)
        ax.set(
            title=title,
            xlabel="t / s",
            yscale="symlog" if log else "linear",
            ylim=(-0.2 if log else -2, 105),
        )
        ax.yaxis.set(major_formatter="{x:g}")
        ax.grid(axis="y", alpha=0.3)
    axes[0, 0].set_ylabel("share / %")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(COLOURS)
    )
    return figure


def plot_following(
    image: ArrayLike, searched: Window | None, boxes: Sequence[Window | None], found: Array
) -> Figure:
    """One instant twice, cut out: where the filter looks, and what it finds there.

    Parameters
    ----------
    image : array_like, shape (height, width)
    searched : Window
        Where the filter looks for the markers.
    boxes : sequence of Window
        The rectangle of the markers at the instants up to this one: two or more.
    found : ndarray, shape (n, 2)
        The markers, px.
    """
    known = [box for box in boxes if box is not None]
    if len(known) < max(len(boxes), 2) or searched is None:
        raise ValueError(
            f"boxes: expected two or more with markers, got {len(known)} of {len(boxes)}"
        )
    centres = np.array([box.centre for box in known])
    view = searched.grown(MARGIN_PX).clipped(np.shape(image)[::-1]) or searched
    figure, axes = plt.subplots(1, 2, figsize=(8.5, 5.2), layout="constrained", facecolor="white")
    for ax, title, shown, points in zip(
        axes,
        ("(c) predicted", "(d) found and corrected"),
        (None, found),
        (centres[:-1], centres),
        strict=True,
    ):
        show_image(image, shown, title=title, ax=ax)
        outline(ax, searched, COLOURS[1], "search window")
        ax.plot(points[:, 0], points[:, 1], ".-", color=COLOURS[2], label="centres so far")
        ax.set(xlim=(view.u, view.u + view.width), ylim=(view.v + view.height, view.v))
    outline(axes[0], known[-2], COLOURS[3], "markers, one instant ago")
    outline(axes[1], known[-1], COLOURS[3], "markers now")
    for ax in axes:
        ax.legend(fontsize=8, loc="lower right")
    return figure


def outline(ax: Axes, window: Window, colour: str, label: str) -> None:
    ax.add_patch(
        Rectangle(
            (window.u - 0.5, window.v - 0.5),
            window.width,
            window.height,
            fill=False,
            edgecolor=colour,
            linewidth=2,
            label=label,
        )
    )
