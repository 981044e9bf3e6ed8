"""The trial of master to slave: parts that are known beforehand, delays against their sum, the
reach against ticks.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

pytest.importorskip("mink", reason="the extra 'slave' is missing")

from trinolab.slave import control
from trinolab.slave.arm import forward, load_robot
from trinolab.slave.control import Command, Inverse, ReferenceParameters
from trinolab.slave.mapping import MappingParameters
from workbench.studies import master_slave
from workbench.studies.master_slave import (
    PARTS,
    STAGES,
    STILL_S,
    at_tool,
    coverage,
    lag_s,
    latency_budget,
    reference_lag_s,
    run,
)

ROBOT = load_robot()
TOOL = forward(ROBOT, ROBOT.home)
# the hand's right, down, away: +x, -z, +y
TO_BASE = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
HANDLE = RigidTransform.from_components([0.0, 0.0, 560.0], Rotation.from_rotvec([0, np.pi / 2, 0]))
MAPPING, FOLLOWING = MappingParameters(alignment=TO_BASE), ReferenceParameters()


def steady(speed, turn=0.0):
    """A hand that goes away with one speed, mm/s, and turns at one rate, rad/s, from `STILL_S`
    on.
    """

    def hand(times):
        moved = np.maximum(times - STILL_S, 0.0)[:, None]
        return RigidTransform.from_components(
            HANDLE.translation + speed * moved * [0, 0, 1],
            Rotation.from_rotvec(turn * moved * [0, 0, 1]) * HANDLE.rotation,
        )

    return hand


# --- the error, taken apart


def test_a_steady_motion_is_behind_by_the_sum_of_the_lags():
    """At the end of the motion, when all has settled: each part is the speed times its lag."""
    speed, age = 60.0, 0.04
    trial = run(ROBOT, steady(speed), MAPPING, age_s=age, duration_s=3.0)
    late = trial.t_s > STILL_S + 2.0
    budget = latency_budget(ROBOT, MAPPING, FOLLOWING, 30.0, speed)
    lags = {
        "age and hold": age + budget["hold"] + budget["tick"],
        "filter lag": budget["filter"],
        "reference lag": budget["reference"],
        "servo": budget["servo"],
        "tracker noise": 0,
        "kinematics": 0,
    }
    behind = {
        name: np.linalg.norm(
            trial.stages[b].translation[late] - trial.stages[a].translation[late], axis=1
        ).mean()
        for name, a, b in zip(PARTS, STAGES[:-1], STAGES[1:], strict=True)
    }
    for name, lag in lags.items():
        # mm; the hold's mean has half a tick to it
        assert behind[name] == pytest.approx(speed * lag, abs=0.1), name
    total = np.linalg.norm(
        trial.stages["hand"].translation[late] - trial.stages["tool"].translation[late], axis=1
    )
    assert total.mean() == pytest.approx(speed * sum(lags.values()), abs=0.2)


# --- delays


def test_the_cross_correlation_finds_a_known_delay_between_ticks():
    t = 0.002 * np.arange(1000)

    def delayed(s):
        return RigidTransform.from_translation(
            50 * np.stack([np.sin(3 * s), np.cos(2 * s), 0 * s], 1)
        )

    stages = {"hand": delayed(t), "tool": delayed(t - 0.0837)}
    assert lag_s(master_slave.Trial(t, stages, ())) == pytest.approx(0.0837, abs=5e-4)
    with pytest.raises(ValueError, match="trial"):
        lag_s(master_slave.Trial(t[:300], {k: stage[:300] for k, stage in stages.items()}, ()))


def test_the_reference_is_late_by_its_time_constant_or_by_what_braking_asks_for():
    assert reference_lag_s(FOLLOWING, 50.0) == 1 / 20
    assert reference_lag_s(FOLLOWING, 420.0) == pytest.approx(420 / 4200)
    assert reference_lag_s(FOLLOWING, 700.0) == np.inf


# --- the mapping, the noise, the reach, the tool


def test_the_reach_is_whole_near_home_and_ends_with_the_arm():
    assert coverage(ROBOT, 0.5, TO_BASE, 3) == (1.0, 1.0)
    assert coverage(ROBOT, 20.0, TO_BASE, 2) == (0.0, 0.0)  # corners, more than 2 m away
    shares = [coverage(ROBOT, scale, TO_BASE, 3) for scale in (1.0, 2.0, 4.0)]
    assert shares == sorted(shares, reverse=True)
    near = ROBOT.limits._replace(low=ROBOT.home - 0.05, high=ROBOT.home + 0.05)
    # joints that hardly move
    assert coverage(ROBOT._replace(limits=near), 1.0, TO_BASE, 2) == (0.0, 0.0)
    # a third of the points is 200 mm below home, and so below the table
    assert shares[1][1] == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    "way",
    [
        # just within the reach, and beyond it
        pytest.param((-330.0, 0.0, 0.0), marks=pytest.mark.heavy),
        pytest.param((-420.0, 0.0, 0.0), marks=pytest.mark.heavy),
    ],
)
def test_a_point_that_newton_reaches_the_arm_reaches_tick_by_tick(way):
    inverse, command, ref = Inverse(ROBOT), Command(ROBOT.home, np.zeros(6)), control.at_rest(TOOL)
    goal = RigidTransform.from_translation(way) * TOOL
    for _ in range(2000):
        after = control.step(ref, goal, inverse.tick_s)
        command = inverse.step(command, ref.pose, after.pose)
        ref = control.leashed(after, inverse.tool(command.q))
    mm = np.linalg.norm(inverse.tool(command.q).translation - goal.translation)
    assert (mm < 1) == master_slave.is_reached(ROBOT, TOOL, np.array(way))


def test_what_the_papers_errors_are_at_the_tool():
    moved, turned, both = at_tool(0.31, 0.67, scale=2.0)
    assert moved == pytest.approx(0.62)
    assert turned == pytest.approx(1.17, abs=0.005)
    assert both == pytest.approx(np.sqrt(0.62**2 + 1.1694**2), abs=1e-3)
    assert at_tool(0.31, 0.67, turn_scale=0.5)[1] == pytest.approx(turned / 2)


# --- a block in the way


def test_the_speed_is_the_rms_over_the_ticks_at_the_tool_s_scale():
    """Steps of 3 and 4 mm in 10 and 20 ms: 300 and 200 mm/s."""
    hand = RigidTransform.from_translation([[0.0, 0, 0], [3.0, 0, 0], [3.0, 4.0, 0]])
    trial = master_slave.Trial(np.array([0.0, 0.01, 0.03]), {"hand": hand}, ())
    rms = np.sqrt((300.0**2 + 200.0**2) / 2)
    assert master_slave.speed_mm_s(trial) == pytest.approx(rms)
    assert master_slave.speed_mm_s(trial, 4.0) == pytest.approx(rms / 4)
