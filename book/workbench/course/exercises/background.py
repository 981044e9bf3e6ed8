"""Exercises of chapter 3: the background."""

from __future__ import annotations

import numpy as np

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


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


def _shares_swapped(frames, first, alpha):
    return background_after(frames, first, 1 - alpha)


def _first_frame_as_start(frames, first, alpha):
    return background_after(frames, frames[0] if len(frames) else first, alpha)


def _from_black(frames, first, alpha):
    return background_after(frames, np.zeros(np.shape(first)), alpha)


def _whole_grey_levels(frames, first, alpha):
    B = np.array(first)
    for frame in frames:
        B = (alpha * frame + (1 - alpha) * B).astype(np.uint8)
    return B


def _always_from_first(frames, first, alpha):
    B = np.array(first, dtype=float)
    for frame in frames:
        B = alpha * frame + (1 - alpha) * np.asarray(first)
    return B


def _plain_mean(frames, first, alpha):
    mean = np.mean(frames, axis=0) if len(frames) else first
    return alpha * mean + (1 - alpha) * np.asarray(first)


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


def _rates_swapped(frame, B, moving, alpha, slow):
    return renewed_twice(frame, B, moving, slow, alpha)


def _mask_alone(frame, B, moving, alpha, slow):
    return renewed_twice(frame, B, moving, alpha, 0.0)


def _rates_multiplied(frame, B, moving, alpha, slow):
    return renewed_twice(frame, B, moving, alpha, alpha * slow)


def _frame_kept(frame, B, moving, alpha, slow):
    return renewed_twice(frame, B, moving, 1 - alpha, 1 - slow)


def _mask_turned_round(frame, B, moving, alpha, slow):
    return renewed_twice(frame, B, moving, alpha=0.0, slow=alpha)


def _as_printed(frame, B, moving, alpha, slow):
    return renewed_twice(frame, B, moving, alpha, alpha)


TIMES = ("twice as long", "as long", "half as long")

EXERCISES = (
    ValueExercise(
        "03.1",
        "pencil",
        "A dark rod",
        "ex-background-dark",
        2,
        (
            Mistake(
                "A shadow of s = 0.3 takes 30 % of the light, and 70 % are left.",
                "3, How does one tell a shadow from a hand?",
                {"lowest": 0.3 * 45 - 15},
            ),
            Mistake(
                "T is subtracted from the shadow's grey. You have subtracted it first and darkened "
                "what was left.",
                "3, How does one tell a shadow from a hand?",
                {"lowest": 0.7 * 30},
            ),
            Mistake(
                "A shadow only darkens. Upwards there is T alone.",
                "3, How does one tell a shadow from a hand?",
                {"highest": 1.3 * 45 + 15},
            ),
            Mistake(
                "This is the limit with the shadow's range. Without it the range is T on both sides.",
                "3, What the paper says",
                {"lowest_plain": 16.5},
            ),
            Mistake(
                "The shaded side has the grey 63, and 60 is the limit on a bench of exactly 45. The "
                "texture scatters by 7: what about a bench of 50?",
                "3, Where does T come from?",
                {"everywhere": "yes"},
            ),
        ),
        {
            "lowest": Asked(16.5, within=0.1),
            "highest": Asked(60.0, within=0.1),
            "lowest_plain": Asked(30.0, within=0.1),
            "everywhere": Asked("no", choices=("yes", "no")),
        },
    ),
    ValueExercise(
        "03.2",
        "pencil",
        "How low may T be?",
        "ex-background-threshold",
        2,
        (
            Mistake(
                "The factor sqrt 2 belongs to the start, where the background is a single frame. "
                "After long it is nearly clean.",
                "3, Where does T come from?",
                {"T": 14.87},
            ),
            Mistake(
                "The noise goes both ways: the two tails of the normal distribution share the one "
                "false pixel.",
                "3, Where does T come from?",
                {"T": 10.22},
            ),
            Mistake(
                "4.5 is the variance. T is counted in standard deviations.",
                "3, Where does T come from?",
                {"T": 22.3},
            ),
            Mistake(
                "You have counted the pixels that are too bright. As many are too dark.",
                "3, Where does T come from?",
                {"false_at_8": 110.5},
            ),
            Mistake(
                "At the start the background is a frame with the same noise: the difference has "
                "twice the variance.",
                "3, Where does T come from?",
                {"T_at_200": 17.31},
            ),
        ),
        {
            "T": Asked(10.52, "grey levels", within=0.06),
            "false_at_8": Asked(221.0, "pixels", within=6.0),
            "T_at_200": Asked(24.47, "grey levels", within=0.6),
        },
    ),
    FunctionExercise(
        "03.3",
        "write",
        "Eq. 6 over a film",
        "ex-background-film",
        4,
        (
            Mistake(
                "The two shares are swapped: the frame has the share alpha, the old background the "
                "rest.",
                "3, What the paper says",
                _shares_swapped,
            ),
            Mistake(
                "The first frame is taken for the background at the start. That is `first`, the "
                "empty bench.",
                "3, The algorithm",
                _first_frame_as_start,
            ),
            Mistake(
                "The background begins with black. It has to begin with `first`.",
                "3, The algorithm",
                _from_black,
            ),
            Mistake(
                "The background is cut down to whole grey levels. A slow rate moves it by less than "
                "one a frame, so that it has to be of float numbers.",
                "3, The algorithm",
                _whole_grey_levels,
            ),
            Mistake(
                "Each frame is mixed with the first background. It has to be mixed with the one that "
                "the last frame has left.",
                "3, What does the background remember?",
                _always_from_first,
            ),
            Mistake(
                "The frames are averaged first. In Eq. 6 later frames have more weight than earlier "
                "ones.",
                "3, What does the background remember?",
                _plain_mean,
            ),
        ),
        background_after,
        _film_cases,
    ),
    FunctionExercise(
        "03.4",
        "write",
        "Two rates",
        "ex-background-write",
        4,
        (
            Mistake(
                "The two rates are swapped: what moves is renewed at the rate `slow`.",
                "3, A hand that rests, and a ghost",
                _rates_swapped,
            ),
            Mistake(
                "What moves is not renewed at all. That is the mask; here it has a rate of its own.",
                "3, And the hand that rests?",
                _mask_alone,
            ),
            Mistake(
                "`slow` is a rate, and not a share of alpha: it is not multiplied by it.",
                "3, A hand that rests, and a ghost",
                _rates_multiplied,
            ),
            Mistake(
                "Frame and background have each other's share: the rate is the frame's.",
                "3, What the paper says",
                _frame_kept,
            ),
            Mistake(
                "The mask is turned round: you renew what moves, and keep what does not.",
                "3, And the hand that rests?",
                _mask_turned_round,
            ),
            Mistake(
                "Everything is renewed at the rate alpha. That is Eq. 6 as printed, and `moving` is "
                "not used.",
                "3, And the hand that rests?",
                _as_printed,
            ),
        ),
        renewed_twice,
        _rates_cases,
    ),
    ValueExercise(
        "03.5",
        "predict",
        "A day's light",
        "ex-background-daylight",
        3,
        (
            Mistake(
                "With this rate the background lags by T itself, and nothing is left for the noise. "
                "3 grey levels are allowed.",
                "3, Where does T come from?",
                {"alpha": 0.03 / 15.03},
            ),
            Mistake(
                "The ramp is per frame: 9 grey levels in 300 frames. You have taken its change in a "
                "second.",
                "3, What does the background remember?",
                {"alpha": 0.9 / 3.9},
            ),
            Mistake(
                "These are frames. There are 30 in a second.",
                "3, One pixel first",
                {"rod_s": 110.0},
            ),
            Mistake(
                "The jump is the rod's grey less the bench's, 45, and not the rod's grey.",
                "3, One pixel first",
                {"rod_s": 6.0},
            ),
            Mistake(
                "Lamp and hand are forgotten at the same pace: whatever the background adapts to, "
                "it forgets. That is why one rate cannot serve both.",
                "3, One pixel first",
                {"hand": "twice as long"},
            ),
            Mistake(
                "This is the time at the rate 0.01. Set `update_rate = 0.02`, and run the chapter "
                "again from its first cell.",
                "3, One pixel first",
                {"hand_s": 3.64},
            ),
        ),
        {
            "alpha": Asked(0.03 / 3.03, within=0.0004),
            "rod_s": Asked(3.67, "s", within=0.08),
            "hand": Asked("half as long", choices=TIMES),
            "hand_s": Asked(1.81, "s", within=0.03),
        },
    ),
    ValueExercise(
        "03.6",
        "project",
        "A second lamp",
        "ex-background-project",
        5,
        (
            Mistake(
                "This is the mean over all 60 frames. The lamp shines from frame 30 on: take those.",
                "3, The light step",
                {"false_right": 7.24},
            ),
            Mistake(
                "This is the mean after the light's step alone. Take all frames from 30 on.",
                "3, The light step",
                {"false_right": 23.5},
            ),
            Mistake(
                "This is the background as printed. Take the cured one.",
                "3, The light step",
                {"false_right": 36.8},
            ),
            Mistake(
                "The grey levels are cut down to whole numbers. Round them, as a camera does.",
                "3, Recordings with known truth",
                {"false_right": 13.4},
            ),
            Mistake(
                "These are shares. Per cent are asked for.",
                "3, The light step",
                {"false_right": 0.1447, "false_left": 0.00658},
            ),
            Mistake(
                "A tile that holds nothing but a hand has no bench to compare with. The hand's ratio "
                "is the commonest there.",
                "3, How does one tell a lamp from a hand?",
                {"hand_tile": "it finds the hand"},
            ),
        ),
        {
            "false_right": Asked(14.47, "%", within=0.4),
            "false_left": Asked(0.66, "%", within=0.06),
            "tiles_missed": Asked(65.0, "%", within=4.0),
            "hand_tile": Asked(
                "it swallows the hand",
                choices=("it finds the hand", "it swallows the hand", "it keeps the old light"),
            ),
        },
    ),
)
