"""Masks of any background compared with the truth as those of `trinolab.background` are, and the
criterion of chapter 3.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from trinolab import background
from trinolab.background import Detection

from .ground_truth import Recorded, Regions, Watched, held, wrong

FIRST_S, STEP_S, RATE_HZ = 0.5, 1.5, 30  # the second before the step, and when the light steps
MOST_FALSE, MOST_MISSED = 0.001, 0.01  # of the bench, and of what moves


def judged(masks: Iterable[np.ndarray], truths: Sequence[Regions], min_pixels: int) -> Watched:
    """Errors of masks, as `ground_truth.watch` has them for `background.step`; they leave no
    background.
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
