"""A hand against a computer's wall in simulated time, and the stiffness from which its swings grow (beyond the paper).

Between two changes of the force the master moves as its equation says, in closed form: nothing is approximated. The
largest stable stiffness is found by bisection, from nothing but growth or decay, so it tests what `wall` says.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .checks import Array, as_number, frozen
from .wall import Loop, sampling_period

SWINGS, MOST_STEPS = 60, 60_000  # of a simulation that is to tell growth from decay


class Contact(NamedTuple):
    """A simulated contact: times, s, depths in the wall, m, and the wall's forces, N, shape (n,) each."""

    t_s: Array
    depth_m: Array
    force_n: Array


def simulate(loop: Loop, stiffness: float, duration_s: float, push_n: float = 1.0, one_sided: bool = True) -> Contact:
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
        A wall only pushes, and only where it is; else it holds on to the master like a spring.

    Returns
    -------
    Contact
        Eight instants a period.

    Raises
    ------
    ValueError
        If stiffness or duration is negative, a number is not finite, or the period is 0.
    """
    as_number(stiffness, "stiffness", 0.0)
    count = int(np.ceil(as_number(duration_s, "duration_s", 0.0) / sampling_period(loop)))
    states = _periods(loop, stiffness, (0.0, 0.0), as_number(push_n, "push_n"), one_sided)
    x, v, before, after = np.array(list(islice(states, count))).reshape(-1, 4).T[:, :, None]
    switch, h = loop.delay_s % loop.period_s, loop.period_s * np.arange(8) / 8
    p, q, e, g = _movement(loop, np.minimum(h, switch))
    P, Q, *_ = _movement(loop, np.maximum(h - switch, 0.0))
    first, second = push_n - before, push_n - after
    depth = x + p * v + q * first + P * (e * v + g * first) + Q * second
    t = loop.period_s * np.arange(count)[:, None] + h
    return Contact(*(frozen(part.ravel()) for part in (t, depth, np.where(h < switch, before, after))))


def grows(loop: Loop, stiffness: float) -> bool:
    """Whether the oscillation of a master that is let go in a two-sided wall grows, by simulation.

    Up to 60 passages through zero are simulated. The mean square of the depths in the last third of them is held
    against that in the third before. A master that hardly swings decays. Raises ValueError as `simulate`.
    """
    as_number(stiffness, "stiffness", 0.0)
    sampling_period(loop)
    swings, last, track = 0, 1.0, []
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
    """The largest stable stiffness, N/m, by bisection: between one whose swings decay and one whose swings grow.

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
    low, high = 0.0, loop.damping / (sampling_period(loop) + loop.delay_s)
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
    time, rate = np.asarray(h, dtype=float), loop.damping / loop.mass_kg
    faded: Array = -np.expm1(-rate * time)
    return faded / rate, (time - faded / rate) / loop.damping, 1 - faded, faded / loop.damping


def _periods(loop: Loop, stiffness: float, start: tuple[float, float], push_n: float,
             one_sided: bool) -> Iterator[tuple[float, float, float, float]]:
    """Depth and speed at the start of each period, and the wall's force before and after the switch within it."""
    (x, v), last, T = start, start[0], loop.period_s
    whole, rest = divmod(loop.delay_s, T)
    (p, q, e, g), (P, Q, E, G) = (map(float, _movement(loop, h)) for h in (rest, T - rest))
    forces = deque([0.0] * (int(whole) + 2), maxlen=int(whole) + 2)
    while True:
        force = stiffness * x + loop.wall_damping * (x - last) / T
        forces.append(0.0 if one_sided and (x <= 0 or force < 0) else force)
        yield x, v, forces[0], forces[1]
        last, first, second = x, push_n - forces[0], push_n - forces[1]
        x, v = x + p * v + q * first, e * v + g * first
        x, v = x + P * v + Q * second, E * v + G * second
