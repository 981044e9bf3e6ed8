"""The Kalman filter over a sequence: any model by `run`, a point in an image by `track`, and its
next window.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from .checks import Array, as_array, as_number, as_points, as_rng, frozen
from .kalman import (
    MIN_DT_S,
    KalmanParameters,
    State,
    constant_acceleration,
    covariance_root,
    gate,
    initial_state,
    innovation,
    nis,
    observation_matrix,
    predict,
    solve_covariance,
    update,
    white_jerk,
)
from .window import Window

Step = tuple[State, State, float, bool]


class Track(NamedTuple):
    """A filter's way through k observations of a state of n numbers.

    Attributes
    ----------
    predicted, updated : State
        Before and after the observation of each instant: means (k, n), covariances (k, n, n).
    nis : ndarray, shape (k,)
        Normalised innovation squared; NaN where nothing was observed.
    used : ndarray of bool, shape (k,)
        Which observations were there and passed the gate.
    """

    predicted: State
    updated: State
    nis: Array
    used: np.ndarray


def run(
    start: State,
    measurements: Sequence[ArrayLike | None] | Array,
    F: ArrayLike,
    Q: ArrayLike,
    H: ArrayLike,
    R: ArrayLike,
    gate_probability: float | None = None,
) -> Track:
    """Filter a sequence: at each instant predict, ask the gate, update (Eq. 9-15).

    Parameters
    ----------
    start : State
        At the instant before the first measurement.
    measurements : sequence of k array_like, shape (m,)
        None, or a row with a NaN, where nothing was observed.
    F, Q : array_like, shape (n, n) or (k, n, n)
        The same for all instants, or one each.
    H, R : array_like, shapes (m, n) and (m, m)
    gate_probability : float, optional
        An observation outside the gate counts as missing; without it all are used.

    Raises
    ------
    ValueError
        As `kalman.update`, or if there is no measurement.
    """
    if len(measurements) == 0:
        raise ValueError("measurements: expected at least one, got none")
    return _stacked(_steps(start, measurements, F, Q, H, R, gate_probability))


def track(
    times_s: ArrayLike,
    uv: ArrayLike,
    parameters: KalmanParameters | None = None,
    gated: bool = True,
) -> Track:
    """Follow a point of an image by the paper's model, at even or uneven times (Eq. 7-15).

    The first point seen starts the filter: there the prediction is the start itself, with a NIS of
    NaN. All values before it are NaN.

    Parameters
    ----------
    times_s : array_like, shape (k,)
        s, increasing.
    uv : array_like, shape (k, 2)
        px; a row with a NaN: not seen.
    parameters : KalmanParameters, optional
    gated : bool
        Leave out what lies outside the gate.

    Raises
    ------
    ValueError
        If the times do not increase, or there is no instant.
    """
    p = parameters or KalmanParameters()
    points = as_points(uv, "uv", 2)
    times = as_array(times_s, "times_s", (len(points),))
    if len(points) == 0 or not (np.diff(times) >= MIN_DT_S).all():
        raise ValueError("times_s, uv: expected increasing times and points that are finite or NaN")
    seen = ~np.isnan(points).any(axis=1)
    first = int(seen.argmax()) if seen.any() else len(points)
    nothing = State(np.full(6, np.nan), np.full((6, 6), np.nan))
    steps = [(nothing, nothing, np.nan, False)] * first
    if seen.any():
        start = initial_state(points[first], p)
        dts = np.diff(times[first:])
        steps += [
            (start, start, np.nan, True),
            *_steps(
                start,
                points[first + 1 :],
                [constant_acceleration(dt) for dt in dts],
                [white_jerk(dt, p.jerk_intensity) for dt in dts],
                observation_matrix(),
                p.sigma_px**2 * np.eye(2),
                p.gate_probability if gated else None,
            ),
        ]
    return _stacked(steps)


def search_window(
    state: State, window: Window, size: tuple[int, int], parameters: KalmanParameters | None = None
) -> Window | None:
    """The window to search for a target next: its last window, moved to the predicted position and
    grown by the gate.

    Parameters
    ----------
    state : State
        Predicted; its first two numbers are the position of the window's centre, px.
    window : Window
        Of the target when it was seen last.
    size : (int, int)
        Width and height of the image.
    parameters : KalmanParameters, optional

    Returns
    -------
    Window or None
        Inside the image; None if the target is expected outside.
    """
    p = parameters or KalmanParameters()
    S = innovation(state, None, np.eye(2, len(state.mean)), p.sigma_px**2 * np.eye(2)).covariance
    margin = np.sqrt(chdtri(2, 1 - p.gate_probability) * S.diagonal().max())
    u, v = np.clip(
        np.rint(state.mean[:2] - (np.array([window.width, window.height]) - 1) / 2), -(2**29), 2**29
    )
    moved = Window(int(u), int(v), window.width, window.height)
    return moved.grown(min(margin, 2.0**29)).clipped(size)


def nees(states: State, truth: ArrayLike) -> Array:
    """Normalised error squared e^T P^-1 e of k states of n numbers: of mean n if the filter is
    consistent; shape (k,).

    Parameters
    ----------
    states : State
        Means (k, n) and covariances (k, n, n).
    truth : array_like, shape (k, n)

    Raises
    ------
    ValueError
        For a covariance that is not positive definite.
    """
    mean = as_array(states[0], "mean", (None, None))
    error = as_array(truth, "truth", mean.shape) - mean
    covariances = as_array(states[1], "covariance", (len(mean), mean.shape[1], mean.shape[1]))
    return frozen(
        np.array(
            [
                e @ solve_covariance(P, e, "covariance")
                for e, P in zip(error, covariances, strict=True)
            ]
        )
    )


def draw(
    start: State,
    count: int,
    F: ArrayLike,
    Q: ArrayLike,
    H: ArrayLike,
    R: ArrayLike,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Draw a motion and its observations from the model itself (Eq. 7, 8).

    Parameters
    ----------
    start : State
        Distribution of the state at the instant before the first observation.
    count : int
        k, at least 1.
    F, Q, H, R : array_like
        As in `run`.
    rng : numpy.random.Generator

    Returns
    -------
    states : ndarray, shape (k, n)
    observations : ndarray, shape (k, m)

    Raises
    ------
    ValueError
        As `run`.
    """
    as_rng(rng)
    n = len(start.mean)
    k = int(as_number(count, "count", 1))
    H = as_array(H, "H", (None, n))
    state = start.mean + covariance_root(start.covariance, "covariance", n) @ rng.standard_normal(n)
    noise = covariance_root(R, "R", len(H))
    states = []
    for F_k, Q_k in zip(_each(F, "F", k, n), _each(Q, "Q", k, n), strict=True):
        state = F_k @ state + covariance_root(Q_k, "Q", n) @ rng.standard_normal(n)
        states.append(state)
    observations = np.array(states) @ H.T + rng.standard_normal((k, len(H))) @ noise.T
    return frozen(np.array(states)), frozen(observations)


def _steps(
    start: State,
    measurements: Sequence[ArrayLike | None] | Array,
    F: ArrayLike,
    Q: ArrayLike,
    H: ArrayLike,
    R: ArrayLike,
    gate_probability: float | None,
) -> list[Step]:
    """The steps of `run`, one per instant: predicted, updated, NIS, used."""
    n = len(as_array(start[0], "mean", (None,)))
    k = len(measurements)
    state = State(*start)
    steps = []
    for z, F_k, Q_k in zip(measurements, _each(F, "F", k, n), _each(Q, "Q", k, n), strict=True):
        predicted = predict(state, F_k, Q_k)
        observed = innovation(predicted, z, H, R)
        seen = not np.isnan(observed.residual).any()
        used = seen and (gate_probability is None or gate(observed, gate_probability))
        state = update(predicted, z if used else None, H, R)
        steps.append((predicted, state, nis(observed), used))
    return steps


def _each(value: ArrayLike, name: str, k: int, n: int) -> Array:
    """One matrix for all k instants, or k of them, shape (k, n, n)."""
    if k == 0:
        return np.empty((0, n, n))
    ndim = np.ndim(value)
    return np.broadcast_to(as_array(value, name, (k, n, n) if ndim == 3 else (n, n)), (k, n, n))


def _stacked(steps: Sequence[Step]) -> Track:
    predicted, updated, values, used = zip(*steps, strict=True)
    states = [
        State(*(frozen(np.stack(part)) for part in zip(*each, strict=True)))
        for each in (predicted, updated)
    ]
    return Track(states[0], states[1], frozen(np.array(values)), frozen(np.array(used)))
