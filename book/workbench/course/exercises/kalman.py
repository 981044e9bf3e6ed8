"""Exercises of chapter 4: the Kalman filter."""

from __future__ import annotations

import numpy as np

from ..exercise import Asked, FunctionExercise, Mistake, ValueExercise


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


def _filter_cases(rng):
    return [
        (rng.normal(5, 2, 6).tolist(), 0.0, 4.0, growth, noise)
        for growth, noise in ((0.0, 1.0), (0.5, 1.0), (2.0, 0.3), (0.1, 5.0))
    ]


def _variance_never_corrected(observations, mean, variance, growth, noise):
    means = []
    for observed in observations:
        variance = variance + growth
        mean = mean + variance / (variance + noise) * (observed - mean)
        means.append(mean)
    return means


def _growth_after(observations, mean, variance, growth, noise):
    means = []
    for observed in observations:
        gain = variance / (variance + noise)
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance + growth
        means.append(mean)
    return means


def _gain_of_noise(observations, mean, variance, growth, noise):
    means = []
    for observed in observations:
        variance = variance + growth
        gain = noise / (variance + noise)
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance
        means.append(mean)
    return means


def _no_brackets(observations, mean, variance, growth, noise):
    means = []
    for observed in observations:
        variance = variance + growth
        gain = variance / variance + noise
        mean = mean + gain * (observed - mean)
        variance = (1 - gain) * variance
        means.append(mean)
    return means


def _never_grown(observations, mean, variance, growth, noise):
    return filter_number(observations, mean, variance, 0.0, noise)


def _only_last(observations, mean, variance, growth, noise):
    return filter_number(observations, mean, variance, growth, noise)[-1]


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


def _step_cases(rng):
    """Covariances in units of about one, so that each of their numbers counts."""
    cases = []
    for k, dt in enumerate((1.0, 0.5, 1.5, 0.8, 1.0, 0.3)):
        X = rng.normal(0, 3, 6)
        A, B, C = rng.normal(0, 1, (6, 6)), rng.normal(0, 0.5, (6, 6)), rng.normal(0, 1, (2, 2))
        Z = np.full(2, np.nan) if k == 4 else X[:2] + rng.normal(0, 4, 2)
        cases.append((X, A @ A.T, Z, dt, B @ B.T, C @ C.T + 0.1 * np.eye(2)))
    return cases


def _step(
    X, P, Z, dt, Q, R, half=0.5, transposed=True, noisy=True, old=False, sign=1.0, late=False
):
    """`kalman_step` with a line that may be wrong."""
    Phi = np.kron([[1, dt, half * dt**2], [0, 1, dt], [0, 0, 1]], np.eye(2))
    H, one = np.eye(2, 6), np.eye(6)
    before = P
    predicted = Phi @ X
    P = Phi @ P @ (Phi.T if transposed else Phi) + (0 if late else Q)
    if np.isnan(Z).any():
        return predicted, P + (Q if late else 0)
    S = H @ P @ H.T + (R if noisy else 0)
    K = P @ H.T @ np.linalg.inv(S)
    corrected = predicted + sign * K @ (Z - H @ predicted)
    return corrected, (one - K @ H) @ (before if old else P) + (Q if late else 0)


def _not_transposed(X, P, Z, dt, Q, R):
    return _step(X, P, Z, dt, Q, R, transposed=False)


def _before_in_place_of_predicted(X, P, Z, dt, Q, R):
    return _step(X, P, Z, dt, Q, R, old=True)


def _no_noise_of_observation(X, P, Z, dt, Q, R):
    return _step(X, P, Z, dt, Q, R, noisy=False)


def _no_half(X, P, Z, dt, Q, R):
    return _step(X, P, Z, dt, Q, R, half=1.0)


def _innovation_turned_round(X, P, Z, dt, Q, R):
    return _step(X, P, Z, dt, Q, R, sign=-1.0)


def _noise_at_the_end(X, P, Z, dt, Q, R):
    return _step(X, P, Z, dt, Q, R, late=True)


def _never_predicted(X, P, Z, dt, Q, R):
    return _step(X, P, Z, 0.0, Q, R)


def _nothing_seen_is_corrected(X, P, Z, dt, Q, R):
    if np.isnan(Z).any():
        return np.full(6, np.nan), _step(X, P, np.zeros(2), dt, Q, R)[1]
    return kalman_step(X, P, Z, dt, Q, R)


_FACTORS = ("divided by c", "the same", "multiplied by c")

EXERCISES = (
    ValueExercise(
        "04.1",
        "pencil",
        "A second observation",
        "ex-kalman-gain",
        2,
        (
            Mistake(
                "The gain is the noise's share. It has to be the guess's share of the innovation's "
                "variance: a certain guess moves little.",
                "4, One number first",
                {"gain": 1 / 1.8},
            ),
            Mistake(
                "This is the variance before the second observation. An observation makes it smaller.",
                "4, One number first",
                {"variance": 0.8},
            ),
            Mistake(
                "You have started from the first guess again, and have forgotten the first "
                "observation.",
                "4, One number first",
                {"mean": 6.8},
            ),
        ),
        {
            "gain": Asked(0.8 / 1.8, within=0.005),
            "mean": Asked(6 + 2 * 0.8 / 1.8, within=0.01),
            "variance": Asked(0.8 / 1.8, within=0.005),
        },
    ),
    FunctionExercise(
        "04.2",
        "write",
        "A filter of one number",
        "ex-kalman-write",
        4,
        (
            Mistake(
                "The variance is never corrected: after an observation it has to shrink by the "
                "factor 1 - gain.",
                "4, One number first",
                _variance_never_corrected,
            ),
            Mistake(
                "The variance grows after the observation. It has to grow before it, because time "
                "has passed by then.",
                "4, One number first",
                _growth_after,
            ),
            Mistake(
                "The gain is the noise's share. It has to be the variance's share of the sum.",
                "4, One number first",
                _gain_of_noise,
            ),
            Mistake(
                "The gain lacks its brackets: variance / variance + noise is 1 + noise. Divide by the "
                "sum.",
                "4, One number first",
                _no_brackets,
            ),
            Mistake(
                "The variance never grows. Before each observation `growth` is added to it.",
                "4, One number first",
                _never_grown,
            ),
            Mistake(
                "Only the last mean is returned. All of them are asked for.",
                "4, Exercises",
                _only_last,
            ),
        ),
        filter_number,
        _filter_cases,
    ),
    FunctionExercise(
        "04.3",
        "write",
        "A step of the paper's filter",
        "ex-kalman-step",
        4,
        (
            Mistake(
                "Eq. 10 is used as printed. A covariance is carried on by Phi from the left and by "
                "its transpose from the right.",
                "4, From two numbers to six",
                _not_transposed,
            ),
            Mistake(
                "Eq. 14 is used with the covariance of the last instant, as it is printed. What is "
                "corrected is the predicted one.",
                "4, From two numbers to six",
                _before_in_place_of_predicted,
            ),
            Mistake(
                "R is missing from the covariance of the innovation: you trust each observation "
                "wholly.",
                "4, Why this gain?",
                _no_noise_of_observation,
            ),
            Mistake(
                "The half is missing in Eq. 11: an acceleration moves the place by dt^2 / 2.",
                "4, From two numbers to six",
                _no_half,
            ),
            Mistake(
                "The innovation is turned round: it is the observation less the prediction. Yours "
                "moves away from what is seen.",
                "4, One number first",
                _innovation_turned_round,
            ),
            Mistake(
                "Q is added after the correction. Time passes before the observation, and Q belongs "
                "to the prediction.",
                "4, Why this gain?",
                _noise_at_the_end,
            ),
            Mistake(
                "The state is not carried on by Phi. Each step begins with a prediction.",
                "4, The algorithm",
                _never_predicted,
            ),
            Mistake(
                "All is right, but where nothing is observed: a NaN in Z leaves no number standing. "
                "The prediction has to be returned as it is.",
                "4, The loop of Sect. 4.2",
                _nothing_seen_is_corrected,
            ),
        ),
        kalman_step,
        _step_cases,
        1e-8,
    ),
    ValueExercise(
        "04.4",
        "predict",
        "Why the ratio?",
        "ex-kalman-ratio",
        3,
        (
            Mistake(
                "The gain is a share, P- by S, and both get the factor c.",
                "4, What happens if q and sigma are others?",
                {"gain": "multiplied by c"},
            ),
            Mistake(
                "S^-1 gets the factor 1 / c, but P- stands before it in K with the factor c.",
                "4, Why this gain?",
                {"gain": "divided by c"},
            ),
            Mistake(
                "A prediction is made of the last mean, and a mean of predictions, observations and "
                "gains. The scale of the covariances occurs in none of them.",
                "4, The algorithm",
                {"predictions": "multiplied by c"},
            ),
            Mistake(
                "The innovations stay, and S, by which they are divided, gets the factor c.",
                "4, Is a filter honest?",
                {"nis": "multiplied by c"},
            ),
            Mistake(
                "The innovations stay, but NIS measures them in units of their own standard "
                "deviation, and that grows.",
                "4, Is a filter honest?",
                {"nis": "the same"},
            ),
            Mistake(
                "NIS is a square, and c is the factor of variances. There is no root to take.",
                "4, Is a filter honest?",
                {"repair": 2.0},
            ),
            Mistake(
                "A filter with a NIS of 8 is too sure of itself. Its variances have to grow.",
                "4, Is a filter honest?",
                {"repair": 0.25},
            ),
            Mistake(
                "This is a quarter of 3.05, the value that holds for the same observations. But in "
                "the chapter the window has grown with the gate, and other markers at the rod's "
                "edge are found in it. Run it, and read the value from the table.",
                "4, Honest on other data?",
                {"ccd1": 3.05 / 4},
            ),
        ),
        {
            "gain": Asked("the same", choices=_FACTORS),
            "predictions": Asked("the same", choices=_FACTORS),
            "nis": Asked("divided by c", choices=_FACTORS),
            "repair": Asked(4.0, within=0.01),
            "ccd1": Asked(0.62, within=0.03),
        },
    ),
    ValueExercise(
        "04.5",
        "project",
        "The whole recording",
        "ex-kalman-whole",
        5,
        (
            Mistake(
                "These are the means of the chapter's single second of motion. Read the recording of "
                "10 s, and follow all of it.",
                "4, Honest on other data?",
                {"ccd1": 3.05, "ccd3": 1.76},
            ),
            Mistake(
                "These are medians. The band is that of the mean: a chi-square is skew, and a few "
                "violent moments make most of it.",
                "4, Is a filter honest?",
                {"ccd1": 0.195, "ccd2": 0.284, "ccd3": 0.353},
            ),
            Mistake(
                "You have divided by the two coordinates once more. NIS is the sum over both, and 2 is "
                "right.",
                "4, Is a filter honest?",
                {"ccd1": 0.783, "ccd2": 1.004, "ccd3": 1.221},
            ),
            Mistake(
                "This is the count for a wider band. With more innovations the band gets narrower: "
                "nis_band has to be told their number.",
                "4, Is a filter honest?",
                {"inside": 3.0},
            ),
            Mistake(
                "One of them does lie in its band. Ask each camera by itself, with the number of its "
                "own innovations.",
                "4, Honest on other data?",
                {"inside": 0.0},
            ),
        ),
        {
            "ccd1": Asked(1.565, within=0.06),
            "ccd2": Asked(2.008, within=0.06),
            "ccd3": Asked(2.442, within=0.06),
            "inside": Asked(1.0, within=0.1),
        },
    ),
)
