"""The moving part of an image: the difference from a background, and the background's renewal (Eq.
5-6, Sect. 4.1).

The background is an array that is passed in and returned: float32, or float64 if it was that
already. Where the light on the scene has changed, its factor is estimated first (beyond the paper).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .checks import Array, as_image, as_number, as_whole
from .memory import room
from .window import Window

WHITE = 255  # grey level at which a pixel is saturated: its light is this, or more
DARK = 10.0  # grey level from which a ratio of greys says something
_MOST = float(np.log(4.0))  # a change of light; beyond it the lens is covered
_BINS = 277  # of the histogram, 0.01 in ln ratio wide
_CELLS = 8  # a bin, for the median
_BLUR = 12  # bins on either side over which the histogram is smoothed
_NEAR = 0.15  # distance from the peak, in ln ratio, within which a pixel agrees with it
_LEAST = 0.1  # share of the pixels that have to agree


@dataclass(frozen=True)
class BackgroundParameters:
    """Parameters of the background's subtraction and renewal.

    Attributes
    ----------
    update_rate : float
        alpha of Eq. 6, the weight of a new frame, 0 to 1 per frame. After about 1/alpha frames the
        background contains the share 1 - 1/e of a change.
    difference_threshold : float
        T of Eq. 5, grey levels.
    shadow_share : float
        The share of the light that a shadow may take, 0 to 1 (see `difference`); 0 is Eq. 5 as
        printed. The default is the best of 0, 0.1, ... 0.5 on persons under a dull sky, outlined by
        hand: the F1 of 0, 0.2 and 0.3 is 0.85, 0.97 and 0.96 (OpenCV's `vtest`, 18 frames; 0.2
        exceeds 0.3 by 0.006 to 0.012, 95 %). Against a low sun it is 0.80, 0.66 and 0.60 (the demo
        of Sports2D, 12 frames; by 0.047 to 0.081). The lamp of the simulated bench gives 0.3 of its
        light: in `hard`, 0.3 leaves 0.0004 % of the bench false, 0.2 leaves 0.0008 %, and 0 leaves
        0.9 %.
    min_pixels : int
        The second threshold of Sect. 4.1, px: something moves if more pixels than these have
        changed. The default is for images of 1280 x 1024.
    masked_rate : float or None
        alpha where something moves (see `update`); 0 keeps the old background there. None is Eq. 6
        as printed, which absorbs a handle at rest.
    compensate_light : bool
        Scale the background to the frame's light before it is compared (see
        `background.light_gain`).
    """

    update_rate: float = 0.01
    difference_threshold: float = 15.0
    shadow_share: float = 0.2
    min_pixels: int = 500
    masked_rate: float | None = 0.0
    compensate_light: bool = True

    def __post_init__(self) -> None:
        as_number(self.update_rate, "update_rate", 0.0, 1.0)
        as_number(self.difference_threshold, "difference_threshold", 0.0)
        as_number(self.shadow_share, "shadow_share", 0.0, 1.0)
        as_number(self.min_pixels, "min_pixels", 0.0)
        if self.masked_rate is not None:
            as_number(self.masked_rate, "masked_rate", 0.0, 1.0)
        if not isinstance(self.compensate_light, bool):
            raise ValueError(
                f"compensate_light: expected True or False, got {self.compensate_light!r}"
            )

    @property
    def slow_rate(self) -> float:
        """alpha of what moves or is saturated."""
        return self.update_rate if self.masked_rate is None else self.masked_rate


class Difference(NamedTuple):
    """A differential image and the pixels that moved.

    Attributes
    ----------
    image : ndarray, shape (height, width)
        D_k: the frame where it moved, elsewhere 0; of the frame's type.
    mask : ndarray of bool, shape (height, width)
        Where it moved. Moving pixels of grey 0 are included, although D_k loses them.
    """

    image: np.ndarray
    mask: np.ndarray


class Detection(NamedTuple):
    """The moving part of one frame: see `Difference`, and W_ROI, None if nothing moves."""

    image: np.ndarray
    mask: np.ndarray
    window: Window | None


def difference(
    frame: ArrayLike, background: ArrayLike, difference_threshold: float, shadow_share: float = 0.0
) -> Difference:
    """Keep the pixels of a frame that differ from the background by more than a threshold (Eq. 5).

    A shadow darkens a background b to between (1 - shadow_share) b and b. With a share above 0, a
    pixel has moved if its distance from that whole range exceeds the threshold; an object that is
    only slightly darker than its background is then missed.

    Parameters
    ----------
    frame, background : array_like, shape (height, width)
        f_k and f_b, grey levels.
    difference_threshold : float
        T, grey levels, not negative.
    shadow_share : float
        The share of the light that a shadow may take, 0 to 1.
    """
    grey, old = _frame_and_background(frame, background)
    threshold = as_number(difference_threshold, "difference_threshold", 0.0)
    share = as_number(shadow_share, "shadow_share", 0.0, 1.0)
    mask = has_moved(grey.astype(old.dtype), old, threshold, share)
    return Difference(_read_only(np.where(mask, grey, grey.dtype.type(0))), _read_only(mask))


def has_moved(
    grey: Array, background: Array, difference_threshold: float, shadow_share: float
) -> np.ndarray:
    """The pixels that `difference` keeps, bool; images of one float type, unchecked (Eq. 5)."""
    change = grey - background
    mask = change > difference_threshold
    if change.min() < -difference_threshold:  # else there is no shadow to tell from what moved
        lowest = background * -shadow_share
        lowest -= difference_threshold
        mask |= change < lowest
    return mask


def update(
    background: ArrayLike,
    frame: ArrayLike,
    update_rate: float,
    mask: ArrayLike | None = None,
    masked_rate: float = 0.0,
) -> np.ndarray:
    """Take a share of a frame into the background (Eq. 6).

    Without a mask this is the equation as printed: every pixel is renewed, and a handle at rest is
    absorbed after a few 1/alpha frames. With the mask of the moving pixels, the background stays as
    it is there. It then never adapts where the background itself has changed, unless `masked_rate`
    is above 0.

    Parameters
    ----------
    background, frame : array_like, shape (height, width)
        B_(k-1) and f_k, grey levels.
    update_rate : float
        alpha, 0 to 1.
    mask : array_like of bool, shape (height, width), optional
        Pixels with a rate of their own.
    masked_rate : float
        Their alpha, 0 to 1.

    Returns
    -------
    ndarray of float32 or float64, shape (height, width)
        B_k, read-only.
    """
    grey, old = _frame_and_background(frame, background)
    alpha = as_number(update_rate, "update_rate", 0.0, 1.0)
    slow = as_number(masked_rate, "masked_rate", 0.0, 1.0)
    level = grey.astype(old.dtype)
    new = renewed(old, level, alpha)
    if mask is not None:
        moved = _as_mask(mask, grey.shape)
        new[moved] = renewed(old[moved], level[moved], slow)
    return _read_only(new)


def renewed(background: Array, grey: Array, update_rate: float) -> Array:
    """The renewed background, as `update` gives it; arrays of one float type, unchecked (Eq. 6)."""
    new = background * (1 - update_rate)
    new += grey * update_rate
    return new


def moving_window(mask: ArrayLike, min_pixels: int = 0) -> Window | None:
    """The minimum upright bounding rectangle of the largest moving region, W_ROI (Sect. 4.2).

    (The paper says "maximum".) Pixels that touch at a corner belong together. Of several regions
    with the most pixels it is the first from the top.

    Parameters
    ----------
    mask : array_like of bool, shape (height, width)
        From `difference`.
    min_pixels : int
        Nothing moves unless more pixels than these have moved in the whole image.

    Returns
    -------
    Window or None
        None if nothing moves.
    """
    return _window(_as_mask(mask), as_number(min_pixels, "min_pixels", 0.0))


def _window(moved: np.ndarray, min_pixels: float) -> Window | None:
    """`moving_window` of a mask that needs no check."""
    pixels = np.count_nonzero(moved)
    if pixels <= min_pixels:
        return None
    loops = _loops()
    if loops is None:
        return Window(*_largest_region(moved))
    return Window(*loops.largest_region(moved, pixels))


def _largest_region(mask: np.ndarray) -> np.ndarray:
    """`pixel_loops.largest_region` by OpenCV, which numbers the regions from the top."""
    boxes = cv2.connectedComponentsWithStatsWithAlgorithm(
        mask.view(np.uint8), 8, cv2.CV_32S, cv2.CCL_WU
    )[2]
    # the first one is what does not move
    return boxes[1 + boxes[1:, cv2.CC_STAT_AREA].argmax(), :4]


def step(
    background: ArrayLike,
    frame: ArrayLike,
    parameters: BackgroundParameters | None = None,
) -> tuple[np.ndarray, Detection]:
    """One instant: compare with the background, find the window, renew the background (Eq. 5, 6).

    The background is the light of the scene, which may exceed what a camera can record: a saturated
    pixel is compared with 255 and does not renew the background.

    Parameters
    ----------
    background, frame : array_like, shape (height, width)
    parameters : BackgroundParameters, optional

    Returns
    -------
    background : ndarray, shape (height, width)
        For the next instant.
    detection : Detection
    """
    return stepped(*_frame_and_background(frame, background), parameters or BackgroundParameters())


def stepped(
    frame: np.ndarray, background: np.ndarray, p: BackgroundParameters
) -> tuple[np.ndarray, Detection]:
    """`step` for images that need no check, the background of floats (Eq. 5, 6)."""
    gain = commonest_ratio(frame, background) if p.compensate_light else 1.0
    new, image, mask = _compared(frame, background, gain, p)
    window = _window(mask, p.min_pixels)
    return _read_only(new), Detection(_read_only(image), _read_only(mask), window)


def prepare() -> None:
    """Load the compiled loops, so that the first frame need not wait: 0.5 s, and on a new machine 2
    s, in which they are compiled.
    """
    _loops()


@cache
def _loops() -> ModuleType | None:
    """The compiled loops; None in a browser, where there is no Numba, and where no folder can be
    written to that keeps what it compiles.
    """
    try:
        from . import pixel_loops  # only here: `import trinolab` stays light
    except (ImportError, RuntimeError):
        return None
    return pixel_loops


def _compared(
    frame: np.ndarray, background: np.ndarray, gain: float, p: BackgroundParameters
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The next background, D_k and the mask; in one loop over the pixels of an image of bytes."""
    loops = _loops()
    if loops is None or frame.dtype != np.uint8 or background.dtype != np.float32:
        return _by_equations(frame, background, gain, p)
    results = (
        room(frame.shape, np.float32),
        room(frame.shape, np.uint8),
        room(frame.shape, bool),
    )
    loops.compare_and_renew(
        np.ascontiguousarray(frame),
        np.ascontiguousarray(background),
        gain,
        p.difference_threshold,
        p.shadow_share,
        p.update_rate,
        p.slow_rate,
        WHITE,
        *results,
    )
    return results


def _by_equations(
    frame: np.ndarray, background: np.ndarray, gain: float, p: BackgroundParameters
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The result of `pixel_loops.compare_and_renew`, by Eq. 5 and Eq. 6 one after the other."""
    expected = background * gain
    # f_k against what a camera can show of f_b
    image, mask = difference(
        frame, np.minimum(expected, WHITE), p.difference_threshold, p.shadow_share
    )
    kept = mask | (frame >= WHITE)
    return update(expected, frame, p.update_rate, kept, p.slow_rate), image, mask


def light_gain(frame: ArrayLike, background: ArrayLike, step: int = 8) -> float:
    """The factor by which the light has become brighter: the commonest ratio of frame to
    background.

    The whole image has one factor. The pixels that have not moved agree on it, even if they are
    fewer than half; the ratios of the others are scattered.

    Parameters
    ----------
    frame, background : array_like, shape (height, width)
        Saturated pixels of the frame are left out, and those that are dark in the background.
    step : int
        Every `step`-th pixel of both directions is taken. On the recordings, every eighth pixel
        gives a factor that differs from that of all pixels by 0.0003 (calm) and 0.0014 (hard), rms,
        and by 0.007 at most.

    Returns
    -------
    float
        1 if nothing in the background is brighter than 10 grey levels, or no factor within 1/4 and
        4 is shared by a tenth of the pixels, which means a covered lens and not a change of light.
    """
    grey, old = _frame_and_background(frame, background)
    return commonest_ratio(grey, old, as_whole(step, "step", 1, 2**31))


def commonest_ratio(frame: np.ndarray, background: np.ndarray, step: int = 8) -> float:
    """The result of `light_gain` for images that are checked."""
    base = np.ascontiguousarray(background[::step, ::step])
    few = frame[::step, ::step].astype(base.dtype)
    usable = (base > DARK) & (few > 0) & (few < WHITE)
    if not usable.any():
        return 1.0
    logs = np.log(few[usable] / base[usable])
    # The cells rise with the ratio; the first and the last one take all that is beyond.
    cells = _BINS * _CELLS
    cell = np.clip((logs / _MOST + 1) * (cells / 2) + 1, 0, cells + 1).astype(np.intp)
    counts = np.bincount(cell, minlength=cells + 2)
    histogram = counts[1:-1].reshape(_BINS, _CELLS).sum(axis=1)
    smooth = np.convolve(histogram, np.hanning(2 * _BLUR + 1), "same")
    away = logs - float(np.linspace(-_MOST, _MOST, _BINS + 1)[smooth.argmax()])
    near = np.count_nonzero(np.abs(away) < _NEAR)
    if near <= _LEAST * np.count_nonzero(base > DARK):
        return 1.0
    # the median of those that are near: they follow each other in order
    middle = np.count_nonzero(away <= -_NEAR) + np.array([(near - 1) // 2, near // 2])
    return float(np.exp(_in_order(logs, cell, counts, middle).mean(dtype=logs.dtype)))


def _in_order(values: Array, cell: np.ndarray, counts: np.ndarray, ranks: np.ndarray) -> Array:
    """The values of two ranks, the lower first, by cells that rise with the value: only those of
    the cells about them are ordered. A partition takes ten times as long where many are equal.
    """
    up_to = np.cumsum(counts)  # how many values lie in a cell or below it
    first, last = np.searchsorted(up_to, ranks, side="right")
    ordered = np.sort(values[(cell >= first) & (cell <= last)])
    return ordered[ranks - (up_to[first] - counts[first])]


def _frame_and_background(frame: ArrayLike, background: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Both as images of one size, the background as floats."""
    grey = as_image(frame, "frame")
    old = as_image(background, "background", (grey.shape[1], grey.shape[0]))
    return grey, old if old.dtype == np.float64 else old.astype(np.float32, copy=False)


def _as_mask(value: ArrayLike, shape: tuple[int, ...] | None = None) -> np.ndarray:
    mask = np.ascontiguousarray(value)
    if mask.dtype != bool or mask.ndim != 2 or mask.size == 0 or shape not in (None, mask.shape):
        raise ValueError(
            f"mask: expected bool of shape {shape or '(height, width)'}, got {mask.dtype} {mask.shape}"
        )
    return mask


def _read_only(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
