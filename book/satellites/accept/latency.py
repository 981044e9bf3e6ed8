"""A5: the delay of a measured pose, from the phase of a sine, and the time that a measurement
takes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.spatial.transform import RigidTransform

from trinolab.bench.scene import EXPOSURE_S
from trinolab.checks import Array
from workbench.intervals import LEVEL, Interval, of_quantile

from . import tracks
from .moving import bar_of_setup
from .numbers import CLOCK, LARGEST, Answer, Number, distribution, share
from .setup import Setup, drawn_at
from .tracks import FPS, Row

NAME = "A5"
TITLE = "Latency"
RATES_HZ = (0.5, 1.0, 2.0)
AMPLITUDE_MM = 30.0
SHARE, FEWEST = 60 / 512, 16  # of instants a rate
BOTH = "Student's t and order statistics"
HELD_HZ = 2000.0  # at which the pose that is held is looked at


def parts(setup: Setup) -> int:
    """How many sines. ValueError if the field has no room for them."""
    bar_of_setup(setup)
    return len(RATES_HZ)


def run(setup: Setup, k: int) -> list[Row]:
    """Render and follow a handle on a sine."""
    times, poses, velocities = sine(setup, k)
    frames = tracks.moving(setup, times, poses, velocities, setup.number(NAME, k))
    return tracks.follow(frames, setup)


def sine(setup: Setup, k: int) -> tuple[Array, RigidTransform, Array]:
    """Times, s, true poses and velocities, mm/s, of a handle that goes to and fro in the middle of
    the field.
    """
    field = setup.field
    path = _way(setup)
    half = min(AMPLITUDE_MM, float(bar_of_setup(setup).half_mm[0]))
    rng = setup.rng(NAME, k)
    times = tracks.instants(setup.part(SHARE, FEWEST), rng)
    omega = 2 * np.pi * RATES_HZ[k]
    positions = field.centre + half * np.outer(np.sin(omega * times), path)
    velocities = half * omega * np.outer(np.cos(omega * times), path)
    turn = drawn_at(field, rng.uniform(size=(1, 6))).poses.rotation[0]
    poses = [RigidTransform.from_components(p, turn) for p in positions]
    return times, RigidTransform.concatenate(poses), velocities


def _way(setup: Setup) -> Array:
    return bar_of_setup(setup).ways[0]


class Sine(NamedTuple):
    """A sine fitted to values: amplitude, phase, rad, and the standard deviation of that."""

    amplitude: float
    phase: float
    sigma: float
    freedom: int


def fit_sine(times: Array, values: Array, rate_hz: float) -> Sine:
    """The sine of a known rate, and a constant, that fits values by least squares (IEEE Std 1057,
    three parameters); phase 0 is a sine that rises at time 0.
    """
    omega = 2 * np.pi * rate_hz
    A = np.column_stack([np.sin(omega * times), np.cos(omega * times), np.ones(len(times))])
    x = np.linalg.lstsq(A, values, rcond=None)[0]
    freedom = len(times) - 3
    variance = float(((A @ x - values) ** 2).sum()) / max(freedom, 1)
    covariance = variance * np.linalg.inv(A.T @ A)
    amplitude = float(np.hypot(x[0], x[1]))
    across = np.array([-x[1], x[0], 0.0]) / amplitude**2  # derivative of the phase
    return Sine(
        amplitude,
        float(np.arctan2(x[1], x[0])),
        float(np.sqrt(across @ covariance @ across)),
        freedom,
    )


def delay_of(times: Array, values: Array, rate_hz: float) -> tuple[float, Interval]:
    """By how much values are behind ``sin(2 pi rate t)``, s, with an interval by Student's t."""
    fit = fit_sine(times, values, rate_hz)
    omega = 2 * np.pi * rate_hz
    reach = float(stats.t.ppf((1 + LEVEL) / 2, fit.freedom)) * fit.sigma / omega
    delay = -fit.phase / omega
    return delay, Interval(delay - reach, delay + reach, "Student's t")


def held(available: Array, values: Array, rate: float = HELD_HZ) -> tuple[Array, Array]:
    """The newest value at each time of a fine grid: what a consumer sees that asks at any time.

    Parameters
    ----------
    available : ndarray, shape (n,)
        When each value is there, s, increasing.
    values : ndarray, shape (n,)
    rate : float
        Of the grid, Hz.

    Returns
    -------
    times, values : ndarray, shape (m,)
        From the first value to one mean interval after the last.
    """
    step = float(np.diff(available).mean())
    grid = np.arange(available[0], available[-1] + step, 1 / rate)
    newest = np.searchsorted(available, grid, side="right") - 1
    return grid, values[newest]


def judge(setup: Setup, rows: list[list[Row]]) -> Answer:
    """The delay of the poses by their own times, of the poses as they come, and what it is made
    of.
    """
    answer = Answer()
    seed = setup.seed
    found_tracks = [tracks.as_track(one) for one in rows]
    times = np.concatenate([track.cpu_s[2:] for track in found_tracks])  # the first is a search
    ready, ready_interval = float(np.median(times)), of_quantile(times, 0.5)
    for k, track in enumerate(found_tracks):
        measured = track.found
        rate = RATES_HZ[k]
        name = f"sine of {rate:g} Hz"
        answer.numbers.append(
            share(NAME, f"{name}, measured", int(measured.sum()), len(measured), seed)
        )
        if measured.sum() < 8:
            continue
        along = (track.positions[measured] - setup.field.centre) @ _way(setup)
        delay, interval = delay_of(track.t_s[measured], along, rate)
        answer.numbers.append(
            _ms(f"pose against its own time, {name}", delay, interval, measured, seed)
        )
        available = track.t_s[measured] + EXPOSURE_S / 2 + ready
        seen = held(available, along)
        behind = delay_of(*seen, rate)[0]
        # what the phase leaves open, and the time of a measurement
        low = behind + (interval.low - delay) + (ready_interval.low - ready)
        high = behind + (interval.high - delay) + (ready_interval.high - ready)
        between = Interval(low, high, BOTH)
        number = _ms(f"newest pose at any time, {name}", behind, between, measured, seed)
        answer.numbers.append(replace(number, source=CLOCK))
    answer.numbers += _times(times)
    answer.notes.append(
        "A handle goes to and fro on a sine. Its measured pose, by the time of mid-exposure that it "
        "carries, is behind the true one by the first delay: a filter would show there. A consumer "
        "that asks at any time gets the newest pose that is ready: half the exposure "
        f"({1e3 * EXPOSURE_S / 2:g} ms), the measurement, and on average half an interval of "
        f"{1e3 / FPS:.1f} ms later. Reading the images out of the cameras and sending them is not "
        "in it, and belongs to the cameras. The measurement's time is the processor time of one "
        "core of the computer that made this sheet."
    )
    return answer


def _ms(what: str, delay: float, interval: Interval, found: np.ndarray, seed: int) -> Number:
    number = Number(NAME, what, "delay", 1e3 * delay, "ms", int(found.sum()), seed)
    return number.within(Interval(1e3 * interval.low, 1e3 * interval.high, interval.how))


def _times(cpu_s: Array) -> list[Number]:
    """Times of a measurement, and the age of a pose when it is there: what is usual, and how bad it
    gets, since whoever is led by the poses feels the worst.
    """
    times = 1e3 * cpu_s
    ages = 1e3 * EXPOSURE_S / 2 + times
    spread = ("median", "95 %", "99 %", LARGEST)
    return [
        *distribution(NAME, "age of a pose when it is there", ages, "ms", None, CLOCK, spread),
        *distribution(NAME, "time of a measurement in motion", times, "ms", None, CLOCK, spread),
    ]
