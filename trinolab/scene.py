"""The simulated bench: what cameras would see of the handle, and of a hand that holds it, with the truth.

A frame is ``digitise(blurred(radiance(...)))``: the light that reaches each pixel's area, the lens's blur, then shot
and read noise and 8 bit. Motion blur is the mean of `radiance` over the poses of an exposure, before the blur.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .arm import Arm
from .arm import true_visibility as true_visibility
from .bench import Bench as Bench
from .bench import background, blurred, digitise
from .camera import Camera, Rig
from .checks import Array, as_array, as_number
from .handle import Handle
from .layer import foreground, over
from .motion import random_pose as random_pose


def render(camera: Camera, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench,
           rng: np.random.Generator, arm: Arm | None = None, gain: float = 1.0) -> np.ndarray:
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

    Raises
    ------
    ValueError
        If the pose is not one rigid motion, `rng` no generator, or `gain` negative.
    """
    light = as_number(gain, "gain", 0.0) * blurred(radiance(camera, handle, T_world_handle, bench, arm), bench)
    return digitise(light, bench, rng)


def render_rig(rig: Rig, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench,
               rng: np.random.Generator, arm: Arm | None = None, gain: float = 1.0) -> list[np.ndarray]:
    """Take a frame with each camera of a rig, in its order; see `render`."""
    return [render(camera, handle, T_world_handle, bench, rng, arm, gain) for camera in rig.cameras]


def render_clip(view: Camera | Rig, handle: Handle, poses: RigidTransform | Sequence[RigidTransform | None],
                bench: Bench, rng: np.random.Generator, arm: Arm | Sequence[Arm | None] | None = None,
                lights: ArrayLike | None = None) -> Iterator[Any]:
    """Take the frames of a clip, one instant after the other: a frame of a camera, or the list of a rig's frames.

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
        At the call if `arm` or `lights` has another length than `poses`, or a light is negative; at the frame what
        `render` refuses.
    """
    take: Any = render_rig if isinstance(view, Rig) else render
    arms = [arm] * len(poses) if arm is None or isinstance(arm, Arm) else list(arm)
    if len(arms) != len(poses):
        raise ValueError(f"arm: expected one for each of {len(poses)} poses, got {len(arms)}")
    gains = np.ones(len(poses)) if lights is None else as_array(lights, "lights", (len(poses),))
    if (gains < 0).any():
        raise ValueError(f"lights: expected factors from 0, got {gains.min():g}")
    return (take(view, handle, poses[k], bench, rng, arms[k], float(gains[k])) for k in range(len(arms)))


def scaled(camera: Camera, factor: float) -> Camera:
    """The same camera with `factor` times as many pixels a side: 0.5 makes four pixels one.

    The corner of the image stays where it is, half a pixel outside the first centre: cx + 1/2 scales, not cx. Raises
    ValueError if the size does not come out in whole pixels.
    """
    factor = as_number(factor, "factor", 0.0, open_low=True)
    size = factor * np.array(camera.size)
    if (np.abs(size - np.round(size)) > 1e-9).any():
        raise ValueError(f"factor: expected whole pixels of {camera.size[0]} x {camera.size[1]}, got {factor:g}")
    matrix = np.diag([factor, factor, 1.0]) @ camera.matrix
    matrix[:2, 2] += (factor - 1) / 2
    width, height = np.round(size).astype(int)
    return Camera(camera.name, (int(width), int(height)), matrix, camera.distortions, camera.T_cam_world)


def radiance(camera: Camera, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench,
             arm: Arm | None = None) -> Array:
    """The image before blur and noise: the mean grey of each pixel's area, shape (height, width); see `foreground`."""
    behind = background(camera, bench)
    if T_world_handle is None:
        return behind.copy()
    return over(foreground(camera, handle, T_world_handle, bench, arm), behind)
