"""A tool's reference: goes after commanded poses no faster, and with no more acceleration, than a tool should."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from .checks import Array, as_number, frozen
from .pose import apart, motion_between, shifted

MARGIN = 0.7  # of the acceleration, that braking is planned with


@dataclass(frozen=True)
class ReferenceParameters:
    """How a reference may move.

    Attributes
    ----------
    rate : float
        Of the approach, 1/s: a steady motion is followed 1 / rate behind, a fast one v / (2 MARGIN acceleration).
    speed_mm_s, acceleration_mm_s2 : float
        Of the tool's position.
    turn_rad_s, turn_rad_s2 : float
        Of its orientation.
    leash_mm, leash_rad : float
        How far it may be ahead of the tool, see `leashed`.

    Raises
    ------
    ValueError
        Names the field that is no number above 0.
    """

    rate: float = 20.0
    speed_mm_s: float = 600.0
    acceleration_mm_s2: float = 3000.0
    turn_rad_s: float = 2.0
    turn_rad_s2: float = 6.0
    leash_mm: float = 4.0
    leash_rad: float = 0.06

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, as_number(value, name, 0.0, open_low=True))


class Reference(NamedTuple):
    """T_base_tool, mm, and the speed of the last tick: of the position, mm/s, and of the orientation, rad/s, base."""

    pose: RigidTransform
    velocity: Array
    turn_rate: Array


def at_rest(pose: RigidTransform) -> Reference:
    """A reference that does not move."""
    return Reference(pose, frozen(np.zeros(3)), frozen(np.zeros(3)))


def step(reference: Reference, target: RigidTransform, dt: float, parameters: ReferenceParameters | None = None
         ) -> Reference:
    """One tick of `dt` s towards a target T_base_tool; it comes to rest there without overshooting."""
    p = parameters or ReferenceParameters()
    off = motion_between(target, reference.pose)
    velocity = _next(reference.velocity, off[:3], dt, p.rate, p.speed_mm_s, p.acceleration_mm_s2)
    turn_rate = _next(reference.turn_rate, off[3:], dt, p.rate, p.turn_rad_s, p.turn_rad_s2)
    moved = shifted(reference.pose, dt * np.concatenate([velocity, turn_rate]))
    return Reference(moved, frozen(velocity), frozen(turn_rate))


def leashed(reference: Reference, tool: RigidTransform, parameters: ReferenceParameters | None = None) -> Reference:
    """Call a reference back that the tool (T_base_tool) cannot follow, or it would come back late (anti-windup).

    What goes on pulling at the leash, its speed loses.
    """
    p = parameters or ReferenceParameters()
    if not apart(reference.pose, tool, p.leash_mm, p.leash_rad):
        return reference
    ahead = motion_between(reference.pose, tool)
    off, velocity = _held(ahead[:3], reference.velocity, p.leash_mm)
    turn, turn_rate = _held(ahead[3:], reference.turn_rate, p.leash_rad)
    return Reference(shifted(tool, np.concatenate([off, turn])), frozen(velocity), frozen(turn_rate))


def _held(off: Array, speed: Array, longest: float) -> tuple[Array, Array]:
    """A vector that is cut to a length, and a speed without its part along it, where it was cut."""
    distance = float(np.linalg.norm(off))
    if distance <= longest:
        return off, speed
    along = off / distance
    return longest * along, speed - max(0.0, float(speed @ along)) * along


def _next(speed: Array, off: Array, dt: float, rate: float, most: float, acceleration: float) -> Array:
    """The speed for the next tick: towards what is off by a vector, and so that it can be stopped there."""
    distance = float(np.linalg.norm(off))
    brake = np.sqrt(2 * MARGIN * acceleration * distance)
    wanted = off * (min(rate * distance, brake, most) / max(distance, 1e-12))
    change = wanted - speed
    size = float(np.linalg.norm(change))
    return speed + change * min(1.0, acceleration * dt / max(size, 1e-12))
