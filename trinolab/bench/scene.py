"""The simulated bench: what cameras would see of the handle, and of a hand that holds it, with the
truth.

A frame is ``digitise(blurred(radiance(...)))``: the light that reaches each pixel's area, the
lens's blur, then shot and read noise and 8 bit. Motion blur is the mean of `radiance` over the
poses of an exposure, before the blur.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import Camera, Rig
from ..checks import Array, as_array, as_number
from ..handle import Handle
from .hand import Arm
from .layer import Layer, cropped, foreground, over
from .optics import Bench, background, blurred, digitise

EXPOSURE_S = 0.010
STEP_PX = 0.5  # the farthest that a marker moves from one sample of the exposure to the next
SMEAR_STEP_PX = 1.5  # likewise in `smeared`
_LEAST_PX, _MOST_PX = 0.05, 300.0  # a motion of the image below or beyond these is not drawn


def render(
    camera: Camera,
    handle: Handle,
    T_world_handle: RigidTransform | None,
    bench: Bench,
    rng: np.random.Generator,
    arm: Arm | None = None,
    gain: float = 1.0,
) -> np.ndarray:
    """Take a frame of the handle.

    Parameters
    ----------
    camera : Camera
    handle : Handle
    T_world_handle : RigidTransform or None
        The pose; None for the empty bench.
    bench : Bench
    rng : numpy.random.Generator
        For the noise.
    arm : Arm or None
        The hand and forearm that hold the handle.
    gain : float
        The light, as a factor on everything that the camera sees; the noise follows it.

    Returns
    -------
    ndarray of uint8, shape (height, width)
    """
    light = as_number(gain, "gain", 0.0) * blurred(
        radiance(camera, handle, T_world_handle, bench, arm), bench
    )
    return digitise(light, bench, rng)


def render_rig(
    rig: Rig,
    handle: Handle,
    T_world_handle: RigidTransform | None,
    bench: Bench,
    rng: np.random.Generator,
    arm: Arm | None = None,
    gain: float = 1.0,
) -> list[np.ndarray]:
    """Take a frame with each camera of a rig, in its order; see `render`."""
    return [render(camera, handle, T_world_handle, bench, rng, arm, gain) for camera in rig.cameras]


def render_clip(
    view: Camera | Rig,
    handle: Handle,
    poses: RigidTransform | Sequence[RigidTransform | None],
    bench: Bench,
    rng: np.random.Generator,
    arm: Arm | Sequence[Arm | None] | None = None,
    lights: ArrayLike | None = None,
) -> Iterator[Any]:
    """Take the frames of a clip, one instant after the other: a frame of a camera, or the list of a
    rig's frames.

    Parameters
    ----------
    view : Camera or Rig
    handle : Handle
    poses : RigidTransform, or a sequence of RigidTransform and None
        n poses T_world_handle, None for the empty bench.
    bench : Bench
    rng : numpy.random.Generator
        For the noise.
    arm : Arm, or a sequence of n Arm and None, or None
        Who holds the handle, for all instants or for each.
    lights : array_like, shape (n,), or None
        The `gain` of each instant; None for 1.

    Raises
    ------
    ValueError
        At the call if `arm` or `lights` has another length than `poses`, or a light is negative; at
        the frame what `render` refuses.
    """
    take: Any = render_rig if isinstance(view, Rig) else render
    arms = [arm] * len(poses) if arm is None or isinstance(arm, Arm) else list(arm)
    if len(arms) != len(poses):
        raise ValueError(f"arm: expected one for each of {len(poses)} poses, got {len(arms)}")
    gains = np.ones(len(poses)) if lights is None else as_array(lights, "lights", (len(poses),))
    if (gains < 0).any():
        raise ValueError(f"lights: expected factors from 0, got {gains.min():g}")
    return (
        take(view, handle, poses[k], bench, rng, arms[k], float(gains[k])) for k in range(len(arms))
    )


def scaled(camera: Camera, factor: float) -> Camera:
    """The same camera with `factor` times as many pixels per side: 0.5 makes four pixels one.

    The corner of the image stays where it is, half a pixel outside the first centre: cx + 1/2
    scales, not cx. Raises ValueError if the size does not come out in whole pixels.
    """
    factor = as_number(factor, "factor", 0.0, open_low=True)
    size = factor * np.array(camera.size)
    if (np.abs(size - np.round(size)) > 1e-9).any():
        raise ValueError(
            f"factor: expected whole pixels of {camera.size[0]} x {camera.size[1]}, got {factor:g}"
        )
    matrix = np.diag([factor, factor, 1.0]) @ camera.matrix
    matrix[:2, 2] += (factor - 1) / 2
    width, height = np.round(size).astype(int)
    return Camera(
        camera.name, (int(width), int(height)), matrix, camera.distortions, camera.T_cam_world
    )


def radiance(
    camera: Camera,
    handle: Handle,
    T_world_handle: RigidTransform | None,
    bench: Bench,
    arm: Arm | None = None,
) -> Array:
    """The image before blur and noise: the mean grey of each pixel's area, shape (height, width);
    see `foreground`.
    """
    behind = background(camera, bench)
    if T_world_handle is None:
        return behind.copy()
    return over(foreground(camera, handle, T_world_handle, bench, arm), behind)


def exposed(
    camera: Camera,
    handle: Handle,
    T_world_handle: RigidTransform,
    bench: Bench,
    velocity: ArrayLike,
    turn_rate: ArrayLike,
    exposure_s: float = EXPOSURE_S,
) -> Array:
    """The image before blur and noise of a handle in steady motion: the mean of `scene.radiance`
    over the exposure.

    Parameters
    ----------
    camera : Camera
    handle : Handle
    T_world_handle : RigidTransform
        At mid-exposure.
    bench : Bench
        While something moves, edges have fewer samples each: there are many exposures of them.
    velocity, turn_rate : array_like, shape (3,)
        Of the handle's origin, mm/s, and about it, rad/s, world frame.
    exposure_s : float
        s.

    Returns
    -------
    ndarray, shape (height, width)
    """
    half = as_number(exposure_s, "exposure_s", low=0.0) / 2
    v = as_array(velocity, "velocity", (3,))
    w = as_array(turn_rate, "turn_rate", (3,))
    ends = [
        camera.project(_moved(T_world_handle, v, w, t).apply(handle.marker_centres))
        for t in (-half, half)
    ]
    longest = np.nanmax(np.linalg.norm(ends[1] - ends[0], axis=1), initial=0.0)
    steps = max(1, int(np.ceil(longest / STEP_PX)))
    if steps > 1:
        bench = replace(bench, supersampling=4, marker_supersampling=6)
    light = np.zeros(camera.size[::-1])
    for t in 2 * half * ((np.arange(steps) + 0.5) / steps - 0.5):
        light += radiance(camera, handle, _moved(T_world_handle, v, w, t), bench)
    return light / steps


def smeared(
    camera: Camera,
    handle: Handle,
    T_world_handle: RigidTransform,
    bench: Bench,
    velocity: ArrayLike,
    turn_rate: ArrayLike,
    arm: Arm | None = None,
    exposure_s: float = EXPOSURE_S,
) -> Layer:
    """Handle and arm in steady motion, smeared over the exposure: `exposed` in a twentieth of its
    time.

    The layer at mid-exposure is drawn once, and moved by the affine motion of the image that fits
    the handle's. This neglects less than a tenth of a pixel: the handle's turn about its own axis,
    and perspective. The arguments are those of `exposed`, and the arm, which moves with the handle.
    """
    half = as_number(exposure_s, "exposure_s", low=0.0) / 2
    v = as_array(velocity, "velocity", (3,))
    w = as_array(turn_rate, "turn_rate", (3,))
    points = np.concatenate(
        [handle.marker_centres, [[0, handle.top_mm, 0], [0, handle.bottom_mm, 0]]]
    )
    begin, end = (
        camera.project(_moved(T_world_handle, v, w, t).apply(points)) for t in (-half, half)
    )
    finite = np.isfinite(begin + end).all(axis=1)
    longest = np.linalg.norm(end - begin, axis=1)[finite].max(initial=0.0)
    if finite.sum() < 4 or not _LEAST_PX < longest < _MOST_PX:
        return foreground(camera, handle, T_world_handle, bench, arm)
    margin = int(np.ceil(longest / 2)) + 2
    width, height = camera.size
    wide = cropped(camera, (-margin, -margin), (width + 2 * margin, height + 2 * margin))
    fine = replace(bench, supersampling=4, marker_supersampling=6)
    layer = foreground(wide, handle, T_world_handle, fine, arm)
    corner = layer.corner[0] - margin, layer.corner[1] - margin
    flow = _affine((begin + end)[finite] / 2 - corner, (end - begin)[finite])
    return _mean_of_moved(
        layer._replace(corner=corner), flow, margin, int(np.ceil(longest / SMEAR_STEP_PX))
    )


def _affine(at: Array, change: Array) -> Array:
    """The affine function of pixels, shape (2, 3), that best gives their change over the exposure.

    Points on one line leave the change across it undetermined: it is the same then.
    """
    middle = at.mean(axis=0)
    linear = np.linalg.lstsq(at - middle, change - change.mean(axis=0), rcond=0.05)[0].T
    return np.column_stack([linear, change.mean(axis=0) - linear @ middle])


def _mean_of_moved(layer: Layer, flow: Array, margin: int, steps: int) -> Layer:
    """The mean of a layer moved by shares of -1/2 to 1/2 of a change over the exposure; its window
    is wider.
    """
    if not layer.light.size:  # it lies outside the image
        return layer
    both = np.dstack([layer.light, layer.cover]).astype(np.float32)
    height, width = both.shape[:2]
    total = np.zeros((height + 2 * margin, width + 2 * margin, 2), np.float32)
    for share in (np.arange(steps) + 0.5) / steps - 0.5:
        forward = np.eye(2, 3) + share * flow
        forward[:, 2] += margin
        total += cv2.warpAffine(
            both, forward, (width + 2 * margin, height + 2 * margin), flags=cv2.INTER_LINEAR
        )
    total /= steps
    u, v = layer.corner
    return Layer(total[..., 0].astype(float), total[..., 1].astype(float), (u - margin, v - margin))


def _moved(T: RigidTransform, velocity: Array, turn_rate: Array, t_s: float) -> RigidTransform:
    turn = Rotation.from_rotvec(turn_rate * t_s)
    return RigidTransform.from_components(T.translation + velocity * t_s, turn * T.rotation)
