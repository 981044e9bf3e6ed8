"""A filter for the handle's pose: position and orientation with their rates, driven by a white
jerk.

The model of `kalman` with 18 numbers: a small motion away from the estimated pose, its rate and the
rate's rate. After each step the motion is merged into the pose and reset to zero (the error-state
filter, Sola 2017, arXiv:1711.02508), so that its three angles stay small.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform

from .. import kalman
from ..checks import Array, as_number, check_numbers, frozen
from ..rigid import motion_between, shifted

FADING_S = 0.15  # time in which an acceleration fades
H = np.eye(6, 18)  # the pose is observed, its rates are not (Eq. 12)


@dataclass(frozen=True)
class PoseFilterParameters:
    """Parameters of the handle's motion model.

    Attributes
    ----------
    jerk_mm, jerk_rad : float
        Intensity of the white jerk, mm^2/s^5 and rad^2/s^5. The first is the most likely one under
        motions drawn like a person's, the second under a recording of a real hand (`python -m
        workbench.studies.tuning`), rounded.
    speed_mm_s, turn_rad_s : float
        Standard deviations of the rates at the start.
    floor_mm, floor_rad : float
        Added to the measured poses' standard deviations, for errors that their covariances do not
        contain.
    """

    jerk_mm: float = 4e7
    jerk_rad: float = 5e1
    speed_mm_s: float = 400.0
    turn_rad_s: float = 2.0
    floor_mm: float = 0.05
    floor_rad: float = 0.005

    def __post_init__(self) -> None:
        check_numbers(self, *vars(self), low=0.0, high=1e12, open_low=True)


class Motion(NamedTuple):
    """The estimated motion of the handle at a time.

    Attributes
    ----------
    t_s : float
    pose : RigidTransform
        T_world_handle.
    rates : ndarray, shape (12,)
        Velocity (mm/s), turn rate (rad/s), and their rates; world frame.
    covariance : ndarray, shape (18, 18)
        Of pose (mm, rad) and rates.
    """

    t_s: float
    pose: RigidTransform
    rates: Array
    covariance: Array

    @property
    def pose_covariance(self) -> Array:
        """Covariance of position (mm) and rotation vector (rad), world frame, shape (6, 6)."""
        return self.covariance[:6, :6]


def begin(t_s: float, pose: RigidTransform, covariance: Array, p: PoseFilterParameters) -> Motion:
    """The motion after a first pose with its covariance (6, 6): rates are zero and unknown."""
    rates = np.repeat([p.speed_mm_s, p.turn_rad_s], 3)
    spread = np.zeros((18, 18))
    spread[:6, :6] = covariance + _floor(p)
    # from rest within 0.1 s
    spread[range(6, 18), range(6, 18)] = np.concatenate([rates, 10 * rates]) ** 2
    return Motion(t_s, pose, np.zeros(12), spread)


def is_new(motion: Motion, p: PoseFilterParameters) -> bool:
    """Whether the velocity is hardly better known than at the start."""
    return bool(np.trace(motion.covariance[6:9, 6:9]) > 3 * (p.speed_mm_s / 2) ** 2)


def predict(motion: Motion, t_s: float, p: PoseFilterParameters) -> Motion:
    """Carry a motion on to a later time (Eq. 9, 10, of 18 numbers). Raises ValueError if the time
    does not increase.
    """
    F, Q = model(
        as_number(t_s - motion.t_s, "t_s", low=kalman.MIN_DT_S, high=1e6), p.jerk_mm, p.jerk_rad
    )
    x, P = kalman.propagate(_state(motion), motion.covariance, F, Q)
    return Motion(t_s, shifted(motion.pose, x[:6]), x[6:], P)


def update(
    motion: Motion, pose: RigidTransform, covariance: Array, p: PoseFilterParameters
) -> Motion:
    """Correct a predicted motion by a measured pose with its covariance (6, 6) (Eq. 13-15)."""
    x = _state(motion)
    P = motion.covariance
    z = motion_between(pose, motion.pose)
    R = covariance + _floor(p)
    r, S = kalman.compare(x, P, z, H, R)
    x, P = kalman.correct(x, P, r, S, H, R)
    return Motion(motion.t_s, shifted(motion.pose, x[:6]), x[6:], P)


def restarted(
    motion: Motion, position: Array, covariance: Array, seen: Motion, p: PoseFilterParameters
) -> Motion:
    """A motion that is elsewhere than predicted, at a position (3,), mm, with a covariance (3, 3).

    Its velocity is the mean velocity since it was last measured. The orientation and its covariance
    stay as predicted.
    """
    pose = RigidTransform.from_components(position, motion.pose.rotation)
    begun = begin(motion.t_s, pose, block_diag(covariance, np.zeros((3, 3))), p)
    rates = motion.rates.copy()
    spread = begun.covariance.copy()
    rates[:3] = (position - seen.pose.translation) / (motion.t_s - seen.t_s)
    rates[6:9] = 0.0
    turning = np.r_[3:6, 9:12, 15:18]
    spread[np.ix_(turning, turning)] = motion.covariance[np.ix_(turning, turning)]
    return Motion(motion.t_s, pose, rates, spread)


def nis(motion: Motion, pose: RigidTransform, covariance: Array, p: PoseFilterParameters) -> float:
    """The normalised innovation squared of a measured pose: chi-square with six degrees of freedom
    if all holds.
    """
    z = motion_between(pose, motion.pose)
    R = covariance + _floor(p)
    r, S = kalman.compare(_state(motion), motion.covariance, z, H, R)
    return float(r @ np.linalg.solve(S, r))


@lru_cache(maxsize=4096)
def transition(dt: float, fading_s: float = np.inf) -> Array:
    """Phi of one coordinate, (x, v, a), over a time dt, s, with an acceleration that fades, shape
    (3, 3) (Eq. 11).
    """
    if np.isinf(fading_s):
        return frozen(np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]]))
    share = dt / fading_s
    remainder = np.exp(-share)
    from_acceleration = fading_s**2 * (share - 1 + remainder)
    return frozen(
        np.array(
            [[1, dt, from_acceleration], [0, 1, -fading_s * np.expm1(-share)], [0, 0, remainder]]
        )
    )


@lru_cache(maxsize=64)
def model(dt: float, jerk_mm: float, jerk_rad: float) -> tuple[Array, Array]:
    """Phi and Q of the 18 numbers, (18, 18) each (Eq. 10, 11); a hand's acceleration does not last
    (Singer 1970).
    """
    F = np.kron(transition(dt, FADING_S), np.eye(6))
    Q = np.kron(kalman.white_jerk(dt, 1.0)[::2, ::2], np.diag(np.repeat([jerk_mm, jerk_rad], 3)))
    return F.astype(float), Q.astype(float)


def _state(motion: Motion) -> Array:
    """X of the 18 numbers: no motion away from the pose that is believed, and the rates."""
    return np.concatenate([np.zeros(6), motion.rates])


def _floor(p: PoseFilterParameters) -> Array:
    return np.diag(np.repeat([p.floor_mm, p.floor_rad], 3) ** 2)
