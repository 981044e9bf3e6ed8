"""Speeds that a joint may take next, so that it never exceeds a limit of position, speed or acceleration.

Time is cut into ticks; during each a joint moves with one speed. A speed is allowed if it differs from the last one by
no more than the acceleration permits, and if the joint can still stop before the end of its range by slowing down as
fast as it may. Whatever was allowed at one tick leaves something that is allowed at the next: slowing down.
"""

from __future__ import annotations

import numpy as np

from .checks import Array
from .robot import Limits


def speed_bounds(q: Array, speed: Array, limits: Limits, dt: float) -> tuple[Array, Array]:
    """Lowest and highest speed for the next tick, rad/s, each (n,).

    Parameters
    ----------
    q : ndarray, shape (n,)
        Positions now, rad, within the limits.
    speed : ndarray, shape (n,)
        Of the last tick, rad/s, one that was allowed then.
    limits : Limits
    dt : float
        Length of a tick, s.
    """
    change = limits.acceleration * dt
    high = np.minimum.reduce([speed + change, limits.speed, stopping_speed(limits.high - q, limits.acceleration, dt)])
    low = np.maximum.reduce([speed - change, -limits.speed, -stopping_speed(q - limits.low, limits.acceleration, dt)])
    return np.minimum(low, speed + change), np.maximum(high, speed - change)  # to slow down is always allowed


def stopping_speed(distance: Array, acceleration: Array, dt: float) -> Array:
    """The highest speed from which a joint stops within a distance, losing ``acceleration * dt`` from tick to tick.

    With v = (n + f) a dt, n whole and 0 <= f < 1, the ticks v, v - a dt, ... until it rests cover
    a dt^2 (n + 1) (n / 2 + f); this is solved for n and f.
    """
    x = np.maximum(distance, 0.0) / (acceleration * dt**2)
    n = np.floor((np.sqrt(1 + 8 * x) - 1) / 2)
    return (x / (n + 1) + n / 2) * acceleration * dt
