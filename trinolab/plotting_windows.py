"""The picture of a target that is followed in one image, after Fig. 6 (c), (d)."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import ArrayLike

from .markertrack import Look
from .plotting import COLOURS, show_image
from .window import Window

MARGIN_PX = 150


def plot_following(image: ArrayLike, looks: Sequence[Look]) -> Figure:
    """One instant twice, cut out: where the filter looks, and what it finds there.

    Parameters
    ----------
    image : array_like, shape (height, width)
    looks : sequence of Look
        Up to this instant: two or more, each with markers.
    """
    now, boxes = looks[-1], [look.box for look in looks if look.box is not None]
    if len(boxes) < max(len(looks), 2) or now.window is None:
        raise ValueError(f"looks: expected two or more with markers, got {len(boxes)} of {len(looks)}")
    centres, searched = np.array([box.centre for box in boxes]), now.window
    view = searched.grown(MARGIN_PX).clipped(np.shape(image)[::-1]) or searched
    figure, axes = plt.subplots(1, 2, figsize=(8.5, 5.2), layout="constrained", facecolor="white")
    for ax, title, found, points in zip(axes, ("(c) predicted", "(d) found and corrected"), (None, now.markers.uv),
                                        (centres[:-1], centres), strict=True):
        show_image(image, found, title=title, ax=ax)
        _outline(ax, searched, COLOURS[1], "search window")
        ax.plot(points[:, 0], points[:, 1], ".-", color=COLOURS[2], label="centres so far")
        ax.set(xlim=(view.u, view.u + view.width), ylim=(view.v + view.height, view.v))
    _outline(axes[0], boxes[-2], COLOURS[3], "markers, one instant ago")
    _outline(axes[1], boxes[-1], COLOURS[3], "markers now")
    for ax in axes:
        ax.legend(fontsize=8, loc="lower right")
    return figure


def _outline(ax: Axes, window: Window, colour: str, label: str) -> None:
    ax.add_patch(Rectangle((window.u - 0.5, window.v - 0.5), window.width, window.height, fill=False, edgecolor=colour,
                           linewidth=2, label=label))
