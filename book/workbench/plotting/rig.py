"""The bench in pictures: where the cameras stand, and how the markers lie on the rod."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from numpy.typing import ArrayLike

from trinolab.checks import as_points

from .basics import COLOURS, row_of_panels

FRUSTUM_MM = 90.0  # length of the pyramids that stand for cameras


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


def plot_layouts(
    layouts: Mapping[str, Sequence[ArrayLike]], diameter_deg: float, diameter_mm: float
) -> Figure:
    """Rods unrolled: each marker by its angle about the axis and its place along it.

    Parameters
    ----------
    layouts : mapping of str to (angles_deg (m,), axial_mm (m,))
        For each rod's name its markers, in the order of their numbers.
    diameter_deg, diameter_mm : float
        Of a marker, about the axis and along it.
    """
    figure, row = row_of_panels(len(layouts), (6.9, 2.6), sharey=True)
    for ax, (name, (angles, axial)) in zip(row, layouts.items(), strict=True):
        for number, (angle, place) in enumerate(
            zip(np.asarray(angles), np.asarray(axial), strict=True)
        ):
            ax.add_patch(Ellipse((angle, place), diameter_deg, diameter_mm, color=COLOURS[0]))
            ax.text(angle, place, str(number), color="w", ha="center", va="center", fontsize=9)
        ax.set(xlabel="angle about the axis / deg", xlim=(-30, 330), ylim=(-16, 16))
        ax.set_title(name, fontsize=10)
        ax.set_xticks(range(0, 301, 60))
    row[0].set_ylabel("along the axis / mm")
    return figure
