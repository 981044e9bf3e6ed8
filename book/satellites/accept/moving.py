"""A3: accuracy in motion: two handles at the ends of a virtual bar that goes to and fro through the
field, and the error of their relative pose by speed.

The bar moves without turning. No truth but the bar's is needed, so the same test can be made with a
real bar; here either end is rendered with motion blur and followed by itself.
"""

from __future__ import annotations

from functools import lru_cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.checks import Array
from trinolab.metrics import FAR_DEG, FAR_MM
from trinolab.rigid import motion_between, shifted
from workbench.intervals import TOGETHER

from . import figures, tracks
from .numbers import LARGEST, Answer, Number, Picture, distribution, far_count, share
from .setup import Field, Setup, drawn_at
from .tracks import FPS, Row

NAME = "A3"
TITLE = "Accuracy in motion: a virtual bar"
BAR_MM = (300.0, 200.0, 150.0, 100.0, 50.0)  # the first that the field has room to move
LEAST_MM = 30.0  # of that room, in either direction
FARTHEST_MM = 1000.0  # that it is looked for
SPEEDS_MM_S = (100.0, 200.0, 500.0, 1000.0)
ADVANCE = 0.2  # of the speed to and fro: that across it
SHARE, FEWEST = 36 / 512, 12  # of instants a raster
ENDS = 2


class Bar(NamedTuple):
    """The bar and the room that its middle has.

    Attributes
    ----------
    length_mm : float
    direction : ndarray, shape (3,)
        Of the bar, world frame.
    middle : ndarray, shape (3,)
        Of the room, mm.
    ways : ndarray, shape (2, 3)
        Directions of the two rasters, across the bar.
    half_mm : ndarray, shape (2,)
        How far the middle may go in them, to either side.
    """

    length_mm: float
    direction: Array
    middle: Array
    ways: Array
    half_mm: Array


class Path(NamedTuple):
    """The middle's way: times, s, positions, mm, and velocities, mm/s; (n,) and twice (n, 3)."""

    t_s: Array
    positions: Array
    velocities: Array


def parts(setup: Setup) -> int:
    """An end of the bar, in a direction, at a speed. ValueError if the field has no room for it."""
    bar_of_setup(setup)
    return len(SPEEDS_MM_S) * 2 * ENDS


def run(setup: Setup, k: int) -> list[Row]:
    """Render and follow one end of the bar along one raster."""
    raster, end = divmod(k, ENDS)
    path = path_of(setup, raster)
    poses = ends_of(setup, raster)[end]
    frames = tracks.moving(setup, path.t_s, poses, path.velocities, setup.number(NAME, k))
    return tracks.follow(frames, setup)


def bar_of(field: Field) -> Bar:
    """The longest of `BAR_MM` that can be moved in the field, along its longest direction.

    Raises
    ------
    ValueError
        If not even the shortest can.
    """
    direction, *ways = field.axes
    for length in BAR_MM:
        half = direction * length / 2
        room = field.points[field.holds(field.points - half) & field.holds(field.points + half)]
        if len(room) == 0:
            continue
        middle = room.mean(axis=0)
        room_mm = _room(field, middle, np.array(ways), half)
        if (2 * room_mm >= LEAST_MM).all():
            return Bar(length, direction, middle, np.array(ways), room_mm)
    raise ValueError(
        f"rig: the common field of view has no room to move a bar of {BAR_MM[-1]:g} mm"
    )


def _room(field: Field, middle: Array, ways: Array, half: Array) -> Array:
    """Half the sides of a rectangle in which the bar can be moved, mm, shape (2,).

    Its sides are in the ratio of how far the bar can go along each direction alone. The field is
    convex, so what holds at the corners holds inside.
    """

    def reach(corners: Array) -> float:
        steps = np.linspace(0.0, 1.0, 501)[:, None]
        free = np.ones(len(steps), bool)
        for corner in corners:
            at = middle + steps * corner
            free &= field.holds(at - half) & field.holds(at + half)
        return float(steps[max(int(np.argmin(free)) - 1, 0), 0]) if not free.all() else 1.0

    sides = np.array([FARTHEST_MM * reach(FARTHEST_MM * np.array([way, -way])) for way in ways])
    signs = np.array([[a, b] for a in (-1, 1) for b in (-1, 1)])
    return sides * reach((signs * sides) @ ways)


def path_of(setup: Setup, raster: int) -> Path:
    """The way of one raster: to and fro along a direction, slowly on across it; it begins at rest.

    The way to and fro is a sine of this largest speed, as long as the room, or shorter, so that one
    period at least is seen.
    """
    n = setup.part(SHARE, FEWEST)
    t = tracks.instants(n, setup.rng(NAME, raster))
    number, direction = divmod(raster, 2)
    args = bar_of_setup(setup), SPEEDS_MM_S[number], direction, n / FPS
    step = 1e-4
    ahead, behind = _middles(*args, t + step), _middles(*args, t - step)
    return Path(t, _middles(*args, t), (ahead - behind) / (2 * step))


def _middles(bar: Bar, speed: float, direction: int, duration: float, t: Array) -> Array:
    """Where the bar's middle is at times (n,), s: to and fro along one of its ways, mm, (n, 3)."""
    half = min(float(bar.half_mm[direction]), speed * duration / (2 * np.pi))
    edge = float(bar.half_mm[1 - direction])
    on = min(ADVANCE * speed, 2 * edge / duration) * (t - duration / 2)
    to_and_fro = -half * np.cos(speed / half * t)
    return (
        bar.middle
        + np.outer(to_and_fro, bar.ways[direction])
        + np.outer(on, bar.ways[1 - direction])
    )


@lru_cache(maxsize=2)
def bar_of_setup(setup: Setup) -> Bar:
    """The bar of a sheet's field."""
    return bar_of(setup.field)


def ends_of(setup: Setup, raster: int) -> tuple[RigidTransform, RigidTransform]:
    """The true poses of the handles at either end along a raster, n each."""
    bar = bar_of_setup(setup)
    path = path_of(setup, raster)
    unit = setup.rng(NAME, 1000 + raster).uniform(size=(ENDS, 6))
    turns = drawn_at(setup.field, unit).poses.rotation
    first, second = (
        RigidTransform.from_components(
            path.positions + sign * bar.length_mm / 2 * bar.direction, turns[k]
        )
        for k, sign in enumerate((-1, 1))
    )
    return first, second


def judge(setup: Setup, rows: list[list[Row]]) -> Answer:
    """The error of the ends' relative pose in ranges of speed, and the share that has one."""
    bar = bar_of_setup(setup)
    rasters = [
        _relative(setup, raster, rows[raster * ENDS : (raster + 1) * ENDS])
        for raster in range(2 * len(SPEEDS_MM_S))
    ]
    speed, error, length = (np.concatenate(parts) for parts in zip(*rasters, strict=True))
    both = np.isfinite(error).all(axis=1)
    answer = Answer()
    for nominal, (low, high) in zip(SPEEDS_MM_S, ranges(), strict=True):
        in_range = (speed >= low) & (speed < high)
        answer.numbers += _at_speed(setup, nominal, (low, high), error[in_range], length[in_range])
    answer.numbers += _far_off(setup, rows)
    if both.any():
        answer.pictures.append(_picture(speed[both] / 1000, np.abs(length[both])))
    answer.notes.append(
        f"A bar of {bar.length_mm:g} mm along the field's longest direction, rasters to and fro "
        f"across it in two directions ({2 * bar.half_mm[0]:.0f} and {2 * bar.half_mm[1]:.0f} mm "
        f"wide), {len(speed)} instants at {FPS:g} a second, exposure 10 ms. It does not turn. Each "
        "end is followed from rest, and by itself. The error is that of the second handle's pose "
        "in the first one's frame, so the first one's angle error counts with the bar's length; "
        "that of the bar's length is free of it. The speed is the one at the instant."
    )
    if bar.length_mm < BAR_MM[0]:
        answer.notes.append(f"The field has no room to move a bar of {BAR_MM[0]:g} mm.")
    return answer


def _at_speed(
    setup: Setup, nominal: float, limits: tuple[float, float], error: Array, length: Array
) -> list[Number]:
    """The numbers of the instants in a range of speed."""
    if len(error) == 0:
        return []
    both = np.array(np.isfinite(error).all(axis=1))
    at = f"at {nominal / 1000:g} m/s"
    note = f"instants of {limits[0] / 1000:.2g} to {limits[1] / 1000:.2g} m/s"
    distances, angles = tracks.lengths(error[both])
    seed = setup.seed
    errors = partial(
        distribution, NAME, seed=seed, statistics=("rms", "95 %", LARGEST), together=TOGETHER
    )
    return [
        share(
            NAME,
            f"both ends measured {at}",
            int(both.sum()),
            len(both),
            seed,
            note=note,
            together=TOGETHER,
        ),
        *errors(f"bar's length {at}", np.abs(length[both]), "mm"),
        *errors(f"relative position {at}", distances, "mm"),
        *errors(f"relative angle {at}", angles, "deg"),
    ]


def _far_off(setup: Setup, rows: list[list[Row]]) -> list[Number]:
    """How many poses of either end are far from their truth."""
    off = [
        tracks.errors(tracks.as_track(one), ends_of(setup, k // ENDS)[k % ENDS], setup)[0]
        for k, one in enumerate(rows)
    ]
    error = np.concatenate(off)
    distances, angles = tracks.lengths(error[np.isfinite(error).all(axis=1)])
    if len(distances) == 0:
        return []
    far = int(((distances > FAR_MM) | (angles > FAR_DEG)).sum())
    return [far_count(NAME, far, len(distances), setup.seed)]


def ranges() -> list[tuple[float, float]]:
    """The ranges of speed, mm/s: half way between the nominal ones."""
    middles = [(a + b) / 2 for a, b in pairwise(SPEEDS_MM_S)]
    return list(zip([SPEEDS_MM_S[0] / 2, *middles], [*middles, 2e3], strict=True))


def _relative(setup: Setup, raster: int, rows: list[list[Row]]) -> tuple[Array, Array, Array]:
    """Of the n instants of a raster: the speed (n,), the error (n, 6) of the second end's pose in
    the first one's frame, and that of their distance (n,); NaN unless both ends are found.
    """
    truths = ends_of(setup, raster)
    off = [
        tracks.errors(tracks.as_track(one), true, setup)[0]
        for one, true in zip(rows, truths, strict=True)
    ]
    n = len(off[0])
    relative = np.full((n, 6), np.nan)
    length = np.full(n, np.nan)
    for k in np.flatnonzero(np.isfinite(off[0] + off[1]).all(axis=1)):
        first, second = (
            shifted(true[k], shift[k]) for true, shift in zip(truths, off, strict=True)
        )
        relative[k] = motion_between(first.inv() * second, truths[0][k].inv() * truths[1][k])
        between = np.linalg.norm(first.translation - second.translation)
        length[k] = between - bar_of_setup(setup).length_mm
    speed = np.linalg.norm(path_of(setup, raster).velocities, axis=1)
    return speed, relative, length


def _picture(speeds: Array, errors: Array) -> Picture:
    return Picture(
        "moving",
        "The error of the bar's length over the speed, a dot per instant, with the root mean square "
        "of each range of speed.",
        figures.as_png(
            figures.plot_over_speed(
                speeds,
                errors,
                [low / 1000 for low, _ in ranges()] + [2.0],
                "bar's length, error / mm",
            )
        ),
    )
