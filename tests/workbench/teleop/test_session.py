"""The chain behind the tracker: from poses to the arm, whatever their rate, and what it does when
they are lost.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

pytest.importorskip("mink", reason="the extra 'slave' is missing")

from trinolab.slave.arm import load_robot
from trinolab.slave.control import TICK_S
from trinolab.slave.mapping import MappingParameters, Sample
from workbench.teleop.session import Log, Session

ROBOT = load_robot()
HANDLE = RigidTransform.from_components([0.0, 0.0, 560.0], Rotation.from_rotvec([0, np.pi / 2, 0]))
# the hand's right, down, away: +x, -z, +y
TO_BASE = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
MAPPING = MappingParameters(alignment=TO_BASE)


def moved(way, turn=(0.0, 0.0, 0.0)):
    return RigidTransform.from_components(
        HANDLE.translation + np.array(way, float), Rotation.from_rotvec(turn) * HANDLE.rotation
    )


def run(samples, mapping=MAPPING):
    session = Session(ROBOT, mapping)
    return session, [session.step(sample) for sample in samples]


def all_ticks(moments, name):
    return np.concatenate([getattr(moment.ticks, name) for moment in moments])


def check_limits(moments):
    limits, q, speed = ROBOT.limits, all_ticks(moments, "q"), all_ticks(moments, "speed")
    assert (q >= limits.low - 1e-9).all()
    assert (q <= limits.high + 1e-9).all()
    assert (np.abs(speed) <= limits.speed * (1 + 1e-9)).all()
    change = np.abs(np.diff(speed, axis=0, prepend=np.zeros((1, 6))))
    assert (change <= limits.acceleration * TICK_S * (1 + 1e-6)).all()


def swing(t):
    return moved(
        [60 * np.sin(2 * t), 30 * np.sin(3 * t), 30 * np.sin(2.5 * t)], [0.2 * np.sin(2 * t), 0, 0]
    )


def test_the_arm_repeats_what_the_hand_does():
    times = np.arange(1, 91) / 30
    _, moments = run([Sample(t, moved([min(60 * t, 120), 0, 0]), "measured", True) for t in times])
    check_limits(moments)
    first, last = moments[0].reading.tool, moments[-1].reading.tool
    # closed at 1/30 s
    np.testing.assert_allclose(last.translation - first.translation, [118, 0, 0], atol=0.5)
    assert (last.rotation * first.rotation.inv()).magnitude() < 1e-3
    assert all(len(moment.ticks.t_s) in (16, 17) for moment in moments[1:])
    # one clock
    np.testing.assert_allclose(np.diff(all_ticks(moments, "t_s")), TICK_S, rtol=0, atol=1e-9)
    assert abs(moments[-1].ticks.t_s[-1] - times[-1]) <= TICK_S


def test_a_second_of_lost_frames_holds_the_arm_still():
    times = np.arange(1, 91) / 30
    samples = [
        Sample(t, None if 1 < t <= 2 else swing(t), "lost" if 1 < t <= 2 else "measured", True)
        for t in times
    ]
    _, moments = run(samples)
    check_limits(moments)
    assert moments[-1].state.held == "pose lost"  # the clutch was never opened
    at_rest = [moment.reading.tool.translation for moment in moments[75:]]
    assert np.ptp(at_rest, axis=0).max() < 0.01


def test_the_force_of_a_contact_is_read():
    times = np.arange(1, 91) / 30
    deep = MappingParameters(alignment=TO_BASE, reach_mm=((-850, 850), (-850, 850), (-20, 950)))
    # down
    _, moments = run(
        [Sample(t, moved([0, min(60 * t, 140), 0]), "measured", True) for t in times], deep
    )
    check_limits(moments)
    assert moments[0].reading.force.tolist() == [0, 0, 0]
    assert moments[-1].reading.force[2] > 20
    log = Log(ROBOT.joints)
    for k, moment in enumerate(moments):
        log.add(moment, clutch=True, scale=1.0 if k < 80 else 2.0)
    events = log.event_table()
    events = events[~events["event"].str.startswith("limit")]
    assert events["event"].tolist() == ["clutch closed", "contact", "scale"]
    assert events["detail"].tolist() == ["", "", "2"]
    force = log.trajectory()["force_n"]
    assert force.iloc[-1] == pytest.approx(np.linalg.norm(moments[-1].reading.force))
    assert (force[log.trajectory()["t_s"] < events["t_s"].iloc[1] - 0.05] == 0).all()


@settings(max_examples=5, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.none() | st.tuples(*[st.floats(-1500, 1500)] * 3, *[st.floats(-3.2, 3.2)] * 3),
            st.booleans(),
            st.floats(-0.05, 0.4),
        ),
        max_size=15,
    )
)
def test_no_stream_however_wild_exceeds_a_limit(stream):
    t, samples = 0.0, []
    for pose, clutch, dt in stream:
        t += dt
        T = None if pose is None else moved(pose[:3], pose[3:])
        samples.append(Sample(t, T, "measured" if T is not None else "lost", clutch))
    if samples:
        check_limits(run(samples)[1])
