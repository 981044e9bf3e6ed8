"""Joint commands from commanded poses: the tool's reference, and joints that follow within their
limits.

The reference follows commanded poses within limits of the tool's speed and acceleration. Joint
speeds follow by differential inverse kinematics (extra `slave`), within limits of position, speed
and acceleration.

Time is divided into ticks, during each of which a joint's speed is constant. A speed is allowed if
it differs from the last one by no more than the acceleration permits, and if the joint can still
stop before the end of its range by slowing down as fast as it may. After a speed that was allowed
at one tick, slowing down is always allowed at the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..checks import Array, check_numbers, frozen
from ..rigid import apart, motion_between, quaternion, rotation_of, shifted
from .arm import TOOL, Limits, Robot, site_pose

MARGIN = 0.7  # of the acceleration, that braking is planned with
TICK_S = 0.002
ORIENTATION_M = 0.3  # a radian counts as much as so many metres
DAMPING = 1e-3  # m^2: a joint that moves the tool by less than 30 mm a radian is spared
# what is left behind is closed no faster than it can be braked with
CATCH_UP_MM_S2, CATCH_UP_RAD_S2 = 1500.0, 3.0


@dataclass(frozen=True)
class ReferenceParameters:
    """Limits and gains of a reference's motion.

    Attributes
    ----------
    rate : float
        Of the approach, 1/s: a steady motion is followed 1 / rate behind, a fast one v / (2 MARGIN
        acceleration).
    speed_mm_s, acceleration_mm_s2 : float
        Of the tool's position.
    turn_rad_s, turn_rad_s2 : float
        Of its orientation.
    leash_mm, leash_rad : float
        How far it may be ahead of the tool, see `leashed`.
    """

    rate: float = 20.0
    speed_mm_s: float = 600.0
    acceleration_mm_s2: float = 3000.0
    turn_rad_s: float = 2.0
    turn_rad_s2: float = 6.0
    leash_mm: float = 4.0
    leash_rad: float = 0.06

    def __post_init__(self) -> None:
        check_numbers(self, *vars(self), low=0.0, open_low=True)


class Reference(NamedTuple):
    """T_base_tool, mm, and the speed of the last tick: of the position, mm/s, and of the
    orientation, rad/s, base.
    """

    pose: RigidTransform
    velocity: Array
    turn_rate: Array


def at_rest(pose: RigidTransform) -> Reference:
    """A reference that does not move."""
    return Reference(pose, frozen(np.zeros(3)), frozen(np.zeros(3)))


def step(
    reference: Reference,
    target: RigidTransform,
    dt: float,
    parameters: ReferenceParameters | None = None,
) -> Reference:
    """One tick of `dt` s towards a target T_base_tool; it comes to rest there without
    overshooting.
    """
    p = parameters or ReferenceParameters()
    off = motion_between(target, reference.pose)
    velocity = _next(reference.velocity, off[:3], dt, p.rate, p.speed_mm_s, p.acceleration_mm_s2)
    turn_rate = _next(reference.turn_rate, off[3:], dt, p.rate, p.turn_rad_s, p.turn_rad_s2)
    moved = shifted(reference.pose, dt * np.concatenate([velocity, turn_rate]))
    return Reference(moved, frozen(velocity), frozen(turn_rate))


def leashed(
    reference: Reference, tool: RigidTransform, parameters: ReferenceParameters | None = None
) -> Reference:
    """Call a reference back that the tool (T_base_tool) cannot follow, or it would come back late
    (anti-windup).

    The reference loses the part of its speed that would lead it further away.
    """
    p = parameters or ReferenceParameters()
    if not apart(reference.pose, tool, p.leash_mm, p.leash_rad):
        return reference
    ahead = motion_between(reference.pose, tool)
    off, velocity = _held(ahead[:3], reference.velocity, p.leash_mm)
    turn, turn_rate = _held(ahead[3:], reference.turn_rate, p.leash_rad)
    return Reference(
        shifted(tool, np.concatenate([off, turn])), frozen(velocity), frozen(turn_rate)
    )


def _held(off: Array, speed: Array, longest: float) -> tuple[Array, Array]:
    """A vector that is cut to a length, and a speed without its part along it, where it was cut."""
    distance = float(np.linalg.norm(off))
    if distance <= longest:
        return off, speed
    along = off / distance
    return longest * along, speed - max(0.0, float(speed @ along)) * along


def _next(
    speed: Array, off: Array, dt: float, rate: float, most: float, acceleration: float
) -> Array:
    """The speed for the next tick: towards what is off by a vector, and so that it can be stopped
    there.
    """
    distance = float(np.linalg.norm(off))
    brake = np.sqrt(2 * MARGIN * acceleration * distance)
    wanted = off * (min(rate * distance, brake, most) / max(distance, 1e-12))
    change = wanted - speed
    size = float(np.linalg.norm(change))
    return speed + change * min(1.0, acceleration * dt / max(size, 1e-12))


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
    high = np.minimum.reduce(
        [speed + change, limits.speed, stopping_speed(limits.high - q, limits.acceleration, dt)]
    )
    low = np.maximum.reduce(
        [speed - change, -limits.speed, -stopping_speed(q - limits.low, limits.acceleration, dt)]
    )
    # to slow down is always allowed
    return np.minimum(low, speed + change), np.maximum(high, speed - change)


def stopping_speed(distance: Array, acceleration: Array, dt: float) -> Array:
    """The highest speed from which a joint stops within a distance, losing ``acceleration * dt``
    from tick to tick.

    With v = (n + f) a dt, n whole and 0 <= f < 1, the ticks v, v - a dt, ... until it rests cover
    a dt^2 (n + 1) (n / 2 + f); this is solved for n and f.
    """
    x = np.maximum(distance, 0.0) / (acceleration * dt**2)
    n = np.floor((np.sqrt(1 + 8 * x) - 1) / 2)
    return (x / (n + 1) + n / 2) * acceleration * dt


class Command(NamedTuple):
    """Commanded joint positions, rad, and speeds of the last tick, rad/s, each (n,)."""

    q: Array
    speed: Array


class Inverse:
    """The inverse kinematics of one robot; it holds work space, and no state.

    Parameters
    ----------
    robot : Robot
    tick_s : float
        Length of a tick, s.
    """

    def __init__(self, robot: Robot, tick_s: float = TICK_S) -> None:
        import mink

        self.robot, self.tick_s = robot, tick_s
        self._configuration = mink.Configuration(robot.model)
        self._task = mink.FrameTask(TOOL, "site", position_cost=1.0, orientation_cost=ORIENTATION_M)
        self._limit = _bounds_of(len(robot.joints))
        self._mink: Any = mink
        self._q: Array | None = None  # what the work space holds the kinematics of
        self._tool = RigidTransform.identity()

    def tool(self, q: Array) -> RigidTransform:
        """T_base_tool, mm, at joint positions, rad."""
        if q is not self._q:
            self._configuration.update(np.array(q))
            self._tool = site_pose(self._configuration.data)
            self._q = None if q.flags.writeable else q
        return self._tool

    def step(self, command: Command, before: RigidTransform, after: RigidTransform) -> Command:
        """The command of the next tick, which no limit is exceeded by.

        Parameters
        ----------
        command : Command
            Of the last tick.
        before, after : RigidTransform
            The reference T_base_tool at the beginning and at the end of the tick, mm.
        """
        now = self.tool(command.q)
        goal = _goal(now, before, after, self.tick_s)
        turn = quaternion(rotation_of(goal))
        self._task.set_target(self._mink.SE3(np.array([*turn, *(goal.translation / 1000)])))
        low, high = speed_bounds(command.q, command.speed, self.robot.limits, self.tick_s)
        self._limit.low = low * self.tick_s
        self._limit.high = high * self.tick_s
        velocity = self._mink.solve_ik(
            self._configuration, [self._task], self.tick_s, "daqp", DAMPING, limits=[self._limit]
        )
        speed = np.clip(velocity, low, high)  # the solver keeps its bounds to a tolerance
        return Command(frozen(command.q + speed * self.tick_s), frozen(speed))


def _bounds_of(n: int) -> Any:
    """A limit for mink: a lowest and a highest step of each joint, set before each tick."""
    import mink

    class Bounds(mink.Limit):
        low = high = np.zeros(n)

        def compute_qp_inequalities(self, configuration: Any, dt: float) -> Any:
            return mink.Constraint(
                np.vstack([np.eye(n), -np.eye(n)]), np.concatenate([self.high, -self.low])
            )

    return Bounds()


def _goal(
    now: RigidTransform, before: RigidTransform, after: RigidTransform, dt: float
) -> RigidTransform:
    """The tool's goal after a tick: moved as the reference moves, and a part of its error
    corrected.
    """
    off = motion_between(before, now)
    closed = np.concatenate(
        [_part(off[:3], CATCH_UP_MM_S2, dt), _part(off[3:], CATCH_UP_RAD_S2, dt)]
    )
    return shifted(shifted(now, closed), motion_between(after, before))


def _part(off: Array, acceleration: float, dt: float) -> Array:
    """The part of a distance that is closed in a tick: half of a short one, of a long one as much
    as can be braked.
    """
    distance = float(np.linalg.norm(off))
    return off * min(0.5, np.sqrt(2 * acceleration * distance) * dt / max(distance, 1e-12))
