"""Images, curves and pose errors, and the colours that all figures share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from trinolab.checks import Array, as_image, as_points
from trinolab.workspace.cones import Cone

STYLE = Path(__file__).with_name("trinolab.mplstyle")
# one per camera, or one per spot
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#56B4E9", "#D55E00", "#F0E442", "#CC79A7")


def subplots(*arguments: Any, **options: Any) -> tuple[Figure, Any]:
    """As `matplotlib.pyplot.subplots`, in the style of the book."""
    # the backend is loaded with the first figure and says whether figures are shown: it has to
    # say so before the style's context begins, at whose end all settings are what they were
    plt.draw_if_interactive()
    with plt.style.context(STYLE):
        made = plt.subplots(*arguments, **options)
        interactive = plt.isinteractive()
    # a notebook's backend turns it on with the first figure, and the end of the style off again
    if interactive:
        plt.ion()
    return made


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


def _names(cones: Sequence[Cone], names: Sequence[str] | None) -> Sequence[str]:
    if names is not None and len(names) != len(cones):
        raise ValueError(f"names: expected {len(cones)}, one a cone, got {len(names)}")
    return names if names is not None else [f"cone {k + 1}" for k in range(len(cones))]
