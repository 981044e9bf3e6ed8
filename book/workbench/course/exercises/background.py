"""Exercises of chapter 3: the background."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker

background_after_exercise = FunctionExerciseMaker(
    "03.3", "Eq. 6 when frames are missing", "ex-background-film", points=4
)


def _renewed(frames, first, rates):
    B = np.array(first, dtype=float)
    for frame, alpha in zip(frames, rates, strict=True):
        B = alpha * frame + (1 - alpha) * B
    return B


def _gaps(times_s):
    return np.diff(times_s, prepend=0.0)


@background_after_exercise.solution
def background_after(frames, times_s, first, memory_s):
    """Renew a background with frames that come at uneven times (Eq. 6).

    Of an old background exp(-t / memory_s) is left after t seconds, however many frames have come in
    these seconds.

    Parameters
    ----------
    frames
        (n, height, width), the frames in their order, grey levels from 0 to 255; n may be 0.
    times_s
        (n,), when they were taken, in seconds since `first` was; they only grow.
    first
        (height, width), the background at the time 0.
    memory_s
        The memory, s.

    Returns
    -------
    ndarray
        (height, width), the background after the last frame, of float numbers.
    """
    B = np.array(first, dtype=float)
    before_s = 0.0
    for frame, now_s in zip(frames, times_s, strict=True):
        alpha = 1 - np.exp(-(now_s - before_s) / memory_s)
        B = alpha * frame + (1 - alpha) * B
        before_s = now_s
    return B


@background_after_exercise.cases
def _film_cases(rng):
    film = rng.integers(0, 256, (6, 3, 4)).astype(np.uint8)
    first = rng.integers(20, 70, (3, 4)).astype(np.uint8)
    even = np.arange(1, 7) / 30
    uneven = np.cumsum([1, 1, 4, 1, 12, 2]) / 30
    return [
        (film, even, first, 0.5),
        (film, uneven, first, 0.5),
        (film, uneven + 0.4, first, 2.0),
        (film[:1], np.array([0.3]), first, 0.2),
        (film[:0], np.array([]), first, 0.2),
        (np.repeat(film[:1], 40, axis=0), np.arange(1, 41) / 60, first, 5.0),
    ]


@background_after_exercise.mistake("3, One pixel first")
def _gap_by_memory(frames, times_s, first, memory_s):
    """The rate is the gap by the memory. That is right for short gaps alone: after a gap as long as
    the memory nothing would be left of the old background.
    """
    return _renewed(frames, first, _gaps(times_s) / memory_s)


@background_after_exercise.mistake("3, What the paper says")
def _shares_swapped(frames, times_s, first, memory_s):
    """The two shares are swapped: exp(-t / memory_s) is what is left of the old background."""
    return _renewed(frames, first, np.exp(-_gaps(times_s) / memory_s))


@background_after_exercise.mistake("3, What does the background remember?")
def _since_the_start(frames, times_s, first, memory_s):
    """The rate is made of the time since the start. What counts is the time since the last frame."""
    return _renewed(frames, first, 1 - np.exp(-np.asarray(times_s) / memory_s))


@background_after_exercise.mistake("3, What does the background remember?")
def _one_rate(frames, times_s, first, memory_s):
    """All frames get one rate, that of the mean gap. A frame after a long gap has to count more."""
    mean_s = _gaps(times_s).mean() if len(times_s) else 0.0
    return _renewed(frames, first, np.full(len(times_s), 1 - np.exp(-mean_s / memory_s)))


@background_after_exercise.mistake("3, The algorithm")
def _gap_before_the_first(frames, times_s, first, memory_s):
    """The first frame is taken for the background at the start. That is `first`, of the time 0."""
    rates = 1 - np.exp(-_gaps(times_s) / memory_s)
    return _renewed(frames, frames[0] if len(frames) else first, rates)


@background_after_exercise.mistake("3, The algorithm")
def _whole_grey_levels(frames, times_s, first, memory_s):
    """The background is cut down to whole grey levels. A slow rate moves it by less than one per
    frame, so that it has to be of float numbers.
    """
    B = np.array(first)
    for frame, gap_s in zip(frames, _gaps(times_s), strict=True):
        left = np.exp(-gap_s / memory_s)
        B = ((1 - left) * frame + left * B).astype(np.uint8)
    return B


@background_after_exercise.mistake("3, The algorithm")
def _from_black(frames, times_s, first, memory_s):
    """The background begins with black. It has to begin with `first`."""
    return background_after(frames, times_s, np.zeros(np.shape(first)), memory_s)


fitting_rates_exercise = FunctionExerciseMaker(
    "03.4", "Is there a right rate?", "ex-background-write", points=4
)


def _rates(lamp, lamp_s, hand, hand_s, T, fps, rate):
    """`fitting_rates` with another way from a jump to a rate."""
    lowest, highest = rate(lamp, T, lamp_s * fps), rate(hand, T, hand_s * fps)
    return np.array([lowest, highest]) if lowest <= highest else np.full(2, np.nan)


@fitting_rates_exercise.solution
def fitting_rates(lamp, lamp_s, hand, hand_s, T, fps):
    """The rates of Eq. 6 that forget a lamp soon enough, and a resting hand not too soon.

    Parameters
    ----------
    lamp
        By how many grey levels the lamp brightens the bench; more than `T`.
    lamp_s
        After so many seconds the lamp is no false alarm any more: the difference is `T` or less.
    hand
        By how many grey levels the hand differs from the bench; more than `T`.
    hand_s
        For so many seconds it is seen: the difference is `T` or more.
    T
        The threshold, grey levels.
    fps
        Frames a second.

    Returns
    -------
    array
        (2,), the lowest and the highest rate that do both; two NaN where there is none.
    """
    lowest = 1 - (T / lamp) ** (1 / (lamp_s * fps))
    highest = 1 - (T / hand) ** (1 / (hand_s * fps))
    if lowest > highest:
        return np.full(2, np.nan)
    return np.array([lowest, highest])


@fitting_rates_exercise.cases
def _rates_cases(rng):
    return [
        (22.5, 1.0, 45.0, 5.0, 15.0, 30.0),
        (22.5, 3.0, 45.0, 2.0, 15.0, 30.0),
        (30.0, 5.0, 120.0, 4.0, 10.0, 25.0),
        (40.0, 2.0, 60.0, 1.5, 12.0, 60.0),
        (40.0, 2.0, 40.0, 2.0, 12.0, 60.0),  # just one rate
        (20.0, 4.0, 200.0, 6.0, 15.0, 10.0),
        (*rng.uniform([20, 6, 90, 1], [25, 9, 150, 2]), 8.0, 30.0),
    ]


@fitting_rates_exercise.mistake("3, One pixel first")
def _seconds_as_frames(lamp, lamp_s, hand, hand_s, T, fps):
    """Seconds are taken for frames. A second has `fps` of them."""
    return fitting_rates(lamp, lamp_s, hand, hand_s, T, 1.0)


@fitting_rates_exercise.mistake("3, One pixel first")
def _linear(lamp, lamp_s, hand, hand_s, T, fps):
    """The way from the jump to T is shared out evenly over the frames. Each frame takes a share of
    what is left, so that the difference falls as a power.
    """
    return _rates(lamp, lamp_s, hand, hand_s, T, fps, lambda jump, T, k: (1 - T / jump) / k)


@fitting_rates_exercise.mistake("3, One pixel first")
def _logarithm(lamp, lamp_s, hand, hand_s, T, fps):
    """ln(jump / T) by the frames is right for slow rates alone: it is -ln(1 - alpha), and alpha is
    asked for.
    """
    return _rates(lamp, lamp_s, hand, hand_s, T, fps, lambda jump, T, k: np.log(jump / T) / k)


@fitting_rates_exercise.mistake("3, Exercises")
def _ends_swapped(lamp, lamp_s, hand, hand_s, T, fps):
    """The two ends are exchanged. The lamp has to be forgotten: it asks for *at least* a rate, and
    the hand for at most one.
    """
    return fitting_rates(hand, hand_s, lamp, lamp_s, T, fps)


@fitting_rates_exercise.mistake("3, Exercises")
def _none_not_told(lamp, lamp_s, hand, hand_s, T, fps):
    """Where the lowest rate lies above the highest there is none, and two NaN are asked for."""
    return np.array([_exact(lamp, T, lamp_s * fps), _exact(hand, T, hand_s * fps)])


def _exact(jump, T, k):
    return 1 - (T / jump) ** (1 / k)


@fitting_rates_exercise.mistake("3, One pixel first")
def _what_is_left(lamp, lamp_s, hand, hand_s, T, fps):
    """This is 1 - alpha, the share that is kept in a frame. The rate is the share that is renewed."""
    lowest, highest = _none_not_told(lamp, lamp_s, hand, hand_s, T, fps)
    return np.array([1 - lowest, 1 - highest]) if lowest <= highest else np.full(2, np.nan)


moving_pixels_exercise = FunctionExerciseMaker(
    "03.7", "Half of an empty bench moves", "ex-background-repair", points=3
)


@moving_pixels_exercise.solution
def moving_pixels(frame, background, T):
    """Which pixels of a frame move (Eq. 5).

    Parameters
    ----------
    frame
        (height, width), grey levels of the type uint8, as a camera gives them.
    background
        (height, width), of uint8 as well, or of float numbers.
    T
        The threshold, grey levels.

    Returns
    -------
    ndarray
        (height, width), True where frame and background differ by more than T, to either side.
    """
    difference = np.abs(frame.astype(float) - background)
    return difference > T


@moving_pixels_exercise.broken
def _in_eight_bits(frame, background, T):
    """The difference of two arrays of uint8 has no sign: 44 - 45 is 255 in eight bits."""
    difference = np.abs(frame - background)
    return difference > T


@moving_pixels_exercise.cases
def _moving_cases(rng):
    def image(low, high):
        return rng.integers(low, high, (8, 9)).astype(np.uint8)

    bench = image(40, 51)
    hand = bench.copy()
    hand[2:5, 3:8] = 180
    dark = bench.copy()
    dark[1:4, :4] = 5
    return [
        (image(40, 51), bench, 15),
        (hand, bench, 15),
        (dark, bench, 15.0),
        (image(0, 256), image(0, 256), 40),
        (hand, bench.astype(float) + 0.25, 15),
        (np.array([[60, 30, 61, 29]], np.uint8), np.full((1, 4), 45, np.uint8), 15),  # just T
        (np.array([[60, 30, 61, 29]], np.uint8), np.full((1, 4), 45.25), 15),
        (np.array([[255, 0, 3]], np.uint8), np.array([[0, 255, 250]], np.uint8), 20),
    ]


@moving_pixels_exercise.mistake("3, What the paper says")
def _brighter_alone(frame, background, T):
    """Only what is brighter than the background is seen. Eq. 5 has an absolute value: a dark thing
    moves as well.
    """
    return frame.astype(float) - background > T


@moving_pixels_exercise.mistake("3, One pixel first")
def _shorter_way_round(frame, background, T):
    """The difference is taken the shorter way round, as of angles. Black and white are neighbours
    then.
    """
    difference = np.abs(frame.astype(float) - background)
    return np.minimum(difference, 256 - difference) > T


@moving_pixels_exercise.mistake("3, One pixel first")
def _seven_bits(frame, background, T):
    """int8 reaches from -128 to 127 only: brighter greys become negative. Take a type that holds all
    differences.
    """
    with np.errstate(all="ignore"):
        one, other = (np.asarray(it).astype(np.uint8).astype(np.int8) for it in (frame, background))
        return np.abs(one.astype(float) - other) > T


@moving_pixels_exercise.mistake("3, What the paper says")
def _from_T_on(frame, background, T):
    """A difference of just T counts as moving. Eq. 5 asks for more than T."""
    return np.abs(frame.astype(float) - background) >= T


@moving_pixels_exercise.mistake("3, Exercises")
def _turned_round(frame, background, T):
    """What does not move is marked: the comparison is turned round."""
    return ~moving_pixels(frame, background, T)


EXERCISES = (
    background_after_exercise.made(),
    fitting_rates_exercise.made(),
    moving_pixels_exercise.made(),
)
