"""Images, curves and tables of several chapters, and the style and the colours that all figures share.

Colours are those of Okabe and Ito, which colour-blind readers can tell apart, on white, whatever
the page's theme.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike

from trinolab.checks import Array, as_array, as_image, as_points
from trinolab.window import Window

STYLE = Path(__file__).with_name("trinolab.mplstyle")
# one per camera, or one per spot
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#56B4E9", "#D55E00", "#F0E442", "#CC79A7")


def subplots(*arguments: Any, **options: Any) -> tuple[Figure, Any]:
    """As `matplotlib.pyplot.subplots`, in the style of the book."""
    with in_style(STYLE):
        return plt.subplots(*arguments, **options)


@contextmanager
def in_style(style: Path | dict[str, Any]) -> Iterator[None]:
    """As `matplotlib.pyplot.style.context`, in which a first figure may be made."""
    # the backend is loaded with the first figure and says whether figures are shown: it has to
    # say so before the style's context begins, at whose end all settings are what they were
    plt.draw_if_interactive()
    with plt.style.context(style):
        yield
        interactive = plt.isinteractive()
    # a notebook's backend turns it on with the first figure, and the end of the style off again
    if interactive:
        plt.ion()


def write_drawing(figure: Figure, path: Path) -> None:
    """Write a figure as an SVG whose bytes are the figure's alone, and close it."""
    with plt.rc_context({"svg.hashsalt": "trinolab", "svg.fonttype": "path"}):
        figure.savefig(path, format="svg", metadata={"Date": None}, bbox_inches="tight")
    plt.close(figure)


def row_of_panels(
    count: int, size_in: tuple[float, float], sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure of width and height `size_in`, inches, with axes side by side."""
    figure, axes = subplots(
        1,
        count,
        figsize=size_in,
        sharey=sharey,
        squeeze=False,
    )
    return figure, list(axes[0])


def show_image(
    image: ArrayLike,
    uv: ArrayLike | None = None,
    labels: Sequence[Any] | None = None,
    title: str = "",
    ax: Axes | None = None,
) -> Axes:
    """A grey image with points on it.

    Parameters
    ----------
    image : array_like, shape (height, width)
    uv : array_like, shape (n, 2), optional
        Pixels; NaN rows are left out.
    labels : sequence, optional
        One a point.
    ax : Axes, optional
        A new figure without it.
    """
    grey = as_image(np.asarray(image), "image")
    if ax is None:
        _, ax = subplots(figsize=(7, 7 * grey.shape[0] / grey.shape[1]))
    ax.imshow(grey, cmap="gray", interpolation="nearest")
    ax.set(
        title=title,
        xlabel="$u$ / px",
        ylabel="$v$ / px",
        xlim=(-0.5, grey.shape[1] - 0.5),
        ylim=(grey.shape[0] - 0.5, -0.5),
    )
    if uv is not None:
        _mark(ax, as_points(uv, "uv", 2), labels)
    return ax


def show_frames(
    frames: Sequence[ArrayLike],
    pixels: Sequence[ArrayLike],
    labels: Sequence[Sequence[Any]],
    names: Sequence[str],
    half_width_px: float = 100.0,
) -> Figure:
    """The images of one instant side by side, cut out around the markers found in them, with the
    markers' labels.

    `frames`, `pixels` (n, 2), `labels` and `names` hold one entry a camera; the label -1 is shown
    as a question mark. Without a marker all of the image is shown.
    """
    figure, axes = row_of_panels(len(frames), (6.9, 6.9 / len(frames) + 0.3))
    for ax, frame, uv, label, name in zip(axes, frames, pixels, labels, names, strict=True):
        show_image(frame, uv, ["?" if text == -1 else text for text in label], name, ax)
        if len(points := np.asarray(uv)) > 0:
            u, v = (points.min(axis=0) + points.max(axis=0)) / 2
            ax.set(
                xlim=(u - half_width_px, u + half_width_px),
                ylim=(v + half_width_px, v - half_width_px),
            )
    return figure


def mark_window(ax: Axes, window: Window, label: str = "", colour: str = COLOURS[1]) -> None:
    """Draw a window into an image's axes, around all of its pixels."""
    ax.add_patch(
        Rectangle(
            (window.u - 0.5, window.v - 0.5),
            window.width,
            window.height,
            fill=False,
            edgecolor=colour,
            linewidth=1.5,
            label=label,
        )
    )


def plot_curves(
    x: ArrayLike,
    curves: Mapping[str, ArrayLike],
    xlabel: str,
    ylabel: str,
    log: str = "",
    styles: Sequence[str] = ("o-",),
) -> Axes:
    """Curves y (n,) over one x (n,), named by the mapping's keys, with a tick at each x.

    `log` names the logarithmic axes ("x", "y", "xy"); `styles` are matplotlib's, taken in turn.
    """
    _, ax = subplots(figsize=(6.5, 3.6))
    ax.set(xscale="log" if "x" in log else "linear", yscale="log" if "y" in log else "linear")
    for k, ((name, y), colour) in enumerate(zip(curves.items(), COLOURS, strict=False)):
        ax.plot(x, y, styles[k % len(styles)], color=colour, label=name)
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.set_xticks(np.asarray(x), [f"{tick:g}" for tick in np.asarray(x)])
    ax.minorticks_off()
    ax.grid(axis="y", alpha=0.3)
    ax.legend(fontsize=9)
    return ax


def plot_with_intervals(
    curves: Mapping[str, tuple[Sequence[float], ArrayLike]],
    xlabel: str,
    ylabel: str,
    log: str = "",
    level: tuple[float, str] | None = None,
) -> Axes:
    """Curves with bars that reach from the low to the high end of an interval.

    Parameters
    ----------
    curves : mapping of str to (x (n,), y (n, 3))
        The columns of y: value, low end, high end. Without an interval the ends are NaN.
    xlabel, ylabel : str
    log : str
        The logarithmic axes: "x", "y", "xy".
    level : (float, str), optional
        A horizontal dotted line and its name.
    """
    _, ax = subplots(figsize=(6.9, 3.2))
    ticks = set[float]()
    for (name, (x, y)), colour, style in zip(
        curves.items(), COLOURS[:3] + COLOURS[4:5], ("o-", "s--", "^-.", "D:"), strict=False
    ):
        value, low, high = as_array(y, name, (len(x), 3), finite=False).T
        bars = np.nan_to_num([value - low, high - value])
        ax.errorbar(x, value, bars, fmt=style, color=colour, capsize=3, label=name)
        ticks |= {float(one) for one in x}
    if level is not None:
        ax.axhline(level[0], color="black", linestyle=":", label=level[1])
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.set(xscale="log" if "x" in log else "linear", yscale="log" if "y" in log else "linear")
    ax.set_xticks(sorted(ticks), [f"{tick:g}" for tick in sorted(ticks)])
    ax.minorticks_off()
    if "y" in log:
        ax.yaxis.set(
            major_locator=LogLocator(subs=(1, 2, 3, 5)),
            major_formatter="{x:g}",
            minor_formatter="",
        )
    ax.grid(axis="y", alpha=0.3)
    ax.legend(fontsize=9)
    return ax


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


def _mark(ax: Axes, uv: Array, labels: Sequence[Any] | None) -> None:
    ax.plot(uv[:, 0], uv[:, 1], "+", color=COLOURS[1], markersize=9)
    for k, (u, v) in enumerate(uv):
        if labels is not None and np.isfinite(u + v):
            ax.annotate(
                str(labels[k]),
                (u, v),
                xytext=(10, 6),
                textcoords="offset points",
                color=COLOURS[1],
                fontsize=9,
            )
