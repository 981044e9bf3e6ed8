"""The arm against its published Denavit-Hartenberg table, its limits, and files that are no arm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("mujoco", reason="the extra 'slave' is missing")

from trinolab.datasets import data_path
from trinolab.slave.arm import Limits, forward, joint_values, load_robot
from trinolab.slave.control import speed_bounds, stopping_speed

# User Manual UR5/CB3, Table B.4: a, d (m), alpha
DH = [
    (0.0, 0.089159, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.39225, 0.0, 0.0),
    (0.0, 0.10915, np.pi / 2),
    (0.0, 0.09465, -np.pi / 2),
    (0.0, 0.0823, 0.0),
]
UR5 = data_path("robots", "ur5.xml").read_text()


def by_the_table(q):
    T = np.eye(4)
    for theta, (a, d, alpha) in zip(q, DH, strict=True):
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        T = T @ [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    return T


@pytest.fixture(scope="module")
def robot():
    return load_robot()


def test_forward_kinematics_are_the_published_table_s(robot):
    rng = np.random.default_rng(0)
    for q in rng.uniform(-np.pi, np.pi, (1000, 6)):
        expected = by_the_table(q)
        found = forward(robot, q, "flange").as_matrix()
        found[:3, 3] /= 1000
        assert np.abs(found - expected).max() < 1e-9


def test_masses_speeds_and_ranges_are_the_published_ones(robot):
    m = robot.model
    names = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    masses = [m.body(name).mass.item() for name in names]
    np.testing.assert_allclose(masses, [3.7, 8.393, 2.275, 1.219, 1.219, 0.1879])
    np.testing.assert_allclose(robot.limits.speed, np.deg2rad(180))
    np.testing.assert_allclose(robot.limits.high, np.deg2rad([360, 360, 180, 360, 360, 360]))
    assert robot.limits.low[2] == 0.35  # ours
    np.testing.assert_allclose(robot.limits.acceleration, 10.0)
    np.testing.assert_allclose(np.delete(robot.limits.low, 2), np.deg2rad(-360))


def test_at_home_the_tool_points_down_above_the_table(robot):
    tool = forward(robot, robot.home)
    np.testing.assert_allclose(tool.rotation.as_matrix()[:, 2], [0, 0, -1], atol=1e-12)
    assert 50 < tool.translation[2] < 200


def test_joints_by_name(robot):
    np.testing.assert_array_equal(joint_values(robot, {}), robot.home)
    q = joint_values(robot, {"elbow": 1.0, "wrist_3": -0.5})
    np.testing.assert_array_equal(q, [*robot.home[:2], 1.0, *robot.home[3:5], -0.5])


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"knee": 0.0}, "joints: unknown joint 'knee'; there are shoulder_pan"),
        ({"elbow": 3.2}, "joints: elbow: expected"),
        ({"elbow": np.nan}, "joints: elbow: expected"),
        ({"elbow": "far"}, "joints: elbow: expected"),
    ],
)
def test_joints_that_are_refused(robot, change, named):
    with pytest.raises(ValueError, match=named):
        joint_values(robot, change)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("<mujoco", "<mujoko", "cannot be read as a robot"),
        ('site name="tool"', 'site name="point"', "no site 'tool'"),
        (
            'range="0.35 3.141592653589793"',
            'range="3 -3"',
            "cannot be read as a robot|wrong way round",
        ),
        (
            '<velocity class="servo_speed" name="elbow_speed" joint="elbow"/>',
            "",
            "joint 'elbow' has no servo called 'elbow_speed'",
        ),
        (
            'name="elbow" axis',
            'name="elbow" type="slide" axis',
            "expected hinges as its only joints",
        ),
        ('qpos="0 -1.35 1.9', 'qpos="0 -1.35 3.9', "its home is beyond the limits"),
    ],
)
def test_files_that_are_no_arm(tmp_path, old, new, named):
    assert old in UR5
    (tmp_path / "arm.xml").write_text(UR5.replace(old, new, 1))
    with pytest.raises(ValueError, match=f"arm.xml: .*({named})") as caught:
        load_robot(tmp_path / "arm.xml")
    assert "\n" not in str(caught.value)


def test_a_site_that_the_arm_does_not_have_is_named(robot):
    with pytest.raises(ValueError, match="site: the robot has no site 'hand'"):
        forward(robot, robot.home, "hand")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("ur6",), r"ur6: no such file, and no shipped arm \(ur5\)"),
        (("none.xml",), "none.xml: no such file"),
        (("ur5", 0.0), "speed_rad_s"),
        (("ur5", 1.0, [1.0, 2.0]), "acceleration_rad_s2"),
        (("ur5", 1.0, -1.0), "acceleration_rad_s2"),
    ],
)
def test_what_is_refused(arguments, named):
    with pytest.raises(ValueError, match=named):
        load_robot(*arguments)


# --- limits of a joint


@given(st.floats(0, 10), st.floats(0.1, 100), st.floats(1e-4, 0.1))
def test_from_the_stopping_speed_a_joint_stops_in_time_and_hardly_earlier(
    distance, acceleration, dt
):
    speed = float(stopping_speed(np.array(distance), np.array(acceleration), dt))
    covered, now = 0.0, speed
    for _ in range(int(speed / (acceleration * dt)) + 2):
        covered, now = covered + now * dt, max(now - acceleration * dt, 0.0)
    assert now == 0.0
    assert covered == pytest.approx(distance, rel=1e-6, abs=1e-9)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.floats(-50, 50), min_size=1, max_size=300),
    st.floats(0.5, 20),
    st.floats(0.001, 0.02),
)
def test_whatever_is_wanted_no_limit_is_exceeded(wanted, acceleration, dt):
    limits = Limits(*(np.array([value]) for value in (-0.5, 0.8, 2.0, acceleration)))
    q, speed = np.array([0.1]), np.zeros(1)
    for want in wanted:
        low, high = speed_bounds(q, speed, limits, dt)
        assert (low <= high).all()
        last, speed = speed, np.clip([want], low, high)
        q = q + speed * dt
        assert limits.low - 1e-9 <= q <= limits.high + 1e-9
        assert abs(speed) <= 2.0 + 1e-12
        assert abs(speed - last) <= acceleration * dt * (1 + 1e-9)
