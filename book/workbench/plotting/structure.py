"""Where the cameras stand, and the paper's Fig. 1 and 2, drawn anew from the text: the master-slave
system and the master's chain as loops.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike

from trinolab.checks import as_points

from .basics import COLOURS, subplots

SYSTEM = {
    "operator": (0, 1),
    "operating\nhandle": (1, 2),
    "detection\nunit": (2, 2),
    "computer": (3, 2),
    "control\nappliance": (3, 0),
    "robot": (2, 0),
    "surveillance\ncameras": (1, 0),
    "monitor": (1, 1),
}

BETWEEN = ("hand", "light", "pose", "joint\nparameters", "motion", "light", "video", "eyes")
MASTER = {
    "frames": (0, 2),
    "background\nEq. 5-6": (1, 2),
    "window\nEq. 7-15": (2, 2),
    "markers\nEq. 16": (3, 2),
    "matches\nEq. 17-18": (3, 0),
    "points\nEq. 19-22": (2, 0),
    "pose\nEq. 23-24": (1, 0),
    "mapping": (0, 0),
}

CHARACTER_IN, PAD_IN = 0.07, 0.16  # width of a letter and of a box around 9 pt text
FRUSTUM_MM = 90.0  # length of the pyramids that stand for cameras
HANDED_ON = ("grey", "mask", "px", "centroids", "pairs", "mm", "mm, rad", "next instant")


def plot_structure() -> Figure:
    """Fig. 1, the system, and Fig. 2, the master: what hands what to whom (Sect. 2, 3.1)."""
    figure, (above, below) = subplots(2, 1, figsize=(6.9, 6.4))
    _loop(above, "the paper's Fig. 1: the system", SYSTEM, BETWEEN)
    above.add_patch(Rectangle((0.5, 0.65), 3, 1.75, fill=False, linestyle="--", label="master"))
    above.add_patch(Rectangle((0.5, -0.4), 3, 0.8, fill=False, linestyle=":", label="slave"))
    above.legend(loc="lower left")
    _loop(below, "the paper's Fig. 2: the master", MASTER, HANDED_ON)
    return figure


def plot_chain(*stages: str) -> Figure:
    """The data's way through the master as a row of boxes, with one stage lit, or several.

    Parameters
    ----------
    *stages : str
        The first words of the boxes, such as "window". Raises ValueError if no box has it.
    """
    names = list(MASTER)
    words = [name.partition("\n")[0] for name in names]
    if unknown := [stage for stage in stages if stage not in words]:
        raise ValueError(f"stage: expected one of {', '.join(words)}, got {unknown[0]!r}")
    lit = [word in stages for word in words]
    width = 6.9  # inches, the page's column
    sizes = [CHARACTER_IN * max(len(line) for line in name.split("\n")) + PAD_IN for name in names]
    gap = (width - sum(sizes)) / len(names)
    figure, ax = plt.subplots(figsize=(width, 0.7), facecolor="white")
    ax.set_position((0, 0, 1, 1))
    ax.set(xlim=(0, width), ylim=(-0.35, 0.35))
    ax.axis("off")
    left_edge = gap / 2
    for k, (name, size, chosen) in enumerate(zip(names, sizes, lit, strict=True)):
        box = {"boxstyle": "round", "facecolor": "#E69F00" if chosen else "#DDEEFF"}
        ax.text(left_edge + size / 2, 0, name, ha="center", va="center", fontsize=9, bbox=box)
        if k > 0:
            ax.annotate("", (left_edge, 0), (left_edge - gap, 0), arrowprops={"arrowstyle": "-|>"})
        left_edge = left_edge + size + gap
    return figure


def _loop(
    ax: Axes, title: str, boxes: Mapping[str, tuple[float, float]], labels: Sequence[str]
) -> None:
    """Boxes with an arrow from each to the next, and from the last to the first."""
    names = list(boxes)
    for a, b, text in zip(names, [*names[1:], names[0]], labels, strict=True):
        gap = 20 if boxes[a][0] == boxes[b][0] else 34  # boxes are wider than high
        ax.annotate(
            "", boxes[b], boxes[a], arrowprops={"arrowstyle": "-|>", "shrinkA": gap, "shrinkB": gap}
        )
        x, y = np.mean([boxes[a], boxes[b]], axis=0)
        if boxes[a][0] == boxes[b][0]:  # beside an upright arrow, above any other
            ax.text(x + 0.08, y, text, fontsize=9, va="center")
        else:
            plain = {"facecolor": "white", "edgecolor": "none", "pad": 1}
            ax.text(x, y + 0.14, text, fontsize=9, ha="center", va="bottom", bbox=plain)
        ax.text(
            *boxes[a],
            a,
            ha="center",
            va="center",
            fontsize=9,
            bbox={"boxstyle": "round", "facecolor": "#DDEEFF"},
        )
    ax.set(title=title, xlim=(-0.5, 3.6), ylim=(-0.5, 2.6))
    ax.axis("off")


def plot_rig(
    views: Mapping[str, tuple[ArrayLike, ArrayLike]],
    rod: ArrayLike,
    markers: ArrayLike,
    axes: ArrayLike,
) -> Figure:
    """The cameras and the rod in space; the world's y, which points down, is drawn downwards.

    Parameters
    ----------
    views : mapping of str to (centre (3,), corners (4, 3))
        For each camera's name its centre and the corners of what it sees, at any distance, world
        frame, mm.
    rod : array_like, shape (2, 3)
        The ends of the rod, world frame, mm.
    markers : array_like, shape (m, 3)
        The centres of its markers, world frame, mm.
    axes : array_like, shape (4, 3)
        The origin of the handle's frame and the tips of its axes x, y, z, world frame, mm.
    """
    figure = plt.figure(figsize=(7.5, 5.5), layout="constrained", facecolor="white")
    ax = figure.add_subplot(projection="3d")

    def draw(points: ArrayLike, colour: str, width: float = 1.0) -> None:
        x, y, z = as_points(points, "points", 3).T
        ax.plot(x, z, y, color=colour, linewidth=width)

    for (name, (centre, corners)), colour in zip(views.items(), COLOURS, strict=False):
        start, ends = np.asarray(centre, float), as_points(corners, "corners", 3)
        rays = ends - start
        tips = start + FRUSTUM_MM * rays / np.linalg.norm(rays, axis=1, keepdims=True)
        for tip in tips:
            draw([start, tip], colour)
        draw([*tips, tips[0]], colour, 2.0)
        # behind the camera, where none of its lines is
        ax.text(
            start[0],
            start[2],
            start[1],
            f"{name} ",
            color=colour,
            fontsize=12,
            ha="right",
            va="center",
        )
        sight = np.array([start, np.asarray(axes, float)[0]]).T
        ax.plot(sight[0], sight[2], sight[1], color=colour, linewidth=0.8, linestyle=":")
    draw(rod, "0.35", 6.0)
    spots = as_points(markers, "markers", 3)
    ax.scatter(spots[:, 0], spots[:, 2], spots[:, 1], s=14, color="k", depthshade=False)
    origin, *tips_of_axes = as_points(axes, "axes", 3)
    for end, colour, name in zip(tips_of_axes, ("red", "green", "blue"), "xyz", strict=True):
        draw([origin, end], colour, 2.5)
        beyond = end + 0.3 * (end - origin)
        middle = {"ha": "center", "va": "center"}
        ax.text(beyond[0], beyond[2], beyond[1], f"${name}$", color=colour, fontsize=12, **middle)
    ax.set(xlabel="$x$ / mm", ylabel="$z$ / mm", zlabel="$y$ / mm")
    for axis in "xyz":
        ax.locator_params(axis=axis, nbins=4)
    ax.invert_zaxis()
    ax.set_aspect("equal")
    ax.view_init(elev=18, azim=-35)
    return figure
