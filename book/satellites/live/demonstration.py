"""The pointing task played by the simulated hand, so that a person who has just opened the page sees
it done, without cameras and without a mouse.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.teleop.operators import least_jerk

from .pointing import GO, MARK_MM, TARGET, Doing

NAME = "demonstration"  # in the place of an operator's
FIRST_S, PAUSE_S = 0.3, 4.0  # before the first run, and between two, when the result is read
HOME_S = 0.8  # the hand is in the middle by then
REACTION_S = 0.3  # before each move
MOVE_S, MOVE_S_MM = 0.45, 0.004  # how long a move takes: at least, and more for each mm
SETTLES_S = 0.4  # the tool is behind the hand
OPEN_S = 1.0  # so long stays the clutch open when the arm has held


class Seen(NamedTuple):
    """What the hand's player sees in a round.

    Attributes
    ----------
    t_s : float
    task : Doing or None
    held : bool
        Whether the arm holds.
    scale : float
        Tool : handle.
    hand_mm : float
        Where the hand goes, along the task's line.
    """

    t_s: float
    task: Doing | None
    held: bool
    scale: float
    hand_mm: float


class Act(NamedTuple):
    """What the player does: begin the task, close or open the clutch, bring the hand to a place
    along the line, mm, and say that the tool is there.
    """

    begin: bool = False
    clutch: bool = False
    hand_mm: float = 0.0
    press: bool = False


class _Move(NamedTuple):
    """A way along the line, mm, between two times, s."""

    begin_s: float
    end_s: float
    from_mm: float
    to_mm: float

    def at(self, t_s: float) -> float:
        """Where the hand is at a time."""
        share = np.clip((t_s - self.begin_s) / (self.end_s - self.begin_s), 0.0, 1.0)
        return float(self.from_mm + (self.to_mm - self.from_mm) * least_jerk(share))


class Demonstration:
    """A player who goes to each mark and target in moves of least jerk, and corrects what a move
    has left.
    """

    def __init__(self) -> None:
        self._begins_s: float | None = None  # the next run
        self._pause_s = FIRST_S
        self._begun_s = 0.0
        self._held_s = -np.inf
        self._aim: tuple[str, int] | None = None
        self._move: _Move | None = None

    def step(self, seen: Seen) -> Act:
        """A round."""
        if seen.task is None:
            return self._between(seen)
        if self._begins_s is not None:  # the run has just begun
            self._begins_s = None
            self._begun_s = seen.t_s
            self._aim = self._move = None
        if seen.held:  # an open clutch lets go
            self._held_s = seen.t_s
        if seen.t_s - self._held_s < OPEN_S:
            self._aim = None  # the way is planned anew
            return Act(hand_mm=seen.hand_mm)
        if seen.task.what == GO:
            return Act(clutch=seen.t_s - self._begun_s > HOME_S)
        return self._follow(seen, seen.task)

    def _between(self, seen: Seen) -> Act:
        """Wait, then begin a run."""
        if self._begins_s is None:
            self._begins_s = seen.t_s + self._pause_s
            self._pause_s = PAUSE_S
        return Act(begin=seen.t_s >= self._begins_s, hand_mm=seen.hand_mm)

    def _follow(self, seen: Seen, task: Doing) -> Act:
        """Go where the task wants the tool, and say so on a target."""
        off_mm = task.aim - task.at[0]
        if self._aim != (task.what, task.done):
            self._aim = (task.what, task.done)
            self._move = self._towards(seen, off_mm)
        assert self._move is not None
        settled = seen.t_s >= self._move.end_s + SETTLES_S
        near = abs(off_mm) < (task.width_mm / 2 if task.what == TARGET else MARK_MM / 2)
        if settled and not near:
            self._move = self._towards(seen, off_mm)
        press = settled and near and task.what == TARGET
        return Act(clutch=True, hand_mm=self._move.at(seen.t_s), press=press)

    def _towards(self, seen: Seen, off_mm: float) -> _Move:
        begin_s = seen.t_s + REACTION_S
        end_s = begin_s + MOVE_S + MOVE_S_MM * abs(off_mm)
        return _Move(begin_s, end_s, seen.hand_mm, seen.hand_mm + off_mm / seen.scale)
