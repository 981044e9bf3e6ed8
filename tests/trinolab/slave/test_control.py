"""Commands on all that a hand can ask for: limits at every tick, errors against the reference, the
end of reach.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

pytest.importorskip("mink", reason="the extra 'slave' is missing")

from trinolab.slave import control
from trinolab.slave.arm import forward, load_robot
from trinolab.slave.control import Command, Inverse, ReferenceParameters

ROBOT = load_robot()
INVERSE = Inverse(ROBOT)
HOME = INVERSE.tool(ROBOT.home)
TICKS = 17  # in a thirtieth of a second
TIMES = np.arange(60) / 30


def at(way, turn=(0.0, 0.0, 0.0)):
    return RigidTransform.from_components(
        HOME.translation + np.array(way), Rotation.from_rotvec(turn) * HOME.rotation
    )


def follow(targets):
    """Joint positions, speeds, and errors against the reference (mm, deg), a row a tick; the tool's
    last pose.
    """
    command, ref, rows, tool = Command(ROBOT.home, np.zeros(6)), control.at_rest(HOME), [], HOME
    for target in targets:
        for _ in range(TICKS):
            after = control.step(ref, target, INVERSE.tick_s)
            command = INVERSE.step(command, ref.pose, after.pose)
            tool = INVERSE.tool(command.q)
            off = after.pose.translation - tool.translation
            turn = (after.pose.rotation * tool.rotation.inv()).magnitude()
            rows.append((*command.q, *command.speed, np.linalg.norm(off), np.rad2deg(turn)))
            ref = control.leashed(after, tool)
    rows = np.array(rows)
    return rows[:, :6], rows[:, 6:12], rows[:, 12], rows[:, 13], tool


def check_limits(q, speed):
    limits = ROBOT.limits
    assert (q >= limits.low - 1e-9).all()
    assert (q <= limits.high + 1e-9).all()
    assert (np.abs(speed) <= limits.speed * (1 + 1e-9)).all()
    change = np.abs(np.diff(speed, axis=0, prepend=np.zeros((1, 6))))
    assert (change <= limits.acceleration * INVERSE.tick_s * (1 + 1e-6)).all()


def ordinary(t):
    return at(
        np.array([80, 60, 50]) * np.sin(2 * np.pi * np.array([0.4, 0.3, 0.5]) * t),
        np.array([0.3, 0.25, 0.4]) * np.sin(2 * np.pi * np.array([0.4, 0.35, 0.3]) * t),
    )


def through_the_wrist(t):
    """The fifth joint through 0, where four axes are parallel; and off the way on which it would be
    easy.
    """
    q = np.array(ROBOT.home)
    q[4] += 1.5 * (1 - np.cos(2 * np.pi * t / 4))
    turn = Rotation.from_rotvec([0.02 * np.sin(7 * t), 0.02, 0])
    return forward(ROBOT, q) * RigidTransform.from_components([3, 5 * np.sin(3 * t), 2], turn)


def test_an_ordinary_motion_is_followed():
    q, speed, off, turn, _ = follow([ordinary(t) for t in TIMES])
    check_limits(q, speed)
    assert off.mean() < 0.2
    assert turn.mean() < 0.1


def test_through_its_singular_pose_the_error_is_bounded_and_joints_do_not_chatter():
    q, speed, off, _, _ = follow([through_the_wrist(t) for t in TIMES])
    check_limits(q, speed)
    assert q[:, 4].min() < -0.5
    assert q[:, 4].max() > 0.5
    assert off.max() < 5.0
    acceleration = np.diff(speed, axis=0) / INVERSE.tick_s
    hard = np.abs(acceleration) > 0.9 * ROBOT.limits.acceleration
    flips = (acceleration[1:] * acceleration[:-1] < 0) & hard[1:] & hard[:-1]
    assert flips.mean() < 0.005


@pytest.mark.heavy
def test_at_the_end_of_its_reach_the_arm_stays():
    q, speed, off, _, tool = follow([at([-700 * min(1, t / 3), 0, 0]) for t in np.arange(150) / 30])
    check_limits(q, speed)
    assert off.max() < 5.0
    assert np.abs(speed[-500:]).max() < 0.05  # the last second
    assert np.linalg.norm(tool.translation - [0, 0, 89.159]) > 880
    assert np.rad2deg((tool.rotation * HOME.rotation.inv()).magnitude()) < 2.0


def test_a_jump_of_the_command_is_followed_within_the_limits():
    q, speed, off, _, tool = follow([HOME] * 3 + [at([100, 80, 78], [0, 0, np.pi / 3])] * 40)
    check_limits(q, speed)
    assert off.max() < 5.0
    np.testing.assert_allclose(tool.translation, HOME.translation + [100, 80, 78], atol=0.01)


@settings(max_examples=8, deadline=None)
@given(
    st.lists(
        st.tuples(*[st.floats(-2000, 2000)] * 3, *[st.floats(-3.1, 3.1)] * 3),
        min_size=1,
        max_size=12,
    )
)
def test_no_stream_of_poses_exceeds_a_limit(stream):
    q, speed, *_ = follow([at(one[:3], one[3:]) for one in stream])
    check_limits(q, speed)
    assert np.isfinite(q).all()


@pytest.mark.parametrize("way", [-1, 1])
def test_bounds_of_a_joint_s_speed(way):
    """At an end of its range a joint that still moves outwards may lose what one tick allows, and no
    more; far from both ends only the highest speed stands in its way.
    """
    limits, dt = ROBOT.limits, INVERSE.tick_s
    change = limits.acceleration * dt
    end, middle = limits.low if way < 0 else limits.high, (limits.low + limits.high) / 2
    for q, speed, outward, inward in (
        (end, 3 * change, 2 * change, 2 * change),
        (middle, limits.speed, limits.speed, limits.speed - change),
    ):
        bounds = control.speed_bounds(q, way * speed, limits, dt)
        found = bounds if way > 0 else (-bounds[1], -bounds[0])
        np.testing.assert_allclose(found, (inward, outward), atol=1e-12)


# --- the reference


@settings(max_examples=2, deadline=None)
@given(st.floats(-500, 500), st.floats(-3, 3))
def test_a_reference_keeps_to_its_limits_and_comes_to_rest_without_overshooting(way, turn):
    p, target = ReferenceParameters(), at([way, 0, 0], [turn, 0, 0])
    ref, ways, turns, speeds = control.at_rest(HOME), [], [], []
    for _ in range(1200):
        last, ref = ref, control.step(ref, target, 0.002)
        ways.append((ref.pose.translation - HOME.translation)[0])
        turns.append((ref.pose.rotation * HOME.rotation.inv()).magnitude())
        speeds.append(np.linalg.norm(ref.velocity))
        assert np.linalg.norm(ref.velocity - last.velocity) <= p.acceleration_mm_s2 * 0.002 * (
            1 + 1e-9
        )
        assert np.linalg.norm(ref.turn_rate - last.turn_rate) <= p.turn_rad_s2 * 0.002 * (1 + 1e-9)
    assert max(speeds) <= p.speed_mm_s * (1 + 1e-9)
    assert max(np.abs(ways)) <= abs(way) + 0.05
    assert max(turns) <= abs(turn) + 1e-3
    assert ways[-1] == pytest.approx(way, abs=0.01)


def test_a_steady_motion_is_followed_one_time_constant_behind():
    p, ref = ReferenceParameters(rate=20.0), control.at_rest(HOME)
    for k in range(1, 501):
        ref = control.step(ref, at([0.1 * k, 0, 0]), 0.002, p)  # 50 mm/s
    assert 50.0 - (ref.pose.translation - HOME.translation)[0] == pytest.approx(50 / 20, rel=0.1)


def test_the_leash_holds_a_reference_and_takes_its_speed_along_it():
    fast = control.Reference(at([30, 0, 0]), np.array([100.0, 50.0, 0.0]), np.zeros(3))
    held = control.leashed(fast, HOME)
    np.testing.assert_allclose(held.pose.translation - HOME.translation, [4, 0, 0])
    np.testing.assert_allclose(held.velocity, [0, 50, 0], atol=1e-9)
    assert control.leashed(held, HOME) is held


def test_parameters_that_are_refused():
    for name in ("rate", "speed_mm_s", "turn_rad_s2", "leash_mm"):
        with pytest.raises(ValueError, match=name):
            ReferenceParameters(**{name: 0.0})
