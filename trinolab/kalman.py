"""The linear Kalman filter over any F, H, Q, R, and the paper's model of a point that moves in an
image (Sect. 4.2).

Eq. 9-15 are three functions, `propagate`, `compare` and `correct`, that take and return plain
arrays in the paper's letters and check nothing. `predict`, `innovation` and `update` check what
they are given, call them, and return the next state as a value. `image_track` runs them over a
sequence, and `following.posefilter` over the 18 numbers of a pose instead of the six of an image
point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.special import chdtri

from .checks import LARGEST, Array, as_array, as_number, check_numbers, frozen

RELATIVE_ATOL = 1e-9  # of a correlation: far above rounding, far below what a mistake makes
TINY = 1 / LARGEST**2  # a smaller variance is zero
MIN_DT_S = 1e-9


def propagate(x: Array, P: Array, F: Array, Q: Array) -> tuple[Array, Array]:
    """Mean and covariance after a step of the motion; nothing is checked (Eq. 9, 10).

    The mean has no noise of its own, though Eq. 9 adds one, and Eq. 10 lacks the transpose.
    """
    return F @ x, F @ P @ F.T + Q


def compare(x: Array, P: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """The innovation Z - H X and its covariance S = H P- H^T + R; nothing is checked (Eq. 13,
    15).
    """
    return z - H @ x, H @ P @ H.T + R


def correct(x: Array, P: Array, r: Array, S: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Mean and covariance after an observation, from what `compare` gives; nothing is checked
    (Eq. 13-15).

    Joseph's form of Eq. 14, P = (I - K H) P- (I - K H)^T + K R K^T, keeps P positive although K is
    rounded. Columns of x and r beside each other are states that share one covariance.
    """
    K = np.linalg.solve(S, H @ P).T  # P- H^T S^-1, since P- and S are symmetric
    rest = np.eye(len(x)) - K @ H
    return x + K @ r, rest @ P @ rest.T + K @ R @ K.T


def as_covariance(value: ArrayLike, name: str, n: int) -> Array:
    """Check a covariance of n numbers, shape (n, n).

    Raises
    ------
    ValueError
        For a matrix that is not symmetric and positive semi-definite to 1e-9 of its own scale.
    """
    C = as_array(value, name, (n, n))
    _, correlation = _correlations(C)
    skewness = np.abs(correlation - correlation.T).max(initial=0)
    if not (np.abs(correlation).max(initial=0) <= 1 + RELATIVE_ATOL and skewness <= RELATIVE_ATOL):
        raise ValueError(
            f"{name}: expected a symmetric, positive semi-definite matrix, got {C.tolist()}"
        )
    lowest = np.linalg.eigvalsh(correlation).min(initial=0)
    if lowest < -RELATIVE_ATOL:
        raise ValueError(
            f"{name}: expected a positive semi-definite matrix, got an eigenvalue of {lowest:.2g} "
            "of its correlations"
        )
    return C


def covariance_root(value: ArrayLike, name: str, n: int) -> Array:
    """A square root A of a covariance, A A^T = C, shape (n, n). Raises ValueError as
    `as_covariance`.

    A is the standard deviations times the symmetric root of the correlations, which is unique. The
    eigenvectors alone would give a root as well, but their signs, and so every draw, would depend
    on how a processor rounds.
    """
    scale, correlation = _correlations(as_covariance(value, name, n))
    values, vectors = np.linalg.eigh(correlation)
    return scale[:, None] * ((vectors * np.sqrt(np.maximum(values, 0))) @ vectors.T)


def _correlations(C: Array) -> tuple[Array, Array]:
    """Standard deviations (n,) and correlations (n, n): px beside px/s^2 then costs no digits."""
    scale = np.sqrt(np.maximum(C.diagonal(), TINY))
    return scale, C / scale[:, None] / scale


def solve_covariance(C: Array, right: Array, name: str) -> Array:
    """C^-1 right by a Cholesky factor; ValueError if C is not positive definite."""
    try:
        if (C.diagonal() < TINY).any():
            raise LinAlgError
        return cho_solve(cho_factor(C, lower=True), right)
    except LinAlgError:
        raise ValueError(
            f"{name}: expected a positive definite covariance, got {C.tolist()}"
        ) from None


@dataclass(frozen=True)
class KalmanParameters:
    """Parameters of the filter of a point in the image; the defaults fit W_ROI's centre in images
    of 1280 x 1024.

    That centre jumps when a part of the target leaves the image: hence a `sigma_px` of several px.

    Attributes
    ----------
    jerk_intensity : float
        q of Q (Eq. 10), the spectral density of the white jerk, px^2/s^5: over a second the
        acceleration wanders by sqrt(q) px/s^2.
    sigma_px : float
        Standard deviation of the observed position in each direction; R = sigma_px^2 I (Eq. 13).
    velocity_sigma, acceleration_sigma : float
        Standard deviations of the unknown first velocity and acceleration, px/s and px/s^2. The
        paper sets them to 0.
    gate_probability : float
        Share of the true observations that the gate lets through, below 1.
    """

    jerk_intensity: float = 2e8
    sigma_px: float = 6.0
    velocity_sigma: float = 1000.0
    acceleration_sigma: float = 3000.0
    gate_probability: float = 0.999

    def __post_init__(self) -> None:
        check_numbers(self, "jerk_intensity", "velocity_sigma", "acceleration_sigma", low=0.0)
        check_numbers(self, "sigma_px", low=0.0, open_low=True)
        check_numbers(self, "gate_probability", low=0.0, high=1 - 1e-12, open_low=True)


class State(NamedTuple):
    """A state estimate: its mean, shape (n,), and the covariance of its error, shape (n, n)."""

    mean: Array
    covariance: Array


class Innovation(NamedTuple):
    """Observation less prediction, shape (m,), NaN if nothing was observed, and its covariance S,
    shape (m, m).
    """

    residual: Array
    covariance: Array


def predict(state: State, F: ArrayLike, Q: ArrayLike) -> State:
    """Carry the state on to the next instant, checked (Eq. 9, 10).

    Parameters
    ----------
    state : State
    F : array_like, shape (n, n)
        Phi, the transition.
    Q : array_like, shape (n, n)
        Covariance of the process noise.

    Raises
    ------
    ValueError
        For a covariance that is not symmetric and positive semi-definite.
    """
    x, P = _checked(state)
    F = as_array(F, "F", (len(x), len(x)))
    Q = as_covariance(Q, "Q", len(x))
    x, P = propagate(x, P, F, Q)
    return State(as_array(x, "F x", x.shape), _symmetric(P, "F P F^T + Q"))


def innovation(state: State, z: ArrayLike | None, H: ArrayLike, R: ArrayLike) -> Innovation:
    """Compare an observation with its prediction, checked (Eq. 13, 15).

    For the parameters and the ways to fail see `update`.
    """
    return _compared(*_checked(state), z, H, R)[0]


def update(state: State, z: ArrayLike | None, H: ArrayLike, R: ArrayLike) -> State:
    """Correct a predicted state by an observation, checked (Eq. 13-15).

    Parameters
    ----------
    state : State
        Predicted to the time of the observation.
    z : array_like, shape (m,), or None
        None, or a NaN in it: nothing was observed, and the prediction stands.
    H : array_like, shape (m, n)
        The observation matrix.
    R : array_like, shape (m, m)
        Covariance of the observation's noise.

    Raises
    ------
    ValueError
        As `predict`; also if S is not positive definite.
    """
    x, P = _checked(state)
    (r, S), H, R = _compared(x, P, z, H, R)
    if np.isnan(r).any():
        return state
    solve_covariance(S, r, "H P H^T + R")  # refuses an S that has no inverse
    x, P = correct(x, P, r, S, H, R)
    return State(as_array(x, "x + K r", x.shape), _symmetric(P, "P"))


def nis(observed: Innovation) -> float:
    """The normalised innovation squared r^T S^-1 r: of mean m if the model holds, NaN if nothing
    was observed.

    Raises ValueError if S is not positive definite.
    """
    residual = as_array(observed.residual, "residual", (None,), finite=False)
    S = as_array(observed.covariance, "covariance", (len(residual), len(residual)))
    if not np.isfinite(residual).all():
        return float("nan")
    return float(residual @ solve_covariance(S, residual, "covariance"))


def gate(observed: Innovation, probability: float) -> bool:
    """Whether an observation is among the `probability` share that lies nearest; a missing one is
    not.

    Raises ValueError as `nis`.
    """
    share = as_number(probability, "probability", 0.0, 1 - 1e-12, open_low=True)
    return bool(nis(observed) <= chdtri(len(observed.residual), 1 - share))


def constant_acceleration(dt: float) -> Array:
    """Phi of X = (x, y, vx, vy, ax, ay) over a time dt, s, shape (6, 6) (Eq. 11).

    Raises ValueError if `dt` is not positive, at least 1e-9 s.
    """
    t = _as_dt(dt)
    return frozen(np.kron([[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]], np.eye(2)))


def observation_matrix() -> Array:
    """H of Z = (x, y), shape (2, 6) (Eq. 12).

    As printed, [1 1 0 0 0 0], it observes x + y alone.
    """
    return frozen(np.eye(2, 6))


def white_jerk(dt: float, intensity: float) -> Array:
    """Q of a point whose acceleration is pushed about by a white jerk, shape (6, 6) (Eq. 10).

    A jerk at a time s before the end moves the end by g(s) = (s^2 / 2, s, 1) in position, velocity
    and acceleration. Jerks of different times are independent, so Q = intensity x the integral of g
    g^T over s from 0 to dt, in each direction. Two steps make the Q of one long step, so that it
    fits uneven frame times.

    Parameters
    ----------
    dt : float
        s, at least 1e-9.
    intensity : float
        q, px^2/s^5.
    """
    t = _as_dt(dt)
    q = as_number(intensity, "intensity", 0.0)
    per_axis = [
        [t**5 / 20, t**4 / 8, t**3 / 6],
        [t**4 / 8, t**3 / 3, t**2 / 2],
        [t**3 / 6, t**2 / 2, t],
    ]
    return frozen(q * np.kron(per_axis, np.eye(2)))


def predict_motion(state: State, dt: float, parameters: KalmanParameters | None = None) -> State:
    """Carry a point's motion on by a time dt, s: `predict` with Phi and Q of the model (Eq. 9-11).

    Raises ValueError as `predict`.
    """
    p = parameters or KalmanParameters()
    return predict(state, constant_acceleration(dt), white_jerk(dt, p.jerk_intensity))


def initial_state(z: ArrayLike, parameters: KalmanParameters | None = None) -> State:
    """The state after a first observation z (2,), with velocity and acceleration zero and unknown.

    The paper's initial covariance, zero, says that they are known to be zero.
    """
    p = parameters or KalmanParameters()
    sigma = np.repeat([p.sigma_px, p.velocity_sigma, p.acceleration_sigma], 2)
    return State(
        frozen(np.append(as_array(z, "z", (2,)), np.zeros(4))),
        as_array(np.diag(sigma**2), "P", (6, 6)),
    )


def _checked(state: State) -> tuple[Array, Array]:
    """Mean and covariance of a state."""
    mean = as_array(state[0], "mean", (None,))
    return mean, as_covariance(state[1], "covariance", len(mean))


def _compared(
    x: Array, P: Array, z: ArrayLike | None, H: ArrayLike, R: ArrayLike
) -> tuple[Innovation, Array, Array]:
    """The innovation of an observation, and H and R, after their checks."""
    H = as_array(H, "H", (None, len(x)))
    R = as_covariance(R, "R", len(H))
    observed = np.full(len(H), np.nan) if z is None else as_array(z, "z", (len(H),), finite=False)
    r, S = compare(x, P, observed, H, R)
    return (
        Innovation(as_array(r, "z - H x", r.shape, finite=False), _symmetric(S, "H P H^T + R")),
        H,
        R,
    )


def _symmetric(C: Array, name: str) -> Array:
    """A computed covariance without the rounding that makes it skew."""
    return as_array((C + C.T) / 2, name, C.shape)


def _as_dt(dt: float) -> float:
    return as_number(dt, "dt", MIN_DT_S, 1e6)
