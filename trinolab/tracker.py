"""From the frames of one instant to the pose, and from instant to instant: the chain of Sect. 4-5, composed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from . import background, kalman
from .bodyend import keep_by_body
from .camera import Rig
from .checks import as_image, as_number, frozen
from .estimation import Identified, candidate_pairs, estimate
from .handle import Handle
from .identity import Hypothesis, choose, identify, relabel
from .image_track import search_window
from .markers import Markers, find_markers
from .parameters import Parameters
from .pose import LOST, Pose
from .window import Window


@dataclass(frozen=True, eq=False)
class Measurement:
    """A pose and what it was made of, for pictures and tests.

    Attributes
    ----------
    pose : Pose
    found : tuple of Markers
        One a camera.
    labels : tuple of ndarray of int
        For each found marker its index on the handle, or -1.
    """

    pose: Pose
    found: tuple[Markers, ...]
    labels: tuple[np.ndarray, ...]


def measure(frames: Sequence[ArrayLike], rig: Rig, handle: Handle, prior: RigidTransform | None = None,
            parameters: Parameters | None = None, windows: Sequence[Window | None] | None = None) -> Measurement:
    """Measure the handle's pose from the frames of one instant by the paper's method (Eq. 16-24).

    Parameters
    ----------
    frames : sequence of array_like, shape (height, width)
        One grey image a camera, in the rig's order; grey levels 0 to 255 of any number type. Colour and 16-bit images
        are for `recording.read_instant` to convert: an array does not say which channel is red, or what is white.
    rig : Rig
    handle : Handle
    prior : RigidTransform, optional
        T_world_handle expected at this instant; chooses among poses that look alike.
    parameters : Parameters, optional
    windows : sequence of Window or None, optional
        W_ROI of each camera, inside its image: markers are looked for there alone, and nowhere where it is None.
        Without `windows` in whole images.

    Returns
    -------
    Measurement
        With a pose ``measured``, ``ambiguous`` or ``lost``.

    Raises
    ------
    ValueError
        If the frames do not fit the rig in number or size, or are no grey images with levels from 0 to 255.
    """
    p = parameters or Parameters()
    images = as_images(frames, rig)
    regions = [Window(0, 0, *camera.size) for camera in rig.cameras] if windows is None else windows
    found = tuple(markers_in(image, region, handle, p) for image, region in zip(images, regions, strict=True))
    pixels = tuple(markers.uv for markers in found)
    matches = candidate_pairs(images, rig, pixels, p) if p.estimator == "paper" else None
    hypotheses = identify(rig, handle, pixels, p.identity, [markers.axes_px for markers in found], matches)
    if not hypotheses:
        return Measurement(LOST, found, tuple(np.full(len(uv), -1) for uv in pixels))
    return _conclude(hypotheses, images, rig, handle, found, prior, p)


def _conclude(hypotheses: list[Hypothesis], images: list[np.ndarray], rig: Rig, handle: Handle,
              found: tuple[Markers, ...], prior: RigidTransform | None, p: Parameters) -> Measurement:
    """Choose among the hypotheses and their equivalents, relabel, and estimate."""
    options = [(h, S, h.T_world_handle * S) for h in hypotheses for S in handle.symmetries]
    kept = keep_by_body(images, rig, handle, [T for *_, T in options])
    options = [option for option, keep in zip(options, kept, strict=True) if keep]
    index, sure = choose([T for *_, T in options], prior)
    h, S, T = options[index]
    pixels = tuple(markers.uv for markers in found)
    labels = tuple(relabel(label, handle, S) for label in h.labels)
    pose = estimate(Identified(images, pixels, labels, T), rig, handle, p)
    return Measurement(pose if sure or pose is LOST else replace(pose, status="ambiguous"), found, labels)


class CameraState(NamedTuple):
    """What the tracker knows of one camera.

    Attributes
    ----------
    background : ndarray, shape (height, width)
    motion : kalman.State or None
        Of the centre of the moving region (Eq. 7); None before anything moved, or after it was long unseen.
    window : Window or None
        Around the moving region when it was last seen.
    """

    background: np.ndarray
    motion: kalman.State | None
    window: Window | None


class TrackerState(NamedTuple):
    """What the tracker knows after an instant.

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


def start(backgrounds: Sequence[ArrayLike], rig: Rig, t_s: float, pose: RigidTransform | None = None) -> TrackerState:
    """The state before the first instant.

    Parameters
    ----------
    backgrounds : sequence of array_like, shape (height, width)
        A grey image of the empty scene a camera, in the rig's order.
    rig : Rig
    t_s : float
        Time of the backgrounds, s; the first instant comes later.
    pose : RigidTransform, optional
        T_world_handle where it is known, for layouts that look alike.

    Raises
    ------
    ValueError
        If the backgrounds are no frames of the rig, see `measure`, or the time is no finite number.
    """
    images = as_images(backgrounds, rig)
    cameras = tuple(CameraState(frozen(image.astype(np.float32)), None, None) for image in images)
    t = as_number(t_s, "t_s")
    return TrackerState(t, cameras, t, pose)


def step(state: TrackerState, frames: Sequence[ArrayLike], t_s: float, rig: Rig, handle: Handle,
         parameters: Parameters | None = None) -> tuple[TrackerState, Measurement]:
    """One instant of a sequence: background, window, prediction, and the measurement in the window (Eq. 5-24).

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
        If the frames are none of the rig, see `measure`, or the time does not increase.
    """
    p = parameters or Parameters()
    t = as_number(t_s, "t_s", low=state.t_s, open_low=True)
    images = as_images(frames, rig)
    stepped = [_step_camera(*pair, t - state.t_s, p) for pair in zip(state.cameras, images, strict=True)]
    cameras, windows = zip(*stepped, strict=True)
    prior = state.pose if t - state.measured_s <= p.memory_s else None
    measurement = measure(images, rig, handle, prior, p, windows)
    if measurement.pose.status == "measured":
        return TrackerState(t, cameras, t, measurement.pose.T_world_handle), measurement
    return TrackerState(t, cameras, state.measured_s, state.pose), measurement


def _step_camera(camera: CameraState, image: np.ndarray, dt: float, p: Parameters) -> tuple[CameraState, Window | None]:
    """Renew one camera's background and filter; the window is where something moves, else where it is predicted."""
    size = (image.shape[1], image.shape[0])
    renewed, detection = background.step(camera.background, image, p.background)
    motion = camera.motion and kalman.predict_motion(camera.motion, dt, p.kalman)
    if detection.window is None:
        predicted = search_window(motion, camera.window, size, p.kalman) if motion and camera.window else None
        return CameraState(renewed, motion if predicted else None, camera.window), predicted
    centre = np.array(detection.window.centre)
    state = CameraState(renewed, corrected(motion, centre, p.kalman), detection.window)
    return state, detection.window.grown(p.markers.diameter_px[0]).clipped(size)


def corrected(motion: kalman.State | None, centre: ArrayLike, p: kalman.KalmanParameters) -> kalman.State:
    """Update a predicted motion by the observed centre; start anew where there is none, or the gate refuses it."""
    H, R = kalman.observation_matrix(), p.sigma_px**2 * np.eye(2)
    if motion is None or not kalman.gate(kalman.innovation(motion, centre, H, R), p.gate_probability):
        return kalman.initial_state(centre, p)
    return kalman.update(motion, centre, H, R)


def markers_in(image: np.ndarray, region: Window | None, handle: Handle, p: Parameters) -> Markers:
    """The markers inside a window, in pixels of the whole image."""
    if region is None:
        return find_markers(np.zeros((1, 1)), len(handle.marker_centres), handle.markers, p.markers)
    found = find_markers(region.crop(image), len(handle.marker_centres), handle.markers, p.markers)
    return replace(found, uv=frozen(found.uv + [region.u, region.v]))


def as_images(frames: Sequence[ArrayLike], rig: Rig) -> list[np.ndarray]:
    if len(frames) != len(rig.cameras):
        raise ValueError(f"frames: expected one for each of {len(rig.cameras)} cameras, got {len(frames)}")
    return [as_image(frame, f"frames: {camera.name}", camera.size, highest=255)
            for frame, camera in zip(frames, rig.cameras, strict=True)]
