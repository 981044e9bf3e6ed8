"""The simulated arm: at rest, in motion, in contact, and out of its mind."""

from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the extra 'slave' is missing")

from trinolab.datasets import data_path
from trinolab.slave.arm import Slave, forward, load_robot
from trinolab.slave.control import Inverse

ROBOT = load_robot()
HOME = forward(ROBOT, ROBOT.home)
DT = 0.002


def path(q_of, seconds):
    """Let the arm follow joint positions that are given for each time; its readings."""
    slave, times = Slave(ROBOT), np.arange(0, seconds + DT / 2, DT)
    return [slave.advance(q_of(a), q_of(b), DT) for a, b in pairwise(times)]


def test_it_holds_its_place_without_a_drift():
    found = path(lambda t: ROBOT.home, 4.0)[-1]
    assert found.t_s == pytest.approx(4.0)
    assert np.linalg.norm(found.tool.translation - HOME.translation) < 0.01
    assert np.abs(found.speed).max() < 1e-6


def test_without_compensation_of_its_weight_it_would_sag():
    """The test above can fail: the arm weighs 21 kg, and its servos are springs."""
    model = load_robot().model
    model.body_gravcomp[:] = 0
    slave = Slave(ROBOT._replace(model=model))
    for _ in range(1000):
        found = slave.advance(ROBOT.home, ROBOT.home, DT)
    assert np.linalg.norm(found.tool.translation - HOME.translation) > 1.0


def test_a_steady_motion_is_followed_without_lag():
    way = np.array([0.3, 0.1, -0.2, 0.3, -0.3, 0.4])  # rad/s
    found = path(lambda t: ROBOT.home + way * max(t - 0.1, 0.0), 1.5)[-1]
    np.testing.assert_allclose(found.q, ROBOT.home + way * 1.4, atol=2e-4)
    np.testing.assert_allclose(found.speed, way, atol=1e-3)


def test_the_force_on_the_tool_is_that_of_the_servos():
    """Static: J^T F of the contact is the torque that the servos' springs make, kp (q_ref - q)."""
    import mujoco

    inverse, q = Inverse(ROBOT), np.array(ROBOT.home)
    for _ in range(200):  # joint positions for a tool 3 mm inside the table, by Newton steps
        jacobian = jacobian_at(q)
        target = np.array([*HOME.translation[:2], -3.0])
        q = q + np.linalg.pinv(jacobian) @ ((target - inverse.tool(q).translation) / 1000)
    slave, start = Slave(ROBOT), np.array(ROBOT.home)
    for k in range(1500):
        a, b = (start + (q - start) * min(1.0, i / 1000) for i in (k, k + 1))
        found = slave.advance(a, b, DT)
    spring = np.array([10000, 10000, 10000, 4000, 4000, 4000]) * (q - found.q)
    np.testing.assert_allclose(jacobian_at(found.q).T @ -found.force, spring, atol=1.5)
    assert 30 < found.force[2] < 300
    assert found.tool.translation[2] > -2.0
    assert mujoco.__version__


def jacobian_at(q):
    """d position / d q of the tool, m/rad, by central differences."""
    steps = 1e-6 * np.eye(6)
    return np.transpose(
        [
            (forward(ROBOT, q + h).translation - forward(ROBOT, q - h).translation) / 2e-3
            for h in steps
        ]
    )


def test_in_the_air_there_is_no_force():
    np.testing.assert_array_equal(Slave(ROBOT).read().force, np.zeros(3))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({2: 3.5}, "beyond the limits"),
        ({2: 0.0}, "beyond the limits"),
        ({1: -1.1}, "the tool is inside something"),
    ],
)
def test_a_start_that_cannot_be(change, named):
    q = np.array(ROBOT.home)
    for joint, value in change.items():
        q[joint] = value
    with pytest.raises(ValueError, match=named):
        Slave(ROBOT, q)


def test_a_simulation_that_diverges_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log
    text = data_path("robots", "ur5.xml").read_text()
    wild = text.replace('<position kp="10000" forcerange="-150 150"/>', '<position kp="1e14"/>')
    assert wild != text
    (tmp_path / "wild.xml").write_text(
        wild.replace('integrator="implicitfast"', 'integrator="Euler"')
    )
    robot = load_robot(tmp_path / "wild.xml")
    slave = Slave(robot)
    with pytest.raises(ValueError, match=r"the simulation diverges at 0\.\d+ s"):
        slave.advance(robot.home, robot.home + 0.1, 0.4)


def test_an_arm_that_is_not_there_is_answered_with_those_that_are():
    with pytest.raises(ValueError, match=r"^nofile: no such file, and no shipped arm \(ur5\)$"):
        load_robot("nofile")
