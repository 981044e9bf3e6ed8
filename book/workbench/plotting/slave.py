"""The slave: the arm with its frames, a session over time, and one end of a two-port."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab.checks import Array

from .basics import COLOURS, subplots

TEXT_COLOURS = (COLOURS[0], "#A06A00", COLOURS[2], "black")  # legible as text
AXIS_SHARE = 0.14  # of the arm's height and width: the length of a drawn axis
ROW_IN, FIRST_ROW_IN = 1.15, 0.55  # inches of a panel, and of what is above the first one


def plot_arm(frames: RigidTransform, names: Sequence[str]) -> Figure:
    """An arm as the chain of its frames: the links, the joints' axes, the base and the tool.

    Parameters
    ----------
    frames : RigidTransform
        n poses in the base frame, mm: of the base, of the frame behind each joint, and of the tool.
        Joint k turns about the z axis of frame k.
    names : sequence of str
        One a frame; an empty one is not written.

    Raises
    ------
    ValueError
        If there are not as many names as frames.
    """
    if len(names) != len(frames):
        raise ValueError(f"names: expected {len(frames)}, one per frame, got {len(names)}")
    figure, ax = subplots(figsize=(6.9, 4.6))
    origins = _from_aside(frames.translation)
    ax.plot(*origins.T, "-", color="#B0B4BA", linewidth=7, solid_capstyle="round", zorder=1)
    length = AXIS_SHARE * float(np.ptp(frames.translation, axis=0).max())
    for k, T in enumerate(frames):
        axes = _from_aside(length * T.rotation.as_matrix().T)
        whole = k in (0, len(frames) - 1)
        colours = TEXT_COLOURS[:3] if whole else (None, None, TEXT_COLOURS[3])
        for along, letter, colour in zip(axes, "xyz", colours, strict=True):
            if colour is not None:
                label = f"${letter}$" if whole else f"$z_{{{k}}}$"
                _arrow(ax, origins[k], along, colour, label)
        ax.plot(*origins[k], "o", color="black", markersize=5, zorder=3)
        ax.annotate(
            names[k], origins[k], (9, -13), textcoords="offset points", fontsize=9, zorder=4
        )
    ax.set_aspect("equal")
    ax.margins(0.1)
    ax.axis("off")
    return figure


def plot_session(
    t_s: ArrayLike,
    panels: Mapping[str, Mapping[str, ArrayLike]],
    spans: Mapping[str, Sequence[tuple[float, float]]] | None = None,
) -> Figure:
    """Curves over one time in panels below each other, with shaded stretches of time.

    Parameters
    ----------
    t_s : array_like, shape (n,)
    panels : mapping of str to mapping of str to array_like, shape (n,)
        By the label of the vertical axis, and by the curve's name.
    spans : mapping of str to sequence of (begin, end), optional
        s, by what they are called; one hatching each.
    """
    figure, rows = subplots(
        len(panels),
        1,
        figsize=(6.9, FIRST_ROW_IN + (ROW_IN + 0.35) * len(panels)),
        sharex=True,
        squeeze=False,
    )
    first_names = list(next(iter(panels.values())))
    for ax, (label, curves) in zip(rows[:, 0], panels.items(), strict=True):
        for (name, values), colour in zip(curves.items(), COLOURS, strict=False):
            ax.plot(t_s, values, color=colour, label=name, linewidth=1.4)
        for (name, stretches), look in zip((spans or {}).items(), _LOOKS, strict=False):
            for k, (begin, end) in enumerate(stretches):
                first = k == 0 and ax is rows[0, 0]
                ax.axvspan(begin, end, label=name if first else None, **look)
        ax.set(ylabel=label)
        ax.grid(alpha=0.3)
        if len(curves) > 1 and list(curves) != first_names:
            ax.legend(fontsize=9, loc="upper right")
    rows[-1, 0].set_xlabel("$t$ / s")
    handles, labels = rows[0, 0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=9)
    return figure


def plot_two_port() -> Figure:
    """A teleoperator as a two-port: what hand, channel and surroundings give each other."""
    figure, ax = plt.subplots(figsize=(6.9, 1.7), facecolor="white")
    ax.set_position((0, 0, 1, 1))
    ax.set(xlim=(0, 6.9), ylim=(-0.85, 0.85))
    ax.axis("off")
    places = (0.55, 2.15, 3.45, 4.75, 6.3)
    names = ("hand", "master", "channel", "slave", "what is\ntouched")
    for x, name in zip(places, names, strict=True):
        box = {"boxstyle": "round,pad=0.5", "facecolor": "#DDEEFF"}
        ax.text(x, 0, name, ha="center", va="center", fontsize=9, bbox=box, zorder=3)
    ax.plot([places[1], places[3]], [0, 0], color="#B0B4BA", linewidth=5, zorder=1)
    ax.add_patch(Rectangle((1.68, -0.6), 3.55, 1.2, fill=False, linestyle="--"))
    ax.text(3.45, 0.7, "the two-port $H$", ha="center", va="center", fontsize=9)
    for left, right, speed, force in (
        (0.9, 1.66, "$V_m$", "$F_h$"),
        (5.25, 5.85, "$V_s$", "$F_e$"),
    ):
        middle = (left + right) / 2
        for height, text, (tip, tail) in (
            (0.25, speed, (right, left)),
            (-0.25, force, (left, right) if force == "$F_e$" else (right, left)),
        ):
            ax.annotate("", (tip, height), (tail, height), arrowprops={"arrowstyle": "-|>"})
            ax.text(middle, height + 0.14, text, ha="center", va="center", fontsize=9)
    return figure


_LOOKS = (
    {"facecolor": "#D9D9D9", "edgecolor": "none", "zorder": 0},
    {"facecolor": "none", "edgecolor": "#707070", "hatch": "///", "linewidth": 0, "zorder": 0},
    {"facecolor": "none", "edgecolor": "#A06A00", "hatch": "...", "linewidth": 0, "zorder": 0},
)


def _from_aside(points: ArrayLike) -> Array:
    """Points of the base frame on the page, shape (..., 2): -x to the right, z up, y obliquely."""
    return np.asarray(points, dtype=float) @ np.array([[-1.0, 0.0], [0.4, 0.35], [0.0, 1.0]])


def _arrow(ax: Axes, start: Array, along: Array, colour: str, label: str) -> None:
    end = start + along
    ax.plot(*end, " ")  # so that the limits hold it
    ax.annotate(
        "", tuple(end), tuple(start), arrowprops={"arrowstyle": "-|>", "color": colour}, zorder=2
    )
    beside = 11 * np.array([along[1], -along[0]]) / max(float(np.linalg.norm(along)), 1e-12)
    ax.annotate(
        label,
        tuple(end),
        tuple(beside),
        textcoords="offset points",
        color=colour,
        ha="center",
        va="center",
        fontsize=9,
    )
