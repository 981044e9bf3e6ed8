"""How the light on an unchanged scene has changed from a background to a frame (Sect. 4.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .checks import Array, as_image, as_number

WHITE = 255.0  # grey level at which a pixel is saturated: its light is this, or more
DARK = 10.0  # grey level from which a ratio of greys says something

_MOST = float(np.log(4.0))  # a change of light; beyond it the lens is covered
_BIN, _BLUR, _NEAR = 0.01, 12, 0.15  # of ln ratio: a bin, half the bins that are blurred, what agrees with the peak
_LEAST = 0.1  # share of the pixels that have to agree


def light_gain(frame: ArrayLike, background: ArrayLike, step: int = 4) -> float:
    """How much brighter the light has become: the commonest ratio of frame to background.

    One factor for all of the image. What has not moved agrees on it, even where it is less than half of the image; the
    ratios of what has moved are spread.

    Parameters
    ----------
    frame, background : array_like, shape (height, width)
        Saturated pixels of the frame are left out, and those that are dark in the background.
    step : int
        Every `step`-th pixel of both directions is taken.

    Returns
    -------
    float
        1 if nothing in the background is brighter than 10 grey levels, or no factor within 1/4 and 4 is shared by a
        tenth of the pixels: that is no change of light but a covered lens.

    Raises
    ------
    ValueError
        If one of the two is no grey image, they differ in size, or `step` is less than 1.
    """
    grey = as_image(frame, "frame")
    old = as_image(background, "background", (grey.shape[1], grey.shape[0]))
    stride = int(as_number(step, "step", 1, 2**31))
    few, base = grey[::stride, ::stride], old[::stride, ::stride]
    told = (base > DARK) & (few > 0) & (few < WHITE)
    logs = np.log(few[told] / base[told])
    counts, edges = np.histogram(logs, round(2 * _MOST / _BIN), (-_MOST, _MOST))
    blurred = np.convolve(counts, np.hanning(2 * _BLUR + 1), "same")
    near: Array = logs[np.abs(logs - edges[blurred.argmax()]) < _NEAR]
    return float(np.exp(np.median(near))) if near.size > _LEAST * np.count_nonzero(base > DARK) else 1.0
