"""Errata of Sect. 4.2: a Kalman filter that runs by the printed equations (Eq. 8-14), and its
window.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from trinolab.background import moving_window
from trinolab.checks import Array
from trinolab.datasets import IMAGE_SIZE, load_handle, load_rig, load_table1
from trinolab.handle import on_cylinder
from trinolab.image_track import draw, run
from trinolab.kalman import (
    KalmanParameters,
    State,
    constant_acceleration,
    covariance_root,
    initial_state,
    innovation,
    nis,
    observation_matrix,
    predict,
    update,
    white_jerk,
)

from ..ledger import Effect

MODEL = KalmanParameters(
    jerk_intensity=1e8, sigma_px=2.0, velocity_sigma=500.0, acceleration_sigma=3000.0
)
DT_S = 1 / 30  # between frames
F = constant_acceleration(DT_S)
Q = white_jerk(DT_S, MODEL.jerk_intensity)
H = observation_matrix()
R = MODEL.sigma_px**2 * np.eye(2)
START = initial_state(np.array([600.0, 500.0]), MODEL)  # velocity and acceleration unknown


def late_observation() -> Effect:
    """What is left of an observation without noise after its prediction is taken off (Eq. 8)."""
    before = np.array([600.0, 500.0, 500.0, 0.0, 0.0, 0.0])
    state = predict(State(before, np.zeros((6, 6))), F, np.zeros((6, 6)))
    z = H @ state.mean
    return Effect(
        "8",
        "distance between observation and expectation without noise, at 500 px/s and 30 frames per second",
        "px",
        float(np.linalg.norm(z - H @ before)),
        float(np.linalg.norm(innovation(state, z, H, R).residual)),
        at_most=1e-9,
    )


def noisy_prediction(steps: int = 1000) -> Effect:
    """Mean NIS on motion drawn from the model, if noise is added to the predicted state (Eq. 9)."""
    rng = np.random.default_rng(0)
    _, observations = draw(START, steps, F, Q, H, R, rng)
    state = START
    root = covariance_root(Q, "Q", 6)
    printed = []
    for z in observations:
        state = predict(state, F, Q)
        state = State(state.mean + root @ rng.standard_normal(6), state.covariance)
        printed.append(nis(innovation(state, z, H, R)))
        state = update(state, z, H, R)
    corrected = run(START, observations, F, Q, H, R).nis
    return Effect(
        "9",
        "mean normalised innovation squared on motion drawn from the model; 2 is expected",
        "",
        float(np.mean(printed)),
        float(np.mean(corrected)),
        1.75,
        2.25,
    )


def lost_transpose() -> Effect:
    """Predicted uncertainty of the position where the velocity is unknown (Eq. 10)."""
    printed = F @ START.covariance @ F + Q
    corrected = predict(START, F, Q).covariance
    rng = np.random.default_rng(0)
    states = (
        START.mean + rng.standard_normal((20_000, 6)) @ covariance_root(START.covariance, "P", 6).T
    )
    sigma = float(
        np.std(
            (states @ F.T + rng.standard_normal((20_000, 6)) @ covariance_root(Q, "Q", 6).T)[:, 0]
        )
    )
    meaning = (
        f"predicted standard deviation of x a frame after the start, velocity known to {MODEL.velocity_sigma:g} "
        "px/s; the limits come from a simulation"
    )
    return Effect(
        "10",
        meaning,
        "px",
        float(np.sqrt(printed[0, 0])),
        float(np.sqrt(corrected[0, 0])),
        0.97 * sigma,
        1.03 * sigma,
    )


def sum_observed() -> Effect:
    """How many of the six state variables the observations determine (Eq. 12)."""
    printed, corrected = (_observed(matrix) for matrix in (np.array([[1.0, 1, 0, 0, 0, 0]]), H))
    return Effect(
        "12", "rank of the observability matrix, of 6 state variables", "", printed, corrected, 6, 6
    )


def one_for_a_matrix() -> Effect:
    """How long P stays a covariance if 1 is a number and P_k^- the prediction before (Eq. 14)."""
    return _updates("as printed, with the number 1", np.ones((6, 6)))


def late_covariance() -> Effect:
    """How long P stays a covariance if 1 is the unit matrix and P_k^- the prediction before
    (Eq. 14).
    """
    return _updates("with the unit matrix for 1", np.eye(6))


def certain_start(draws: int = 40) -> Effect:
    """Share of the first ten true observations that pass a 99.9 % gate, if P_0 is zero
    (Sect. 4.2).
    """
    printed, corrected = (
        _share_in_gate(P_0, draws) for P_0 in (np.zeros((6, 6)), START.covariance)
    )
    return Effect(
        "Sect. 4.2",
        "share of the first ten true observations that a gate for 99.9 % of them lets pass",
        "",
        printed,
        corrected,
        at_least=0.98,
    )


def largest_rectangle() -> Effect:
    """Share of the image in the window around the handle, if its bounding rectangle is the largest
    (Sect. 4.2).
    """
    camera = load_rig("paper_pair").cameras[0]
    body = _body()
    shares = []
    for T in load_table1().set_poses:
        mask = np.zeros(IMAGE_SIZE[::-1], dtype=np.uint8)
        cv2.fillConvexPoly(
            mask, cv2.convexHull(np.rint(camera.project(T.apply(body))).astype(np.int32)), 1
        )
        window = moving_window(mask.astype(bool))
        shares.append(0.0 if window is None else window.area / mask.size)
    return Effect(
        "Sect. 4.2",
        "share of CCD1's image in the rectangle around the handle, mean over Table 1",
        "",
        1.0,
        float(np.mean(shares)),
        at_most=0.5,
    )


def _observed(matrix: Array) -> int:
    return int(
        np.linalg.matrix_rank(
            np.vstack(
                [matrix @ np.linalg.matrix_power(constant_acceleration(1.0), k) for k in range(6)]
            )
        )
    )


def _updates(how: str, one: Array) -> Effect:
    def printed(predicted: State, before: Array) -> Array:
        S = H @ predicted.covariance @ H.T + R
        P = (one - predicted.covariance @ H.T @ np.linalg.inv(S) @ H) @ before
        return (P + P.T) / 2

    def corrected(predicted: State, _: Array) -> Array:
        return update(predicted, np.zeros(2), H, R).covariance

    return Effect(
        "14",
        f"updates until P is no covariance any more, {how}",
        "",
        _updates_until_broken(printed),
        _updates_until_broken(corrected),
        at_least=100,
    )


def _updates_until_broken(renew: Callable[[State, Array], Array], most: int = 100) -> float:
    """The update after which P has a negative eigenvalue; infinite if none of `most` has."""
    state, before = START, START.covariance
    for k in range(1, most + 1):
        predicted = predict(state, F, Q)
        state = State(predicted.mean, renew(predicted, before))
        before = predicted.covariance
        if np.linalg.eigvalsh(state.covariance)[0] < -1e-6:
            return k
    return np.inf


def _share_in_gate(P_0: Array, draws: int) -> float:
    rng = np.random.default_rng(0)
    passed = []
    for _ in range(draws):
        _, observations = draw(START, 10, F, Q, H, R, rng)
        track = run(State(START.mean, P_0), observations, F, Q, H, R, 1.0 - 1e-3)
        passed.append(track.used)
    return float(np.mean(passed))


def _body() -> Array:
    """The two rims of the handle's body, handle frame, shape (48, 3), mm."""
    handle = load_handle("paper")
    t = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return np.concatenate(
        [on_cylinder(handle.radius_mm, t, y) for y in (handle.bottom_mm, handle.top_mm)]
    )
