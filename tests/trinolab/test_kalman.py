"""Eq. 7-15 against one dense Gaussian for all instants, matrix exponentials and draws."""

import numpy as np
import pytest
from scipy.linalg import block_diag, expm, sqrtm
from scipy.stats import chi2

from trinolab import kalman
from trinolab.image_track import draw, nees, run, search_window, track
from trinolab.window import Window

DT = 1 / 30
H = kalman.observation_matrix()
PX = kalman.KalmanParameters(
    jerk_intensity=2.2e5, sigma_px=1.0, velocity_sigma=300.0, acceleration_sigma=1000.0
)
R = PX.sigma_px**2 * np.eye(2)
UNEVEN = np.cumsum([0.0, 0.03, 0.05, 0.02, 0.11, 0.03, 0.03, 0.07, 0.03, 0.03])


def path(times, rng, sigma=1.0):
    """A parabola with noise, shape (k, 2)."""
    t = np.asarray(times)[:, None]
    noise = sigma * rng.standard_normal((len(t), 2))
    return [100, 200] + [300, -150] * t + 0.5 * np.array([-400, 250]) * t**2 + noise


def test_transition_and_noise_are_those_of_the_differential_equation():
    """Van Loan: both are blocks of the exponential of one matrix made of x''' = w."""
    A = np.kron(np.diag([1.0, 1.0], 1), np.eye(2))
    noise = 7.0 * np.diag([0, 0, 0, 0, 1.0, 1.0])
    big = expm(np.block([[-A, noise], [np.zeros((6, 6)), A.T]]) * 0.3)
    F = big[6:, 6:].T
    np.testing.assert_allclose(kalman.constant_acceleration(0.3), F, atol=1e-14)
    np.testing.assert_allclose(kalman.white_jerk(0.3, 7.0), F @ big[:6, 6:], atol=1e-14)


def test_observability_as_printed_and_corrected():
    F = kalman.constant_acceleration(DT)
    # Eq. 12 as printed: x + y and its derivatives
    for observed, rank in ((np.array([[1.0, 1, 0, 0, 0, 0]]), 3), (H, 6)):
        powers = [observed @ np.linalg.matrix_power(F, k) for k in range(6)]
        assert np.linalg.matrix_rank(np.vstack(powers)) == rank


def dense_solution(start, times, points):
    """Mean and covariance of the last state from the joint distribution of all states, without any
    recursion.

    Unknowns: every state. Residuals, each divided by its standard deviation: the start, the motion
    from each instant to the next, the observations.
    """
    k = len(points)
    rows = [np.eye(6, 6 * (k + 1))]
    target, weight = [start.mean], [np.linalg.inv(start.covariance)]
    for i, dt in enumerate(np.diff(times)):
        row = np.zeros((6, 6 * (k + 1)))
        row[:, 6 * i : 6 * i + 6] = -kalman.constant_acceleration(dt)
        row[:, 6 * i + 6 : 6 * i + 12] = np.eye(6)
        rows.append(row)
        target.append(np.zeros(6))
        weight.append(np.linalg.inv(kalman.white_jerk(dt, PX.jerk_intensity)))
        if np.isfinite(points[i]).all():
            rows.append(np.eye(2, 6 * (k + 1), 6 * i + 6))
            target.append(points[i])
            weight.append(np.linalg.inv(R))
    A, b, W = np.vstack(rows), np.concatenate(target), block_diag(*weight)
    covariance = np.linalg.inv(A.T @ W @ A)
    return (covariance @ A.T @ W @ b)[-6:], covariance[-6:, -6:]


@pytest.mark.parametrize("part", ["updated", "predicted"])
def test_last_state_is_that_of_the_joint_distribution_of_all(part):
    points = path(UNEVEN, np.random.default_rng(1))
    points[4] = np.nan
    result = getattr(track(UNEVEN, points, PX, gated=False), part)
    if part == "predicted":
        points[-1] = np.nan
        before = track(UNEVEN[:-1], points[:-1], PX, gated=False).updated
        alone = kalman.predict_motion(kalman.State(*(each[-1] for each in before)), 0.03, PX)
        np.testing.assert_allclose(alone.covariance, result.covariance[-1], rtol=1e-9)
    mean, covariance = dense_solution(kalman.initial_state(points[0], PX), UNEVEN, points[1:])
    scale = np.sqrt(np.diag(covariance))
    # inverses of 60 x 60: 1e-9
    np.testing.assert_allclose((result.mean[-1] - mean) / scale, 0, atol=1e-7)
    np.testing.assert_allclose(
        (result.covariance[-1] - covariance) / np.outer(scale, scale), 0, atol=1e-7
    )


def test_nees_by_hand():
    states = kalman.State(
        np.array([[1.0, 2.0], [0.0, 0.0]]),
        np.array([np.diag([4.0, 9.0]), [[2.0, 1.0], [1.0, 2.0]]]),
    )
    # 2^2 / 4 + 3^2 / 9; the inverse of the second is ((2, -1), (-1, 2)) / 3
    np.testing.assert_allclose(nees(states, [[3, 5], [1, 1]]), [2, 2 / 3], atol=1e-12)


def test_nis_and_gate_by_hand():
    state = kalman.State(np.array([1.0, 2.0]), np.diag([3.0, 8.0]))
    seen = kalman.innovation(state, [3.0, 5.0], np.eye(2), np.eye(2))  # S = diag(4, 9), r = (2, 3)
    assert kalman.nis(seen) == pytest.approx(2.0, abs=1e-12)
    assert kalman.gate(seen, 0.64)  # chi2 with 2 degrees: 1 - exp(-1) = 0.632
    assert not kalman.gate(seen, 0.63)
    missing = kalman.innovation(state, None, np.eye(2), np.eye(2))
    assert np.isnan(kalman.nis(missing))
    assert not kalman.gate(missing, 0.99)


@pytest.mark.parametrize("missing", [None, [np.nan, np.nan], [1.0, np.nan]])
def test_without_an_observation_the_prediction_stands(missing):
    state = kalman.initial_state([5.0, 6.0], PX)
    for kept, same in zip(kalman.update(state, missing, H, R), state, strict=True):
        np.testing.assert_array_equal(kept, same)


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
    assert a.used.tolist() == [False] * 3 + [True] * 7
    assert np.isnan(track(UNEVEN, late * np.nan, PX).updated.mean).all()
    only = track([0.0], [[3.0, 4.0]], PX)
    np.testing.assert_array_equal(only.updated.mean, [[3, 4, 0, 0, 0, 0]])
    np.testing.assert_allclose(np.diag(only.updated.covariance[0]), [1, 1, 9e4, 9e4, 1e6, 1e6])


def test_search_window_by_hand():
    state = kalman.State(np.array([100.4, 50.0, 9, 9]), np.diag([8.0, 3.0, 1, 1]))
    # chi2 with 2 degrees: 4; 4 x (8 + 1) = 6^2
    p = kalman.KalmanParameters(sigma_px=1.0, gate_probability=1 - np.exp(-2))
    assert search_window(state, Window(0, 0, 21, 11), (1000, 800), p) == Window(84, 39, 33, 23)
    assert search_window(state, Window(0, 0, 21, 11), (90, 800), p) == Window(84, 39, 6, 23)
    assert search_window(state, Window(0, 0, 21, 11), (80, 800), p) is None


@pytest.mark.slow
def test_drawn_motion_has_the_models_moments():
    draws, rng = 400, np.random.default_rng(7)
    F, Q = kalman.constant_acceleration(0.5), kalman.white_jerk(0.5, 100.0)
    p = kalman.KalmanParameters(sigma_px=1.0, velocity_sigma=3.0, acceleration_sigma=5.0)
    start = kalman.predict(kalman.initial_state([1.0, 2.0], p), F, Q)
    drawn = np.array(
        [np.hstack([part[-1] for part in draw(start, 2, F, Q, H, R, rng)]) for _ in range(draws)]
    )
    end = kalman.predict(kalman.predict(start, F, Q), F, Q)
    S = H @ end.covariance @ H.T + R
    deviation = np.sqrt(np.append(np.diag(end.covariance), np.diag(S)))
    bias = (drawn.mean(axis=0) - np.append(end.mean, H @ end.mean)) / deviation
    assert np.abs(bias).max() < 4 / np.sqrt(draws)
    spread = [drawn.std(axis=0) / deviation, (drawn[:, 6:] - drawn[:, :2]).std(axis=0)]
    assert np.abs(np.concatenate(spread) - 1).max() < 4 / np.sqrt(2 * draws)


GOOD = kalman.State(np.zeros(6), np.eye(6))
SKEW = np.eye(6) + np.eye(6, k=1) * 0.1
F1, Q1 = kalman.constant_acceleration(DT), kalman.white_jerk(DT, 1.0)


REFUSED = [
    (kalman.predict, (kalman.State(np.zeros(6), SKEW), F1, Q1)),
    (kalman.predict, (kalman.State(np.zeros(6), -np.eye(6)), F1, Q1)),
    (kalman.predict, (kalman.State(np.zeros(2), [[1, 2], [2, 1]]), np.eye(2), np.eye(2))),
    (kalman.predict, (GOOD, 1e37 * F1, Q1)),
    (kalman.predict, (GOOD, F1, Q1 - 1e-3 * np.eye(6))),
    (kalman.update, (GOOD, [0, 0], H, np.diag([1.0, -1.0]))),
    (kalman.update, (kalman.State(np.zeros(6), np.zeros((6, 6))), [0, 0], H, np.zeros((2, 2)))),
    (kalman.update, (kalman.State(np.full(6, 1e308), np.eye(6)), [-1e308, 0], H, R)),
    (kalman.gate, (kalman.innovation(GOOD, [0, 0], H, R), 1.0)),
    (kalman.constant_acceleration, (0.0,)),
    (kalman.constant_acceleration, (1e7,)),
    (kalman.white_jerk, (0.0, 1.0)),
    (kalman.white_jerk, (0.1, -1.0)),
    (run, (GOOD, [], F1, Q1, H, R)),
    (run, (GOOD, [[0, 0]] * 2, [F1] * 3, Q1, H, R)),
    (track, ([0, 0], [[0, 0]] * 2, PX)),
    (track, ([0.1, 0], [[np.nan, 0]] * 2, PX)),
    (track, ([], np.empty((0, 2)), PX)),
    (nees, (kalman.State(np.zeros((1, 2)), np.zeros((1, 2, 2))), np.zeros((1, 2)))),
    (draw, (GOOD, 0, F1, Q1, H, R, np.random.default_rng(0))),
    (kalman.covariance_root, ([[0, 1], [1, 0]], "C", 2)),
    (kalman.covariance_root, ([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]], "C", 3)),
    (kalman.KalmanParameters, (-1,)),
    (kalman.KalmanParameters, (1, 0)),
    (kalman.KalmanParameters, (1, 1, np.inf)),
    (kalman.KalmanParameters, (1, 1, 1, -1)),
    (kalman.KalmanParameters, (1, 1, 1, 1, 1)),
]


@pytest.mark.parametrize(("call", "given"), REFUSED)
def test_bad_input_is_a_value_error(call, given):
    with pytest.raises(ValueError, match="expected"):
        call(*given)


def test_a_root_of_a_covariance_is_the_symmetric_one_of_the_correlations():
    """px beside px/s^2; of rank two."""
    scale = np.array([0.1, 30.0, 4e4])
    correlation = np.array([[1.0, 0.6, 0.6], [0.6, 1.0, 1.0], [0.6, 1.0, 1.0]])
    C = scale[:, None] * correlation * scale
    root = kalman.covariance_root(C, "C", 3)
    np.testing.assert_allclose(root, scale[:, None] * sqrtm(correlation).real, rtol=1e-6)
    np.testing.assert_allclose(root @ root.T, C, rtol=1e-9)
