"""Exercises of chapter 4: the Kalman filter."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker

__all__ = ["filter_number", "kalman_step"]


def _step(
    X, P, Z, dt, Q, R, half=0.5, transposed=True, noisy=True, old=False, sign=1.0, late=False
):
    """`kalman_step` with a line that may be wrong."""
    Phi = np.kron([[1, dt, half * dt**2], [0, 1, dt], [0, 0, 1]], np.eye(2))
    H, identity = np.eye(2, 6), np.eye(6)
    before = P
    predicted = Phi @ X
    P = Phi @ P @ (Phi.T if transposed else Phi) + (0 if late else Q)
    if np.isnan(Z).any():
        return predicted, P + (Q if late else 0)
    S = H @ P @ H.T + (R if noisy else 0)
    K = P @ H.T @ np.linalg.inv(S)
    corrected = predicted + sign * K @ (Z - H @ predicted)
    return corrected, (identity - K @ H) @ (before if old else P) + (Q if late else 0)


filter_number_exercise = FunctionExerciseMaker(
    "04.2", "A filter of one number", "ex-kalman-write", points=4
)


@filter_number_exercise.solution
def filter_number(observations, mean, variance, growth, noise):
    """Filter the observations of one number.

    Before each observation the variance grows. Then the mean moves towards the observation.

    Parameters
    ----------
    observations
        (n,), in their order.
    mean, variance
        What is known before the first one.
    growth
        Q, by which the variance grows before each observation.
    noise
        R, the variance of an observation.

    Returns
    -------
    list
        The n means, one after each observation.
    """
    means = []
    for observed in observations:
        variance = variance + growth
        gain = variance / (variance + noise)
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance
        means.append(mean)
    return means


@filter_number_exercise.cases
def _filter_cases(rng):
    """Each argument has several values, so that none of them can be left out."""
    known = [(0.0, 4.0), (3.0, 4.0), (-1.5, 0.7), (8.0, 25.0), (5.0, 0.0), (2.0, 1.0)]
    rates = [(0.0, 1.0), (0.5, 1.0), (2.0, 0.3), (0.1, 5.0), (0.4, 2.0), (1.0, 0.25)]
    return [
        (rng.normal(5, 2, 6).tolist(), *before, *rate)
        for before, rate in zip(known, rates, strict=True)
    ]


@filter_number_exercise.mistake("4, One number first")
def _variance_never_corrected(observations, mean, variance, growth, noise):
    """The variance is never corrected: after an observation it has to shrink by the factor 1 -
    gain.
    """
    means = []
    for observed in observations:
        variance = variance + growth
        mean = mean + variance / (variance + noise) * (observed - mean)
        means.append(mean)
    return means


@filter_number_exercise.mistake("4, One number first")
def _growth_after(observations, mean, variance, growth, noise):
    """The variance grows after the observation. It has to grow before it, because time has passed
    by then.
    """
    means = []
    for observed in observations:
        gain = variance / (variance + noise)
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance + growth
        means.append(mean)
    return means


@filter_number_exercise.mistake("4, One number first")
def _gain_of_noise(observations, mean, variance, growth, noise):
    """The gain is the noise's share. It has to be the variance's share of the sum."""
    means = []
    for observed in observations:
        variance = variance + growth
        gain = noise / (variance + noise)
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance
        means.append(mean)
    return means


@filter_number_exercise.mistake("4, One number first")
def _no_brackets(observations, mean, variance, growth, noise):
    """The gain lacks its brackets: variance / variance + noise is 1 + noise. Divide by the sum."""
    means = []
    for observed in observations:
        variance = variance + growth
        gain = variance / variance + noise
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance
        means.append(mean)
    return means


@filter_number_exercise.mistake("4, One number first")
def _never_grown(observations, mean, variance, growth, noise):
    """The variance never grows. Before each observation `growth` is added to it."""
    return filter_number(observations, mean, variance, 0.0, noise)


@filter_number_exercise.mistake("4, Exercises")
def _only_last(observations, mean, variance, growth, noise):
    """Only the last mean is returned. All of them are asked for."""
    return filter_number(observations, mean, variance, growth, noise)[-1]


kalman_step_exercise = FunctionExerciseMaker(
    "04.3", "A step of the paper's filter", "ex-kalman-step", points=4
)


@kalman_step_exercise.solution
def kalman_step(X, P, Z, dt, Q, R):
    """Make one step of the paper's filter: predict, then correct (Eq. 9-15, corrected).

    Parameters
    ----------
    X
        (6,), position, velocity and acceleration at the last instant: px, px/s, px/s^2, of x and y
        in turn.
    P
        (6, 6), the covariance of its error.
    Z
        (2,), the position that is observed now, px; NaN if nothing is.
    dt
        The time since the last instant, s.
    Q
        (6, 6), what the motion adds to the covariance in this time.
    R
        (2, 2), the covariance of an observation.

    Returns
    -------
    X, P
        The same at this instant. Where nothing is observed they are the prediction.
    """
    one = [[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]]
    Phi = np.kron(one, np.eye(2))  # Eq. 11
    X = Phi @ X  # Eq. 9
    P = Phi @ P @ Phi.T + Q  # Eq. 10
    if np.isnan(Z).any():
        return X, P
    H = np.eye(2, 6)  # Eq. 12
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)  # Eq. 13
    X = X + K @ (Z - H @ X)  # Eq. 15
    P = (np.eye(6) - K @ H) @ P  # Eq. 14
    return X, P


@kalman_step_exercise.cases
def _step_cases(rng):
    """Covariances in units of about one, so that each of their numbers counts."""
    cases = []
    for k, dt in enumerate((1.0, 0.5, 1.5, 0.8, 1.0, 0.3)):
        X = rng.normal(0, 3, 6)
        A, B, C = rng.normal(0, 1, (6, 6)), rng.normal(0, 0.5, (6, 6)), rng.normal(0, 1, (2, 2))
        Z = np.full(2, np.nan) if k == 4 else X[:2] + rng.normal(0, 4, 2)
        cases.append((X, A @ A.T, Z, dt, B @ B.T, C @ C.T + 0.1 * np.eye(2)))
    return cases


@kalman_step_exercise.mistake("4, From two numbers to six")
def _not_transposed(X, P, Z, dt, Q, R):
    """Eq. 10 is used as printed. A covariance is carried on by Phi from the left and by its
    transpose from the right.
    """
    return _step(X, P, Z, dt, Q, R, transposed=False)


@kalman_step_exercise.mistake("4, From two numbers to six")
def _before_in_place_of_predicted(X, P, Z, dt, Q, R):
    """Eq. 14 is used with the covariance of the last instant, as it is printed. What is corrected
    is the predicted one.
    """
    return _step(X, P, Z, dt, Q, R, old=True)


@kalman_step_exercise.mistake("4, Why this gain?")
def _no_noise_of_observation(X, P, Z, dt, Q, R):
    """R is missing from the covariance of the innovation: you trust each observation wholly."""
    return _step(X, P, Z, dt, Q, R, noisy=False)


@kalman_step_exercise.mistake("4, From two numbers to six")
def _no_half(X, P, Z, dt, Q, R):
    """The half is missing in Eq. 11: an acceleration moves the place by dt^2 / 2."""
    return _step(X, P, Z, dt, Q, R, half=1.0)


@kalman_step_exercise.mistake("4, One number first")
def _innovation_turned_round(X, P, Z, dt, Q, R):
    """The innovation is turned round: it is the observation less the prediction. Yours moves away
    from what is seen.
    """
    return _step(X, P, Z, dt, Q, R, sign=-1.0)


@kalman_step_exercise.mistake("4, Why this gain?")
def _noise_at_the_end(X, P, Z, dt, Q, R):
    """Q is added after the correction. Time passes before the observation, and Q belongs to the
    prediction.
    """
    return _step(X, P, Z, dt, Q, R, late=True)


@kalman_step_exercise.mistake("4, The algorithm")
def _never_predicted(X, P, Z, dt, Q, R):
    """The state is not carried on by Phi. Each step begins with a prediction."""
    return _step(X, P, Z, 0.0, Q, R)


@kalman_step_exercise.mistake("4, The loop of Sect. 4.2")
def _nothing_seen_is_corrected(X, P, Z, dt, Q, R):
    """All is right, but where nothing is observed: a NaN in Z leaves no number standing. The
    prediction has to be returned as it is.
    """
    if np.isnan(Z).any():
        return np.full(6, np.nan), _step(X, P, np.zeros(2), dt, Q, R)[1]
    return kalman_step(X, P, Z, dt, Q, R)


EXERCISES = (
    filter_number_exercise.made(),
    kalman_step_exercise.made(),
)
