"""Eq. 7-15 against OpenCV's filter, one dense Gaussian for all instants, a fitted parabola and
matrix exponentials.
"""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import block_diag, expm, sqrtm
from scipy.stats import chi2

from trinolab.image_track import Track, draw, nees, run, search_window, track
from trinolab.kalman import (
    KalmanParameters,
    State,
    as_covariance,
    constant_acceleration,
    covariance_root,
    gate,
    initial_state,
    innovation,
    nis,
    observation_matrix,
    predict,
    update,
    white_jerk,
)
from trinolab.window import Window

DT = 1 / 30
H = observation_matrix()
PX = KalmanParameters(
    jerk_intensity=2.2e5, sigma_px=1.0, velocity_sigma=300.0, acceleration_sigma=1000.0
)
R = PX.sigma_px**2 * np.eye(2)
UNEVEN = np.cumsum([0.0, 0.03, 0.05, 0.02, 0.11, 0.03, 0.03, 0.07, 0.03, 0.03])


def models(times, q=PX.jerk_intensity):
    steps = np.diff(times)
    return [constant_acceleration(dt) for dt in steps], [white_jerk(dt, q) for dt in steps]


def path(times, rng, sigma=1.0):
    """A parabola with noise, shape (k, 2)."""
    t = np.asarray(times)[:, None]
    return (
        [100, 200]
        + [300, -150] * t
        + 0.5 * np.array([-400, 250]) * t**2
        + sigma * rng.standard_normal((len(t), 2))
    )


def test_transition_by_hand():
    moved = constant_acceleration(0.5) @ [1, 2, 10, 20, 8, -8]  # x + v t + a t^2 / 2; v + a t; a
    np.testing.assert_allclose(moved, [1 + 5 + 1, 2 + 10 - 1, 14, 16, 8, -8], atol=1e-15)


def test_transition_and_noise_are_those_of_the_differential_equation():
    """Van Loan: both are blocks of the exponential of one matrix made of x''' = w."""
    A = np.kron(np.diag([1.0, 1.0], 1), np.eye(2))
    noise = 7.0 * np.diag([0, 0, 0, 0, 1.0, 1.0])
    big = expm(np.block([[-A, noise], [np.zeros((6, 6)), A.T]]) * 0.3)
    F = big[6:, 6:].T
    np.testing.assert_allclose(constant_acceleration(0.3), F, atol=1e-14)
    np.testing.assert_allclose(white_jerk(0.3, 7.0), F @ big[:6, 6:], atol=1e-14)


def test_two_short_steps_make_a_long_one():
    start = initial_state([3.0, 4.0], PX)
    long = predict(start, constant_acceleration(0.12), white_jerk(0.12, 1e6))
    short = predict(start, constant_acceleration(0.05), white_jerk(0.05, 1e6))
    short = predict(short, constant_acceleration(0.07), white_jerk(0.07, 1e6))
    # (px/s^2)^2, up to 1e6
    np.testing.assert_allclose(short.covariance, long.covariance, atol=1e-8)


def rank(observed):
    F = constant_acceleration(DT)
    return np.linalg.matrix_rank(
        np.vstack([observed @ np.linalg.matrix_power(F, k) for k in range(6)])
    )


def test_observability_as_printed_and_corrected():
    # Eq. 12 as printed: x + y and its derivatives
    assert rank(np.array([[1.0, 1, 0, 0, 0, 0]])) == 3
    assert rank(H) == 6


def opencv_filter(start, F, Q):
    f = cv2.KalmanFilter(6, 2, 0, cv2.CV_64F)
    f.statePost, f.errorCovPost = np.array(start.mean)[:, None], np.array(start.covariance)
    f.transitionMatrix, f.processNoiseCov = np.array(F), np.array(Q)
    f.measurementMatrix, f.measurementNoiseCov = np.array(H), np.array(R)
    return f


def test_every_step_is_opencvs():
    F, Q = constant_acceleration(DT), white_jerk(DT, PX.jerk_intensity)
    points = path(np.arange(25) * DT, np.random.default_rng(0))
    state = initial_state(points[0], PX)
    reference = opencv_filter(state, F, Q)
    for z in points[1:]:
        state = predict(state, F, Q)
        np.testing.assert_allclose(state.mean, reference.predict()[:, 0], atol=1e-8)
        # (px/s^2)^2, up to 1e6
        np.testing.assert_allclose(state.covariance, reference.errorCovPre, atol=1e-6)
        state = update(state, z, H, R)
        np.testing.assert_allclose(state.mean, reference.correct(z[:, None])[:, 0], atol=1e-8)
        np.testing.assert_allclose(state.covariance, reference.errorCovPost, atol=1e-6)


def dense_solution(start, points, F, Q):
    """Mean and covariance of the last state from the joint distribution of all states, without any
    recursion.

    Unknowns: every state. Residuals, each divided by its standard deviation: the start, the motion
    from each instant to the next, the observations.
    """
    k = len(points)
    rows = [np.hstack([np.eye(6), np.zeros((6, 6 * k))])]
    target, weight = [start.mean], [np.linalg.inv(start.covariance)]
    for i in range(k):
        row = np.zeros((6, 6 * (k + 1)))
        row[:, 6 * i : 6 * i + 6], row[:, 6 * i + 6 : 6 * i + 12] = -F[i], np.eye(6)
        rows.append(row)
        target.append(np.zeros(6))
        weight.append(np.linalg.inv(Q[i]))
        if np.isfinite(points[i]).all():
            row = np.zeros((2, 6 * (k + 1)))
            row[:, 6 * i + 6 : 6 * i + 12] = H
            rows.append(row)
            target.append(points[i])
            weight.append(np.linalg.inv(R))
    A, b, W = np.vstack(rows), np.concatenate(target), block_diag(*weight)
    covariance = np.linalg.inv(A.T @ W @ A)
    return (covariance @ A.T @ W @ b)[-6:], covariance[-6:, -6:]


def test_last_state_is_that_of_the_joint_distribution_of_all():
    F, Q = models(UNEVEN)
    points = path(UNEVEN, np.random.default_rng(1))
    start = initial_state(points[0], PX)
    points[4] = np.nan
    mean, covariance = dense_solution(start, points[1:], F, Q)
    result = run(start, points[1:], F, Q, H, R)
    scale = np.sqrt(np.diag(covariance))
    # inverses of 60 x 60: 1e-9
    np.testing.assert_allclose((result.updated.mean[-1] - mean) / scale, 0, atol=1e-7)
    np.testing.assert_allclose(
        (result.updated.covariance[-1] - covariance) / np.outer(scale, scale), 0, atol=1e-7
    )


def test_without_noise_of_the_motion_the_filter_is_a_fitted_parabola():
    points = path(UNEVEN, np.random.default_rng(2))
    vague = KalmanParameters(
        jerk_intensity=0.0, sigma_px=1.0, velocity_sigma=1e5, acceleration_sigma=1e6
    )
    x = track(UNEVEN, points, vague, gated=False).updated
    t = UNEVEN - UNEVEN[-1]
    fits = [np.polynomial.polynomial.polyfit(t, column, 2) for column in points.T]
    expected = [(fit[0], fit[1], 2 * fit[2]) for fit in fits]
    scale = np.sqrt(np.diag(x.covariance[-1]))  # 0.8 px, 6 px/s, 45 px/s^2
    # (fit / vague)^2
    np.testing.assert_allclose((x.mean[-1] - np.transpose(expected).ravel()) / scale, 0, atol=1e-4)


def mean_nees(start, draws, frames, seed, covariance=None):
    """Mean NEES a frame over motions drawn from the model, shape (frames,)."""
    rng, total = np.random.default_rng(seed), np.zeros(frames)
    F, Q = constant_acceleration(DT), white_jerk(DT, PX.jerk_intensity)
    for _ in range(draws):
        states, observed = draw(start, frames, F, Q, H, R, rng)
        believed = State(start.mean, start.covariance if covariance is None else covariance)
        total += nees(run(believed, observed, F, Q, H, R).updated, states)
    return total / draws


@pytest.mark.slow
def test_errors_are_as_large_as_the_covariance_says():
    draws = 60
    values = mean_nees(initial_state([0, 0], PX), draws, 12, seed=3)
    low, high = chi2.ppf([0.025, 0.975], 6 * draws) / draws  # 95 % band of the mean of 60 draws
    assert low < values[0] < high
    assert low < values[-1] < high


def expected_nees_from_zero(q, frames):
    """The same for P_0 = 0, exactly: the wrong filter's gains applied to the true covariance of the
    start.
    """
    F, Q = constant_acceleration(DT), white_jerk(DT, q)
    P, E, values = np.zeros((6, 6)), np.array(initial_state([0, 0], PX).covariance), []
    for _ in range(frames):
        P, E = F @ P @ F.T + Q, F @ E @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        P, E = ((np.eye(6) - K @ H) @ C @ (np.eye(6) - K @ H).T + K @ R @ K.T for C in (P, E))
        # of position and velocity: 4 expected
        values.append(np.trace(np.linalg.solve(P[:4, :4], E[:4, :4])))
    return np.array(values)


def test_initial_covariance_zero_is_far_too_sure():
    """About 320 after ten frames where 4 are expected, for this Q; with a larger one back after
    thirty.
    """
    assert 300 < expected_nees_from_zero(PX.jerk_intensity, 10)[-1] < 340
    assert expected_nees_from_zero(PX.jerk_intensity / 10, 10)[-1] > 10_000  # it is Q that decides
    assert expected_nees_from_zero(100 * PX.jerk_intensity, 30)[-1] < 4.1
    drawn = mean_nees(initial_state([0, 0], PX), 25, 10, seed=4, covariance=np.zeros((6, 6)))
    assert drawn[-1] > 100  # all six of the state; the right filter has 6


def test_nees_by_hand():
    states = State(
        np.array([[1.0, 2.0], [0.0, 0.0]]),
        np.array([np.diag([4.0, 9.0]), [[2.0, 1.0], [1.0, 2.0]]]),
    )
    # 2^2 / 4 + 3^2 / 9; the inverse of the second is ((2, -1), (-1, 2)) / 3
    np.testing.assert_allclose(nees(states, [[3, 5], [1, 1]]), [2, 2 / 3], atol=1e-12)


def test_nis_and_gate_by_hand():
    state = State(np.array([1.0, 2.0]), np.diag([3.0, 8.0]))
    seen = innovation(state, [3.0, 5.0], np.eye(2), np.eye(2))  # S = diag(4, 9), r = (2, 3)
    assert nis(seen) == pytest.approx(2.0, abs=1e-12)
    assert gate(seen, 0.64)  # chi2 with 2 degrees: 1 - exp(-1) = 0.632
    assert not gate(seen, 0.63)
    missing = innovation(state, None, np.eye(2), np.eye(2))
    assert np.isnan(nis(missing))
    assert not gate(missing, 0.99)


@pytest.mark.parametrize("missing", [None, [np.nan, np.nan], [1.0, np.nan]])
def test_without_an_observation_the_prediction_stands(missing):
    state = initial_state([5.0, 6.0], PX)
    kept = update(state, missing, H, R)
    np.testing.assert_array_equal(kept.mean, state.mean)
    np.testing.assert_array_equal(kept.covariance, state.covariance)


def test_what_lies_outside_the_gate_is_left_out():
    times = np.arange(12) * DT
    points = path(times, np.random.default_rng(5), sigma=0.5)
    points[8] += 60
    gap = points.copy()
    gap[8] = np.nan
    gated, without = track(times, points, PX), track(times, gap, PX)
    np.testing.assert_array_equal(np.flatnonzero(~gated.used), [8])
    np.testing.assert_array_equal(gated.updated.mean, without.updated.mean)
    assert gated.nis[8] > chi2.ppf(PX.gate_probability, 2)
    assert np.isnan(without.nis[8])
    # swallowed without it
    assert abs(track(times, points, PX, gated=False).updated.mean[8, 0] - gap[7, 0]) > 20


def test_track_starts_at_the_first_point_that_was_seen():
    points = path(UNEVEN, np.random.default_rng(6))
    late = points.copy()
    late[:3] = np.nan
    a, b = track(UNEVEN, late, PX), track(UNEVEN[3:], points[3:], PX)
    np.testing.assert_array_equal(a.updated.mean[3:], b.updated.mean)
    assert np.isnan(a.updated.mean[:3]).all()
    assert not a.used[:3].any()
    assert np.isnan(track(UNEVEN, late * np.nan, PX).updated.mean).all()


def test_a_single_instant():
    only = track([0.0], [[3.0, 4.0]], PX)
    np.testing.assert_array_equal(only.updated.mean, [[3, 4, 0, 0, 0, 0]])
    np.testing.assert_allclose(np.diag(only.updated.covariance[0]), [1, 1, 9e4, 9e4, 1e6, 1e6])


def test_search_window_by_hand():
    state = State(np.array([100.4, 50.0, 9, 9]), np.diag([8.0, 3.0, 1, 1]))
    # chi2 with 2 degrees: 4; 4 x (8 + 1) = 6^2
    p = KalmanParameters(sigma_px=1.0, gate_probability=1 - np.exp(-2))
    assert search_window(state, Window(0, 0, 21, 11), (1000, 800), p) == Window(84, 39, 33, 23)
    assert search_window(state, Window(0, 0, 21, 11), (90, 800), p) == Window(84, 39, 6, 23)
    assert search_window(state, Window(0, 0, 21, 11), (80, 800), p) is None


@pytest.mark.slow
def test_drawn_motion_has_the_models_moments():
    rng, F, Q = np.random.default_rng(7), constant_acceleration(0.5), white_jerk(0.5, 100.0)
    start = initial_state(
        [1.0, 2.0], KalmanParameters(sigma_px=1.0, velocity_sigma=3.0, acceleration_sigma=5.0)
    )
    drawn = np.array(
        [np.hstack([part[-1] for part in draw(start, 2, F, Q, H, R, rng)]) for _ in range(1500)]
    )
    end = predict(predict(start, F, Q), F, Q)
    S = H @ end.covariance @ H.T + R
    deviation = np.sqrt(np.append(np.diag(end.covariance), np.diag(S)))
    bias = (drawn.mean(axis=0) - np.append(end.mean, H @ end.mean)) / deviation
    assert np.abs(bias).max() < 4 / np.sqrt(1500)
    assert np.abs(drawn.std(axis=0) / deviation - 1).max() < 4 / np.sqrt(2 * 1500)
    noise = drawn[:, 6:] - drawn[:, :2]
    assert np.abs(noise.std(axis=0) - 1).max() < 4 / np.sqrt(2 * 1500)


GOOD = State(np.zeros(6), np.eye(6))
SKEW = np.eye(6) + np.eye(6, k=1) * 0.1
F1, Q1 = constant_acceleration(DT), white_jerk(DT, 1.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda: predict(State(np.full(6, np.nan), np.eye(6)), F1, Q1),
        lambda: predict(State(np.zeros(6), SKEW), F1, Q1),
        lambda: predict(State(np.zeros(6), -np.eye(6)), F1, Q1),
        lambda: predict(State(np.zeros(5), np.eye(6)), F1, Q1),
        lambda: predict(GOOD, F1[:5], Q1),
        lambda: predict(GOOD, F1, SKEW),
        lambda: predict(GOOD, F1 * np.nan, Q1),
        lambda: predict(GOOD, 1e37 * F1, Q1),
        lambda: predict(GOOD, F1, Q1 - 1e-3 * np.eye(6)),
        lambda: predict(State(np.zeros(2), [[1, 2], [2, 1]]), np.eye(2), np.eye(2)),
        lambda: update(GOOD, [1, 2, 3], H, R),
        lambda: update(GOOD, [np.inf, 0], H, R),
        lambda: update(GOOD, [0, 0], H[:, :5], R),
        lambda: update(GOOD, [0, 0], H, np.diag([1.0, -1.0])),
        lambda: update(State(np.zeros(6), np.zeros((6, 6))), [0, 0], H, np.zeros((2, 2))),
        lambda: update(State(np.full(6, 1e308), np.eye(6)), [-1e308, 0], H, R),
        lambda: innovation(GOOD, [0], H, R),
        lambda: gate(innovation(GOOD, [0, 0], H, R), 1.0),
        lambda: constant_acceleration(0.0),
        lambda: constant_acceleration(-0.1),
        lambda: constant_acceleration(float("nan")),
        lambda: white_jerk(0.0, 1.0),
        lambda: white_jerk(0.1, -1.0),
        lambda: initial_state([1, np.nan]),
        lambda: initial_state([1, 2, 3]),
        lambda: run(GOOD, [], F1, Q1, H, R),
        lambda: run(GOOD, [[0, 0]] * 2, [F1] * 3, Q1, H, R),
        lambda: track([0, 0.1], [[0, 0]], PX),
        lambda: track([0, 0], [[0, 0]] * 2, PX),
        lambda: track([0.1, 0], [[0, 0]] * 2, PX),
        lambda: track([], np.empty((0, 2)), PX),
        lambda: track([0, 1], [[0, 0], [np.inf, 0]], PX),
        lambda: track([0, np.nan], [[0, 0]] * 2, PX),
        lambda: nees(State(np.zeros((2, 3)), np.eye(3)), np.zeros((2, 3))),
        lambda: nees(State(np.zeros((1, 2)), np.zeros((1, 2, 2))), np.zeros((1, 2))),
        lambda: draw(GOOD, 0, F1, Q1, H, R, np.random.default_rng(0)),
        lambda: draw(GOOD, 3, F1, Q1, H, R, 0),
        lambda: KalmanParameters(jerk_intensity=-1),
        lambda: KalmanParameters(sigma_px=0),
        lambda: KalmanParameters(gate_probability=1),
        lambda: KalmanParameters(velocity_sigma=np.inf),
        lambda: track([0.1, 0], [[np.nan, 0]] * 2, PX),
        lambda: covariance_root([[0, 1], [1, 0]], "C", 2),
        lambda: covariance_root([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]], "C", 3),
        lambda: covariance_root([[1, 0.1], [0.2, 1]], "C", 2),
    ],
)
def test_bad_input_is_a_value_error(call):
    with pytest.raises(ValueError, match="expected"):
        call()


def test_a_root_of_a_covariance_is_the_same_whatever_signs_eigenvectors_have(monkeypatch):
    """px beside px/s^2; of rank two."""
    scale = np.array([0.1, 30.0, 4e4])
    correlation = np.array([[1.0, 0.6, 0.6], [0.6, 1.0, 1.0], [0.6, 1.0, 1.0]])
    C = scale[:, None] * correlation * scale
    root = covariance_root(C, "C", 3)
    np.testing.assert_allclose(root, scale[:, None] * sqrtm(correlation).real, rtol=1e-6)
    np.testing.assert_allclose(root @ root.T, C, rtol=1e-9)
    eigh = np.linalg.eigh

    def others(matrix):
        values, vectors = eigh(matrix)
        return values, vectors * [-1, 1, -1]

    monkeypatch.setattr(np.linalg, "eigh", others)
    np.testing.assert_allclose(covariance_root(C, "C", 3), root, rtol=1e-9)


numbers = st.floats(-1e6, 1e6)
wild = st.floats(allow_nan=True, allow_infinity=True)
scales = st.floats(-6, 6).map(lambda x: 10.0**x)
shares = st.floats(-6, 0).map(lambda x: 10.0**x)


@given(
    arrays(float, (3, 5), elements=numbers),
    arrays(float, 3, elements=numbers),
    st.lists(scales, min_size=3),
    arrays(float, (3, 3), elements=st.floats(-10, 10)),
    arrays(float, (2, 3), elements=st.floats(-10, 10)),
    shares,
    shares,
)
@settings(max_examples=60, deadline=None)
def test_what_the_filter_returns_it_takes_again(root, mean, scale, F, observed, motion, noise):
    """A step never makes what is no covariance, for a motion and an observation with noise above
    rounding.
    """
    C = np.array(scale[:3])[:, None] * root / 1e6
    C = C @ C.T
    state = predict(State(mean, C), F, (1e-6 + motion * np.trace(F @ C @ F.T)) * np.eye(3))
    as_covariance(state.covariance, "P", 3)
    S = observed @ state.covariance @ observed.T
    state = update(state, mean[:2], observed, (1e-6 + noise * np.trace(S)) * np.eye(2))
    as_covariance(state.covariance, "P", 3)
    np.testing.assert_array_equal(state.covariance, state.covariance.T)
    assert np.isfinite(state.mean).all()


@given(
    arrays(float, 4, elements=wild),
    arrays(float, (4, 4), elements=wild),
    arrays(float, (4, 4), elements=wild),
    arrays(float, 2, elements=wild),
    arrays(float, (2, 2), elements=wild),
    st.booleans(),
)
@settings(max_examples=100, deadline=None)
def test_wild_numbers_raise_value_errors_or_give_numbers(mean, C, F, z, noise, tame):
    if tame:  # get past the checks of the covariances
        C, noise = np.diag(np.abs(np.diag(C))), np.diag(np.abs(np.diag(noise)))
    try:
        state = predict(State(mean, C), F, C)
        state = update(state, z, np.eye(2, 4), noise)
    except ValueError:
        return
    assert np.isfinite(state.mean).all()
    assert np.isfinite(state.covariance).all()
    np.testing.assert_array_equal(state.covariance, state.covariance.T)


@given(
    arrays(float, st.integers(0, 6), elements=wild),
    arrays(float, st.tuples(st.integers(0, 6), st.integers(1, 3)), elements=wild),
)
@settings(max_examples=100, deadline=None)
def test_any_times_and_points_raise_value_errors_or_give_a_track(times, uv):
    try:
        result = track(times, uv, PX)
    except ValueError:
        return
    assert isinstance(result, Track)
    after = np.maximum.accumulate(result.used)  # from the first point on
    assert np.isfinite(result.updated.mean[after]).all()
    assert not result.used[np.isnan(uv).any(axis=1)].any()


@given(st.lists(st.floats(-10, 10).map(lambda x: 10.0**x), min_size=1, max_size=5), scales)
@settings(max_examples=50, deadline=None)
def test_noise_of_the_motion_is_a_covariance_for_any_time(times, q):
    for dt in times:
        if 1e-9 <= dt <= 1e6:
            as_covariance(white_jerk(dt, q), "Q", 6)
        else:
            with pytest.raises(ValueError, match="dt: expected"):
                white_jerk(dt, q)
