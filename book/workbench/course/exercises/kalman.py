"""Exercises of chapter 4: the Kalman filter."""

from __future__ import annotations

import numpy as np

from ..exercise import FunctionExerciseMaker


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
    "04.2", "A filter that may be blind", "ex-kalman-write", points=4
)


def _filtered(observations, mean, variance, growth, noise, slip):  # noqa: C901
    """`filter_number` with one thing wrong."""
    means = []
    for observed in observations:
        before = variance
        if slip not in ("never", "after"):
            variance = variance + growth
        expected = noise if slip == "noise gate" else variance + noise
        apart = (observed - mean) ** 2
        limit = 3 * expected if slip == "square" else 9 * expected
        near = not np.isnan(observed) if slip == "no gate" else apart <= limit
        if slip == "spoilt" and np.isnan(observed):
            near = True
        if near:
            gain = variance / (variance + noise)
            if slip == "share":
                gain = noise / (variance + noise)
            if slip == "brackets":
                gain = 1 + noise
            mean = mean + gain * (observed - mean)
            if slip != "uncorrected":
                variance = (1 - gain) * variance
        elif slip == "waits":
            variance = before
        if slip == "after":
            variance = variance + growth
        if near or slip != "left out":
            means.append(mean)
    return means


@filter_number_exercise.solution
def filter_number(observations, mean, variance, growth, noise):
    """Filter the observations of one number; some are missing, and some are wrong.

    Before each observation the variance grows. Then the mean moves towards the observation, unless
    there is none, or it lies more than three standard deviations of the innovation away.

    Parameters
    ----------
    observations
        (n,), in their order; NaN where nothing was seen.
    mean, variance
        What is known before the first one.
    growth
        Q, by which the variance grows before each observation, whether it is seen or not.
    noise
        R, the variance of an observation.

    Returns
    -------
    list
        The n means, one after each observation. Where an observation is missing or refused, the
        prediction stands.
    """
    means = []
    for observed in observations:
        variance = variance + growth
        expected = variance + noise
        innovation = observed - mean
        if innovation**2 <= 9 * expected:  # never with a NaN
            gain = variance / expected
            mean = mean + gain * innovation
            variance = (1 - gain) * variance
        means.append(mean)
    return means


@filter_number_exercise.cases
def _filter_cases(rng):
    """Each argument has several values, so that none of them can be left out; some observations lie
    just inside the gate, and some just outside.
    """
    known = [(0.0, 4.0), (3.0, 0.2), (6.0, 0.0), (8.0, 25.0)]
    rates = [(0.0, 1.0), (0.5, 1.0), (0.4, 2.0), (0.1, 5.0)]
    cases = []
    for k, (before, rate) in enumerate(zip(known, rates, strict=True)):
        observations = rng.normal(5, 1, 8)
        observations[[k, k + 2]] = np.nan
        observations[5] = 30.0
        cases.append((observations.tolist(), *before, *rate))
    inside, outside = np.sqrt([8.5 * 5.0, 9.5 * 5.0])  # the innovation's variance is 5
    cases.append(([float(inside), np.nan, 2.0], 0.0, 3.0, 1.0, 1.0))
    cases.append(([-float(outside), np.nan, np.nan, 5.0, 2.0], 0.0, 0.5, 0.5, 4.0))
    return cases


def _slips(sentence, read, slip):
    def gives(observations, mean, variance, growth, noise):
        return _filtered(observations, mean, variance, growth, noise, slip)

    filter_number_exercise.known_mistake(sentence, read, gives)


for _sentence, _slip in (
    (
        "The variance is never corrected: after an observation it has to shrink by the factor 1 - "
        "gain.",
        "uncorrected",
    ),
    (
        "The variance grows after the observation. It has to grow before it, because time has "
        "passed by then.",
        "after",
    ),
    ("The gain is the noise's share. It has to be the variance's share of the sum.", "share"),
    (
        "The gain lacks its brackets: variance / variance + noise is 1 + noise. Divide by the sum.",
        "brackets",
    ),
    ("The variance never grows. Before each observation `growth` is added to it.", "never"),
    (
        "The variance does not grow while nothing is seen, or while what is seen is refused. Time "
        "passes all the same, and the next gate has to be wider.",
        "waits",
    ),
    ("A missing observation makes every later mean NaN. The prediction stands there.", "spoilt"),
    (
        "Every observation is believed. One that lies more than three standard deviations of its "
        "innovation away is to be refused.",
        "no gate",
    ),
):
    _slips(_sentence, "4, One number first", _slip)
for _sentence, _slip in (
    (
        "The gate is made of the noise alone. The innovation scatters by the prediction's variance "
        "as well.",
        "noise gate",
    ),
    (
        "The square of the innovation is held against 3 variances. Three standard deviations are 9 "
        "variances.",
        "square",
    ),
    (
        "Means are left out where an observation is missing or refused. Each instant has a mean: "
        "there it is the prediction.",
        "left out",
    ),
):
    _slips(_sentence, "4, Exercises", _slip)


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


search_window_exercise = FunctionExerciseMaker(
    "04.6", "A window that stays small", "ex-kalman-repair", points=3
)


def _windowed(X, P, dt, Q, frames, carry, often=True):
    """`search_window` with another way to carry P on."""
    Phi = np.array([[1, dt], [0, 1]])
    for k in range(frames):
        X = Phi @ X
        P = carry(Phi, P) + (Q if often or k == 0 else 0)
    return X[0], 3 * np.sqrt(P[0, 0])


@search_window_exercise.solution
def search_window(X, P, dt, Q, frames):
    """Where a target is looked for when it was not seen in some frames.

    Parameters
    ----------
    X
        (2,), its place and its speed when it was seen last, px and px/s.
    P
        (2, 2), the covariance of their error.
    dt
        The time from one frame to the next, s.
    Q
        (2, 2), what the motion adds to the covariance in this time.
    frames
        How many frames have passed, 1 or more.

    Returns
    -------
    place
        Where it is expected, px.
    half_width
        Of the window, three standard deviations of the place, px.
    """
    Phi = np.array([[1, dt], [0, 1]])
    for _ in range(frames):
        X = Phi @ X
        P = Phi @ P @ Phi.T + Q
    return X[0], 3 * np.sqrt(P[0, 0])


@search_window_exercise.broken
def _covariance_stays(X, P, dt, Q, frames):
    """The covariance is not carried on: what is not known of the speed never gets into the place."""
    Phi = np.array([[1, dt], [0, 1]])
    for _ in range(frames):
        X = Phi @ X
        P = P + Q
    return X[0], 3 * np.sqrt(P[0, 0])


@search_window_exercise.cases
def _window_cases(rng):
    noise = np.array([[0.04, 0.5], [0.5, 30.0]])
    known = np.array([[0.25, 3.0], [3.0, 3600.0]])
    cases = [(np.array([320.0, 90.0]), known, 1 / 30, noise, frames) for frames in (1, 2, 6, 15)]
    for frames in (1, 4):
        A, C = rng.normal(0, 1, (2, 2, 2))
        cases.append((rng.normal(0, 5, 2), A @ A.T, 0.7, C @ C.T, frames))
    return cases


@search_window_exercise.mistake("4, From two numbers to six")
def _transpose_left(X, P, dt, Q, frames):
    """To the right of P the transpose of Phi is missing, or Phi stands there as it is. A covariance is
    carried on by Phi from the left and by its transpose from the right.
    """
    return _windowed(X, P, dt, Q, frames, lambda Phi, P: Phi @ P)


@search_window_exercise.mistake("4, Where does Q come from?")
def _noise_once(X, P, dt, Q, frames):
    """Q is added once. It belongs to the time of one frame, and has to be added in each."""
    return _windowed(X, P, dt, Q, frames, lambda Phi, P: Phi @ P @ Phi.T, often=False)


@search_window_exercise.mistake("4, Two numbers: a speed that nobody measures")
def _times_frames(X, P, dt, Q, frames):
    """The window is made wider by a factor of the number of frames. That cures the picture and not the
    cause: how fast it has to grow follows from what is not known of the speed.
    """
    place, half_width = _covariance_stays(X, P, dt, Q, frames)
    return place, half_width * frames


@search_window_exercise.mistake("4, Two numbers: a speed that nobody measures")
def _speed_added(X, P, dt, Q, frames):
    """The way that the target goes is added to the window. That way is in the place already; what is
    missing is how badly the speed is known.
    """
    place, half_width = _covariance_stays(X, P, dt, Q, frames)
    return place, half_width + abs(X[1]) * dt * frames


EXERCISES = (
    filter_number_exercise.made(),
    kalman_step_exercise.made(),
    search_window_exercise.made(),
)
