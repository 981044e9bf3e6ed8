"""Pictures of the pose: two rays that meet, and the frames that a point is carried through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab.camera import Camera, Rig
from trinolab.checks import Array, as_array

from .basics import COLOURS, subplots

AXIS_MM = 55.0  # length of a frame's axes
BEYOND = 1.15  # a ray is drawn so much farther than the point
FRAME_COLOURS = (COLOURS[0], "#A06A00", COLOURS[2], "black")  # legible as text


def plot_two_rays(
    left: Camera, right: Camera, uv_left: ArrayLike, uv_right: ArrayLike, wedge_px: float
) -> Axes:
    """The rays of two pixels, seen from above: the plane x, z of the left camera's frame.

    Parameters
    ----------
    left, right : Camera
    uv_left, uv_right : array_like, shape (2,)
        Pixels of one marker.
    wedge_px : float
        Around each ray the wedge of the pixels that lie up to so far beside it along u is shaded.
        The marker lies where both wedges overlap.
    """
    _, ax = subplots(figsize=(6.9, 2.9))
    pixels = [as_array(uv, "uv", (2,)) for uv in (uv_left, uv_right)]
    starts = [_from_above(left, camera.centre[None])[0] for camera in (left, right)]
    middles, edges = [], []
    for camera, uv, start, colour in zip((left, right), pixels, starts, COLOURS, strict=False):
        beside = np.array([[0.0, 0.0], [-wedge_px, 0.0], [wedge_px, 0.0]])
        ends = _from_above(left, camera.centre + camera.rays(uv + beside))
        middles.append(ends[0] - start)
        edges.append(ends[1:] - start)
        reach = 2.0 * np.abs(left.T_cam_world.apply(right.centre)).max() + 600.0
        middle, low, high = start + reach * (ends - start)
        ax.fill(*np.array([start, low, high]).T, color=colour, alpha=0.25, linewidth=0)
        ax.plot(*np.array([start, middle]).T, color=colour, label=f"{camera.name.upper()}'s ray")
        ax.plot(*start, "o", color=colour)
        ax.annotate(camera.name.upper(), start, (-6, 0), textcoords="offset points", ha="right")
    marker = _crossing(starts, middles)
    sides = [(0, 0), (0, 1), (1, 1), (1, 0)]  # of the two wedges, in order around the overlap
    lozenge = np.array([_crossing(starts, [edges[0][i], edges[1][j]]) for i, j in sides])
    ax.fill(*lozenge.T, color=COLOURS[4], alpha=0.6, linewidth=0, label="both wedges")
    ax.plot(*marker, "o", color="black", label="the marker", zorder=3)
    ax.plot(*np.array(starts).T, "--", color=COLOURS[2], label="baseline")
    xs = [starts[0][1], starts[1][1], marker[1]]
    ax.set(xlabel="$z$ / mm", ylabel="$x$ / mm", aspect="equal")
    ax.set_xlim(-110, max(BEYOND * marker[0], 1.04 * lozenge[:, 0].max()))
    ax.set_ylim(min(xs) - 45, max(xs) + 45)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.5), ncols=5, fontsize=9)
    return ax


def _crossing(starts: Sequence[Array], ways: Sequence[Array]) -> Array:
    """Where two lines of the plane meet, shape (2,)."""
    far = np.linalg.solve(np.stack([ways[0], -ways[1]], axis=1), starts[1] - starts[0])
    return starts[0] + far[0] * ways[0]


def plot_frames(rig: Rig, T_world_handle: RigidTransform) -> Figure:
    """The frames of a rig's cameras and of the handle, and the ways of Eq. 21 and 23 between them.

    Parameters
    ----------
    rig : Rig
        Its first camera's frame stands for the world, as in the paper.
    T_world_handle : RigidTransform
        mm.
    """
    figure, ax = subplots(figsize=(6.9, 3.8))
    frames = {camera.name: camera.T_world_cam for camera in rig.cameras}
    frames["handle"] = T_world_handle
    for (name, T), colour in zip(frames.items(), FRAME_COLOURS, strict=False):
        draw_frame(ax, name, T, colour)
    world = oblique(rig.cameras[0].centre)
    ways = {"Eq. 21": rig.cameras[1].centre, "Eq. 23": T_world_handle.translation}
    places = (("right", (-14, -4)), ("center", (0, 4)))  # beside the line, clear of the arrows
    for (label, start), (side, shift) in zip(ways.items(), places, strict=True):
        ends = np.stack([oblique(start), world])
        ax.plot(*ends.T, ":", color="black", linewidth=1)
        u, v = ends.mean(axis=0)
        ax.annotate(label, (u, v), shift, textcoords="offset points", ha=side)
    ax.set_aspect("equal")
    ax.margins(0.08)
    ax.axis("off")
    return figure


def oblique(points: ArrayLike) -> Array:
    """World points on the page, shape (..., 2): z to the right, y down, x obliquely backwards."""
    return np.asarray(points, dtype=float) @ np.array([[-0.4, 0.45], [0.0, -1.0], [1.0, 0.0]])


def _from_above(left: Camera, points: Array) -> Array:
    """z and x in the left camera's frame, shape (n, 2)."""
    return left.T_cam_world.apply(points)[:, [2, 0]]


def draw_frame(
    ax: Axes, name: str, T: RigidTransform, colour: str, length_mm: float = AXIS_MM
) -> None:
    """Three labelled arrows at a frame's origin; a camera's name in capitals, as in the text."""
    origin = oblique(T.translation)
    u, v = origin
    ax.plot(u, v, "o", color=colour)
    shown = name.upper() if name.startswith("ccd") else name
    ax.annotate(shown, (u, v), (6, 9), textcoords="offset points", color=colour, fontweight="bold")
    for axis, letter in zip(T.rotation.as_matrix().T, "xyz", strict=True):
        along = length_mm * oblique(axis)
        tip = (u + along[0], v + along[1])
        ax.plot(*tip, " ")  # so that the limits hold it
        ax.annotate("", tip, (u, v), arrowprops={"arrowstyle": "-|>", "color": colour})
        x, y = origin + 1.25 * along
        ax.text(x, y, f"${letter}$", color=colour, ha="center")
