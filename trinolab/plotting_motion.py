"""Figures of what moves: windows in an image, and what a detection found, missed and took for moving (Fig. 6)."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch, Rectangle
from numpy.typing import ArrayLike

from .checks import as_array
from .plotting import COLOURS
from .window import Window

_VERDICTS = {"background": "white", "found": "silver", "false": "#D55E00", "missed": "#0072B2"}


def mark_window(ax: Axes, window: Window, label: str = "", colour: str = COLOURS[1], style: str = "-") -> None:
    """Draw a window into an image's axes, around all of its pixels."""
    ax.add_patch(Rectangle((window.u - 0.5, window.v - 0.5), window.width, window.height, fill=False,
                           edgecolor=colour, linestyle=style, linewidth=1.5, label=label))


def show_verdict(mask: ArrayLike, inside: ArrayLike, outside: ArrayLike, title: str, ax: Axes) -> None:
    """Show which pixels count as moving, and which of them rightly.

    Parameters
    ----------
    mask : array_like of bool, shape (height, width)
        The detection.
    inside, outside : array_like of bool, shape (height, width)
        Pixels that truly moved, and that truly did not. What is neither is never false or missed.
    title : str
    ax : Axes
    """
    found, moved, still = (as_array(part, "mask", (None, None)) > 0 for part in (mask, inside, outside))
    kind = 1 * found + 1 * (found & still) + 3 * (~found & moved)
    ax.imshow(kind, cmap=ListedColormap(list(_VERDICTS.values())), vmin=0, vmax=3, interpolation="nearest")
    ax.set(title=title, xlabel="u / px", ylabel="v / px")
    ax.legend(handles=[Patch(facecolor=colour, edgecolor="black", label=name) for name, colour in _VERDICTS.items()],
              fontsize=8, loc="upper left")
