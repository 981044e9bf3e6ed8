"""What a teleoperation session leaves behind: the joints' trajectory and the events, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from .session import Moment


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
        self.joints, self.events = list(joints), list[Event]()
        self._ticks: list[np.ndarray] = []
        self._last: tuple[bool, str, tuple[str, ...]] = (False, "", ())

    def add(self, moment: Moment, clutch: bool) -> None:
        """One more moment; its changes against the one before become events."""
        ticks = moment.ticks
        tool = np.array([pose.translation for pose in ticks.tool]).reshape(-1, 3)
        self._ticks.append(np.column_stack([ticks.t_s, ticks.q, ticks.speed, ticks.measured, tool]))
        now = (clutch, moment.state.held, moment.limits)
        self.events += _changes(moment.state.t_s, self._last, now)
        self._last = now

    def trajectory(self) -> pd.DataFrame:
        """A row a tick: ``t_s``; each joint commanded (rad, rad/s) and measured (rad); the tool (mm, base)."""
        columns = ["t_s", *(f"{joint}{end}" for end in ("_rad", "_rad_s", "_measured_rad") for joint in self.joints),
                   "tool_x_mm", "tool_y_mm", "tool_z_mm"]
        rows = np.vstack(self._ticks) if self._ticks else np.empty((0, len(columns)))
        return pd.DataFrame(rows, columns=columns)

    def event_table(self) -> pd.DataFrame:
        """A row an event: ``t_s``, ``event``, ``detail``."""
        return pd.DataFrame(self.events, columns=list(Event._fields))


def _changes(t: float, before: tuple[bool, str, tuple[str, ...]], now: tuple[bool, str, tuple[str, ...]]
             ) -> list[Event]:
    found = [Event(t, "clutch closed" if now[0] else "clutch open")] if now[0] != before[0] else []
    if now[1] != before[1]:
        found.append(Event(t, "hold", now[1]) if now[1] else Event(t, "hold ended"))
    found += [Event(t, "limit", name) for name in now[2] if name not in before[2]]
    return found + [Event(t, "limit left", name) for name in before[2] if name not in now[2]]
