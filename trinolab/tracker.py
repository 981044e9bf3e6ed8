"""The paper's tracker: background, moving window, prediction, and the measurement in the window
(Sect. 4-5).

One call of `step` is one instant. The tracker that the commands use is `following.posetracker`,
which follows the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform
from scipy.special import chdtri

from . import background, kalman
from .camera import Rig
from .checks import Array, as_array, as_number, frozen
from .handle import Handle
from .image_track import search_window
from .measurement import Measurement, as_images, measure
from .methods import PAPER
from .parameters import Parameters
from .window import Window


class CameraState(NamedTuple):
    """The tracker's state of one camera.

    Attributes
    ----------
    background : ndarray, shape (height, width)
    motion : kalman.State or None
        Of the centre of the moving region (Eq. 7); None before anything moved, or after it was long
        unseen.
    window : Window or None
        Around the moving region when it was last seen.
    """

    background: np.ndarray
    motion: kalman.State | None
    window: Window | None


class TrackerState(NamedTuple):
    """The tracker's state after an instant.

    Attributes
    ----------
    t_s : float
        Time of the instant, s.
    cameras : tuple of CameraState
        In the rig's order.
    measured_s : float
        Time of `pose`, s.
    pose : RigidTransform or None
        The last T_world_handle that was measured or given.
    """

    t_s: float
    cameras: tuple[CameraState, ...]
    measured_s: float
    pose: RigidTransform | None


def start(
    backgrounds: Sequence[ArrayLike], rig: Rig, t_s: float, pose: RigidTransform | None = None
) -> TrackerState:
    """The state before the first instant.

    Parameters
    ----------
    backgrounds : sequence of array_like, shape (height, width)
        One grey image of the empty scene per camera, in the rig's order.
    rig : Rig
    t_s : float
        Time of the backgrounds, s; the first instant comes later.
    pose : RigidTransform, optional
        T_world_handle where it is known, for layouts that look alike.
    """
    images = as_images(backgrounds, rig)
    background.prepare()
    cameras = tuple(CameraState(frozen(image.astype(np.float32)), None, None) for image in images)
    t = as_number(t_s, "t_s")
    return TrackerState(t, cameras, t, pose)


def step(
    state: TrackerState,
    frames: Sequence[ArrayLike],
    t_s: float,
    rig: Rig,
    handle: Handle,
    parameters: Parameters | None = None,
) -> tuple[TrackerState, Measurement]:
    """One instant of a sequence: background, window, prediction, and the measurement in the window
    (Eq. 5-24).

    Parameters
    ----------
    state : TrackerState
        After the instant before.
    frames : sequence of array_like, shape (height, width)
        As for `measure`.
    t_s : float
        Time of the frames, s; any step after the last one.
    rig : Rig
    handle : Handle
    parameters : Parameters, optional

    Returns
    -------
    state : TrackerState
        After this instant.
    measurement : Measurement

    Raises
    ------
    ValueError
        If the time does not increase.
    """
    p = (parameters or Parameters()).with_default(PAPER)
    t = as_number(t_s, "t_s", low=state.t_s, open_low=True)
    images = as_images(frames, rig)
    stepped = [
        _step_camera(*pair, t - state.t_s, p) for pair in zip(state.cameras, images, strict=True)
    ]
    cameras, windows = zip(*stepped, strict=True)
    prior = state.pose if t - state.measured_s <= p.memory_s else None
    measurement = measure(images, rig, handle, prior, p, windows)
    if measurement.pose.status == "measured":
        return TrackerState(t, cameras, t, measurement.pose.T_world_handle), measurement
    return TrackerState(t, cameras, state.measured_s, state.pose), measurement


def _step_camera(
    camera: CameraState, image: np.ndarray, dt: float, p: Parameters
) -> tuple[CameraState, Window | None]:
    """Renew one camera's background and filter; the window is where something moves, else where it
    is predicted.
    """
    size = (image.shape[1], image.shape[0])
    renewed, detection = background.stepped(image, camera.background, p.background)
    motion = camera.motion and _predicted(camera.motion, dt, p.kalman)
    if detection.window is None:
        predicted = (
            search_window(motion, camera.window, size, p.kalman)
            if motion and camera.window
            else None
        )
        return CameraState(renewed, motion if predicted else None, camera.window), predicted
    centre = np.array(detection.window.centre)
    state = CameraState(renewed, corrected(motion, centre, p.kalman), detection.window)
    return state, detection.window.grown(p.markers.diameter_px[0]).clipped(size)


def _predicted(motion: kalman.State, dt: float, p: kalman.KalmanParameters) -> kalman.State:
    """`kalman.predict_motion` of a state that the tracker itself has made (Eq. 9, 10)."""
    x, P = kalman.propagate(*motion, *_motion_model(dt, p.jerk_intensity))
    return kalman.State(frozen(x), frozen((P + P.T) / 2))


@lru_cache(maxsize=64)
def _motion_model(dt: float, jerk_intensity: float) -> tuple[Array, Array]:
    """Phi and Q of a time step; most steps of a sequence are equally long."""
    return kalman.constant_acceleration(dt), kalman.white_jerk(dt, jerk_intensity)


def corrected(
    motion: kalman.State | None, centre: ArrayLike, p: kalman.KalmanParameters
) -> kalman.State:
    """Update a predicted motion by the observed centre; start anew where there is none, or the gate
    refuses it (Eq. 13-15).
    """
    z = as_array(centre, "centre", (2,))
    if motion is None:
        return kalman.initial_state(z, p)
    H = np.eye(2, 6)
    R = p.sigma_px**2 * np.eye(2)
    r, S = kalman.compare(*motion, z, H, R)
    if r @ np.linalg.solve(S, r) > chdtri(2, 1 - p.gate_probability):
        return kalman.initial_state(z, p)
    x, P = kalman.correct(*motion, r, S, H, R)
    return kalman.State(frozen(x), frozen((P + P.T) / 2))
