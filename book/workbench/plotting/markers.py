"""Figures of markers: the contours at every threshold, and a marker on its rod."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from trinolab.checks import Array

from .basics import COLOURS, show_image, subplots


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
    figure, axes = subplots(2, len(images), figsize=(6.9, 4.0), sharey="row")
    for (name, image), spots, count, path, (top, bottom) in zip(
        images.items(), uv, counts, steps, axes.T, strict=True
    ):
        show_image(image, spots, ax=top)
        top.set_title(name, fontsize=9)
        top.set(xlabel="", ylabel="", xticks=[], yticks=[])
        bottom.semilogy(np.maximum(count, 0.5), color="grey")
        bottom.axhline(wanted, color=COLOURS[4], linestyle="--")
        bottom.plot(*np.transpose(path), "o-", linewidth=0.5, markersize=4, color=COLOURS[0])
        bottom.set(xlabel="threshold", xticks=[0, 100, 200])
    axes[1, 0].set_ylabel("contours")
    return figure


def plot_rod_section(
    radius_mm: float, marker_diameter_mm: float, slant_deg: float, centroid_mm: float
) -> Axes:
    """A rod cut across, with a round marker wrapped on it, and what a camera far above sees of it.

    Parameters
    ----------
    radius_mm : float
        Of the rod.
    marker_diameter_mm : float
        Along the surface.
    slant_deg : float
        How far the marker's middle is turned from the line of sight.
    centroid_mm : float
        Where the centroid of its image lies, beside the rod's axis.
    """
    half = marker_diameter_mm / 2 / radius_mm  # rad
    theta = np.deg2rad(slant_deg)
    below = -0.5 * radius_mm  # where the image is drawn
    figure, ax = subplots(figsize=(6.9, 3.4))
    around = np.linspace(-np.pi / 2, np.pi / 2, 91)
    ax.fill(radius_mm * np.sin(around), radius_mm * np.cos(around), color="silver", label="rod")
    wrapped = theta + np.linspace(-half, half, 31)
    on_arc = radius_mm * np.stack([np.sin(wrapped), np.cos(wrapped)])
    ax.plot(*on_arc, color=COLOURS[0], linewidth=5, solid_capstyle="butt", label="marker")
    for angle in (theta - half, theta + half):
        x, y = radius_mm * np.sin(angle), radius_mm * np.cos(angle)
        ax.plot([x, x], [y, below], ":", color=COLOURS[0], linewidth=1)
    ax.plot(
        on_arc[0, [0, -1]], [below, below], color=COLOURS[0], linewidth=5, solid_capstyle="butt"
    )
    middle = radius_mm * np.sin(theta)
    ax.plot([0, 0], [0, radius_mm], "-.", color="black", linewidth=0.8)
    ax.plot([0, middle], [0, radius_mm * np.cos(theta)], color="black", linewidth=0.8)
    ax.plot([middle, middle], [radius_mm * np.cos(theta), below], color=COLOURS[4], linewidth=1)
    ax.plot(
        middle, below, "|", color=COLOURS[4], markersize=20, markeredgewidth=2, label="its middle"
    )
    ax.plot(
        centroid_mm,
        below,
        "x",
        color="black",
        markersize=9,
        markeredgewidth=2,
        label="centroid of its image",
    )
    ax.text(
        0.3 * radius_mm * np.sin(theta / 2),
        0.3 * radius_mm * np.cos(theta / 2),
        r"$\theta$",
        ha="center",
        va="bottom",
    )
    ax.text(middle / 2 + 0.15, radius_mm * np.cos(theta) / 2 - 0.1, "$r$", va="top")
    ax.text(-1.05 * radius_mm, below, "image", ha="right", va="center")
    ax.text(0, 1.12 * radius_mm, "to the camera", ha="center")
    ax.annotate("", (0, 1.1 * radius_mm), (0, radius_mm), arrowprops={"arrowstyle": "-|>"})
    ax.set(aspect="equal", xlim=(-1.8 * radius_mm, 1.3 * radius_mm))
    ax.axis("off")
    figure.legend(loc="outside right center")
    return ax
