"""Picture of the matching: the epipolar plane in space."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import ArrayLike

from trinolab.camera import Camera
from trinolab.checks import Array, as_array, as_points

from .basics import COLOURS

PLANE_MM = 180.0  # distance from a camera's centre at which its image is drawn


def plot_epipolar_plane(
    left: Camera, right: Camera, uv: ArrayLike, depths_mm: Sequence[float]
) -> Figure:
    """A left pixel's ray in space, points on it, and what the right camera sees of them.

    Parameters
    ----------
    left, right : Camera
    uv : array_like, shape (2,)
        Pixel of the left image.
    depths_mm : sequence of float
        Distances of the points from the left camera's centre along the ray, mm, increasing.
    """
    pixel = as_array(uv, "uv", (2,))
    depths = as_array(depths_mm, "depths_mm", (None,))
    points = left.centre + depths[:, None] * left.rays(pixel[None])
    figure = plt.figure(figsize=(7.5, 4.2), layout="constrained", facecolor="white")
    ax: Axes3D = figure.add_subplot(projection="3d")
    for camera, colour in ((left, COLOURS[0]), (right, COLOURS[1])):
        _draw_camera(ax, camera, colour)
    ax.plot(*np.stack([left.centre, points[-1]]).T, color=COLOURS[0], label="ray of the left pixel")
    ax.scatter(*points.T, color="black", s=20, label="points that it may show")
    for point in points:
        ax.plot(*np.stack([right.centre, point]).T, color=COLOURS[1], linewidth=0.8)
    plane = np.stack([left.centre, points[-1], right.centre])
    ax.add_collection3d(Poly3DCollection([plane], facecolor=COLOURS[2], alpha=0.15))
    seen = _on_image(right, right.project(points))
    ax.plot(*seen.T, "o-", color=COLOURS[4], markersize=4, label="epipolar line, right image")
    _seen_from_the_side(ax)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def _draw_camera(ax: Axes3D, camera: Camera, colour: str) -> None:
    """A camera's centre, its name, and its image in front of it."""
    corners = _on_image(camera, np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * camera.size)
    ax.add_collection3d(Poly3DCollection([corners], facecolor=colour, alpha=0.15, edgecolor=colour))
    ax.scatter(*camera.centre, color=colour, s=30)
    ax.text(*camera.centre, f"  {camera.name.upper()}", color=colour)


def _seen_from_the_side(ax: Axes3D) -> None:
    """One scale for all directions, no axes; the first camera looks to the right."""
    ax.set_aspect("equal")
    ax.set_box_aspect(ax.get_box_aspect(), zoom=1.15)
    ax.set_axis_off()
    ax.view_init(elev=25, azim=30, roll=-90)


def _on_image(camera: Camera, uv: ArrayLike) -> Array:
    """Points of an image that is drawn in front of its camera, world frame, shape (n, 3)."""
    pixels = as_points(uv, "uv", 2)
    xy = camera.normalise(pixels)
    local = PLANE_MM * np.column_stack([xy, np.ones(len(xy))])
    return camera.T_world_cam.apply(local)
