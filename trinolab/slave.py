"""The simulated slave arm: servos that follow commands, and the force that its tool feels. Extra `slave`."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .checks import Array, as_array, as_whole, frozen
from .robot import TOOL, Robot, site_pose


class Reading(NamedTuple):
    """What is measured at the arm.

    Attributes
    ----------
    t_s : float
        Time of the simulation, s.
    q, speed : ndarray, shape (n,)
        Of the joints, rad and rad/s.
    tool : RigidTransform
        T_base_tool, mm.
    force : ndarray, shape (3,)
        On the tool, by what it touches, N, base frame.
    """

    t_s: float
    q: Array
    speed: Array
    tool: RigidTransform
    force: Array


class Slave:
    """The arm in MuJoCo, at rest at joint positions `q` (its home without them).

    Its servos run at every step of the simulation (1 kHz in the shipped model); commands between two ticks are
    interpolated.

    Parameters
    ----------
    robot : Robot
    q : array_like, shape (n,), optional
        rad.

    Raises
    ------
    ValueError
        For a start beyond the limits, or one in which the tool is inside something.
    """

    def __init__(self, robot: Robot, q: ArrayLike | None = None) -> None:
        import mujoco

        self.robot, self._mujoco, self._data = robot, mujoco, mujoco.MjData(robot.model)
        start = robot.home if q is None else as_array(q, "q", (len(robot.joints),))
        if ((start < robot.limits.low) | (start > robot.limits.high)).any():
            raise ValueError("q: the start is beyond the limits of a joint")
        self._data.qpos[:] = start
        self._position, self._speed = ([robot.model.actuator(f"{joint}{end}").id for joint in robot.joints]
                                       for end in ("", "_speed"))
        self._data.ctrl[self._position] = start
        mujoco.mj_forward(robot.model, self._data)
        if (self._data.contact.dist < 0).any():
            raise ValueError("q: at the start the tool is inside something")

    @property
    def data(self) -> Any:
        """The `mujoco.MjData`, for pictures of the scene."""
        return self._data

    def advance(self, q_before: Array, q_after: Array, dt: float) -> Reading:
        """Go on by `dt` s, while the commanded positions go from one to the other with one speed.

        Raises ValueError if the simulation diverges.
        """
        steps = as_whole(round(dt / self.robot.model.opt.timestep), "dt", low=1)
        self._data.ctrl[self._speed] = (q_after - q_before) / dt
        for k in range(steps):  # a servo compares where the joint is with where it should be now
            self._data.ctrl[self._position] = q_before + (q_after - q_before) * (k / steps)
            self._mujoco.mj_step(self.robot.model, self._data)
        if self._diverges():
            raise ValueError(f"the simulation diverges at {self._data.time:.3f} s")
        return self.read()

    def read(self) -> Reading:
        """What is measured now."""
        d = self._data
        return Reading(float(d.time), frozen(np.array(d.qpos)), frozen(np.array(d.qvel)), site_pose(d),
                       frozen(self._force()))

    def _force(self) -> Array:
        """The sum of the contact forces on the tool's body."""
        model, data, total = self.robot.model, self._data, np.zeros(3)
        body, wrench = model.site(TOOL).bodyid.item(), np.zeros(6)
        for k, contact in enumerate(data.contact):
            bodies = [model.geom_bodyid[geom] for geom in contact.geom]
            if body in bodies:
                self._mujoco.mj_contactForce(model, data, k, wrench)
                on_second = contact.frame.reshape(3, 3).T @ wrench[:3]
                total += on_second if bodies[1] == body else -on_second
        return total

    def _diverges(self) -> bool:
        bad = (self._mujoco.mjtWarning.mjWARN_BADQACC, self._mujoco.mjtWarning.mjWARN_BADQVEL,
               self._mujoco.mjtWarning.mjWARN_BADQPOS)
        return not np.isfinite(self._data.qpos).all() or any(self._data.warning[one].number for one in bad)
