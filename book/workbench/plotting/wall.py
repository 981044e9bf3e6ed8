"""Nyquist curves and the largest stable stiffness of a wall (beyond the paper)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from .basics import COLOURS, subplots


def plot_nyquist(curves: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> Figure:
    """Loop transfer functions in the complex plane around the point -1, which a stable loop leaves
    on its left.

    Parameters
    ----------
    curves : mapping of str to (exact, approximate)
        By name, the values of the loop with its hold, shape (n,), drawn solid, and with a delay in
        its place, shape (k,), drawn dashed; in the order of rising frequency.
    """
    figure, ax = subplots(figsize=(6.5, 5))
    ax.plot(
        np.cos(angle := np.linspace(0, 2 * np.pi, 200)), np.sin(angle), color="silver", linewidth=1
    )
    for (name, (exact, approximate)), colour in zip(curves.items(), COLOURS, strict=False):
        for values, style, label in ((exact, "-", name), (approximate, "--", None)):
            ax.plot(np.real(values), np.imag(values), style, color=colour, label=label)
    ax.plot(-1, 0, "x", color="black", markersize=9, label="the point -1")
    ax.set(
        xlabel="real part of the loop / 1",
        ylabel="imaginary part of the loop / 1",
        aspect="equal",
        xlim=(-2.5, 1.0),
        ylim=(-2.5, 1.5),
    )
    ax.grid(alpha=0.3)
    ax.legend(loc="lower right", fontsize=9)
    return figure


def plot_limits(
    delays_s: ArrayLike,
    limits: Mapping[str, ArrayLike],
    marks: Mapping[str, ArrayLike] | None = None,
) -> Figure:
    """The largest stable stiffness over the delay, on a logarithmic axis.

    Parameters
    ----------
    delays_s : array_like, shape (n,)
        s.
    limits : mapping of str to array_like, shape (n,)
        N/m, by the name of the curve.
    marks : mapping of str to array_like, shape (n,), optional
        The same by another algorithm, drawn as circles; NaN where there is none.
    """
    figure, ax = subplots(figsize=(6.9, 4.2))
    for (name, limit), colour in zip(limits.items(), COLOURS, strict=False):
        ax.plot(1e3 * np.asarray(delays_s), limit, color=colour, label=name)
    for name, limit in (marks or {}).items():
        ax.plot(1e3 * np.asarray(delays_s), limit, "o", color="black", fillstyle="none", label=name)
    ax.set(
        xlabel="delay / ms",
        ylabel="largest stable stiffness / (N/m)",
        yscale="log",
    )
    ax.yaxis.set(major_formatter="{x:g}")
    ax.grid(alpha=0.3, which="both")
    ax.legend(fontsize=9)
    return figure
