"""The movement mapping of a leader and a follower: the handle's pose to the tool's (Sect. 2, 3.1).

While the clutch is closed, the tool moves from where it was when it was closed as the handle moves
from where it was, scaled, and turned so that the operator sees in the surveillance camera's picture
what the hand does. While it is open the tool rests, and the hand can be brought back (indexing). An
unreliable sample stops the tool as well, until the clutch has been opened and closed again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import Camera
from ..checks import Array, as_number, check_numbers, frozen
from ..rigid import apart, motion_between, placed, rotation_matrix, rotation_of
from . import oneeuro
from .oneeuro import Filtered, OneEuroParameters

FOLLOWED = ("measured", "ambiguous", "predicted")
LOST = "pose lost"
STALE = "pose stale"
JUMP = "pose jumped"
NOT_FINITE = "pose not finite"
BACKWARDS = "time went backwards"


@dataclass(frozen=True)
class MappingParameters:
    """Parameters of the mapping from the handle's motion to the tool's.

    Attributes
    ----------
    scale : float
        Distance that the tool moves, divided by the handle's.
    turn_scale : float
        Angle that the tool turns, divided by the handle's.
    alignment : Rotation
        R_base_world: how directions in the handle's world frame become directions at the robot, see
        `alignment`.
    filtering : OneEuroParameters
    stale_s : float
        Largest age of the last measured pose.
    hand_mm_s, hand_rad_s : float
        Largest speed of a hand: a pose that is further away counts as wrong.
    slack_mm, slack_rad : float
        Allowance for the error of a pose.
    reach_mm : tuple of three pairs of floats
        Range of the commanded position, low and high in x, y, z of the base.
    leash_mm : float
        Distance by which the hand may lead beyond that range; from there on it takes the handle's
        origin along (anti-windup).
    """

    scale: float = 1.0
    turn_scale: float = 1.0
    alignment: Rotation = field(default_factory=Rotation.identity)
    filtering: OneEuroParameters = field(default_factory=OneEuroParameters)
    stale_s: float = 0.15
    hand_mm_s: float = 3000.0
    hand_rad_s: float = 25.0
    slack_mm: float = 5.0
    slack_rad: float = 0.1
    reach_mm: tuple[tuple[float, float], ...] = ((-850.0, 850.0), (-850.0, 850.0), (0.0, 950.0))
    leash_mm: float = 10.0

    def __post_init__(self) -> None:
        check_numbers(
            self,
            "scale",
            "turn_scale",
            "stale_s",
            "hand_mm_s",
            "hand_rad_s",
            low=0.0,
            open_low=True,
        )
        check_numbers(self, "slack_mm", "slack_rad", "leash_mm", low=0.0)
        if len(self.reach_mm) != 3:
            raise ValueError(
                f"reach_mm: expected low and high of x, y and z, got {len(self.reach_mm)} pairs"
            )
        for axis, (low, high) in zip("xyz", self.reach_mm, strict=True):
            as_number(
                high,
                f"reach_mm: high {axis}",
                as_number(low, f"reach_mm: low {axis}"),
                open_low=True,
            )


class Sample(NamedTuple):
    """An instant: time, s; T_world_handle, mm, or None; the pose's status; whether the clutch is
    closed.
    """

    t_s: float
    T_world_handle: RigidTransform | None
    status: str
    clutch: bool


class Origin(NamedTuple):
    """Positions of handle (world) and tool (base) when the clutch was closed, mm, each (3,)."""

    handle: Array
    tool: Array


class State(NamedTuple):
    """The mapping's state.

    Attributes
    ----------
    t_s : float
        Of the last instant, s.
    target : RigidTransform
        T_base_tool, mm.
    origin : Origin or None
        None while the tool rests.
    handle : Filtered or None
        The filtered pose of the handle, as long as it is known.
    measured_s : float
        When it was measured last, s.
    held : str
        Why the tool rests although the clutch is closed; empty if it does not.
    limited : bool
        Whether the target was beyond `MappingParameters.reach_mm`.
    """

    t_s: float
    target: RigidTransform
    origin: Origin | None = None
    handle: Filtered | None = None
    measured_s: float = -np.inf
    held: str = ""
    limited: bool = False


def alignment(surveillance: Camera, R_operator_world: Rotation | None = None) -> Rotation:
    """R_base_world by which the tool goes right, down and away in the picture as the hand does
    before the operator.

    Parameters
    ----------
    surveillance : Camera
        Its frame in the robot's base frame, as ``T_world_cam``.
    R_operator_world : Rotation, optional
        From the handle's world frame to one with x to the operator's right, y down, z away; without
        it the world frame is such a one, as if the operator looked along CCD1's axis.
    """
    return surveillance.T_world_cam.rotation * (R_operator_world or Rotation.identity())


def step(state: State, sample: Sample, parameters: MappingParameters | None = None) -> State:
    """The state after another instant. No sample raises an error: one that cannot be used stops the
    tool.
    """
    p = parameters or MappingParameters()
    t = sample.t_s
    wrong = _wrong(state, sample, p)
    if wrong == BACKWARDS:
        return _resting(state, wrong if sample.clutch else "")
    if wrong in (JUMP, NOT_FINITE) or (wrong and t - state.measured_s > p.stale_s):
        return _resting(state, wrong if sample.clutch else "")._replace(t_s=t, handle=None)
    if wrong:  # a moment without a pose
        return state._replace(t_s=t) if sample.clutch else _resting(state, "")._replace(t_s=t)
    return (
        _mapped(state, _seen(state, sample, p), p)
        if sample.clutch
        else _resting(_seen(state, sample, p), "")
    )


def _wrong(state: State, sample: Sample, p: MappingParameters) -> str:
    """The fault of a sample; empty if it can be used."""
    T = sample.T_world_handle
    if not state.t_s < sample.t_s < np.inf:  # nor NaN
        return BACKWARDS
    if T is None or sample.status not in FOLLOWED:
        return LOST
    if not np.isfinite(T.as_matrix()).all():
        return NOT_FINITE
    gone_s = sample.t_s - state.measured_s
    # the stream had stopped
    if gone_s > p.stale_s and (sample.status == "predicted" or state.origin is not None):
        return STALE
    return JUMP if state.handle is not None and _is_jump(state.handle, sample, p) else ""


def _is_jump(handle: Filtered, sample: Sample, p: MappingParameters) -> bool:
    """Whether a pose is further from the filtered one than a hand can be by then."""
    assert sample.T_world_handle is not None
    dt = sample.t_s - handle.t_s
    return apart(
        sample.T_world_handle,
        handle.pose,
        p.hand_mm_s * dt + p.slack_mm,
        p.hand_rad_s * dt + p.slack_rad,
    )


def _seen(state: State, sample: Sample, p: MappingParameters) -> State:
    """The state with the handle's pose, filtered."""
    T, t = sample.T_world_handle, sample.t_s
    assert T is not None
    handle = (
        oneeuro.begin(t, T)
        if state.handle is None
        else oneeuro.step(state.handle, t, T, p.filtering)
    )
    return state._replace(
        t_s=t, handle=handle, measured_s=state.measured_s if sample.status == "predicted" else t
    )


def _mapped(before: State, state: State, p: MappingParameters) -> State:
    """The state with the target that belongs to the handle's pose; `before` is that of the instant
    before.
    """
    if state.held or state.handle is None:
        return state
    pose = state.handle.pose
    origin = state.origin or Origin(pose.translation, state.target.translation)
    wanted = origin.tool + p.scale * p.alignment.apply(pose.translation - origin.handle)
    reached = np.clip(wanted, *np.transpose(p.reach_mm))
    ahead = wanted - reached
    excess = ahead * max(0.0, 1 - p.leash_mm / max(float(np.linalg.norm(ahead)), 1e-12))
    target = placed(reached, _turned(before, pose, p) @ rotation_of(state.target))
    return state._replace(
        target=target,
        origin=Origin(origin.handle, frozen(origin.tool - excess)),
        limited=bool(ahead.any()),
    )


def _turned(before: State, pose: RigidTransform, p: MappingParameters) -> Array:
    """The rotation matrix that the tool turns by from one instant to the next; scaled step by
    step, as angles beyond 180 deg are.
    """
    if before.origin is None or before.handle is None:
        return np.eye(3)
    turn = motion_between(pose, before.handle.pose)[3:]
    return rotation_matrix(p.turn_scale * p.alignment.apply(turn))


def _resting(state: State, why: str) -> State:
    """The state in which the tool rests where it is commanded to be; the first reason is kept."""
    return state._replace(origin=None, held=(state.held or why) if why else "", limited=False)
