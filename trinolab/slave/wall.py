"""A wall that a computer lets a hand feel: how stiff it may be before the loop gets unstable
(beyond the paper).

A master of one degree of freedom is pressed against the wall, m x'' + b x' = h - f, with x the
depth in the wall and h the hand's force. Each period T the computer reads x and finds f = K x + B
(x - x before) / T. The master feels it after the delay tau, until the next one comes. The Nyquist
criterion gives the largest stable K, with the hold as it is or as the delay T/2 that it resembles.

`contact` simulates the same in time, in closed form between two changes of the force. Its largest
stable stiffness is found by bisection, from nothing but growth or decay, so it tests what the
Nyquist criterion says.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

from ..checks import Array, as_array, as_number, check_numbers, frozen

Complex = NDArray[np.complex128]
GRID = 4000  # frequencies among which the phase crossings are looked for
SWINGS, MOST_STEPS = 60, 60_000  # of a simulation that is to tell growth from decay


@dataclass(frozen=True)
class Loop:
    """A master and the computer that closes the loop around it.

    Attributes
    ----------
    mass_kg : float
        m, of the master with the hand that holds it.
    damping : float
        b, N s/m, of the same; positive.
    period_s : float
        T, from one reading of the position to the next; 0 is a loop without samples and hold.
    delay_s : float
        tau, from the reading to the force that follows from it.
    wall_damping : float
        B, N s/m, which the computer adds by a backward difference.

    Raises
    ------
    ValueError
        If the delay is longer than 1000 periods.
    """

    mass_kg: float
    damping: float
    period_s: float
    delay_s: float = 0.0
    wall_damping: float = 0.0

    def __post_init__(self) -> None:
        check_numbers(self, "mass_kg", "damping", low=0.0, open_low=True)
        check_numbers(self, "period_s", "wall_damping", low=0.0)
        as_number(self.delay_s, "delay_s", 0.0, 1000 * self.period_s or np.inf)

    @property
    def lag_s(self) -> float:
        """tau + T/2, s: the delay, and the mean age of a held force."""
        return self.delay_s + self.period_s / 2


class Limit(NamedTuple):
    """The largest stable stiffness, N/m, and the frequency of the oscillation there, rad/s (NaN if
    there is none).
    """

    stiffness: float
    omega: float


def sampling_period(loop: Loop) -> float:
    """T, s, of a loop that must have one: ValueError if it is 0."""
    return as_number(loop.period_s, "period_s", 0.0, open_low=True)


def delayed_response(loop: Loop, omega: ArrayLike) -> Complex:
    """Depth over the computer's force, m/N, shape (n,), the hold taken as a delay of T/2.

    Parameters
    ----------
    loop : Loop
    omega : array_like, shape (n,)
        rad/s, positive.
    """
    s = 1j * as_array(omega, "omega", (None,))
    return np.exp(-s * loop.lag_s) / (s * (loop.mass_kg * s + loop.damping))


def sampled_response(loop: Loop, omega: ArrayLike) -> Complex:
    """Depth over the computer's force, m/N, shape (n,), from sample to sample: exact for any delay.

    In a period the force of d + 1 periods ago acts for r seconds, then that of d periods ago, where
    tau = d T + r. Parameters as for `delayed_response`, omega up to pi / T; also raises ValueError
    if the period is 0.
    """
    z = np.exp(1j * as_array(omega, "omega", (None,)) * sampling_period(loop))
    whole, rest = divmod(loop.delay_s, loop.period_s)
    late, push_late = _step(loop, loop.period_s - rest)
    early, push_early = _step(loop, rest)
    (_, p), (_, q) = late @ early  # the upper left entry is 1, the lower left one 0
    depth, speed = (late @ push_early)[:, None] / z + push_late[:, None]
    return (depth + p * speed / (z - q)) / (z - 1) * z**-whole


def nyquist_limit(loop: Loop, sampled: bool = True) -> Limit:
    """The largest stable stiffness by the Nyquist criterion: the gain margin of the loop of
    stiffness 1.

    Parameters
    ----------
    loop : Loop
    sampled : bool
        The hold as it is; else as a delay of T/2.

    Returns
    -------
    Limit
        Of stiffness 0 if the wall's damping alone makes the loop unstable, infinite if every
        stiffness is stable (no delay and no hold).

    Raises
    ------
    ValueError
        If the loop is sampled and the period is 0.
    """
    if not (sampled or loop.lag_s):
        return Limit(np.inf, np.nan)
    respond = sampled_response if sampled else delayed_response
    top = np.pi / sampling_period(loop) if sampled else 2 * np.pi / loop.lag_s

    def wanted(omega: Array) -> Complex:  # K for which 1 + (K + B difference) response = 0
        return -1 / respond(loop, omega) - loop.wall_damping * _difference(loop, omega)

    def wanted_damping(omega: Array) -> Complex:  # the same for B if K = 0
        return -1 / (respond(loop, omega) * _difference(loop, omega))

    if loop.wall_damping >= _smallest_crossing(loop, wanted_damping, top).stiffness:
        return Limit(0.0, np.nan)
    return _smallest_crossing(loop, wanted, top)


def passive_limit(loop: Loop) -> float:
    """The stiffness, N/m, below which a wall without delay is passive, so stable in any passive
    hand: b > K T/2 + B.

    Colgate and Schenkel (1997), J. of Robotic Systems 14(1), 37-47. Never negative; infinite if the
    period is 0.

    Raises
    ------
    ValueError
        If the loop has a delay, which the bound does not cover.
    """
    as_number(loop.delay_s, "delay_s", 0.0, 0.0)
    spare = max(loop.damping - loop.wall_damping, 0.0)
    return 2 * spare / loop.period_s if loop.period_s else (np.inf if spare else 0.0)


def _difference(loop: Loop, omega: Array) -> Complex:
    """The frequency response of the backward difference at omega, 1/s."""
    s = 1j * omega
    return np.asarray(
        -np.expm1(-s * loop.period_s) / loop.period_s if loop.period_s else s, dtype=np.complex128
    )


def _step(loop: Loop, h: float) -> tuple[Array, Array]:
    """Transition of (depth, speed) over h seconds, (2, 2), and what 1 N does in that time, (2,)."""
    slope = np.array([[0, 1, 0], [0, -loop.damping / loop.mass_kg, 1 / loop.mass_kg], [0, 0, 0]])
    moved = expm(slope * h)
    return moved[:2, :2], moved[:2, 2]


def _smallest_crossing(loop: Loop, wanted: Callable[[Array], Complex], top: float) -> Limit:
    """The smallest positive gain that is real, of those wanted at the frequencies up to `top`."""
    slowest = 0.1 * min(1 / loop.lag_s, np.sqrt(loop.damping / loop.mass_kg / loop.lag_s))
    grid = np.geomspace(min(slowest, top / 2), top, GRID)
    off = wanted(grid).imag
    at = [
        brentq(lambda w: wanted(np.array([w]))[0].imag, *grid[k : k + 2], xtol=1e-14 * grid[k])
        for k in np.flatnonzero(off[:-1] * off[1:] < 0)
    ]
    omega = np.array([*at, top])
    gain = wanted(omega)
    real = (gain.real > 0) & (np.abs(gain.imag) <= 1e-6 * np.abs(gain))  # so is that at z = -1
    if not real.any():
        return Limit(np.inf, np.nan)
    first = np.argmin(np.where(real, gain.real, np.inf))
    return Limit(float(gain.real[first]), float(omega[first]))


class Contact(NamedTuple):
    """A simulated contact: times, s, depths in the wall, m, and the wall's forces, N, shape (n,)
    each.
    """

    t_s: Array
    depth_m: Array
    force_n: Array


def simulate(
    loop: Loop, stiffness: float, duration_s: float, push_n: float = 1.0, one_sided: bool = True
) -> Contact:
    """A hand pushes the resting master into the wall with a constant force, from its surface.

    Parameters
    ----------
    loop : Loop
        With a period above 0.
    stiffness : float
        K, N/m.
    duration_s : float
        Rounded up to whole periods.
    push_n : float
        h, N.
    one_sided : bool
        Whether the wall only pushes; else it holds the master like a spring.

    Returns
    -------
    Contact
        Eight instants per period.

    Raises
    ------
    ValueError
        If the period is 0.
    """
    as_number(stiffness, "stiffness", 0.0)
    count = int(np.ceil(as_number(duration_s, "duration_s", 0.0) / sampling_period(loop)))
    states = _periods(loop, stiffness, (0.0, 0.0), as_number(push_n, "push_n"), one_sided)
    x, v, before, after = np.array(list(islice(states, count))).reshape(-1, 4).T[:, :, None]
    switch = loop.delay_s % loop.period_s
    h = loop.period_s * np.arange(8) / 8
    p, q, e, g = _movement(loop, np.minimum(h, switch))
    P, Q, *_ = _movement(loop, np.maximum(h - switch, 0.0))
    first, second = push_n - before, push_n - after
    depth = x + p * v + q * first + P * (e * v + g * first) + Q * second
    t = loop.period_s * np.arange(count)[:, None] + h
    return Contact(
        *(frozen(part.ravel()) for part in (t, depth, np.where(h < switch, before, after)))
    )


def grows(loop: Loop, stiffness: float) -> bool:
    """Whether the oscillation of a master that is let go in a two-sided wall grows, by simulation.

    Up to 60 passages through zero are simulated. The mean square of the depths in the last third of
    them is compared with that in the third before. A master that hardly swings counts as one that
    decays. Raises ValueError as `simulate`.
    """
    as_number(stiffness, "stiffness", 0.0)
    sampling_period(loop)
    swings = 0
    last = 1.0
    track = []
    for x, *_ in islice(_periods(loop, stiffness, (1.0, 0.0), 0.0, False), MOST_STEPS):
        swings, last = swings + (x * last < 0), x or last
        if swings >= SWINGS or not 1e-12 < abs(last) < 1e12:
            break
        track.append((x, swings))
    if swings < 6 or not 1e-12 < abs(last) < 1e12:
        return abs(last) >= 1e12
    x, third = np.array(track).T * [[1.0], [3 / (swings + 1)]]
    return bool(np.mean(x[third >= 2] ** 2) > np.mean(x[(third >= 1) & (third < 2)] ** 2))


def simulated_limit(loop: Loop, tolerance: float = 1e-3) -> float:
    """The largest stable stiffness, N/m, by bisection: between one whose swings decay and one whose
    swings grow.

    Parameters
    ----------
    loop : Loop
        With a period above 0.
    tolerance : float
        Relative width of the last interval, from 1e-6 to 0.5.

    Raises
    ------
    ValueError
        If the tolerance lies elsewhere or the period is 0.
    """
    tolerance = as_number(tolerance, "tolerance", 1e-6, 0.5)
    low = 0.0
    high = loop.damping / (sampling_period(loop) + loop.delay_s)
    if grows(loop, 1e-3 * high):
        return 0.0
    while not grows(loop, high):
        low, high = high, 2 * high
    while high - low > tolerance * high:
        middle = (low + high) / 2
        low, high = (low, middle) if grows(loop, middle) else (middle, high)
    return (low + high) / 2


def _movement(loop: Loop, h: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """The step over h seconds in closed form: depth + p speed + q force, and e speed + g force."""
    time = np.asarray(h, dtype=float)
    rate = loop.damping / loop.mass_kg
    faded: Array = -np.expm1(-rate * time)
    return faded / rate, (time - faded / rate) / loop.damping, 1 - faded, faded / loop.damping


def _periods(
    loop: Loop, stiffness: float, start: tuple[float, float], push_n: float, one_sided: bool
) -> Iterator[tuple[float, float, float, float]]:
    """Depth and speed at the start of each period, and the wall's force before and after the switch
    within it.
    """
    (x, v) = start
    last = start[0]
    T = loop.period_s
    whole, rest = divmod(loop.delay_s, T)
    (p, q, e, g), (P, Q, E, G) = (map(float, _movement(loop, h)) for h in (rest, T - rest))
    forces = deque([0.0] * (int(whole) + 2), maxlen=int(whole) + 2)
    while True:
        force = stiffness * x + loop.wall_damping * (x - last) / T
        forces.append(0.0 if one_sided and (x <= 0 or force < 0) else force)
        yield x, v, forces[0], forces[1]
        last = x
        first = push_n - forces[0]
        second = push_n - forces[1]
        x, v = x + p * v + q * first, e * v + g * first
        x, v = x + P * v + Q * second, E * v + G * second
