"""The simulated arm: its published Denavit-Hartenberg table and limits, at rest, in motion, in contact,
out of its mind, and files that are no arm.
"""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("mujoco", reason="the extra 'slave' is missing")

from trinolab.datasets import data_path
from trinolab.slave.arm import Limits, Slave, forward, joint_values, load_robot
from trinolab.slave.control import Inverse, speed_bounds, stopping_speed

ROBOT = load_robot()
# User Manual UR5/CB3, Table B.4: a, d (m), alpha
DH = [
    (0.0, 0.089159, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.39225, 0.0, 0.0),
    (0.0, 0.10915, np.pi / 2),
    (0.0, 0.09465, -np.pi / 2),
    (0.0, 0.0823, 0.0),
]
SERVO = '<velocity class="servo_speed" name="elbow_speed" joint="elbow"/>'
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


def test_forward_kinematics_are_the_published_table_s():
    rng = np.random.default_rng(0)
    for q in rng.uniform(-np.pi, np.pi, (100, 6)):
        expected = by_the_table(q)
        found = forward(ROBOT, q, "flange").as_matrix()
        found[:3, 3] /= 1000
        assert np.abs(found - expected).max() < 1e-9


def test_masses_speeds_and_ranges_are_the_published_ones():
    m = ROBOT.model
    names = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    masses = [m.body(name).mass.item() for name in names]
    np.testing.assert_allclose(masses, [3.7, 8.393, 2.275, 1.219, 1.219, 0.1879])
    np.testing.assert_allclose(ROBOT.limits.speed, np.deg2rad(180))
    np.testing.assert_allclose(ROBOT.limits.high, np.deg2rad([360, 360, 180, 360, 360, 360]))
    assert ROBOT.limits.low[2] == 0.35  # ours
    np.testing.assert_allclose(ROBOT.limits.acceleration, 10.0)
    np.testing.assert_allclose(np.delete(ROBOT.limits.low, 2), np.deg2rad(-360))


def test_home_and_joints_by_name():
    tool = forward(ROBOT, ROBOT.home)
    np.testing.assert_allclose(tool.rotation.as_matrix()[:, 2], [0, 0, -1], atol=1e-12)  # down
    assert 50 < tool.translation[2] < 200  # above the table
    np.testing.assert_array_equal(joint_values(ROBOT, {}), ROBOT.home)
    q = joint_values(ROBOT, {"elbow": 1.0, "wrist_3": -0.5})
    np.testing.assert_array_equal(q, [*ROBOT.home[:2], 1.0, *ROBOT.home[3:5], -0.5])


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("<mujoco", "<mujoko", "cannot be read as a robot"),
        ('site name="tool"', 'site name="point"', "no site 'tool'"),
        ('range="0.35 3.141592653589793"', 'range="3 -3"', "cannot be read|wrong way round"),
        (SERVO, "", "joint 'elbow' has no servo called 'elbow_speed'"),
        ('name="elbow" axis', 'name="elbow" type="slide" axis', "expected hinges as its only"),
        ('qpos="0 -1.35 1.9', 'qpos="0 -1.35 3.9', "its home is beyond the limits"),
    ],
)
def test_files_that_are_no_arm(tmp_path, old, new, named):
    assert old in UR5
    (tmp_path / "arm.xml").write_text(UR5.replace(old, new, 1))
    with pytest.raises(ValueError, match=f"arm.xml: .*({named})") as caught:
        load_robot(tmp_path / "arm.xml")
    assert "\n" not in str(caught.value)


def test_what_is_refused():
    for call, arguments, named in (
        (
            joint_values,
            (ROBOT, {"knee": 0.0}),
            "joints: unknown joint 'knee'; there are shoulder_pan",
        ),
        (joint_values, (ROBOT, {"elbow": 3.2}), "joints: elbow: expected"),
        (joint_values, (ROBOT, {"elbow": "far"}), "joints: elbow: expected"),
        (forward, (ROBOT, np.zeros(6), "hand"), "site: the robot has no site 'hand'"),
        (load_robot, ("ur6",), r"^ur6: no such file, and no shipped arm \(ur5\)$"),
        (load_robot, ("none.xml",), "none.xml: no such file"),
        (load_robot, ("ur5", 0.0), "speed_rad_s"),
        (load_robot, ("ur5", 1.0, [1.0, 2.0]), "acceleration_rad_s2"),
        (load_robot, ("ur5", 1.0, -1.0), "acceleration_rad_s2"),
        (Slave, (ROBOT, with_joint(2, 3.5)), "beyond the limits"),
        (Slave, (ROBOT, with_joint(2, 0.0)), "beyond the limits"),
        (Slave, (ROBOT, with_joint(1, -1.1)), "the tool is inside something"),
    ):
        with pytest.raises(ValueError, match=named):
            call(*arguments)


def with_joint(joint, value):
    q = np.array(ROBOT.home)
    q[joint] = value
    return q


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


@settings(max_examples=100, deadline=None)
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


# --- the simulation

HOME = forward(ROBOT, ROBOT.home)
DT = 0.002


def path(q_of, seconds):
    """Let the arm follow joint positions that are given for each time; its readings."""
    slave, times = Slave(ROBOT), np.arange(0, seconds + DT / 2, DT)
    return [slave.advance(q_of(a), q_of(b), DT) for a, b in pairwise(times)]


def test_it_holds_its_place_without_a_drift():
    """And would sag without compensation of its weight: it has 21 kg, and its servos are springs."""
    found = path(lambda t: ROBOT.home, 2.0)[-1]
    assert found.t_s == pytest.approx(2.0)
    assert np.linalg.norm(found.tool.translation - HOME.translation) < 0.01
    assert np.abs(found.speed).max() < 1e-6
    np.testing.assert_array_equal(Slave(ROBOT).read().force, np.zeros(3))
    model = load_robot().model
    model.body_gravcomp[:] = 0
    slave = Slave(ROBOT._replace(model=model))
    for _ in range(500):
        found = slave.advance(ROBOT.home, ROBOT.home, DT)
    assert np.linalg.norm(found.tool.translation - HOME.translation) > 1.0


def test_a_steady_motion_is_followed_without_lag():
    way = np.array([0.3, 0.1, -0.2, 0.3, -0.3, 0.4])  # rad/s
    found = path(lambda t: ROBOT.home + way * max(t - 0.1, 0.0), 1.5)[-1]
    np.testing.assert_allclose(found.q, ROBOT.home + way * 1.4, atol=2e-4)
    np.testing.assert_allclose(found.speed, way, atol=1e-3)


def test_the_force_on_the_tool_is_that_of_the_servos():
    """Static: J^T F of the contact is the torque that the servos' springs make, kp (q_ref - q)."""
    inverse, q = Inverse(ROBOT), np.array(ROBOT.home)
    for _ in range(200):  # joint positions for a tool 3 mm inside the table, by Newton steps
        jacobian = jacobian_at(q)
        target = np.array([*HOME.translation[:2], -3.0])
        q = q + np.linalg.pinv(jacobian) @ ((target - inverse.tool(q).translation) / 1000)
    slave, start = Slave(ROBOT), np.array(ROBOT.home)
    for k in range(800):
        a, b = (start + (q - start) * min(1.0, i / 500) for i in (k, k + 1))
        found = slave.advance(a, b, DT)
    spring = np.array([10000, 10000, 10000, 4000, 4000, 4000]) * (q - found.q)
    np.testing.assert_allclose(jacobian_at(found.q).T @ -found.force, spring, atol=1.5)
    assert 30 < found.force[2] < 300
    assert found.tool.translation[2] > -2.0


def jacobian_at(q):
    """d position / d q of the tool, m/rad, by central differences."""
    steps = 1e-6 * np.eye(6)
    return np.transpose(
        [
            (forward(ROBOT, q + h).translation - forward(ROBOT, q - h).translation) / 2e-3
            for h in steps
        ]
    )
