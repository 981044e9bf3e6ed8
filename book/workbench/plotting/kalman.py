"""A filter's beliefs: normal distributions, a prediction in its image, how innovations are
distributed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from numpy.typing import ArrayLike
from scipy.special import chdtri

from trinolab.checks import as_array, as_points
from trinolab.window import Window

from .basics import COLOURS, mark_window, show_image, subplots

MARGIN_PX = 40  # of the image around the search window


def plot_beliefs(
    beliefs: Mapping[str, tuple[ArrayLike, ArrayLike]], xlabel: str, ylabel: str
) -> Axes:
    """Normal distributions of two numbers, each as its ellipse of one standard deviation.

    Parameters
    ----------
    beliefs : mapping of str to (array_like, array_like)
        Name -> mean, shape (2,), and covariance, shape (2, 2).
    xlabel, ylabel : str
        Of the first and of the second number.
    """
    turn = np.linspace(0, 2 * np.pi, 181)
    circle = np.array([np.cos(turn), np.sin(turn)])
    _, ax = subplots(figsize=(6.5, 3.4))
    styles = zip(beliefs.items(), COLOURS, ("-", "--", "-."), strict=False)
    for (name, (mean, covariance)), colour, style in styles:
        x, y = as_array(mean, "mean", (2,))
        root = np.linalg.cholesky(as_array(covariance, "covariance", (2, 2)))
        around = root @ circle
        ax.plot(x + around[0], y + around[1], style, color=colour, linewidth=2, label=name)
        ax.plot(x, y, "+", color=colour)
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    return ax


def plot_prediction(
    image: ArrayLike,
    window: Window,
    before: Window,
    predicted: ArrayLike,
    covariance: ArrayLike,
    gate_probability: float,
    found: ArrayLike,
) -> Axes:
    """Where a filter looks for a target in an image, cut out around the search window.

    Parameters
    ----------
    image : array_like, shape (height, width)
    window : Window
        What is searched.
    before : Window
        The markers' rectangle, one instant ago.
    predicted : array_like, shape (2,)
        Predicted centre of the rectangle, px.
    covariance : array_like, shape (2, 2)
        S of the innovation (Eq. 13), px^2.
    gate_probability : float
        Share of the true observations that the gate lets through.
    found : array_like, shape (n, 2)
        The markers in the window, px.
    """
    points = as_points(found, "found", 2)
    S = as_array(covariance, "covariance", (2, 2))
    values, vectors = np.linalg.eigh(S)
    axes_px = 2 * np.sqrt(chdtri(2, 1 - gate_probability) * values)
    angle_deg = np.rad2deg(np.arctan2(vectors[1, 0], vectors[0, 0]))
    ax = show_image(image)
    mark_window(ax, before, "markers, one instant ago", COLOURS[3])
    mark_window(ax, window, "search window")
    u, v = as_array(predicted, "predicted", (2,))
    ax.plot(u, v, "x", color=COLOURS[1], label="prediction")
    gate = Ellipse(
        (float(u), float(v)),
        *axes_px,
        angle=angle_deg,
        fill=False,
        edgecolor=COLOURS[4],
        linestyle="--",
        linewidth=2,
        label=f"gate, {100 * gate_probability:g} %",
    )
    ax.add_patch(gate)
    ax.plot(points[:, 0], points[:, 1], "+", color=COLOURS[2], label="markers found")
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    ax.plot(*centre, "o", color=COLOURS[2], fillstyle="none", label="their centre, observed")
    view = window.grown(MARGIN_PX)
    ax.set(xlim=(view.u, view.u + view.width), ylim=(view.v + view.height, view.v))
    ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    ax.figure.set_size_inches(7.5, 4.2)  # type: ignore[union-attr]
    return ax


def plot_learning(
    predicted: Sequence[tuple[ArrayLike, ArrayLike]],
    corrected: Sequence[tuple[ArrayLike, ArrayLike]],
    xlabel: str,
    ylabel: str,
    true_y: float,
) -> Axes:
    """What a filter believes of two numbers from frame to frame, as ellipses of one standard
    deviation: before and after each observation.

    Parameters
    ----------
    predicted, corrected : sequence of (array_like, array_like)
        A mean, shape (2,), and a covariance, shape (2, 2), of each frame.
    xlabel, ylabel : str
        Of the first and of the second number.
    true_y : float
        The second number in truth, which nobody has observed.
    """
    turn = np.linspace(0, 2 * np.pi, 181)
    circle = np.array([np.cos(turn), np.sin(turn)])
    _, ax = subplots(figsize=(6.9, 3.0))
    kinds = (("predicted", predicted, COLOURS[1], "--"), ("corrected", corrected, COLOURS[2], "-"))
    for name, beliefs, colour, style in kinds:
        for frame, (mean, covariance) in enumerate(beliefs, start=1):
            x, y = as_array(mean, "mean", (2,))
            around = np.linalg.cholesky(as_array(covariance, "covariance", (2, 2))) @ circle
            ax.plot(
                x + around[0],
                y + around[1],
                style,
                color=colour,
                linewidth=2 if style == "-" else 1,
                label=name if frame == 1 else None,
            )
            if style == "-":
                ax.annotate(str(frame), (float(x), float(y)), ha="center", va="center", fontsize=9)
    ax.axhline(true_y, color="black", linestyle=":", linewidth=1, label="true speed")
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.legend(loc="lower right")
    return ax


def plot_tracks(
    times_s: ArrayLike,
    truth: ArrayLike,
    observed: ArrayLike,
    filtered: Mapping[str, tuple[ArrayLike, ArrayLike, ArrayLike]],
) -> Figure:
    """One coordinate of a target as several filters follow it: above where it is, below how far off
    the predictions are, within the gate that the filter sets.

    Parameters
    ----------
    times_s : array_like, shape (n,)
    truth, observed : array_like, shape (n,)
        px.
    filtered : mapping of str to (array_like, array_like, array_like)
        Title -> the estimates, the observations less the predictions, and the gates' radii, each
        (n,), px. The scale of the last two is linear up to 10 px and logarithmic beyond.
    """
    t = as_array(times_s, "times_s", (None,))
    figure, axes = subplots(
        2, len(filtered), figsize=(7.5, 4.6), sharex=True, sharey="row", squeeze=False
    )
    for (title, curves), (above, below) in zip(filtered.items(), axes.T, strict=True):
        estimate, off, gate = (as_array(curve, title, t.shape) for curve in curves)
        above.plot(t, truth, color="black", linewidth=1, label="true")
        above.plot(t, observed, ".", color=COLOURS[0], label="observed")
        above.plot(t, estimate, "--", color=COLOURS[1], linewidth=2, label="filtered")
        above.set(title=title)
        below.fill_between(t, -gate, gate, color=COLOURS[2], alpha=0.3, label="gate")
        below.plot(t, off, ".-", color=COLOURS[4], label="innovation")
        below.set(xlabel="time / s")
        below.set_yscale("symlog", linthresh=10)
    axes[0, 0].set(ylabel="$u$ / px")
    axes[1, 0].set(ylabel="off by / px")
    axes[0, 0].legend(fontsize=9)
    axes[1, len(filtered) // 2].legend(fontsize=9, loc="lower right")
    return figure
