"""A1: jitter and drift of a handle that rests at nine places, and the Allan deviation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.checks import Array
from workbench import intervals
from workbench.intervals import Interval, by_bootstrap, rms

from . import figures, tracks
from .numbers import CLOCK, OWN, Answer, Number, Picture
from .setup import Field, Setup, drawn_at
from .tracks import Row, Track

NAME = "A1"
TITLE = "Jitter and drift at rest"
PLACES = 9
SHARE, FEWEST = 240 / 512, 12  # of instants per place
OUTWARDS = 0.65  # the eight outer places, as a share of the way from the middle to the field's ends
# A recording in which the handle leaves its median by no more than this at 95 % of the instants is
# one of a handle at rest.
REST_MM, REST_DEG = 0.5, 1.0


def parts(setup: Setup) -> int:
    """How many places."""
    return PLACES


def run(setup: Setup, k: int) -> list[Row]:
    """Render and follow a handle at rest at the k-th place."""
    frames = tracks.resting(setup, places(setup)[k], instants(setup), setup.number(NAME, k))
    return tracks.follow(frames, setup)


def instants(setup: Setup) -> int:
    """How many at each place."""
    return setup.part(SHARE, FEWEST)


def places(setup: Setup) -> RigidTransform:
    """The middle of the field, and a place in each of its octants; any orientation."""
    field = setup.field
    unit = setup.rng(NAME).uniform(size=(PLACES, 6))
    turns = drawn_at(field, unit).poses.rotation
    return RigidTransform.from_components(_positions(field), turns)


def _positions(field: Field) -> Array:
    """The middle, and a part of the way from there to the point of each octant that is farthest
    out, shape (9, 3).
    """
    middle = field.centre
    local = (field.points - middle) @ field.axes.T
    spread = local / local.std(axis=0)
    signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    ends = [field.points[(spread @ sign).argmax()] for sign in signs]
    return np.vstack([middle, middle + OUTWARDS * (np.array(ends) - middle)])


class Rest(NamedTuple):
    """A handle at rest: its measured places about their mean.

    Attributes
    ----------
    t_s : ndarray, shape (n,)
    off : ndarray, shape (n, 6)
        Position, mm, and rotation vector, deg, about their means.
    gaps : int
        Instants that were not measured.
    """

    t_s: Array
    off: Array
    gaps: int


def rest_of(track: Track) -> Rest | None:
    """What a track of a handle at rest shows; None if fewer than eight instants were measured."""
    measured = track.found
    if measured.sum() < 8:
        return None
    turns = Rotation.from_quat(track.quaternions[measured])
    turned = np.rad2deg((turns * turns.mean().inv()).as_rotvec())
    position = track.positions[measured]
    off = np.column_stack([position - position.mean(axis=0), turned - turned.mean(axis=0)])
    return Rest(track.t_s[measured], off, int((~measured).sum()))


def at_rest(track: Track) -> bool:
    """Whether a recorded track is one of a handle at rest, see `REST_MM`."""
    if (rest := rest_of(track)) is None:
        return False
    away = rest.off - np.median(rest.off, axis=0)
    reach = [np.quantile(np.linalg.norm(away[:, part], axis=1), 0.95) for part in (_MM, _DEG)]
    return bool(reach[0] <= REST_MM and reach[1] <= REST_DEG)


_MM, _DEG = slice(0, 3), slice(3, 6)
_KINDS = (("position", _MM, "mm"), ("rotation", _DEG, "deg"))


def judge(setup: Setup, rows: list[list[Row]]) -> Answer:
    """Jitter, drift and Allan deviation over the rendered places."""
    return judge_tracks([tracks.as_track(one) for one in rows], setup.seed, OWN)


def judge_tracks(found: list[Track], seed: int | None, source: str) -> Answer:
    """The same over tracks of handles at rest, rendered or recorded."""
    answer = Answer()
    rests = [rest for track in found if (rest := rest_of(track)) is not None]
    if not rests:
        answer.notes.append("No place was measured in eight instants.")
        return answer
    whole = [rest for rest in rests if rest.gaps == 0]
    for kind, part, unit in _KINDS:
        answer.numbers += [*_jitter(rests, kind, part, unit, seed, source)]
        answer.numbers += [*_allan(whole, kind, part, unit, seed, source)]
    answer.numbers += [*_drift(rests, seed, source)]
    answer.numbers += time(found)
    if whole:
        answer.pictures.append(_picture(whole))
    else:
        answer.notes.append("No Allan deviation: instants are missing at every place.")
    answer.notes.append(
        f"{len(rests)} places of {len(found)}, {sum(len(rest.t_s) for rest in rests)} instants. "
        "The jitter is the root mean square of the deviations from each place's mean, all three "
        "axes together."
    )
    if source == OWN:
        answer.notes.append(
            "On the bench nothing warms up, bends or flickers: its noise is white and its light "
            "constant, so the Allan deviation falls with the root of the time, and a drift could "
            "only be one of the software. A real rig shows here from where on averaging is in vain."
        )
    return answer


def jitter_of(found: list[Track]) -> tuple[float, float] | None:
    """Standard deviation about each axis, mm and deg, for those who need a handle as noisy; None if
    no track says it.
    """
    rests = [rest for track in found if (rest := rest_of(track)) is not None]
    if not rests:
        return None
    return tuple(  # type: ignore[return-value]
        rms(np.concatenate([rest.off[:, part].ravel() for rest in rests])) for part in (_MM, _DEG)
    )


def _jitter(
    rests: list[Rest], kind: str, part: slice, unit: str, seed: int | None, source: str
) -> list[Number]:
    """The jitter over all places, with an interval over places, and that of the worst place."""
    each = np.array([np.sqrt((rest.off[:, part] ** 2).sum(axis=1).mean()) for rest in rests])
    count = sum(len(rest.t_s) for rest in rests)
    all_places = Number(NAME, f"jitter, {kind}", "rms", rms(each), unit, count, seed, source)
    worst = Number(
        NAME,
        f"jitter, {kind}",
        "worst place",
        float(each.max()),
        unit,
        count,
        seed,
        source,
        note=f"of {len(each)} places",
    )
    interval = by_bootstrap(each, rms)
    if interval.how:
        interval = interval._replace(how=f"{interval.how} of the places")
    return [all_places.within(interval), worst]


def _allan(
    rests: list[Rest], kind: str, part: slice, unit: str, seed: int | None, source: str
) -> list[Number]:
    """The Allan deviation of one instant and of the longest time that all places, none with gaps,
    hold four times.
    """
    if not rests:
        return []
    n = min(len(rest.t_s) for rest in rests)
    step = float(np.median(np.diff(rests[0].t_s)))
    lengths = intervals.octaves(n)
    numbers = []
    for length in (1, lengths[-1]):
        each = [intervals.allan_deviation(rest.off[:n, part], length) for rest in rests]
        number = Number(
            NAME,
            f"Allan deviation, {kind}",
            f"over {length * step:.3g} s",
            rms(np.array(each)),
            unit,
            n * len(rests),
            seed,
            source,
        )
        # three columns that may be correlated and unequally large: counted as one, on the safe side
        numbers.append(number.within(intervals.of_allan(number.value, n, length, len(rests))))
    return numbers


def _drift(rests: list[Rest], seed: int | None, source: str) -> list[Number]:
    """The steepest line through a coordinate over time, and how many lines are no accident."""
    numbers = []
    for kind, part, unit in _KINDS:
        slopes = [
            intervals.of_slope(rest.t_s, column) for rest in rests for column in rest.off[:, part].T
        ]
        steepest, interval = max(slopes, key=lambda pair: abs(pair[0]))
        sure = sum(low > 0 or high < 0 for _, (low, high, _) in slopes)
        numbers.append(
            Number(
                NAME,
                f"drift, {kind}",
                "steepest of all axes",
                60 * steepest,
                f"{unit}/min",
                len(slopes),
                seed,
                source,
                note=f"{sure} of {len(slopes)} lines differ from none; "
                f"{0.05 * len(slopes):.1f} would by chance",
            ).within(Interval(60 * interval.low, 60 * interval.high, interval.how))
        )
    return numbers


def time(found: list[Track]) -> list[Number]:
    """The processor time of a measurement at rest, the first of each place left out: a search."""
    times = 1e3 * np.concatenate([track.cpu_s[2:] for track in found])
    times = times[np.isfinite(times)]
    if len(times) == 0:
        return []
    number = Number(
        NAME,
        "time of a measurement",
        "median",
        float(np.median(times)),
        "ms",
        len(times),
        None,
        CLOCK,
    )
    return [number.within(intervals.of_quantile(times, 0.5))]


def _picture(rests: list[Rest]) -> Picture:
    """The Allan deviation of every place, none with gaps, over the time that is averaged over."""
    curves = []
    for rest in rests:
        lengths = intervals.octaves(len(rest.t_s))
        step = float(np.median(np.diff(rest.t_s)))
        deviation = [intervals.allan_deviation(rest.off[:, _MM], m) for m in lengths]
        curves.append((step * np.array(lengths), 1e3 * np.array(deviation)))
    png = figures.as_png(figures.plot_allan(curves, "Allan deviation of the position / µm"))
    return Picture(
        "allan",
        "Allan deviation of the position over the averaging time, a grey line per place, their root "
        "mean square in blue, and a dashed line that falls with the root of the time, as white "
        "noise does.",
        png,
    )
