"""Models of a person who moves the tool onto a target that the delayed picture shows (beyond the
paper).

Two ways to do it are known, and each has its model.

``continuous``
    The hand moves as long as the tool is seen beside the target, the faster the further: McRuer's
    crossover model. Operator and machine together are an integrator behind a delay, ``omega_c
    exp(-tau s) / s`` (McRuer and Jex 1967, DOI 10.1109/THFE.1967.234304). A practised operator
    knows the delay and takes the highest crossover frequency omega_c that does not overshoot:
    omega_c tau = 1/e.
``move-and-wait``
    The hand moves the whole way at once, without looking, and waits until the picture shows what
    came of it; what is left is the next move (Sheridan and Ferrell 1963, DOI
    10.1109/THFE.1963.231283; Ferrell 1965, DOI 10.1109/THFE.1965.6591253).

The machine is that of a session: a pose per frame, the One-Euro filter and the scale of `mapping`, and
the limited reference of `control`, here along one line and for many trials at once. The servos of
the simulated arm are left out: its tool is 1 ms behind its reference.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from trinolab.checks import Array, as_number, as_points, check_numbers
from trinolab.slave import oneeuro
from trinolab.slave.control import MARGIN, ReferenceParameters
from trinolab.slave.mapping import MappingParameters

from .pointing import COLUMNS

STRATEGIES = ("continuous", "move-and-wait")
TICK_S = 1 / 120
FRAME_TICKS = 4  # 30 frames/s
LONGEST_S = 40.0  # of a trial, which then ends where the tool is
MOST_MOVES = 60
REST_MM_S = 5.0  # a tool that is seen to be slower is at rest
USUAL_HAND_MM_S = 100.0  # at scale 1: the speed by which an operator knows the filter's lag


@dataclass(frozen=True)
class Person:
    """What an operator can do. The defaults are those of the publications named here; the duration
    of an unseen move is ours.

    Attributes
    ----------
    delay_s : float
        From what is seen to what the muscles are told, s; 0.15: corrections of the distance were
        seen 0.13 to 0.2 s after the hand's picture was shifted (Saunders and Knill 2005, DOI
        10.1007/s00221-004-2064-1).
    neuromuscular_s : float
        Lag of the first order of the limb, s; 0.1 in the optimal control model (Kleinman, Baron
        and Levison 1970, DOI 10.1016/0005-1098(70)90051-8).
    observation_noise, motor_noise : float
        Power density of the white noise on what is seen and on the hand's speed, over pi times
        the signal's square; 0.01 (-20 dB) and 0.003 (-25 dB), as in the same model.
    acuity_mm : float
        What is seen of a small distance is as noisy as of this one, mm at the tool; 0.5 is 0.05
        deg, the threshold of the same model, at 600 mm.
    miss : float
        Standard deviation of the end of an unseen move, over its length; 0.07, the constant error
        of Crossman and Goodeve's and Keele's iterative corrections (1963, 1968).
    move_s : float
        Duration of an unseen move, of minimum jerk (Flash and Hogan 1985), s.
    crossover : float
        omega_c tau of the crossover model, rad; 1/e, the highest without overshoot.
    """

    delay_s: float = 0.15
    neuromuscular_s: float = 0.1
    observation_noise: float = 0.01
    motor_noise: float = 0.003
    acuity_mm: float = 0.5
    miss: float = 0.07
    move_s: float = 0.3
    crossover: float = math.exp(-1)

    def __post_init__(self) -> None:
        check_numbers(self, "delay_s", "neuromuscular_s", "move_s", low=0.01, high=2.0)
        check_numbers(self, "crossover", low=0.0, high=math.pi / 2, open_low=True)
        check_numbers(self, "observation_noise", "motor_noise", "acuity_mm", "miss", low=0.0)


@dataclass
class Machine:
    """The way from the hand to the tool along a line, of n trials at once, mm.

    The same laws as `oneeuro.step`, `mapping.step` and `control.step`, which a test holds beside
    it.
    """

    n: int
    mapping: MappingParameters = field(default_factory=MappingParameters)
    following: ReferenceParameters = field(default_factory=ReferenceParameters)

    def __post_init__(self) -> None:
        self._filtered = np.zeros(self.n)
        self._last = np.zeros(self.n)
        self._hand_speed = np.zeros(self.n)
        self._speed = np.zeros(self.n)
        self.tool = np.zeros(self.n)

    def see(self, hand: Array, dt: float) -> None:
        """A measured position of the handle, `dt` s after the last one: the One-Euro filter."""
        p = self.mapping.filtering
        moved = (hand - self._last) / dt
        self._hand_speed += oneeuro.low_pass_share(p.speed_cutoff_hz, dt) * (
            moved - self._hand_speed
        )
        cutoff = p.cutoff_hz + p.slope * np.abs(self._hand_speed)
        self._filtered += oneeuro.low_pass_share(cutoff, dt) * (hand - self._filtered)
        self._last = hand

    def move(self, dt: float) -> None:
        """A tick: the tool goes after the target within its limits."""
        p = self.following
        off = self.mapping.scale * self._filtered - self.tool
        distance = np.abs(off)
        brake = np.sqrt(2 * MARGIN * p.acceleration_mm_s2 * distance)
        wanted = np.sign(off) * np.minimum(np.minimum(p.rate * distance, brake), p.speed_mm_s)
        most = p.acceleration_mm_s2 * dt
        self._speed += np.clip(wanted - self._speed, -most, most)
        self.tool = self.tool + dt * self._speed


def machine_lag_s(mapping: MappingParameters, following: ReferenceParameters) -> float:
    """How far the tool is behind a hand of a usual speed, s: half a frame, filter, reference."""
    p = mapping.filtering
    speed = USUAL_HAND_MM_S / mapping.scale
    filtering = oneeuro.lag_s(speed, p.cutoff_hz, p.slope)
    return FRAME_TICKS * TICK_S / 2 + filtering + 1 / following.rate


def least_jerk(share: Array) -> Array:
    """From 0 at 0 to 1 at 1, at rest and without acceleration at both: how a hand goes to a place
    (Flash and Hogan 1985).
    """
    return share**3 * (10 - 15 * share + 6 * share**2)


class _Continuous:
    """The crossover model: the hand's speed follows what was seen a moment ago."""

    def __init__(
        self,
        person: Person,
        targets: Array,
        machine: Machine,
        delay: int,
        rng: np.random.Generator,
    ) -> None:
        n = len(targets)
        own_s = person.delay_s + person.neuromuscular_s
        loop_s = own_s + machine_lag_s(machine.mapping, machine.following) + delay * TICK_S
        self._gain = person.crossover / loop_s / machine.mapping.scale
        self._person = person
        self._half = targets[:, 1] / 2
        late = round(person.delay_s / TICK_S)
        self._known = deque([np.full(n, np.nan)] * late, maxlen=late)
        self._rng = rng
        self._speed = np.zeros(n)
        self.position = np.zeros(n)
        self.moves = np.zeros(n)

    def step(self, seen: Array, speed: Array) -> Array:
        """A tick; `seen` is the distance left in the picture, mm, `speed` that of the tool in it.
        True where the operator says that the tool is there.
        """
        p = self._person
        known = self._known[0]
        self._known.append(seen)
        if np.isnan(known).any():  # the target has not been noticed yet
            return np.zeros(len(seen), bool)
        blur = np.sqrt(np.pi * p.observation_noise * (known**2 + p.acuity_mm**2) / TICK_S)
        wanted = self._gain * (known + blur * self._rng.standard_normal(len(seen)))
        self._speed = self._speed + TICK_S / p.neuromuscular_s * (wanted - self._speed)
        shake = np.sqrt(np.pi * p.motor_noise / TICK_S) * self._rng.standard_normal(len(seen))
        self.position = self.position + TICK_S * self._speed * (1 + shake)
        self.moves = np.ones(len(seen))
        return np.abs(known) <= self._half


class _MoveAndWait:
    """Unseen moves of minimum jerk, and between them the wait for the picture to come to rest."""

    def __init__(
        self,
        person: Person,
        targets: Array,
        machine: Machine,
        delay: int,
        rng: np.random.Generator,
    ) -> None:
        n = len(targets)
        self._person = person
        self._scale = machine.mapping.scale
        self._half = targets[:, 1] / 2
        self._duration = round(person.move_s / TICK_S)
        self._reaction = round((person.delay_s + person.neuromuscular_s) / TICK_S)
        # the first picture that can show the end of a move, a frame after it
        self._shown = self._duration + delay + FRAME_TICKS + 1
        self._misses = rng.standard_normal((n, 2, MOST_MOVES))
        self._tick = 0
        self._start = np.full(n, -self._shown)  # of the last move; all are over
        self._act = np.full(n, self._reaction)  # when the next one begins, or the operator presses
        self._from = np.zeros(n)
        self._length = np.zeros(n)
        self.position = np.zeros(n)
        self.moves = np.zeros(n)

    def step(self, seen: Array, speed: Array) -> Array:
        """As that of `_Continuous`."""
        now = self._act == self._tick
        arrived = now & (np.abs(seen) <= self._half)
        self._set_out(now & ~arrived & (self.moves < MOST_MOVES), seen)
        at_rest = (speed < REST_MM_S) & (self._tick >= self._start + self._shown)
        self._act = np.where(
            at_rest & (self._act < self._tick), self._tick + self._reaction, self._act
        )
        self._tick += 1
        part = np.clip((self._tick - self._start) / self._duration, 0.0, 1.0)
        self.position = self._from + self._length * least_jerk(part)
        return arrived

    def _set_out(self, which: Array, seen: Array) -> None:
        """Begin the moves of these trials, each as long as the distance that is seen, and off."""
        p = self._person
        trial = np.flatnonzero(which)
        off, blur = self._misses[trial, :, self.moves[trial].astype(int)].T
        length = seen[trial] * (1 + p.miss * off) + p.acuity_mm * blur
        self._from[trial] += self._length[trial]
        self._length[trial] = length / self._scale
        self._start[trial] = self._tick
        self._act[trial] = -1  # nothing is planned until the picture rests
        self.moves[trial] += 1


def point(
    trials: Array,
    strategy: str,
    scale: float,
    delay_s: float,
    rng: np.random.Generator,
    person: Person | None = None,
    pose_noise_mm: float = 0.05,
) -> pd.DataFrame:
    """A task done by the model of an operator: a log of `pointing`.

    Parameters
    ----------
    trials : array_like, shape (n, 2)
        Distance and width of each target at the tool, mm; see `pointing.conditions`.
    strategy : str
        One of `STRATEGIES`.
    scale : float
        Tool : handle.
    delay_s : float
        Added between the tool and its picture, s; whole ticks of 1/120 s are taken.
    rng : numpy.random.Generator
    person : Person, optional
    pose_noise_mm : float
        Standard deviation of the measured handle, mm per frame.

    Raises
    ------
    ValueError
        For an unknown strategy, a delay that is no number from 0 to 5 s.
    """
    targets = as_points(trials, "trials", 2)
    if strategy not in STRATEGIES:
        raise ValueError(f"strategy: expected one of {', '.join(STRATEGIES)}, got {strategy!r}")
    delay = round(as_number(delay_s, "delay_s", 0.0, 5.0) / TICK_S)
    noise = as_number(pose_noise_mm, "pose_noise_mm", 0.0)
    who = person or Person()
    machine = Machine(len(targets), MappingParameters(scale=scale))
    kind: type[_Continuous] | type[_MoveAndWait] = (
        _Continuous if strategy == "continuous" else _MoveAndWait
    )
    hand = kind(who, targets, machine, delay, rng)
    delayed = deque([machine.tool] * (delay + 2), maxlen=delay + 2)  # the tool, the oldest first
    end = np.full(len(targets), np.nan)
    error = np.zeros(len(targets))
    for k in range(int(LONGEST_S / TICK_S)):
        pressed = hand.step(targets[:, 0] - delayed[1], np.abs(delayed[1] - delayed[0]) / TICK_S)
        if k % FRAME_TICKS == 0:
            measured = hand.position + noise * rng.standard_normal(len(targets))
            machine.see(measured, FRAME_TICKS * TICK_S)
        machine.move(TICK_S)
        delayed.append(machine.tool)
        new = pressed & np.isnan(end)
        end[new] = (k + 1) * TICK_S
        error[new] = (machine.tool - targets[:, 0])[new]
        if not np.isnan(end).any():
            break
    late = np.isnan(end)
    error[late] = (machine.tool - targets[:, 0])[late]
    return pd.DataFrame(
        {
            "task": np.arange(len(targets)),
            "operator": strategy,
            "scale": scale,
            "delay_s": delay * TICK_S,
            "distance_mm": targets[:, 0],
            "width_mm": targets[:, 1],
            "start_s": 0.0,
            "end_s": np.where(late, LONGEST_S, end),
            "error_mm": error,
            "moves": hand.moves,
        },
        columns=list(COLUMNS),
    )
