"""How the light on an unchanged scene has changed from a background to a frame (Sect. 4.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .checks import as_image, as_number


def light_gain(frame: ArrayLike, background: ArrayLike, step: int = 4) -> float:
    """How much brighter the light has become: the median of frame by background.

    One factor for all of the image. It holds while what moves covers less than about a third of it.

    Parameters
    ----------
    frame, background : array_like, shape (height, width)
    step : int
        Every `step`-th pixel of both directions is taken.

    Returns
    -------
    float
        1 if nothing in the background is brighter than 10 grey levels, or the factor is not within 1/4 and 4: that is
        no change of light but a covered lens.

    Raises
    ------
    ValueError
        If one of the two is no grey image, they differ in size, or `step` is less than 1.
    """
    grey = as_image(frame, "frame")
    old = as_image(background, "background", (grey.shape[1], grey.shape[0]))
    stride = int(as_number(step, "step", 1, 2**31))
    few, base = grey[::stride, ::stride], old[::stride, ::stride]
    lit = base > 10
    gain = float(np.median(few[lit] / base[lit])) if lit.any() else 1.0
    return gain if 0.25 <= gain <= 4 else 1.0
