"""What everybody else would ask of a background: a running median and OpenCV's mixture of Gaussians,
and their masks held against the truth as those of `trinolab.background` are. Chapter 3.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike

from trinolab import background
from trinolab.background import Detection

from .ground_truth import Recorded, Regions, Watched, held, wrong

FIRST_S, STEP_S, RATE_HZ = 0.5, 1.5, 30  # the second before the step, and when the light steps
MOST_FALSE, MOST_MISSED = 0.001, 0.01  # of the bench, and of what moves


def running_median(
    frames: Iterable[ArrayLike],
    first: ArrayLike,
    difference_threshold: float,
    step_grey: float = 0.5,
) -> Iterator[np.ndarray]:
    """What moves in each frame, bool (height, width), by a background that takes equal steps.

    The background goes `step_grey` grey levels towards each frame, up or down, and comes to rest
    where half of the frames are brighter.

    Parameters
    ----------
    frames : iterable of array_like, shape (height, width)
    first : array_like, shape (height, width)
        The background before the first of them.
    difference_threshold : float
        T, grey levels.
    step_grey : float
        Grey levels a frame.
    """
    B = np.array(first, dtype=float)
    for frame in frames:
        yield np.abs(frame - B) > difference_threshold
        B = B + step_grey * np.sign(frame - B)


def mog2(
    frames: Iterable[ArrayLike], first: ArrayLike, update_rate: float, variance_ratio: float = 16.0
) -> Iterator[np.ndarray]:
    """What moves in each frame, bool (height, width), by OpenCV's mixture of Gaussians.

    Parameters
    ----------
    frames : iterable of array_like of uint8, shape (height, width)
    first : array_like of uint8, shape (height, width)
        The background before the first of them.
    update_rate : float
        alpha, a frame.
    variance_ratio : float
        How many variances a pixel may lie from a Gaussian that it belongs to, squared distance;
        OpenCV's own default.
    """
    model = cv2.createBackgroundSubtractorMOG2(varThreshold=variance_ratio)
    model.apply(np.asarray(first))
    for frame in frames:
        # 255 is what moves, 127 a shadow
        yield model.apply(np.asarray(frame), learningRate=update_rate) == 255


def judged(masks: Iterable[np.ndarray], truths: Sequence[Regions], min_pixels: int) -> Watched:
    """Masks held against the truth, as `ground_truth.watch` does it for `background.step`; they
    leave no background.
    """
    shares = []
    windows = []
    for mask, truth in zip(masks, truths, strict=True):
        window = background.moving_window(mask, min_pixels)
        shares.append(wrong(Detection(mask, mask, window), truth))
        windows.append(window)
    false, missed = np.array(shares).reshape(-1, 2).T
    return Watched(false, missed, windows, np.empty(0))


def survives_the_step(watched: Watched, recording: Recorded, camera: int) -> tuple[bool, ...]:
    """Whether a background survives the step of the light in `hard`, in three parts.

    In each frame after the step the false pixels stay below `MOST_FALSE` of the bench or below
    their most in the second before it, the missed ones below `MOST_MISSED` of what moves or below
    their most then, and the window holds each marker that the camera truly sees.
    """
    first, step = round(FIRST_S * RATE_HZ), round(STEP_S * RATE_HZ)
    parts = []
    for share, limit in ((watched.false, MOST_FALSE), (watched.missed, MOST_MISSED)):
        known = np.nan_to_num(share)  # NaN where nothing moves
        parts.append(bool(known[step:].max() <= max(known[first:step].max(), limit)))
    parts.append(bool(held(watched.windows, recording, camera)[step:].all()))
    return tuple(parts)
