"""The mapping: scales and directions by hand, the clutch, the dead man, limits; and no stream makes
the tool jump.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Camera
from trinolab.slave import mapping, oneeuro
from trinolab.slave.mapping import MappingParameters, Sample, State, step
from trinolab.slave.oneeuro import OneEuroParameters

QUICK = OneEuroParameters(cutoff_hz=1e6, turn_cutoff_hz=1e6)  # as good as no filter
HANDLE = RigidTransform.from_components(
    [10.0, -20.0, 560.0], Rotation.from_euler("ZYX", [0.4, -0.2, 0.9])
)
TOOL = RigidTransform.from_components([-500.0, -100.0, 120.0], Rotation.from_rotvec([0, np.pi, 0]))
START = State(0.0, TOOL)


def moved(way, turn=(0.0, 0.0, 0.0)):
    return RigidTransform.from_components(
        HANDLE.translation + np.array(way, float), Rotation.from_rotvec(turn) * HANDLE.rotation
    )


def run(samples, parameters=None, state=START):
    """The states after samples: (pose or None, clutch[, status]), thirty a second."""
    states = [state]
    for k, (pose, clutch, *status) in enumerate(samples, 1):
        given_status = status[0] if status else ("lost" if pose is None else "measured")
        states.append(
            step(states[-1], Sample(state.t_s + k / 30, pose, given_status, clutch), parameters)
        )
    return states[1:]


def off(state):
    """By how far the tool has moved."""
    return state.target.translation - TOOL.translation


def steadily(way, turn=(0, 0, 0), n=30, clutch=True):
    """A motion in n steps."""
    return [(moved(np.array(way) * k / n, np.array(turn) * k / n), clutch) for k in range(n + 1)]


# --- the map


@pytest.mark.parametrize("scale", [0.25, 1.0, 3.0])
def test_the_tool_moves_by_the_scale_along_the_aligned_axes(scale):
    swap = Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x -> y -> z -> x
    p = MappingParameters(scale, alignment=swap, filtering=QUICK)
    last = run(steadily([30, 0, 6]), p)[-1]
    np.testing.assert_allclose(off(last), scale * np.array([6, 30, 0]), atol=1e-3)
    assert (last.target.rotation * TOOL.rotation.inv()).magnitude() < 1e-9


@pytest.mark.parametrize(("turn_scale", "turn"), [(1.0, 0.5), (0.5, 0.8), (0.5, 4.0), (2.0, 2.5)])
def test_the_tool_turns_by_the_scale_also_beyond_half_a_turn(turn_scale, turn):
    p = MappingParameters(turn_scale=turn_scale, filtering=QUICK)
    last = run(steadily([0, 0, 0], [0, turn, 0], n=60), p)[-1]
    expected = Rotation.from_rotvec([0, turn_scale * turn, 0]) * TOOL.rotation
    assert (last.target.rotation * expected.inv()).magnitude() < 1e-3
    np.testing.assert_allclose(last.target.translation, TOOL.translation, atol=1e-6)


def test_in_the_surveillance_picture_the_tool_moves_as_the_hand():
    """The camera looks along the base's +y, its picture upright: right is +x, down is -z."""
    R = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    T = RigidTransform.from_components([-500, -900, 120], R).inv()
    camera = Camera("c", (640, 480), np.diag([600.0, 600.0, 1.0]), np.zeros(5), T)
    p = MappingParameters(alignment=mapping.alignment(camera), filtering=QUICK)
    for way, tool in (
        ([20, 0, 0], [20, 0, 0]),
        ([0, 20, 0], [0, 0, -20]),
        ([0, 0, 20], [0, 20, 0]),
    ):
        np.testing.assert_allclose(off(run(steadily(way), p)[-1]), tool, atol=1e-3)


# --- the clutch


def test_indexing_carries_the_tool_far_with_a_small_hand():
    back = [(moved([40 * (1 - k / 15), 0, 0]), False) for k in range(16)]
    states = run((steadily([40, 0, 0], n=15) + back) * 5, MappingParameters(filtering=QUICK))
    np.testing.assert_allclose(off(states[-1]), [200, 0, 0], atol=0.01)
    steps = np.diff([off(state) for state in states], axis=0)
    assert np.abs(steps).max() < 3.0  # no step larger than the hand's
    # nothing moves before the clutch is closed
    assert run(back)[-1].target is TOOL


# --- the dead man


def test_a_lost_pose_holds_until_the_clutch_is_closed_anew_and_then_without_a_jump():
    states = run(
        [
            *steadily([30, 0, 0]),
            *[(None, True)] * 30,
            *[(moved([90, 0, 0]), True)] * 10,
            *[(moved([90, 0, 0]), False)] * 2,
            *[(moved([90 + k, 0, 0]), True) for k in range(10)],
        ],
        MappingParameters(filtering=QUICK),
    )
    # a moment without a pose is bridged
    assert [state.held for state in states[31:34]] == [""] * 3
    assert {state.held for state in states[40:71]} == {"pose lost"}
    for state in (*states[40:71], *states[71:73]):
        np.testing.assert_allclose(off(state), [30, 0, 0], atol=1e-3)
    assert states[72].held == ""
    np.testing.assert_allclose(off(states[73]), off(states[72]))
    np.testing.assert_allclose(off(states[-1]), [39, 0, 0], atol=1e-3)


AT_REST = moved([0, 0, 0])


@pytest.mark.parametrize(
    ("samples", "held"),
    [
        # what no hand can do
        ([(moved([400, 0, 0]), True), *[(AT_REST, True)] * 3], ["pose jumped"] * 4),
        ([(moved([0, 0, 0], [2.5, 0, 0]), True), (AT_REST, True)], ["pose jumped"] * 2),
        ([(RigidTransform.from_translation([np.nan, 0, 0]), True)], ["pose not finite"]),
        # a prediction is followed for a moment only
        ([(AT_REST, True, "predicted")] * 8, [""] * 4 + ["pose stale"] * 4),
    ],
)
def test_a_sample_that_cannot_be_used_holds(samples, held):
    states = run([*steadily([0, 0, 0], n=5), *samples])
    assert [state.held for state in states[6:]] == held
    assert states[-1].target.translation == pytest.approx(TOOL.translation)


def test_time_that_does_not_go_on_holds():
    state = run(steadily([0, 0, 0], n=5))[-1]
    for t in (0.0, state.t_s, np.nan, np.inf):
        after = step(state, Sample(t, HANDLE, "measured", True))
        assert after.held == "time went backwards"
        assert after.t_s == state.t_s


@pytest.mark.parametrize(("rate", "held"), [(5, "pose stale"), (30, ""), (200, "")])
def test_streams_of_other_rates(rate, held):
    state = START
    for k in range(1, 2 * rate):
        state = step(state, Sample(k / rate, moved([10 * k / rate, 0, 0]), "measured", True))
    assert state.held == held
    assert held or 15 < off(state)[0] < 20


# --- the end of the reach


def test_beyond_the_reach_the_target_stays_and_a_hand_that_turns_round_is_followed_after_the_leash():
    p = MappingParameters(
        filtering=QUICK, reach_mm=((-600, -460), (-300, 300), (0, 400)), leash_mm=10
    )
    out = steadily([150, 20, 0], n=60)
    back = [(moved([150 - 2 * k, 20, 0]), True) for k in range(1, 16)]
    states = run([*out, *back], p)
    at_the_end = states[len(out) - 1]
    np.testing.assert_allclose(at_the_end.target.translation, [-460, -80, 120], atol=1e-3)
    assert at_the_end.limited
    x = np.array([state.target.translation[0] for state in states[len(out) :]])
    np.testing.assert_allclose(x[:5], -460, atol=1e-3)
    np.testing.assert_allclose(x[-1], -480, atol=1e-3)
    assert not states[-1].limited
    other_end = run(steadily([-150, 0, 0], n=60), p)[-1]
    np.testing.assert_allclose(other_end.target.translation, [-600, -100, 120], atol=1e-3)


# --- whatever comes


POSES = st.tuples(*[st.floats(-1e4, 1e4)] * 3, *[st.floats(-3.2, 3.2)] * 3)
SAMPLES = st.tuples(
    st.none() | POSES,
    st.booleans(),
    st.sampled_from(["measured", "predicted", "lost", "ambiguous"]),
    st.floats(-0.1, 1.0),
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.lists(SAMPLES, max_size=40))
def test_whatever_comes_the_target_moves_only_as_a_hand_can_and_stays_within_reach(stream):
    p, state, t = MappingParameters(scale=2.0), START, 0.0
    low, high = np.transpose(p.reach_mm)
    for pose, clutch, status, dt in stream:
        t += dt
        T = None if pose is None else moved(pose[:3], pose[3:])
        before, state = state, step(state, Sample(t, T, status, clutch), p)
        way = np.linalg.norm(state.target.translation - before.target.translation)
        assert way <= 2 * (p.hand_mm_s * max(t - before.t_s, 0) + p.slack_mm) + 1e-6
        assert (low <= state.target.translation).all()
        assert (state.target.translation <= high).all()
        assert not (state.held and state.origin is not None)
        if not clutch:
            assert way == 0
            assert state.held == ""


def test_parameters_that_are_refused():
    for field, value in (
        ("scale", 0.0),
        ("scale", np.nan),
        ("stale_s", -1.0),
        ("leash_mm", -1.0),
        ("hand_mm_s", np.inf),
        ("reach_mm", ((0, 1), (0, 1))),
        ("reach_mm", ((1, 0), (0, 1), (0, 1))),
    ):
        with pytest.raises(ValueError, match=field):
            MappingParameters(**{field: value})


# --- the filter


@pytest.mark.slow
@pytest.mark.parametrize("speed", [10.0, 500.0])
def test_the_filter_is_as_far_behind_as_it_says(speed):
    p, state = OneEuroParameters(), oneeuro.begin(0.0, HANDLE)
    for k in range(1, 1501):
        state = oneeuro.step(state, k / 1000, moved([speed * k / 1000, 0, 0]), p)
    behind = (speed * 1.5 + HANDLE.translation[0] - state.pose.translation[0]) / speed
    assert behind == pytest.approx(oneeuro.lag_s(speed, p.cutoff_hz, p.slope), rel=0.05)


def test_the_filter_refuses_time_that_stands_still():
    with pytest.raises(ValueError, match="t_s"):
        oneeuro.step(oneeuro.begin(1.0, HANDLE), 1.0, HANDLE)
