"""Pictures of a calibration: where the board was held, what its images say of the lens, how far off
the cameras come out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab.camera import Rig
from trinolab.checks import as_array, as_points

from .basics import COLOURS, row_of_panels, subplots
from .pose import FRAME_COLOURS, draw_frame, oblique


def plot_boards(rig: Rig, outline: ArrayLike, T_world_board: RigidTransform) -> Figure:
    """The cameras' frames, a flat target at each of its positions, and the ways of Eq. 25.

    Parameters
    ----------
    rig : Rig
        The first two cameras are the paper's left and right one.
    outline : array_like, shape (n, 3)
        The target's own corners, mm, target frame.
    T_world_board : RigidTransform of length m
    """
    corners = as_points(outline, "outline", 3)
    figure, ax = subplots(figsize=(6.9, 3.6))
    for T in T_world_board:
        ring = oblique(T.apply(np.vstack([corners, corners[:1]])))
        ax.fill(*ring.T, facecolor=COLOURS[3], alpha=0.15)
        ax.plot(*ring.T, color=COLOURS[3], linewidth=1)
    for camera, colour in zip(rig.cameras, FRAME_COLOURS, strict=False):
        draw_frame(ax, camera.name, camera.T_world_cam, colour, length_mm=40.0)
    first = oblique(T_world_board[0].translation)
    names = ("$R_l, T_l$", "$R_r, T_r$")
    for camera, name, side in zip(rig.cameras, names, ("top", "bottom"), strict=False):
        ends = np.stack([first, oblique(camera.centre)])
        ax.plot(*ends.T, ":", color="black", linewidth=1)
        u, v = ends.mean(axis=0)
        ax.text(u, v, name, ha="center", va=side)
    ends = np.stack([oblique(camera.centre) for camera in rig.cameras[:2]])
    ax.plot(*ends.T, "--", color="black", linewidth=1)
    u, v = ends.mean(axis=0)
    ax.annotate("$R_{rl}, T_{rl}$", (u, v), (-30, -12), textcoords="offset points", ha="right")
    ax.set_aspect("equal")
    ax.margins(0.06)
    ax.axis("off")
    return figure


def plot_grids(panels: Mapping[str, Mapping[str, ArrayLike]]) -> Figure:
    """Images of regular grids of points, laid over each other, a panel a comparison.

    Parameters
    ----------
    panels : mapping
        From a panel's title to its grids; these from their name to pixels, shape (rows, columns,
        2). The first is drawn in lines, the others in dots.
    """
    figure, axes = row_of_panels(len(panels), (6.9, 3.0))
    for ax, (title, grids) in zip(axes, panels.items(), strict=True):
        for k, (name, uv) in enumerate(grids.items()):
            grid = as_array(uv, name, (None, None, 2))
            if k == 0:
                ax.plot(*grid.transpose(2, 0, 1), color=COLOURS[0], linewidth=1)
                ax.plot(*grid.transpose(2, 1, 0), color=COLOURS[0], linewidth=1)
                ax.plot([], [], color=COLOURS[0], label=name)
            else:
                ax.plot(*grid.reshape(-1, 2).T, "o", color=COLOURS[4], markersize=3, label=name)
        ax.set(title=title, xlabel="u / px", aspect="equal")
        ax.invert_yaxis()
    axes[0].set(ylabel="v / px")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def plot_chi_square(values: ArrayLike, degrees: int, xlabel: str) -> Axes:
    """How numbers are distributed that should be chi-square with so many degrees of freedom.

    Parameters
    ----------
    values : array_like, shape (n,)
    degrees : int
    xlabel : str
    """
    from scipy.stats import chi2  # 0.4 s, which other figures need not wait for

    statistics = as_array(values, "values", (None,))
    reach = max(float(chi2.ppf(0.9999, degrees)), 1.05 * float(statistics.max()))
    x = np.linspace(0, reach, 300)
    _, ax = subplots(figsize=(6.9, 2.8))
    edges = np.linspace(0, reach, 16).tolist()
    ax.hist(statistics, bins=edges, density=True, color=COLOURS[3], label="drawn")
    expected = f"chi-square, {degrees} degrees of freedom"
    ax.plot(x, chi2.pdf(x, degrees), color="black", label=expected)
    low, high = chi2.ppf([0.025, 0.975], degrees)
    for edge, label in ((low, "95 % lie between"), (high, None)):
        ax.axvline(edge, color=COLOURS[4], linestyle="--", label=label)
    ax.set(xlabel=xlabel, ylabel="probability density")
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
