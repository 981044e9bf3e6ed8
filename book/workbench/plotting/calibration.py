"""Figures of a calibration: where the board was held, its residuals, and what its errors cost."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab.camera import Rig
from trinolab.checks import Array, as_array, as_points

from .basics import COLOURS, in_style, subplots
from .pose import FRAME_COLOURS, draw_frame, oblique

if TYPE_CHECKING:
    import pandas as pd

    from trinolab.calibration.adjust import Calibrated
    from trinolab.calibration.views import TargetViews

_EXACT = 3.0  # how far to the left of the first level an exact rig is drawn
_CALIBRATION_PANELS = {
    "E_t_mm": "$E_t$ / mm",
    "geodesic_deg": "geodesic angle / deg",
    "measured": "measured",
    "off": "off by 2 mm or 5°",
}


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


def plot_calibration_error(table: pd.DataFrame, handle: str, limit_mm: float) -> Figure:
    """Pose errors, and the poses that are measured, over the error of the calibration: a colour a
    rig, a style an estimator, bands of 95 %.

    Parameters
    ----------
    table : pandas.DataFrame
        ``data/sweeps/calibration_error.csv``; what is changed are principal points and
        directions. The exact rig stands at the left edge.
    handle : str
        Whose rows are shown.
    limit_mm : float
        Of E_t, a dotted line.

    Raises
    ------
    ValueError
        If the table has no row of that handle.
    """
    rows = table[(table["handle"] == handle) & (table["changed"] == "directions")]
    if rows.empty:
        raise ValueError(
            f"handle: expected one of {', '.join(table['handle'].unique())}, got {handle!r}"
        )
    exact = rows.loc[rows["centre_px"] > 0, "centre_px"].min() / _EXACT
    with in_style({"font.size": 9}):
        figure, axes = subplots(
            2,
            2,
            figsize=(7.0, 5.2),
            sharex=True,
            height_ratios=(2.2, 1),
        )
        for ax, (column, ylabel) in zip(axes.flat, _CALIBRATION_PANELS.items(), strict=True):
            for (rig, estimator), curve in rows.groupby(["rig", "estimator"], sort=False):
                colour = COLOURS[0 if rig == rows["rig"].iloc[0] else 4]
                style = "s--" if estimator == rows["estimator"].iloc[0] else "o-"
                x = curve["centre_px"].where(curve["centre_px"] > 0, exact)
                ax.plot(
                    x, curve[column], style, color=colour, label=f"{rig}, {estimator}", markersize=4
                )
                ax.fill_between(
                    x,
                    curve[f"{column}_low"],
                    curve[f"{column}_high"],
                    color=colour,
                    alpha=0.2,
                    lw=0,
                )
            ax.set(xscale="log", ylabel=ylabel)
            ax.grid(alpha=0.3)
        for ax in axes[0]:
            ax.set(yscale="log")
            ax.yaxis.set(major_formatter="{x:g}", minor_formatter="")
            above = ax.secondary_xaxis("top", functions=_between(rows))
            above.set(xlabel="each camera turned about an axis by / deg")
            above.set_xticks(
                ticks := [0.0005, 0.0015, 0.005, 0.015, 0.05], map("{:g}".format, ticks)
            )
            above.minorticks_off()
        axes[0, 0].axhline(limit_mm, color="black", linestyle=":", label=f"{limit_mm:g} mm")
        for ax in axes[1]:
            ax.set(xlabel="each principal point off by / px", ylim=(-0.03, 1.03))
        named = {exact: "exact"} | {px: f"{px:g}" for px in (0.01, 0.03, 0.1, 0.3, 1.0)}
        axes[1, 0].set_xticks(list(named), list(named.values()))
        axes[1, 0].minorticks_off()
        figure.legend(
            *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=9
        )
    return figure


def _between(rows: pd.DataFrame) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """From the principal points' error to the directions', and back."""
    last = rows.iloc[-1]
    ratio = last["turn_deg"] / last["centre_px"]
    return (lambda px: px * ratio, lambda deg: deg / ratio)


def plot_residuals(
    uv: ArrayLike,
    residuals_px: ArrayLike,
    sizes: Sequence[tuple[int, int]],
    names: Sequence[str],
    views: Sequence[str],
) -> Figure:
    """Residuals as arrows in each camera's image, and their rms a view below.

    Parameters
    ----------
    uv : array_like, shape (cameras, views, n, 2)
        Measured points, px.
    residuals_px : array_like, shape (cameras, views, n, 2)
        Projected minus measured; NaN for what was not used.
    sizes : sequence of (int, int)
        Width and height of each camera's images.
    names, views : sequence of str
    """
    uv = as_array(uv, "uv", (len(names), len(views), None, 2), finite=False)
    off = as_array(residuals_px, "residuals_px", uv.shape, finite=False)
    figure = Figure(
        figsize=(max(4.2 * len(names), 8.4), 6.6), layout="constrained", facecolor="white"
    )
    grid = figure.add_gridspec(2, len(names), height_ratios=(3, 2))
    for k, name in enumerate(names):
        _arrows(
            figure.add_subplot(grid[0, k]), uv[k], off[k], sizes[k], name, COLOURS[k % len(COLOURS)]
        )
    _bars(figure.add_subplot(grid[1, :]), np.linalg.norm(off, axis=3), names, views)
    return figure


def picture_of_residuals(seen: TargetViews, calibrated: Calibrated) -> bytes:
    """The figure of `plot_residuals` as a PNG, for `calibrate_rig`."""
    figure = plot_residuals(seen.uv, calibrated.residuals_px, seen.sizes, seen.cameras, seen.views)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=120)
    return file.getvalue()


def _arrows(ax: Axes, uv: Array, off: Array, size: tuple[int, int], name: str, colour: str) -> None:
    """One camera's residuals, magnified by a power of ten; most are shorter than a tenth of the
    image's width.
    """
    used = np.isfinite(off).all(axis=2) & np.isfinite(uv).all(axis=2)
    start, arrow = uv[used], off[used]
    length = np.linalg.norm(arrow, axis=1)
    largest = np.quantile(length, 0.98) if len(length) and length.max() > 0 else 1.0
    factor = 10 ** np.floor(np.log10(0.1 * size[0] / largest))
    ax.quiver(
        *start.T,
        *(factor * arrow).T,
        color=colour,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.002,
    )
    rms = np.sqrt(np.mean(length**2)) if len(length) else np.nan
    ax.set(
        title=f"{name}: {rms:.3f} px rms, arrows x {factor:g}",
        xlim=(-0.5, size[0] - 0.5),
        ylim=(size[1] - 0.5, -0.5),
        aspect="equal",
        xlabel="u / px",
        ylabel="v / px",
    )


def _bars(ax: Axes, distances: Array, names: Sequence[str], views: Sequence[str]) -> None:
    """The rms of each camera's views, beside each other."""
    width = 0.8 / len(names)
    at = np.arange(len(views))
    count = np.isfinite(distances).sum(axis=2)
    rms = np.sqrt(np.nansum(distances**2, axis=2) / np.maximum(count, 1))
    for k, (name, heights) in enumerate(zip(names, rms, strict=True)):
        ax.bar(
            at + width * (k - (len(names) - 1) / 2),
            heights,
            width,
            color=COLOURS[k % len(COLOURS)],
            label=name,
        )
    step = -(-len(views) // 25)
    ax.set_xticks(
        at[::step], [str(view) for view in views[::step]], rotation=60, ha="right", fontsize=7
    )
    ax.set(ylabel="rms / px", xlabel="view (no bar: not used)")
    ax.legend(fontsize=8)
