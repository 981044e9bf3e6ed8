"""The linear Kalman filter over any F, H, Q, R, and the paper's model of a point that moves in an image (Sect. 4.2).

The state is a value: `predict` and `update` take one and return the next. A covariance is computed as a root times its
transpose, which rounding cannot turn negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.special import chdtri

from .checks import Array, as_array, as_number, frozen

RELATIVE_ATOL = 1e-9  # of a correlation: far above rounding, far below what a mistake makes
TINY = 1e-290  # a smaller variance is zero: its square root times another one is no precise number any more
MIN_DT_S = 1e-9  # its fifth power is still a number


def covariance_root(value: ArrayLike, name: str, n: int) -> Array:
    """A square root A of a covariance, A A^T = C, after the check that C is one.

    Rows and columns are scaled to correlations first, so that px beside px/s^2 costs no digits.

    Parameters
    ----------
    value : array_like, shape (n, n)
    name : str
        For the message.
    n : int

    Returns
    -------
    ndarray, shape (n, n)

    Raises
    ------
    ValueError
        For a wrong shape, NaN or infinity, or a matrix that is not symmetric and positive semi-definite to 1e-9 of its
        own scale.
    """
    C = as_array(value, name, (n, n))
    scale = np.sqrt(np.maximum(C.diagonal(), TINY))
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is above 1, or NaN
        correlation = C / scale[:, None] / scale
        skewness = np.abs(correlation - correlation.T).max(initial=0)
    if not (np.abs(correlation).max(initial=0) <= 1 + RELATIVE_ATOL and skewness <= RELATIVE_ATOL):
        raise ValueError(f"{name}: expected a symmetric, positive semi-definite matrix, got {C.tolist()}")
    values, vectors = np.linalg.eigh(correlation)
    if values.min(initial=0) < -RELATIVE_ATOL:
        raise ValueError(f"{name}: expected a positive semi-definite matrix, got an eigenvalue of {values.min():.2g} "
                         "of its correlations")
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0))


def solve_covariance(C: Array, right: Array, name: str) -> Array:
    """C^-1 right by a Cholesky factor; ValueError if C is not positive definite, or the result overflows."""
    try:
        solution = cho_solve(cho_factor(C, lower=True), right)
    except (LinAlgError, ValueError):  # SciPy: not positive definite; not finite
        raise ValueError(f"{name}: expected a positive definite covariance, got {np.asarray(C).tolist()}") from None
    if not np.isfinite(solution).all():
        raise ValueError(f"{name}: expected a covariance that can be inverted, got {np.asarray(C).tolist()}")
    return solution


def gram(root: Array, name: str) -> Array:
    """The covariance of a root (n, k), read-only; symmetric, and not negative by rounding.

    Raises ValueError if it overflows.
    """
    with np.errstate(all="ignore"):
        C = root @ root.T
    if not np.isfinite(C).all():
        raise ValueError(f"{name}: expected numbers that can be squared, got an overflow")
    return frozen((C + C.T) / 2)


@dataclass(frozen=True)
class KalmanParameters:
    """Parameters of the filter of a point in the image; the defaults fit W_ROI's centre in images of 1280 x 1024.

    That centre jumps when a part of the target leaves the image: hence a `sigma_px` of several px.

    Attributes
    ----------
    jerk_intensity : float
        q of Q (Eq. 10), the spectral density of the white jerk, px^2/s^5: over a second the acceleration wanders by
        sqrt(q) px/s^2.
    sigma_px : float
        Standard deviation of the observed position in each direction; R = sigma_px^2 I (Eq. 13).
    velocity_sigma, acceleration_sigma : float
        Standard deviations of the unknown first velocity and acceleration, px/s and px/s^2. The paper sets them to 0.
    gate_probability : float
        Share of the true observations that the gate lets through, below 1.

    Raises
    ------
    ValueError
        Names the field that is no number or out of range.
    """

    jerk_intensity: float = 2e8
    sigma_px: float = 6.0
    velocity_sigma: float = 1000.0
    acceleration_sigma: float = 3000.0
    gate_probability: float = 0.999

    def __post_init__(self) -> None:
        as_number(self.jerk_intensity, "jerk_intensity", 0.0)
        as_number(self.sigma_px, "sigma_px", 0.0, open_low=True)
        as_number(self.velocity_sigma, "velocity_sigma", 0.0)
        as_number(self.acceleration_sigma, "acceleration_sigma", 0.0)
        as_number(self.gate_probability, "gate_probability", 0.0, 1 - 1e-12, open_low=True)


class State(NamedTuple):
    """What is known of the state: its mean, shape (n,), and the covariance of its error, shape (n, n)."""

    mean: Array
    covariance: Array


class Innovation(NamedTuple):
    """Observation less prediction, shape (m,), NaN if nothing was observed, and its covariance S, shape (m, m)."""

    residual: Array
    covariance: Array


def predict(state: State, F: ArrayLike, Q: ArrayLike) -> State:
    """Carry the state on to the next instant (Eq. 9, 10).

    The mean has no noise of its own, though Eq. 9 adds one; P- = F P F^T + Q, where Eq. 10 lacks the transpose.

    Parameters
    ----------
    state : State
    F : array_like, shape (n, n)
        Phi, the transition.
    Q : array_like, shape (n, n)
        Covariance of what disturbs the motion in between.

    Raises
    ------
    ValueError
        For a wrong shape, NaN or infinity, a covariance that is not symmetric and positive semi-definite, or a result
        that overflows.
    """
    mean, root = _checked(state)
    F = as_array(F, "F", (len(mean), len(mean)))
    with np.errstate(all="ignore"):  # an overflow shows in the result
        mean, root = F @ mean, np.hstack([F @ root, covariance_root(Q, "Q", len(mean))])
    return State(as_array(mean, "F x", mean.shape), gram(root, "F P F^T + Q"))


def innovation(state: State, z: ArrayLike | None, H: ArrayLike, R: ArrayLike) -> Innovation:
    """Compare an observation with its prediction: Z - H X and S = H P H^T + R (Eq. 13, 15).

    For the parameters and the ways to fail see `update`.
    """
    mean, root = _checked(state)
    H = as_array(H, "H", (None, len(mean)))
    observed = np.full(len(H), np.nan) if z is None else as_array(z, "z", (len(H),), finite=False)
    if np.isinf(observed).any():
        raise ValueError("z: expected finite numbers, or NaN if nothing was observed, got infinity")
    with np.errstate(all="ignore"):
        S = gram(np.hstack([H @ root, covariance_root(R, "R", len(H))]), "H P H^T + R")
        residual = observed - as_array(H @ mean, "H x", (len(H),))
    return Innovation(frozen(residual), S)


def update(state: State, z: ArrayLike | None, H: ArrayLike, R: ArrayLike) -> State:
    """Correct a predicted state by an observation (Eq. 13-15).

    The gain K = P- H^T S^-1 is solved for by a Cholesky factor of S, and Eq. 14 is taken in Joseph's form
    P = (I - K H) P- (I - K H)^T + K R K^T, which is a covariance whatever rounding did to K.

    Parameters
    ----------
    state : State
        Predicted to the time of the observation.
    z : array_like, shape (m,), or None
        None, or a NaN in it: nothing was observed, and the prediction stands.
    H : array_like, shape (m, n)
        What of the state is observed.
    R : array_like, shape (m, m)
        Covariance of the observation's noise.

    Raises
    ------
    ValueError
        As `predict`; also if S is not positive definite, or `z` is infinite.
    """
    mean, root = _checked(state)
    residual, S = innovation(state, z, H, R)
    if np.isnan(residual).any():
        return state
    H = np.asarray(H, dtype=float)
    with np.errstate(all="ignore"):
        K = solve_covariance(S, H @ root @ root.T, "H P H^T + R").T
        mean = mean + K @ residual
        root = np.hstack([root - K @ (H @ root), K @ covariance_root(R, "R", len(H))])
    return State(as_array(mean, "x + K r", mean.shape), gram(root, "P"))


def nis(observed: Innovation) -> float:
    """The normalised innovation squared r^T S^-1 r: of mean m if the model holds, NaN if nothing was observed.

    Raises ValueError if S has another shape or is not positive definite.
    """
    residual = as_array(observed.residual, "residual", (None,), finite=False)
    S = as_array(observed.covariance, "covariance", (len(residual), len(residual)))
    if not np.isfinite(residual).all():
        return float("nan")
    with np.errstate(all="ignore"):
        return as_number(residual @ solve_covariance(S, residual, "covariance"), "r^T S^-1 r")


def gate(observed: Innovation, probability: float) -> bool:
    """Whether an observation is among the `probability` share that lies nearest; a missing one is not.

    Raises ValueError if the probability is not in (0, 1), or as `nis`.
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

    A jerk at a time s before the end moves the end by g(s) = (s^2 / 2, s, 1) in position, velocity and acceleration.
    Jerks of different times are independent, so Q = intensity x the integral of g g^T over s from 0 to dt, in each
    direction. Two steps make the Q of one long step, so that it fits uneven frame times.

    Parameters
    ----------
    dt : float
        s, positive.
    intensity : float
        q, px^2/s^5.

    Raises
    ------
    ValueError
        If `dt` is not positive, at least 1e-9 s, or the intensity negative.
    """
    t, q = _as_dt(dt), as_number(intensity, "intensity", 0.0, 1e100)
    one = [[t**5 / 20, t**4 / 8, t**3 / 6], [t**4 / 8, t**3 / 3, t**2 / 2], [t**3 / 6, t**2 / 2, t]]
    return frozen(q * np.kron(one, np.eye(2)))


def predict_motion(state: State, dt: float, parameters: KalmanParameters | None = None) -> State:
    """Carry a point's motion on by a time dt, s: `predict` with Phi and Q of the model (Eq. 9-11).

    Raises ValueError as `predict`, `constant_acceleration` and `white_jerk`.
    """
    p = parameters or KalmanParameters()
    return predict(state, constant_acceleration(dt), white_jerk(dt, p.jerk_intensity))


def initial_state(z: ArrayLike, parameters: KalmanParameters | None = None) -> State:
    """The state after a first observation z (2,), with velocity and acceleration zero and unknown.

    The paper's initial covariance, zero, says that they are known to be zero.

    Raises ValueError if `z` is not two finite numbers.
    """
    p = parameters or KalmanParameters()
    sigma = np.repeat([p.sigma_px, p.velocity_sigma, p.acceleration_sigma], 2)
    return State(frozen(np.append(as_array(z, "z", (2,)), np.zeros(4))), gram(np.diag(sigma), "parameters"))


def _checked(state: State) -> tuple[Array, Array]:
    """Mean and root of a state's covariance."""
    mean = as_array(state[0], "mean", (None,))
    return mean, covariance_root(state[1], "covariance", len(mean))


def _as_dt(dt: float) -> float:
    return as_number(dt, "dt", MIN_DT_S, 1e6)
