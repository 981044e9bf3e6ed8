"""Exercises of chapter 3: the background."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker

__all__ = ["background_after", "renewed_twice"]

background_after_exercise = FunctionExerciseMaker(
    "03.3", "Eq. 6 over a film", "ex-background-film", points=4
)


@background_after_exercise.solution
def background_after(frames, first, alpha):
    """Renew a background with one frame after the other (Eq. 6).

    Parameters
    ----------
    frames
        (n, height, width), the frames in their order, grey levels from 0 to 255; n may be 0.
    first
        (height, width), B_0, the background before the first of them.
    alpha
        The share of a frame that the background takes in.

    Returns
    -------
    ndarray
        (height, width), B_n, of float numbers.
    """
    B = np.array(first, dtype=float)
    for frame in frames:
        B = alpha * frame + (1 - alpha) * B
    return B


@background_after_exercise.cases
def _film_cases(rng):
    film = rng.integers(0, 256, (6, 3, 4)).astype(np.uint8)
    first = rng.integers(20, 70, (3, 4)).astype(np.uint8)
    return [
        (film, first, 0.05),
        (film, first, 0.2),
        (film[:1], first, 0.1),
        (film[:0], first, 0.1),
        (film, first, 1.0),
        (np.repeat(film[:1], 40, axis=0), first, 0.02),
    ]


@background_after_exercise.mistake("3, What the paper says")
def _shares_swapped(frames, first, alpha):
    """The two shares are swapped: the frame has the share alpha, the old background the rest."""
    return background_after(frames, first, 1 - alpha)


@background_after_exercise.mistake("3, The algorithm")
def _first_frame_as_start(frames, first, alpha):
    """The first frame is taken for the background at the start. That is `first`, the empty bench."""
    return background_after(frames, frames[0] if len(frames) else first, alpha)


@background_after_exercise.mistake("3, The algorithm")
def _from_black(frames, first, alpha):
    """The background begins with black. It has to begin with `first`."""
    return background_after(frames, np.zeros(np.shape(first)), alpha)


@background_after_exercise.mistake("3, The algorithm")
def _whole_grey_levels(frames, first, alpha):
    """The background is cut down to whole grey levels. A slow rate moves it by less than one a
    frame, so that it has to be of float numbers.
    """
    B = np.array(first)
    for frame in frames:
        B = (alpha * frame + (1 - alpha) * B).astype(np.uint8)
    return B


@background_after_exercise.mistake("3, What does the background remember?")
def _always_from_first(frames, first, alpha):
    """Each frame is mixed with the first background. It has to be mixed with the one that the last
    frame has left.
    """
    B = np.array(first, dtype=float)
    for frame in frames:
        B = alpha * frame + (1 - alpha) * np.asarray(first)
    return B


@background_after_exercise.mistake("3, What does the background remember?")
def _plain_mean(frames, first, alpha):
    """The frames are averaged first. In Eq. 6 later frames have more weight than earlier ones."""
    mean = np.mean(frames, axis=0) if len(frames) else first
    return alpha * mean + (1 - alpha) * np.asarray(first)


renewed_twice_exercise = FunctionExerciseMaker("03.4", "Two rates", "ex-background-write", points=4)


@renewed_twice_exercise.solution
def renewed_twice(frame, B, moving, alpha, slow):
    """Renew a background at two rates.

    Parameters
    ----------
    frame
        (height, width), grey levels.
    B
        (height, width), the background so far.
    moving
        (height, width), True where something moves.
    alpha
        The rate where nothing moves.
    slow
        The rate where something moves.

    Returns
    -------
    ndarray
        (height, width), the new background.
    """
    rate = np.where(moving, slow, alpha)
    return rate * frame + (1 - rate) * B


@renewed_twice_exercise.cases
def _rates_cases(rng):
    B = rng.uniform(30, 60, (4, 5))
    frame = rng.integers(0, 256, (4, 5)).astype(float)
    moving = rng.random((4, 5)) < 0.4
    return [
        (frame, B, moving, 0.05, 0.005),
        (frame, B, moving, 0.05, 0.0),
        (frame, B, moving, 0.1, 0.1),
        (frame, B, np.zeros_like(moving), 0.2, 0.01),
        (frame, B, np.ones_like(moving), 0.2, 0.01),
        (frame, B, moving, 0.01, 0.3),
    ]


@renewed_twice_exercise.mistake("3, A hand that rests, and a ghost")
def _rates_swapped(frame, B, moving, alpha, slow):
    """The two rates are swapped: what moves is renewed at the rate `slow`."""
    return renewed_twice(frame, B, moving, slow, alpha)


@renewed_twice_exercise.mistake("3, And the hand that rests?")
def _mask_alone(frame, B, moving, alpha, slow):
    """What moves is not renewed at all. That is the mask; here it has a rate of its own."""
    return renewed_twice(frame, B, moving, alpha, 0.0)


@renewed_twice_exercise.mistake("3, A hand that rests, and a ghost")
def _rates_multiplied(frame, B, moving, alpha, slow):
    """`slow` is a rate, and not a share of alpha: it is not multiplied by it."""
    return renewed_twice(frame, B, moving, alpha, alpha * slow)


@renewed_twice_exercise.mistake("3, What the paper says")
def _frame_kept(frame, B, moving, alpha, slow):
    """Frame and background have each other's share: the rate is the frame's."""
    return renewed_twice(frame, B, moving, 1 - alpha, 1 - slow)


@renewed_twice_exercise.mistake("3, And the hand that rests?")
def _mask_turned_round(frame, B, moving, alpha, slow):
    """The mask is turned round: you renew what moves, and keep what does not."""
    return renewed_twice(frame, B, moving, alpha=0.0, slow=alpha)


@renewed_twice_exercise.mistake("3, And the hand that rests?")
def _as_printed(frame, B, moving, alpha, slow):
    """Everything is renewed at the rate alpha. That is Eq. 6 as printed, and `moving` is not used."""
    return renewed_twice(frame, B, moving, alpha, alpha)


EXERCISES = (
    background_after_exercise.made(),
    renewed_twice_exercise.made(),
)
