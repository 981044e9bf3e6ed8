"""Joint commands that take the tool along a reference, by differential inverse kinematics. Extra `slave`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from .checks import Array, frozen
from .limiter import speed_bounds
from .pose import motion_between, shifted
from .rigid import rotation_of
from .robot import TOOL, Robot, site_pose

TICK_S = 0.002
ORIENTATION_M = 0.3  # a radian counts as much as so many metres
DAMPING = 1e-3  # m^2: a joint that moves the tool by less than 30 mm a radian is spared
CATCH_UP_MM_S2, CATCH_UP_RAD_S2 = 1500.0, 3.0  # what is left behind is closed no faster than it can be braked with


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
            self._tool, self._q = site_pose(self._configuration.data), None if q.flags.writeable else q
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
        self._task.set_target(self._se3(_goal(now, before, after, self.tick_s)))
        low, high = speed_bounds(command.q, command.speed, self.robot.limits, self.tick_s)
        self._limit.low, self._limit.high = low * self.tick_s, high * self.tick_s
        found = self._mink.solve_ik(self._configuration, [self._task], self.tick_s, "daqp", DAMPING,
                                    limits=[self._limit])
        speed = np.clip(found, low, high)  # the solver keeps its bounds to a tolerance
        return Command(frozen(command.q + speed * self.tick_s), frozen(speed))

    def _se3(self, pose: RigidTransform) -> Any:
        w, x, y, z = rotation_of(pose).as_quat(scalar_first=True)
        return self._mink.SE3(np.array([w, x, y, z, *(pose.translation / 1000)]))


def _bounds_of(n: int) -> Any:
    """A limit for mink: a lowest and a highest step of each joint, set before each tick."""
    import mink

    class Bounds(mink.Limit):
        low = high = np.zeros(n)

        def compute_qp_inequalities(self, configuration: Any, dt: float) -> Any:
            return mink.Constraint(np.vstack([np.eye(n), -np.eye(n)]), np.concatenate([self.high, -self.low]))

    return Bounds()


def _goal(now: RigidTransform, before: RigidTransform, after: RigidTransform, dt: float) -> RigidTransform:
    """Where the tool should be after a tick: moved as the reference moves, and a part of what it was off."""
    off = motion_between(before, now)
    closed = np.concatenate([_part(off[:3], CATCH_UP_MM_S2, dt), _part(off[3:], CATCH_UP_RAD_S2, dt)])
    return shifted(shifted(now, closed), motion_between(after, before))


def _part(off: Array, acceleration: float, dt: float) -> Array:
    """The part of a distance that is closed in a tick: half of a short one, of a long one as much as can be braked."""
    distance = float(np.linalg.norm(off))
    return off * min(0.5, np.sqrt(2 * acceleration * distance) * dt / max(distance, 1e-12))
