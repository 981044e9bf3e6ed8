"""Motion blur: frames of a handle that moves while the shutter is open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from .camera import Camera
from .checks import Array, as_array, as_number
from .handle import Handle
from .scene import Bench, radiance

EXPOSURE_S = 0.010
STEP_PX = 0.5  # the farthest that a marker moves from one sample of the exposure to the next


def exposed(camera: Camera, handle: Handle, T_world_handle: RigidTransform, bench: Bench, velocity: ArrayLike,
            turn_rate: ArrayLike, exposure_s: float = EXPOSURE_S) -> Array:
    """The image before blur and noise of a handle in steady motion: the mean of `scene.radiance` over the exposure.

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

    Raises
    ------
    ValueError
        If a shape is wrong, a number not finite, or the exposure negative.
    """
    half = as_number(exposure_s, "exposure_s", low=0.0) / 2
    v, w = as_array(velocity, "velocity", (3,)), as_array(turn_rate, "turn_rate", (3,))
    ends = [camera.project(_moved(T_world_handle, v, w, t).apply(handle.marker_centres)) for t in (-half, half)]
    longest = np.nanmax(np.linalg.norm(ends[1] - ends[0], axis=1), initial=0.0)
    steps = max(1, int(np.ceil(longest / STEP_PX)))
    if steps > 1:
        bench = replace(bench, supersampling=4, marker_supersampling=6)
    light = np.zeros(camera.size[::-1])
    for t in 2 * half * ((np.arange(steps) + 0.5) / steps - 0.5):
        light += radiance(camera, handle, _moved(T_world_handle, v, w, t), bench)
    return light / steps


def _moved(T: RigidTransform, velocity: Array, turn_rate: Array, t_s: float) -> RigidTransform:
    turn = Rotation.from_rotvec(turn_rate * t_s)
    return RigidTransform.from_components(T.translation + velocity * t_s, turn * T.rotation)
