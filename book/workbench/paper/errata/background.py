"""Errata of Sect. 4.1: what the background's subtraction and renewal lose as printed (Eq. 5-6)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trinolab.background import BackgroundParameters, difference, update

from ..ledger import Effect

# grey levels of the standard scene, and T
BACKGROUND = 45.0
HANDLE = 90.0
THRESHOLD = 15.0
UPDATE_RATE = BackgroundParameters().update_rate  # the assumed one
FRAME_RATE = 30.0  # a second


def black_pixels() -> Effect:
    """The share of a black object's pixels that a count of the nonzero pixels of D_k finds
    (Eq. 5).
    """
    background = np.full((40, 60), BACKGROUND)
    frame = background.copy()
    frame[10:30, 20:30] = 0.0
    printed = np.where(np.abs(frame - background) > THRESHOLD, frame, 0.0)
    corrected = difference(frame, background, THRESHOLD).mask
    return Effect(
        "5",
        "share of the pixels of a black object that count as moving",
        "",
        np.count_nonzero(printed) / 200,
        np.count_nonzero(corrected) / 200,
        at_least=0.99,
    )


def resting_handle() -> Effect:
    """How long a handle that rests stays different from the background (Eq. 6)."""

    def printed(background: np.ndarray, frame: np.ndarray) -> np.ndarray:
        return UPDATE_RATE * frame + (1 - UPDATE_RATE) * background

    def masked(background: np.ndarray, frame: np.ndarray) -> np.ndarray:
        return update(background, frame, UPDATE_RATE, difference(frame, background, THRESHOLD).mask)

    meaning = (
        f"time until a resting handle has gone into the background: grey {HANDLE:g} before {BACKGROUND:g}, "
        f"alpha {UPDATE_RATE}, T {THRESHOLD:g}, {FRAME_RATE:g} frames per second"
    )
    return Effect("6", meaning, "s", _seconds_seen(printed), _seconds_seen(masked), at_least=60.0)


def _seconds_seen(
    renew: Callable[[np.ndarray, np.ndarray], np.ndarray], longest: float = 60.0
) -> float:
    """Seconds until no pixel differs any more; infinite if some still do after the longest time."""
    background = np.full((20, 30), BACKGROUND)
    frame = background.copy()
    frame[5:15, 10:20] = HANDLE
    for k in range(int(longest * FRAME_RATE)):
        if not difference(frame, background, THRESHOLD).mask.any():
            return k / FRAME_RATE
        background = renew(background, frame)
    return np.inf
