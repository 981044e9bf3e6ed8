"""Pictures of what moves: a pixel's history, and shares of false and missed pixels over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from trinolab.checks import as_array

from .basics import COLOURS, row_of_panels, subplots


def plot_pixel_histories(
    t_s: ArrayLike, pixels: Mapping[str, tuple[ArrayLike, ArrayLike]], threshold: float
) -> Figure:
    """What single pixels show over time, beside what their backgrounds expect: one below the other.

    Parameters
    ----------
    t_s : array_like, shape (n,)
        Times of the frames, s.
    pixels : mapping of str to (array_like, array_like), shape (n,) both
        Title -> grey levels of the frames f_k, and of the backgrounds that they are compared with.
    threshold : float
        T of Eq. 5, grey levels. Frames farther than that from their background count as moving.
    """
    times = as_array(t_s, "t_s", (None,))
    figure, axes = subplots(
        len(pixels),
        1,
        figsize=(6.9, 1.7 * len(pixels) + 0.5),
        sharex=True,
        squeeze=False,
    )
    for ax, (title, (levels, backgrounds)) in zip(axes[:, 0], pixels.items(), strict=True):
        f = as_array(levels, "levels", times.shape)
        B = as_array(backgrounds, "backgrounds", times.shape)
        moving = np.abs(f - B) > threshold
        ax.fill_between(
            times, B - threshold, B + threshold, color=COLOURS[1], alpha=0.3, label="within $T$"
        )
        ax.plot(times, B, color=COLOURS[1], linewidth=2, label="background $B$")
        ax.plot(times[~moving], f[~moving], ".", color="black", markersize=3, label="frame $f_k$")
        ax.plot(
            times[moving], f[moving], "x", color=COLOURS[0], markersize=4, label="counts as moving"
        )
        ax.set(ylabel="grey level")
        ax.set_title(title, fontsize=10, loc="left")
    axes[-1, 0].set_xlabel("$t$ / s")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4, fontsize=9
    )
    return figure


def plot_shares(
    t_s: ArrayLike, panels: Mapping[str, Mapping[str, ArrayLike]], log: bool = False
) -> Figure:
    """Shares from 0 to 1 over time, as per cent: panels side by side by their titles, curves (n,)
    by their names.

    `log` spreads what is small: the axis is logarithmic from 1 % on and linear below.
    """
    figure, axes = row_of_panels(len(panels), (6.9, 3.2), sharey=True)
    styles = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))
    for ax, (title, curves) in zip(axes, panels.items(), strict=True):
        for (name, share), colour, style in zip(curves.items(), COLOURS, styles, strict=False):
            ax.plot(t_s, 100 * np.asarray(share), linestyle=style, color=colour, label=name)
        ax.set(
            title=title,
            xlabel="$t$ / s",
            yscale="symlog" if log else "linear",
            ylim=(-0.2 if log else -2, 105),
        )
        ax.yaxis.set(major_formatter="{x:g}")
        ax.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("share / %, linear below 1 %" if log else "share / %")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(COLOURS)
    )
    return figure
