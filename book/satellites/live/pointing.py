"""The pointing task for the person before the page, logged as `teleop.pointing` has it, so that
people and the models of `teleop.operators` are judged alike.

The tool goes along one line, to the operator's right and left in the picture of the surveillance
camera. A mark says where to begin. When the tool has rested there, a target appears on the other
side, and the person says when the tool is on it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from trinolab.checks import Array, as_points, as_whole
from workbench.teleop.pointing import (
    COLUMNS,
    Performance,
    conditions,
    performance,
    read_log,
    write_log,
)

from .settings import Values

MARK_MM = 5.0  # so near the tool must be to the mark
RESTS_S = 0.5  # so long
MOST_REPEATS = 10  # of each target
LONGEST_NAME = 40  # of an operator
GO, MARK, TARGET = "close the clutch", "go to the mark", "go to the target"


class Doing(NamedTuple):
    """What there is to do, for the page; places are along the line, mm from its middle.

    Attributes
    ----------
    what : str
        `GO`, `MARK` or `TARGET`.
    done, of : int
        Trials.
    at : tuple of float
        Of the tool, to the operator's right and up.
    aim, width_mm : float
        Of mark or target.
    reach_mm : float
        How far from the middle the furthest targets are.
    middle, right, up : ndarray, shape (3,)
        The line's middle, mm, and the directions, base frame.
    """

    what: str
    done: int
    of: int
    at: tuple[float, float]
    aim: float
    width_mm: float
    reach_mm: float
    middle: Array
    right: Array
    up: Array


class _Target(NamedTuple):
    """A target that is shown: from which round on, where the tool started, and how scale and added
    delay were set.
    """

    round: int
    from_mm: float
    scale: float
    delay_s: float


class Pointing:
    """The task, begun and ended by the page, and taken further by the loop, a round at a time.

    Parameters
    ----------
    path : Path
        Of the log. Rows are added to those that are there; it is written after each trial.
    alignment : Rotation
        R_base_world, as of `slave.mapping.MappingParameters`.
    targets : array_like, shape (n, 2), optional
        Distance and width of the targets at the tool, mm; those of the study without it.

    Attributes
    ----------
    status : str
        How it went, in words for the page.
    """

    def __init__(self, path: Path, alignment: Rotation, targets: ArrayLike | None = None) -> None:
        self.status = ""
        self._path = path
        self._right = alignment.apply([1.0, 0.0, 0.0])
        self._up = alignment.apply([0.0, -1.0, 0.0])
        self._targets = (
            conditions(repeats=1) if targets is None else as_points(targets, "targets", 2)
        )
        self._runs = 0
        self._on = False

    @property
    def on(self) -> bool:
        """Whether it goes on."""
        return self._on

    def begin(self, operator: object, repeats: object, t_s: float, logged: bool = True) -> None:
        """Begin with all targets, `repeats` times, in an order that differs from run to run; a
        demonstration is not logged.

        It does not begin, and `status` says why, for a name that cannot be one, another number of
        times than 1 to 10, or a file that is no log.
        """
        try:
            self._operator = _as_name(operator)
            times = as_whole(repeats, "times", 1, MOST_REPEATS)
            self._before = read_log(self._path) if logged and self._path.exists() else None
        except ValueError as error:
            self.status = f"not begun: {error}"
            return
        order = np.random.default_rng(self._runs).permutation(times * len(self._targets))
        self.trials = np.tile(self._targets, (times, 1))[order]
        self._rows: list[dict[str, Any]] = []
        self._begin_s = t_s
        self._middle: Array | None = None
        self._side = -1.0  # of the mark
        self._since_s: float | None = None  # the tool is at the mark
        self._target: _Target | None = None
        self.seen_s: float | None = None
        self._runs += 1
        self._logged = logged
        self._on = True
        self.status = ""

    def end(self) -> None:
        """End it; what was done is in the log."""
        if self._on:
            self._on = False
            self.status = self.status or ("no target was reached" if self._logged else "")

    def drawn(self, number: int, t_s: float) -> None:
        """The page has drawn a round at a time, s; a target that it shows is seen from then on."""
        if self._on and self._target and self.seen_s is None and number >= self._target.round:
            self.seen_s = t_s

    def press(self, tool: Array, values: Values, t_s: float) -> None:
        """The person says that the tool, (3,), mm, base frame, is on the target."""
        if not self._on or self._target is None or self.seen_s is None or self._middle is None:
            return
        target = self._target
        self._target = None
        self._since_s = None
        if (target.scale, target.delay_s) != _setting(values):
            self.status = "scale or delay was changed: once more"
            return
        distance, width = self.trials[len(self._rows)]
        way = -self._side * (float((tool - self._middle) @ self._right) - target.from_mm)
        number = len(self._rows) + (0 if self._before is None else len(self._before))
        row = (
            number,
            self._operator,
            target.scale,
            target.delay_s,
            distance,
            width,
            self.seen_s - self._begin_s,
            max(t_s, self.seen_s) - self._begin_s,
            way - distance,
            0,
        )
        self._rows.append(dict(zip(COLUMNS, row, strict=True)))
        self._side = -self._side
        self.keep()
        if len(self._rows) == len(self.trials):
            self.end()

    def step(
        self, tool: Array, coupled: bool, values: Values, number: int, t_s: float
    ) -> Doing | None:
        """A round: where the tool is, (3,), mm, base frame, and whether it follows the hand.

        None if no task goes on.
        """
        if not self._on:
            return None
        if self._middle is None and coupled:
            self._middle = tool
        middle = tool if self._middle is None else self._middle
        off = tool - middle
        along = float(off @ self._right)
        distance, width = self.trials[len(self._rows)]
        aim = self._side * distance / 2
        if self._target is None and self._middle is not None:
            self._wait_at(along, aim, values, number, t_s)
        if self._target is not None:
            aim = self._target.from_mm - self._side * distance
        return Doing(
            GO if self._middle is None else MARK if self._target is None else TARGET,
            len(self._rows),
            len(self.trials),
            (along, float(off @ self._up)),
            aim,
            2 * MARK_MM if self._target is None else float(width),
            float(self._targets[:, 0].max() / 2),
            middle,
            self._right,
            self._up,
        )

    def _wait_at(self, along: float, mark: float, values: Values, number: int, t_s: float) -> None:
        """Show the target when the tool has been at the mark for long enough."""
        if abs(along - mark) > MARK_MM:
            self._since_s = None
        elif self._since_s is None:
            self._since_s = t_s
        elif t_s - self._since_s >= RESTS_S:
            self._target = _Target(number, along, *_setting(values))
            self.seen_s = None

    def keep(self) -> None:
        """Write the log; a disk that is full is said, and the task goes on."""
        log = pd.DataFrame(self._rows, columns=list(COLUMNS))
        self.status = in_words(performance(log))
        if not self._logged:
            self.status += "; a demonstration, not logged"
            return
        try:
            whole = log if self._before is None else pd.concat([self._before, log])
            write_log(whole, self._path)
        except ValueError as error:
            self.status += f"; not kept: {error}"
        else:
            self.status += f"; in {self._path}"


def in_words(found: Performance) -> str:
    """How well it was done, in a line."""
    targets = "1 target" if found.n == 1 else f"{found.n} targets"
    rate = (
        f"{found.throughput_bit_s:.2f} bit/s"
        if np.isfinite(found.throughput_bit_s)
        else "throughput after two trials of a target"
    )
    return (
        f"{targets}: {rate}, {found.movement_s:.2f} s each, "
        f"{100 * found.error_share:.0f} % beside the target"
    )


def _as_name(operator: object) -> str:
    if not isinstance(operator, str) or not operator.strip() or not operator.isprintable():
        raise ValueError("name: expected the operator's name")
    return operator.strip()[:LONGEST_NAME]


def _setting(values: Values) -> tuple[float, float]:
    """Scale, and added delay, s."""
    return values["scale"], 1e-3 * values["delay_ms"]
