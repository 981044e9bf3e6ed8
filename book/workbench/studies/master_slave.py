"""Master to slave on trial: the error at the tool and the delay, taken apart by stages; what the
arm reaches and feels.

A part of the error lies between two stages that follow each other, at the ends of the ticks.
Chapters 11 and 12; extra `slave`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.motion import human_motion
from trinolab.checks import Array, as_number, as_rng, as_whole, frozen
from trinolab.slave import mapping as slave_mapping
from trinolab.slave import oneeuro
from trinolab.slave.arm import TOOL, Reading, Robot, forward, load_robot
from trinolab.slave.control import MARGIN, TICK_S, ReferenceParameters
from trinolab.slave.mapping import MappingParameters, Sample, State

from ..teleop.session import Session

REST_S = 1.5
# the block's side towards the arm's home, in the shipped model
BLOCK_Y_MM = 160.0
TOOL_RADIUS_MM = 5.0
DEEP_MM = 3.0
Hand = Callable[[Array], RigidTransform]  # times, s, shape (n,), to n poses T_world_handle, mm
EXPOSURE_S, MEASUREMENT_S = 0.010, 0.0105  # of a frame; of the image model with three cameras
# a hand rests until its clutch is closed, and takes about so long to its pace
STILL_S, SPEEDING_UP_S = 1.0, 0.5
# the part of the delay that is a pose's age when it arrives
CAMERAS = ("exposure", "frame", "measurement")
STAGES = ("hand", "seen", "filtered", "target", "reference", "commanded", "tool")
PARTS = ("age and hold", "filter lag", "tracker noise", "reference lag", "kinematics", "servo")
WORKSPACE_MM = (200.0, 200.0, 150.0)  # of the handle, along x, y, z of its world


def pushed() -> tuple[Session, Reading]:
    """An arm whose tool a hand has led down and, away from the operator, `DEEP_MM` into the block;
    what it measures.
    """
    # the hand's right, down and away: the base's x, -z and y
    away = Rotation.from_euler("x", -90, degrees=True)
    reach = (-850.0, 850.0), (-850.0, BLOCK_Y_MM - TOOL_RADIUS_MM + DEEP_MM), (30.0, 950.0)
    session = Session(load_robot(), MappingParameters(alignment=away, reach_mm=reach))
    for t in np.arange(90) / 30:
        hand = RigidTransform.from_translation([0, min(150 * t, 90), 560 + 150 * max(t - 0.6, 0)])
        reading = session.step(Sample(t, hand, "measured", True)).reading
    return session, reading


class Trial(NamedTuple):
    """A trial: times of the ticks, s, shape (n,); of each of `STAGES` the n poses T_base_tool, mm;
    all that held it.
    """

    t_s: Array
    stages: dict[str, RigidTransform]
    held: tuple[str, ...]


def human_hand(seed: int, pace: float = 1.0) -> Hand:
    """`motion.human_motion`, `pace` times as fast, after a rest of `STILL_S`."""

    def hand(times: Array) -> RigidTransform:
        moved = np.maximum(times - STILL_S, 0.0)
        return human_motion(np.random.default_rng(seed), pace * moved**2 / (moved + SPEEDING_UP_S))

    return hand


def noisy(
    poses: RigidTransform, noise_mm: float, noise_deg: float, rng: np.random.Generator
) -> RigidTransform:
    """Poses as a tracker gives them: Gaussian noise of these standard deviations about each of
    three axes.
    """
    mm = as_number(noise_mm, "noise_mm", 0.0)
    deg = as_number(noise_deg, "noise_deg", 0.0)
    shape = poses.translation.shape
    shift = mm * as_rng(rng).normal(size=shape)
    turn = np.deg2rad(deg) * rng.normal(size=shape)
    return RigidTransform.from_components(
        poses.translation + shift, Rotation.from_rotvec(turn) * poses.rotation
    )


def mapped(
    poses: RigidTransform, tool: RigidTransform, mapping: MappingParameters
) -> RigidTransform:
    """T_base_tool, mm, for n poses of a handle whose clutch is closed at the first: no filter, no
    end of the reach.
    """
    displacement = mapping.alignment.apply(poses.translation - poses.translation[0])
    turns = mapping.alignment.apply((poses.rotation[1:] * poses.rotation[:-1].inv()).as_rotvec())
    rotations = [tool.rotation]
    for turn in Rotation.from_rotvec(mapping.turn_scale * turns):
        rotations.append(turn * rotations[-1])
    return RigidTransform.from_components(
        tool.translation + mapping.scale * displacement, Rotation.concatenate(rotations)
    )


def run(
    robot: Robot,
    hand: Hand,
    mapping: MappingParameters | None = None,
    following: ReferenceParameters | None = None,
    *,
    noise_mm: float = 0.0,
    noise_deg: float = 0.0,
    rate_hz: float = 30.0,
    age_s: float = 0.0,
    duration_s: float = 8.0,
    rng: np.random.Generator | None = None,
) -> Trial:
    """A hand's motion through a session; its clutch is closed at `STILL_S`, and the trial begins
    there.

    The tracker gives `rate_hz` poses per second, each `age_s` after its exposure, with Gaussian noise
    about each axis.
    """
    p = mapping or MappingParameters()
    last_s = STILL_S + as_number(duration_s, "duration_s", 0.0, open_low=True)
    rate = as_number(rate_hz, "rate_hz", 0.0, open_low=True)
    times = np.arange(round(last_s * rate) + 1) / rate
    poses = hand(np.maximum(times - as_number(age_s, "age_s", 0.0), 0.0))
    clean, noised = (
        [
            Sample(t, T, "measured", t >= STILL_S - 1e-9)
            for t, T in zip(times.tolist(), measured, strict=True)
        ]
        for measured in (poses, noisy(poses, noise_mm, noise_deg, rng or np.random.default_rng(0)))
    )
    session = Session(robot, p, following)
    first = [sample.clutch for sample in clean].index(True)
    tool = session.slave.read().tool
    moments = [session.step(sample) for sample in noised]
    alone = accumulate(
        clean, lambda state, sample: slave_mapping.step(state, sample, p), initial=State(-1.0, tool)
    )
    ticks = [moment.ticks for moment in moments[first + 1 :]]
    # the sample that a tick follows
    after = np.repeat(np.arange(len(ticks)), [len(one.t_s) for one in ticks])
    t_s = np.concatenate([one.t_s for one in ticks])
    stages = {
        "hand": mapped(hand(np.array([STILL_S, *t_s])), tool, p)[1:],
        "seen": mapped(poses[first:], tool, p)[after],
        "filtered": RigidTransform.concatenate([state.target for state in alone][first + 1 :])[
            after
        ],
        "target": RigidTransform.concatenate([moment.state.target for moment in moments[first:]])[
            after
        ],
        **{
            name: RigidTransform.concatenate([T for one in ticks for T in getattr(one, name)])
            for name in STAGES[4:]
        },
    }
    states = [moment.state for moment in moments]
    why = {state.held for state in states if state.held} | {
        "reach" for state in states if state.limited
    }
    return Trial(frozen(t_s), stages, tuple(sorted(why)))


def parts(trial: Trial) -> dict[str, tuple[float, float]]:
    """Mean error, mm and deg, of each of `PARTS`, between the stages on either side of it, and of
    the ``total``.
    """
    stages = [trial.stages[name] for name in STAGES]
    distances = {name: between(stages[k], stages[k + 1]) for k, name in enumerate(PARTS)}
    return {**distances, "total": between(stages[0], stages[-1])}


def between(a: RigidTransform, b: RigidTransform) -> tuple[float, float]:
    """Mean distance, mm, and mean angle, deg, of n pairs of poses."""
    return (
        float(np.linalg.norm(b.translation - a.translation, axis=1).mean()),
        float(np.rad2deg((b.rotation * a.rotation.inv()).magnitude()).mean()),
    )


def latency_budget(
    robot: Robot,
    mapping: MappingParameters,
    following: ReferenceParameters,
    rate_hz: float,
    speed_mm_s: float,
    exposure_s: float = EXPOSURE_S,
    measurement_s: float = MEASUREMENT_S,
) -> dict[str, float]:
    """Delay of each stage, s, for a hand of a steady speed.

    A frame shows the middle of its exposure, is read out and sent within one interval, and
    measured. A pose is held until the next one: half an interval on average, and half a tick since
    it is looked at when a tick ends; there the reference has come nearer by a tick. It has to climb
    after each new pose, see `climbing_s`. The servos know the speed and need no lag; where the tool
    is, is read one step of the simulation late.
    """
    return {
        "exposure": exposure_s / 2,
        "frame": 1 / rate_hz,
        "measurement": measurement_s,
        "hold": 0.5 / rate_hz,
        "filter": oneeuro.lag_s(speed_mm_s, mapping.filtering.cutoff_hz, mapping.filtering.slope),
        "reference": reference_lag_s(following, mapping.scale * speed_mm_s)
        + climbing_s(following, mapping.scale * speed_mm_s, rate_hz)
        - TICK_S,
        "tick": TICK_S / 2,
        "servo": float(robot.model.opt.timestep),
    }


def reference_lag_s(following: ReferenceParameters, speed_mm_s: float) -> float:
    """How far a reference is behind a steady speed of the tool, s; infinite from its largest speed
    on.

    One time constant, or d / v if d is more, within which it could brake: v^2 = 2 MARGIN
    acceleration d.
    """
    brake = speed_mm_s / (2 * MARGIN * following.acceleration_mm_s2)
    return max(1 / following.rate, brake) if speed_mm_s < following.speed_mm_s else np.inf


def climbing_s(following: ReferenceParameters, speed_mm_s: float, rate_hz: float) -> float:
    """How much more a reference is behind a steady speed because its target comes in steps, s.

    Each step J = v / rate_hz asks at once for k J more speed, where k is how the speed asked for
    grows with the distance: the rate, or MARGIN a / v where it brakes. With the acceleration a this
    is missing less and less, for k J / (a + k v) s; the mean of what is missing, over k, is a
    distance.
    """
    a, v = following.acceleration_mm_s2, speed_mm_s
    k = min(following.rate, MARGIN * a / max(v, 1e-12))
    return k * v / rate_hz / (2 * (a + k * v))


def lag_s(trial: Trial, stage: str = "tool", longest_s: float = 0.4) -> float:
    """How far a stage is behind the hand, s, where their cross-correlation is largest; NaN without
    a motion.

    Raises ValueError for a trial not three times as long as the longest lag.
    """
    hand = trial.stages["hand"].translation
    positions = trial.stages[stage].translation
    tick = float(np.ptp(trial.t_s)) / (len(trial.t_s) - 1)
    shifts = np.arange(-2, round(longest_s / tick))
    if len(hand) < 3 * len(shifts):
        raise ValueError(
            f"trial: expected {3 * longest_s:g} s or more, got {np.ptp(trial.t_s):g} s"
        )
    middle = np.arange(shifts[-1], len(hand) - 2)
    values = np.array([_correlation(hand[middle - shift], positions[middle]) for shift in shifts])
    if not np.isfinite(values).all():
        return np.nan
    k = int(np.clip(np.argmax(values), 1, len(values) - 2))
    low, peak, high = values[k - 1 : k + 2]
    return float(tick * (shifts[k] + (low - high) / 2 / (low - 2 * peak + high)))


def speed_mm_s(trial: Trial, scale: float = 1.0) -> float:
    """Root mean square speed of the hand, mm/s."""
    steps = np.diff(trial.stages["hand"].translation, axis=0) / np.diff(trial.t_s)[:, None]
    return float(np.sqrt((steps**2).sum(axis=1).mean()) / scale)


def coverage(
    robot: Robot, scale: float, alignment: Rotation, count: int = 5
) -> tuple[float, float]:
    """Share of the handle's workspace, scaled and centred at the tool's home, that the arm reaches;
    and above z = 0.

    To each point of a grid, `count` a side, the tool goes straight from home by damped Newton steps
    within the joints' ranges, without turning; the point is reached if it ends within 1 mm and 1
    deg.
    """
    axes = [
        np.linspace(-side / 2, side / 2, as_whole(count, "count", low=1)) for side in WORKSPACE_MM
    ]
    grid = scale * alignment.apply(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3))
    home = forward(robot, robot.home)
    reached = np.array([is_reached(robot, home, way) for way in grid])
    return float(reached.mean()), float((reached & (home.translation[2] + grid[:, 2] > 0)).mean())


def at_tool(
    position_mm: float,
    angle_deg: float,
    scale: float = 1.0,
    turn_scale: float = 1.0,
    lever_mm: float = 100.0,
) -> tuple[float, float, float]:
    """What errors of the handle are at the tool, mm: of position, of angle at the end of a lever,
    and both (rss).
    """
    moved = scale * position_mm
    turned = lever_mm * float(np.deg2rad(turn_scale * angle_deg))
    return moved, turned, float(np.hypot(moved, turned))


def _correlation(a: Array, b: Array) -> float:
    """Correlation coefficient of two motions (n, 3), over time and axes; NaN if one of them
    rests.
    """
    a = a - a.mean(axis=0)
    b = b - b.mean(axis=0)
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float((a * b).sum()) / size if size > 1e-3 else np.nan


def is_reached(
    robot: Robot, home: RigidTransform, way: Array, stations: int = 12, steps: int = 4
) -> bool:
    """Whether the tool gets from home along `way`, mm, straight and without turning."""
    import mujoco

    data = mujoco.MjData(robot.model)
    jacobian = np.zeros((6, len(robot.joints)))
    off = np.zeros(6)
    data.qpos[:], tool, upright = robot.home, data.site(TOOL), home.rotation.as_matrix()
    for k in range(stations * steps + 20):
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        off[:3] = (
            home.translation + way * min(1.0, (k // steps + 1) / stations)
        ) / 1000 - tool.xpos
        # sines of what it has turned
        off[3:] = np.cross(tool.xmat.reshape(3, 3), upright, axis=0).sum(axis=1) / 2
        mujoco.mj_jacSite(robot.model, data, jacobian[:3], jacobian[3:], tool.id)
        step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-6 * np.eye(6), off)
        data.qpos[:] = np.clip(data.qpos + step, robot.limits.low, robot.limits.high)
    return bool(np.linalg.norm(off[:3]) < 1e-3 and np.linalg.norm(off[3:]) < np.deg2rad(1))
