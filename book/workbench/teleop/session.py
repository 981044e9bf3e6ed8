"""A teleoperation session in memory: the handle's poses in, the arm's motion out, tick by tick.
Extra `slave`.

What it leaves behind, the joints' trajectory and the events, is kept as tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab.checks import Array, frozen
from trinolab.slave import control
from trinolab.slave import mapping as slave_mapping
from trinolab.slave.arm import Reading, Robot, Slave
from trinolab.slave.control import Command, Inverse, Reference, ReferenceParameters
from trinolab.slave.mapping import MappingParameters, Sample, State

TOUCHED_N = 1.0  # a force from which on the tool touches something
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
        T_base_tool, mm: the limited reference, that of the commanded joints, and that of the
        simulated arm.
    force_n : ndarray, shape (n,)
        On the tool, N.
    """

    t_s: Array
    q: Array
    speed: Array
    measured: Array
    reference: list[RigidTransform]
    commanded: list[RigidTransform]
    tool: list[RigidTransform]
    force_n: Array


class Moment(NamedTuple):
    """An instant: the mapping's state after its sample, the ticks up to it, and what is measured at
    the arm.
    """

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
    tick_s : float
        From one command to the arm to the next, s.
    longest_s : float
        Of a gap between two samples that the arm moves in, s.

    Raises
    ------
    ValueError
        For a start that cannot be, see `arm.Slave`.
    """

    def __init__(
        self,
        robot: Robot,
        mapping: MappingParameters | None = None,
        following: ReferenceParameters | None = None,
        q: ArrayLike | None = None,
        tick_s: float = control.TICK_S,
        longest_s: float = LONGEST_S,
    ) -> None:
        self.robot = robot
        self.mapping = mapping or MappingParameters()
        self._following = following or ReferenceParameters()
        self._inverse = Inverse(robot, tick_s)
        self._longest_s = longest_s
        self.slave = Slave(robot, q)
        start = self.slave.read()
        self._command = Command(start.q, start.speed)
        self._reference = control.at_rest(start.tool)
        self.state: State | None = None
        self._moved_s = 0.0  # up to when the arm has moved

    def step(self, sample: Sample) -> Moment:
        """One instant: the arm moves up to its time as was commanded before, then the sample says
        what comes next.

        Raises ValueError if the simulation diverges.
        """
        if self.state is None:
            self.state = State(np.nextafter(sample.t_s, -np.inf), self._reference.pose)
            self._moved_s = sample.t_s
        ticks = self._run(self.state, sample.t_s)
        self.state = slave_mapping.step(self.state, sample, self.mapping)
        return Moment(self.state, ticks, self.slave.read(), self._at_limits())

    def _run(self, state: State, until_s: float) -> Ticks:
        dt = self._inverse.tick_s
        gap = until_s - self._moved_s  # with what rounding has left from the instant before
        count = round(min(gap, self._longest_s) / dt) if gap > 0 else 0
        begin = until_s - count * dt if gap > self._longest_s else self._moved_s
        rows = [(begin + (k + 1) * dt, *self._tick(state.target)) for k in range(count)]
        self._moved_s = begin + count * dt
        times, commands, readings, references = (
            zip(*rows, strict=True) if rows else ((), (), (), ())
        )
        n = len(self.robot.joints)
        return Ticks(
            frozen(np.array(times)),
            frozen(np.array([c.q for c in commands]).reshape(-1, n)),
            frozen(np.array([c.speed for c in commands]).reshape(-1, n)),
            frozen(np.array([r.q for r in readings]).reshape(-1, n)),
            [one[0] for one in references],
            [one[1] for one in references],
            [r.tool for r in readings],
            frozen(np.array([np.linalg.norm(r.force) for r in readings])),
        )

    def _tick(
        self, target: RigidTransform
    ) -> tuple[Command, Reading, tuple[RigidTransform, RigidTransform]]:
        dt = self._inverse.tick_s
        before = self._reference
        command = self._command
        after: Reference = control.step(before, target, dt, self._following)
        self._command = self._inverse.step(command, before.pose, after.pose)
        commanded = self._inverse.tool(self._command.q)
        self._reference = control.leashed(after, commanded, self._following)
        reading = self.slave.advance(command.q, self._command.q, dt)
        return self._command, reading, (after.pose, commanded)

    def _at_limits(self) -> tuple[str, ...]:
        """What cannot go further: joints at an end of their range, the reach of the mapping, the
        leash.
        """
        q, limits = self._command.q, self.robot.limits
        ends = np.minimum(q - limits.low, limits.high - q) < 1e-3
        names = [joint for joint, end in zip(self.robot.joints, ends, strict=True) if end]
        return (*names, *(["reach"] if self.state is not None and self.state.limited else []))


class Event(NamedTuple):
    """Something that happened: time, s, what, and which or why."""

    t_s: float
    event: str
    detail: str = ""


class Log:
    """The moments of a session, as they come.

    Parameters
    ----------
    joints : sequence of str
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self.joints = list(joints)
        self.events = list[Event]()
        self._ticks: list[np.ndarray] = []
        self._last = Now()

    def add(self, moment: Moment, clutch: bool, scale: float | None = None) -> None:
        """One more moment; its changes against the one before become events.

        `scale` is that of the mapping, tool : handle; None if it never changes.
        """
        ticks = moment.ticks
        tool = np.array([pose.translation for pose in ticks.tool]).reshape(-1, 3)
        parts = [ticks.t_s, ticks.q, ticks.speed, ticks.measured, tool, ticks.force_n]
        self._ticks.append(np.column_stack(parts))
        touching = bool(np.linalg.norm(moment.reading.force) > TOUCHED_N)
        now = Now(clutch, moment.state.held, moment.limits, touching, scale)
        self.events += changes(moment.state.t_s, self._last, now)
        self._last = now

    def trajectory(self) -> pd.DataFrame:
        """A row per tick: ``t_s``; each joint commanded (rad, rad/s) and measured (rad); the tool
        (mm, base), and the force on it (N).
        """
        columns = [
            "t_s",
            *(
                f"{joint}{end}"
                for end in ("_rad", "_rad_s", "_measured_rad")
                for joint in self.joints
            ),
            "tool_x_mm",
            "tool_y_mm",
            "tool_z_mm",
            "force_n",
        ]
        rows = np.vstack(self._ticks) if self._ticks else np.empty((0, len(columns)))
        return pd.DataFrame(rows, columns=columns)

    def event_table(self) -> pd.DataFrame:
        """A row an event: ``t_s``, ``event``, ``detail``."""
        return pd.DataFrame(self.events, columns=list(Event._fields))


class Now(NamedTuple):
    """What a log compares: clutch, reason of a hold, limits, whether the tool touches something,
    scale.
    """

    clutch: bool = False
    held: str = ""
    limits: tuple[str, ...] = ()
    touching: bool = False
    scale: float | None = None


def changes(t: float, before: Now, now: Now) -> list[Event]:
    """What has changed from one instant to the next."""
    changed = []
    if now.scale != before.scale and None not in (now.scale, before.scale):
        changed.append(Event(t, "scale", f"{now.scale:g}"))
    if now.clutch != before.clutch:
        changed.append(Event(t, "clutch closed" if now.clutch else "clutch open"))
    if now.held != before.held:
        changed.append(Event(t, "hold", now.held) if now.held else Event(t, "hold ended"))
    if now.touching != before.touching:
        changed.append(Event(t, "contact" if now.touching else "contact left"))
    changed += [Event(t, "limit", name) for name in now.limits if name not in before.limits]
    return changed + [
        Event(t, "limit left", name) for name in before.limits if name not in now.limits
    ]
