"""The One-Euro filter for poses: strong at rest, where noise shows, weak in motion, where lag does.

Casiez, Roussel, Vogel: 1 Euro Filter: A Simple Speed-based Low-pass Filter for Noisy Input in
Interactive Systems. CHI 2012, doi:10.1145/2207676.2208639. Position and orientation are filtered
separately; a speed is the length of a vector.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..checks import Array, as_number, check_numbers, frozen
from ..rigid import motion_between, shifted


@dataclass(frozen=True)
class OneEuroParameters:
    """Cutoff frequencies, ``cutoff + slope x speed``.

    Attributes
    ----------
    cutoff_hz, turn_cutoff_hz : float
        At rest, of position and orientation, Hz.
    slope, turn_slope : float
        Hz per mm/s, and Hz per rad/s.
    speed_cutoff_hz : float
        Of the speeds.
    """

    cutoff_hz: float = 1.5
    turn_cutoff_hz: float = 1.0
    slope: float = 0.05
    turn_slope: float = 2.0
    speed_cutoff_hz: float = 2.0

    def __post_init__(self) -> None:
        check_numbers(
            self, "cutoff_hz", "turn_cutoff_hz", "speed_cutoff_hz", low=0.0, open_low=True
        )
        check_numbers(self, "slope", "turn_slope", low=0.0)


class Filtered(NamedTuple):
    """The state: time, s, the filtered pose and the last one, and filtered speeds, mm/s and rad/s,
    each (3,).
    """

    t_s: float
    pose: RigidTransform
    last: RigidTransform
    velocity: Array
    turn_rate: Array


def begin(t_s: float, pose: RigidTransform) -> Filtered:
    """The state at a first pose."""
    return Filtered(t_s, pose, pose, frozen(np.zeros(3)), frozen(np.zeros(3)))


def step(
    state: Filtered, t_s: float, pose: RigidTransform, parameters: OneEuroParameters | None = None
) -> Filtered:
    """The state after another pose. Raises ValueError if the time does not increase."""
    p = parameters or OneEuroParameters()
    dt = as_number(t_s, "t_s", state.t_s, open_low=True) - state.t_s
    off = motion_between(pose, state.pose)
    moved = motion_between(pose, state.last)
    share = low_pass_share(p.speed_cutoff_hz, dt)
    velocity = state.velocity + share * (moved[:3] / dt - state.velocity)
    turn_rate = state.turn_rate + share * (moved[3:] / dt - state.turn_rate)
    off[:3] *= low_pass_share(p.cutoff_hz + p.slope * float(np.linalg.norm(velocity)), dt)
    off[3:] *= low_pass_share(
        p.turn_cutoff_hz + p.turn_slope * float(np.linalg.norm(turn_rate)), dt
    )
    return Filtered(t_s, shifted(state.pose, off), pose, frozen(velocity), frozen(turn_rate))


def lag_s(speed: float, cutoff_hz: float, slope: float) -> float:
    """The lag of the filter behind a steady motion, s: the time constant 1 / (2 pi f) of its
    low-pass at that speed.
    """
    return 1 / (2 * np.pi * (cutoff_hz + slope * speed))


def low_pass_share(cutoff_hz: Any, dt: float) -> Any:
    """The share of a step that a first-order low-pass takes in `dt` s; of an array of cutoffs, Hz,
    an array.
    """
    return 1 / (1 + 1 / (2 * np.pi * cutoff_hz * dt))
