"""How small a search window can be: the filter's, and those of rules without a covariance.

A rule says where a target's last rectangle will be. It needs a margin around it: the filter's is its
gate, a rule of one line has one that is chosen, or that follows its last misses. Chapter 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from trinolab import image_track, kalman
from trinolab.checks import Array
from trinolab.kalman import KalmanParameters
from trinolab.window import Window

from .. import intervals

BLOCK = 15  # frames, half a second: neighbouring frames are alike
# of a margin that follows a rule's own misses: over so many frames, times the largest, px at least
FRAMES, TIMES, LEAST_PX = 10, 1.5, 8.0


class Seen(NamedTuple):
    """A target in the images of one camera.

    Attributes
    ----------
    name : tuple
        Of the recording and the camera.
    times_s : ndarray, shape (k,)
    boxes : sequence of Window or None
        Its rectangle; None where it was not seen.
    size : (int, int)
        Width and height of the images.
    """

    name: tuple[str, int]
    times_s: Array
    boxes: Sequence[Window | None]
    size: tuple[int, int]

    @property
    def centres(self) -> Array:
        """Of the rectangles, px, shape (k, 2); NaN where it was not seen."""
        return np.array([box.centre if box else (np.nan, np.nan) for box in self.boxes])


class Guess(NamedTuple):
    """Where a rule expects a target, and where it is.

    Attributes
    ----------
    block : tuple
        Recording, camera and half second.
    expected : Window
        The last rectangle, moved; without a margin.
    gate_px : float
        The filter's margin; NaN for a rule that has none.
    box : Window
        Where the target is, inside the image.
    size : (int, int)
        Of the image.
    """

    block: tuple[str, int, int]
    expected: Window
    gate_px: float
    box: Window
    size: tuple[int, int]


Pairs = Sequence[tuple[Guess, float]]  # guesses with their margins


def last_place(z: Array, k: int, gap: int = 1) -> Array:
    """The target of frame k is where it was seen `gap` frames before."""
    return z[k - gap]


def last_step(z: Array, k: int, gap: int = 1) -> Array:
    """It goes on as it went when it was seen last."""
    return z[k - gap] + gap * (z[k - gap] - z[k - gap - 1])


RULES: Mapping[str, Callable[[Array, int, int], Array]] = {
    "last place": last_place,
    "last step": last_step,
}


def filter_s_place(
    way: image_track.Track, times_s: Array, k: int, settings: KalmanParameters, gap: int = 1
) -> tuple[Array, float]:
    """Where the filter expects the target, px, and the margin that its gate makes, px."""
    before = kalman.State(way.updated.mean[k - gap], way.updated.covariance[k - gap])
    state = kalman.predict_motion(before, times_s[k] - times_s[k - gap], settings)
    S = state.covariance[:2, :2] + settings.sigma_px**2 * np.eye(2)
    gate = -2 * math.log(1 - settings.gate_probability)
    return state.mean[:2], math.sqrt(gate * S.diagonal().max())


def moved_to(box: Window, centre: Array) -> Window:
    """A rectangle about another centre."""
    u, v = np.rint(centre - (np.array([box.width, box.height]) - 1) / 2)
    return Window(int(u), int(v), box.width, box.height)


def guesses(
    targets: Sequence[Seen], rule: str, settings: KalmanParameters, gap: int = 1
) -> list[Guess]:
    """What a rule expects, wherever it can be asked: the target is seen now and was seen in the two
    frames before, or, as if it had been hidden since, in those before the gap.

    Parameters
    ----------
    targets : sequence of Seen
    rule : str
        "last place", "last step" or "filter".
    settings : KalmanParameters
        Of the filter.
    gap : int
        Frames since it was seen.
    """
    found = []
    for target in targets:
        z = target.centres
        way = image_track.track(target.times_s, z, settings) if rule == "filter" else None
        for k in range(gap + 1, len(z)):
            box, last, earlier = (target.boxes[i] for i in (k, k - gap, k - gap - 1))
            if box is None or last is None or earlier is None:
                continue
            gate_px = math.nan
            if way is not None:
                centre, gate_px = filter_s_place(way, target.times_s, k, settings, gap)
            else:
                centre = RULES[rule](z, k, gap)
            inside = box.clipped(target.size)
            if inside is not None:
                block = (*target.name, k // BLOCK)
                found.append(Guess(block, moved_to(last, centre), gate_px, inside, target.size))
    return found


def miss(guess: Guess) -> int:
    """By how many px the target sticks out of the expected rectangle; 0 if it is inside."""
    box, window = guess.box, guess.expected
    left, top = window.u - box.u, window.v - box.v
    right = box.width - window.width - left
    bottom = box.height - window.height - top
    return max(0, left, top, right, bottom)


def largest_miss(found: Sequence[Guess]) -> int:
    """The margin, px, that would have held the target in every frame."""
    return max((miss(guess) for guess in found), default=0)


def margins_by_last_misses(found: Sequence[Guess]) -> list[float]:
    """The margin of each guess, px, from the misses of the same camera's last frames."""
    margins = []
    for k, guess in enumerate(found):
        last = [one for one in found[max(0, k - FRAMES) : k] if one.block[:2] == guess.block[:2]]
        margins.append(max(LEAST_PX, TIMES * largest_miss(last)))
    return margins


def window_share(guess: Guess, margin_px: float) -> tuple[float, bool]:
    """The share of the image in the window, and whether it holds the target."""
    window = guess.expected.grown(margin_px).clipped(guess.size)
    share = window.area / (guess.size[0] * guess.size[1]) if window else 0.0
    return share, miss(guess) <= math.ceil(margin_px)


def rules_with_margins(
    recordings: Mapping[str, Sequence[Seen]], settings: KalmanParameters
) -> dict[str, dict[str, list[tuple[Guess, float]]]]:
    """Every rule with its margins, by the name of the rule and of the recording.

    A rule of one line has the margin of its largest miss, in hindsight or from the other recording,
    and the last step also one by its misses in the last ten frames. The filter has its gate, and
    its bare rectangle none.

    Parameters
    ----------
    recordings : mapping of str to sequence of Seen
        Two recordings, each with its cameras.
    settings : KalmanParameters
    """
    first, second = recordings
    other = {first: second, second: first}
    tried: dict[str, dict[str, list[tuple[Guess, float]]]] = {}
    for rule in RULES:
        found = {name: guesses(targets, rule, settings) for name, targets in recordings.items()}
        chosen = {name: largest_miss(one) for name, one in found.items()}
        for how, source in (
            ("in hindsight", {name: name for name in found}),
            ("from the other", other),
        ):
            tried[f"{rule}, {how}"] = {
                name: [(guess, float(chosen[source[name]])) for guess in one]
                for name, one in found.items()
            }
    tried["last step, of ten frames"] = {
        name: list(zip(one, margins_by_last_misses(one), strict=True))
        for name, one in found.items()
    }
    filtered = {name: guesses(targets, "filter", settings) for name, targets in recordings.items()}
    tried["filter"] = {
        name: [(guess, guess.gate_px) for guess in one] for name, one in filtered.items()
    }
    tried["the bare rectangle"] = {
        name: [(guess, 0.0) for guess in one] for name, one in filtered.items()
    }
    return tried


def by_blocks(pairs: Pairs) -> Array:
    """Sums of the windows' shares and how many there are, by half seconds of single cameras, shape
    (blocks, 2).
    """
    blocks: dict[tuple[str, int, int], list[float]] = {}
    for guess, margin_px in pairs:
        blocks.setdefault(guess.block, []).append(window_share(guess, margin_px)[0])
    return np.array([(sum(shares), len(shares)) for shares in blocks.values()])


def area_and_kept(pairs: Pairs) -> tuple[float, intervals.Interval, int]:
    """Mean share of the image in the window, its interval over half seconds, and how many windows
    hold their target.
    """
    blocks = by_blocks(pairs)
    return intervals.ratio(blocks), intervals.of_ratio(*blocks.T), held(pairs)


def held(pairs: Pairs) -> int:
    """How many windows hold their target."""
    return sum(window_share(*pair)[1] for pair in pairs)


def area_by(first: Mapping[str, Pairs], second: Mapping[str, Pairs]) -> tuple[float, float, float]:
    """The windows' area by one rule divided by that of another, over the same recordings, with its
    interval.
    """
    both = np.concatenate(
        [
            np.column_stack([by_blocks(first[name])[:, 0], by_blocks(second[name])[:, 0]])
            for name in first
        ]
    )
    low, high, _ = intervals.of_ratio(*both.T)
    return intervals.ratio(both), low, high
