"""A teleoperation session in memory: the handle's poses in, the arm's motion out, tick by tick. Extra `slave`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from . import reference, teleop
from .checks import Array, frozen
from .inverse import Command, Inverse
from .reference import Reference, ReferenceParameters
from .robot import Robot
from .slave import Reading, Slave
from .teleop import MappingParameters, Sample, State

LONGEST_S = 3.0  # of a gap between two samples; by then the arm rests


class Ticks(NamedTuple):
    """What happened from one instant to the next, n ticks.

    Attributes
    ----------
    t_s : ndarray, shape (n,)
        Ends of the ticks.
    q, speed : ndarray, shape (n, joints)
        Commanded, rad and rad/s.
    measured : ndarray, shape (n, joints)
        Of the simulated arm, rad.
    reference, commanded, tool : list of RigidTransform
        T_base_tool, mm: the limited reference, that of the commanded joints, and that of the simulated arm.
    """

    t_s: Array
    q: Array
    speed: Array
    measured: Array
    reference: list[RigidTransform]
    commanded: list[RigidTransform]
    tool: list[RigidTransform]


class Moment(NamedTuple):
    """An instant: the mapping's state after its sample, the ticks up to it, and what is measured at the arm."""

    state: State
    ticks: Ticks
    reading: Reading
    limits: tuple[str, ...]


class Session:
    """The whole chain behind the tracker: mapping, reference, inverse kinematics, servos.

    Parameters
    ----------
    robot : Robot
    mapping : MappingParameters, optional
    following : ReferenceParameters, optional
    q : array_like, shape (n,), optional
        Where the arm starts, rad; its home without it.

    Raises
    ------
    ValueError
        For a start that cannot be, see `slave.Slave`.
    """

    def __init__(self, robot: Robot, mapping: MappingParameters | None = None,
                 following: ReferenceParameters | None = None, q: ArrayLike | None = None) -> None:
        self.robot, self.mapping = robot, mapping or MappingParameters()
        self._following, self._inverse, self.slave = following or ReferenceParameters(), Inverse(robot), Slave(robot, q)
        start = self.slave.read()
        self._command, self._reference = Command(start.q, start.speed), reference.at_rest(start.tool)
        self.state: State | None = None
        self._moved_s = 0.0  # up to when the arm has moved

    def step(self, sample: Sample) -> Moment:
        """One instant: the arm moves up to its time as was commanded before, then the sample says what comes next.

        Raises ValueError if the simulation diverges.
        """
        if self.state is None:
            self.state = State(np.nextafter(sample.t_s, -np.inf), self._reference.pose)
            self._moved_s = sample.t_s
        ticks = self._run(self.state, sample.t_s)
        self.state = teleop.step(self.state, sample, self.mapping)
        return Moment(self.state, ticks, self.slave.read(), self._at_limits())

    def _run(self, state: State, until_s: float) -> Ticks:
        dt = self._inverse.tick_s
        gap = until_s - self._moved_s  # with what rounding has left from the instant before
        count = round(min(gap, LONGEST_S) / dt) if gap > 0 else 0
        begin = until_s - count * dt if gap > LONGEST_S else self._moved_s
        rows = [(begin + (k + 1) * dt, *self._tick(state.target)) for k in range(count)]
        self._moved_s = begin + count * dt
        times, commands, readings, references = zip(*rows, strict=True) if rows else ((), (), (), ())
        n = len(self.robot.joints)
        return Ticks(frozen(np.array(times)), frozen(np.array([c.q for c in commands]).reshape(-1, n)),
                     frozen(np.array([c.speed for c in commands]).reshape(-1, n)),
                     frozen(np.array([r.q for r in readings]).reshape(-1, n)), [one[0] for one in references],
                     [one[1] for one in references], [r.tool for r in readings])

    def _tick(self, target: RigidTransform) -> tuple[Command, Reading, tuple[RigidTransform, RigidTransform]]:
        dt, before, command = self._inverse.tick_s, self._reference, self._command
        after: Reference = reference.step(before, target, dt, self._following)
        self._command = self._inverse.step(command, before.pose, after.pose)
        commanded = self._inverse.tool(self._command.q)
        self._reference = reference.leashed(after, commanded, self._following)
        reading = self.slave.advance(command.q, self._command.q, dt)
        return self._command, reading, (after.pose, commanded)

    def _at_limits(self) -> tuple[str, ...]:
        """What cannot go further: joints at an end of their range, the reach of the mapping, the leash."""
        q, limits = self._command.q, self.robot.limits
        ends = np.minimum(q - limits.low, limits.high - q) < 1e-3
        names = [joint for joint, end in zip(self.robot.joints, ends, strict=True) if end]
        return (*names, *(["reach"] if self.state is not None and self.state.limited else []))
