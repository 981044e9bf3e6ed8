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


def steadily(way, turn=(0, 0, 0), n=30, clutch=True):
    """A motion in n steps."""
    return [(moved(np.array(way) * k / n, np.array(turn) * k / n), clutch) for k in range(n + 1)]


# --- the map


@pytest.mark.parametrize("scale", [0.25, 1.0, 3.0])
def test_the_tool_moves_by_the_scale_along_the_aligned_axes(scale):
    swap = Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x -> y -> z -> x
    p = MappingParameters(scale, alignment=swap, filtering=QUICK)
    last = run(steadily([30, 0, 6]), p)[-1]
    np.testing.assert_allclose(
        last.target.translation - TOOL.translation, scale * np.array([6, 30, 0]), atol=1e-3
    )
    np.testing.assert_allclose(
        (last.target.rotation * TOOL.rotation.inv()).magnitude(), 0, atol=1e-9
    )


@pytest.mark.parametrize(("turn_scale", "turn"), [(1.0, 0.5), (0.5, 0.8), (0.5, 4.0), (2.0, 2.5)])
def test_the_tool_turns_by_the_scale_also_beyond_half_a_turn(turn_scale, turn):
    p = MappingParameters(turn_scale=turn_scale, filtering=QUICK)
    last = run(steadily([0, 0, 0], [0, turn, 0], n=60), p)[-1]
    expected = Rotation.from_rotvec([0, turn_scale * turn, 0]) * TOOL.rotation
    assert (last.target.rotation * expected.inv()).magnitude() < 1e-3
    np.testing.assert_allclose(last.target.translation, TOOL.translation, atol=1e-6)


def test_in_the_surveillance_picture_the_tool_moves_as_the_hand():
    """The camera looks along the base's +y, its picture upright: right is +x, down is -z."""
    camera = Camera(
        "surveillance",
        (640, 480),
        [[600, 0, 320], [0, 600, 240], [0, 0, 1]],
        np.zeros(5),
        RigidTransform.from_components(
            [-500, -900, 120], Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        ).inv(),
    )
    p = MappingParameters(alignment=mapping.alignment(camera), filtering=QUICK)
    for way, (du, dv) in (([20, 0, 0], (1, 0)), ([0, 20, 0], (0, 1))):
        uv = camera.project([TOOL.translation, run(steadily(way), p)[-1].target.translation])
        np.testing.assert_allclose(np.sign((uv[1] - uv[0]).round(6)), [du, dv])
    away = run(steadily([0, 0, 20]), p)[-1].target.translation
    np.testing.assert_allclose(away - TOOL.translation, [0, 20, 0], atol=1e-3)


# --- the clutch


def test_indexing_carries_the_tool_far_with_a_small_hand():
    stroke = steadily([40, 0, 0], n=15) + [
        (moved([40 * (1 - k / 15), 0, 0]), False) for k in range(16)
    ]
    states = run(stroke * 5, MappingParameters(filtering=QUICK))
    np.testing.assert_allclose(
        states[-1].target.translation - TOOL.translation, [200, 0, 0], atol=0.01
    )
    targets = np.array([state.target.translation for state in states])
    assert np.abs(np.diff(targets, axis=0)).max() < 3.0  # no step larger than the hand's


def test_nothing_moves_before_the_clutch_is_closed():
    assert run(steadily([50, 50, 0], clutch=False))[-1].target is TOOL


# --- the dead man


def test_a_lost_pose_holds_until_the_clutch_is_closed_anew_and_then_without_a_jump():
    p = MappingParameters(filtering=QUICK)
    states = run(
        [
            *steadily([30, 0, 0]),
            *[(None, True)] * 30,
            *[(moved([90, 0, 0]), True)] * 10,
            *[(moved([90, 0, 0]), False)] * 2,
            *[(moved([90 + k, 0, 0]), True) for k in range(10)],
        ],
        p,
    )
    held = states[40:71]
    assert {state.held for state in held} == {"pose lost"}
    for state in (*held, *states[71:73]):
        np.testing.assert_allclose(
            state.target.translation - TOOL.translation, [30, 0, 0], atol=1e-3
        )
    assert states[72].held == ""
    np.testing.assert_allclose(states[73].target.translation, states[72].target.translation)
    np.testing.assert_allclose(
        states[-1].target.translation - TOOL.translation, [39, 0, 0], atol=1e-3
    )


def test_a_moment_without_a_pose_is_bridged():
    states = run(
        [*steadily([30, 0, 0]), (None, True), (None, True), *[(moved([33, 0, 0]), True)] * 3],
        MappingParameters(filtering=QUICK),
    )
    assert {state.held for state in states} == {""}
    np.testing.assert_allclose(
        states[-1].target.translation - TOOL.translation, [33, 0, 0], atol=1e-3
    )


@pytest.mark.parametrize(
    ("sample", "why"),
    [
        ((moved([400, 0, 0]), True), "pose jumped"),
        ((moved([0, 0, 0], [2.5, 0, 0]), True), "pose jumped"),
        ((RigidTransform.from_translation([np.nan, 0, 0]), True), "pose not finite"),
    ],
)
def test_what_no_hand_can_do_holds(sample, why):
    states = run([*steadily([0, 0, 0], n=5), sample, *[(moved([0, 0, 0]), True)] * 3])
    assert [state.held for state in states[6:]] == [why] * 4
    assert states[-1].target.translation == pytest.approx(TOOL.translation)


def test_a_prediction_is_followed_for_a_moment_only():
    states = run([*steadily([0, 0, 0], n=5), *[(moved([0, 0, 0]), True, "predicted")] * 8])
    assert [state.held for state in states[6:10]] == [""] * 4
    assert states[-1].held == "pose stale"


@pytest.mark.parametrize("t", [0.0, -1.0, np.nan, np.inf])
def test_time_that_does_not_go_on_holds(t):
    state = run(steadily([0, 0, 0], n=5))[-1]
    after = step(state, Sample(t, HANDLE, "measured", True))
    assert after.held == "time went backwards"
    assert after.t_s == state.t_s


@pytest.mark.parametrize(("rate", "held"), [(5, "pose stale"), (30, ""), (200, "")])
def test_streams_of_other_rates(rate, held):
    state = START
    for k in range(1, 2 * rate):
        state = step(state, Sample(k / rate, moved([10 * k / rate, 0, 0]), "measured", True))
    assert state.held == held
    if not held:
        assert 15 < (state.target.translation - TOOL.translation)[0] < 20


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


# --- whatever comes


POSES = st.tuples(*[st.floats(-1e4, 1e4)] * 3, *[st.floats(-3.2, 3.2)] * 3)
SAMPLES = st.tuples(
    st.none() | POSES,
    st.booleans(),
    st.sampled_from(["measured", "predicted", "lost", "ambiguous"]),
    st.floats(-0.1, 1.0),
)


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
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


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("scale", 0.0),
        ("scale", np.nan),
        ("stale_s", -1.0),
        ("leash_mm", -1.0),
        ("hand_mm_s", np.inf),
        ("reach_mm", ((0, 1), (0, 1))),
        ("reach_mm", ((1, 0), (0, 1), (0, 1))),
    ],
)
def test_parameters_that_are_refused(field, value):
    with pytest.raises(ValueError, match=field):
        MappingParameters(**{field: value})


# --- the filter


@pytest.mark.slow
@pytest.mark.parametrize("speed", [10.0, pytest.param(100.0, marks=pytest.mark.heavy), 500.0])
def test_the_filter_is_as_far_behind_as_it_says(speed):
    p, state = OneEuroParameters(), oneeuro.begin(0.0, HANDLE)
    for k in range(1, 1501):
        state = oneeuro.step(state, k / 1000, moved([speed * k / 1000, 0, 0]), p)
    behind = (speed * 1.5 + HANDLE.translation[0] - state.pose.translation[0]) / speed
    assert behind == pytest.approx(oneeuro.lag_s(speed, p.cutoff_hz, p.slope), rel=0.05)


def test_at_rest_the_filter_takes_most_of_the_noise():
    rng, p, state, found = (
        np.random.default_rng(0),
        OneEuroParameters(),
        oneeuro.begin(0.0, HANDLE),
        [],
    )
    for k in range(1, 600):
        noisy = moved(rng.normal(0, 0.05, 3), rng.normal(0, np.deg2rad(0.5), 3))
        state = oneeuro.step(state, k / 30, noisy, p)
        found.append(
            [
                *(state.pose.translation - HANDLE.translation),
                *(state.pose.rotation * HANDLE.rotation.inv()).as_rotvec(),
            ]
        )
    scatter = np.std(found[60:], axis=0)
    assert scatter[:3].max() < 0.05 * 0.6
    assert scatter[3:].max() < np.deg2rad(0.5) * 0.6


def test_the_filter_refuses_time_that_stands_still():
    with pytest.raises(ValueError, match="t_s"):
        oneeuro.step(oneeuro.begin(1.0, HANDLE), 1.0, HANDLE)
