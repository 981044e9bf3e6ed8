"""The shadow that handle and arm cast on the wall behind the simulated bench."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from .arm import Arm, capsules
from .bench import Bench
from .camera import Camera
from .capsule import capsule_corners
from .checks import Array, as_transform
from .handle import Handle
from .raycast import body_corners, hull_region

WALL_MM = 850.0  # z of the wall in the world frame, a plane across the line of sight of a first camera
_PENUMBRA_MM = 12.0  # over which the shadow's edge fades


def shadow(camera: Camera, handle: Handle, T_world_handle: RigidTransform, bench: Bench,
           arm: Arm | None = None) -> np.ndarray:
    """Share of the wall's directed light that is missing in each pixel, float32 (height, width), 0 to 1.

    The light comes from far away. Nothing where it does not shine towards the wall. Raises ValueError if the pose is
    not one rigid motion.
    """
    solids = [as_transform(T_world_handle, "T_world_handle").apply(body_corners(handle))]
    if arm is not None:
        solids += list(capsule_corners(capsules(arm, handle, T_world_handle)))
    dark = np.zeros(camera.size[::-1], bool)
    if bench.light[2] < -1e-3:
        for corners in solids:
            dark |= hull_region(camera, camera.T_cam_world.apply(_on_wall(corners, bench.light)))
    side = 1 + 2 * int(_PENUMBRA_MM * camera.focal.mean() / WALL_MM / 4)
    return cv2.blur(cv2.blur(dark.astype(np.float32), (side, side)), (side, side))


def _on_wall(points: Array, light: tuple[float, float, float]) -> Array:
    """Where the shadows of points fall, world frame, shape (n, 3), mm; of those behind the wall, where they are."""
    way = np.maximum(WALL_MM - points[:, 2], 0) / -light[2]
    return points - way[:, None] * np.array(light)
