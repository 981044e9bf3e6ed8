"""The model that a calibration adjusts: parameters, projected target points and their slopes (Sect. 6.2).

A target point P is at W = R_v P + t_v in the world, which is the first camera's frame, at L = R_c^T (W - T_c) in
camera c's, and from there goes through the lens. R_c, T_c are T_world_cam, the direction of Eq. 25.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform, Rotation

from .checks import Array
from .lens import distort
from .pose import cross_matrices


class Layout(NamedTuple):
    """How the parameters stand in one vector: for each camera fx, fy, cx, cy and distortions; for each camera but the
    first T_c and the rotation vector of R_c; for each view t_v and the rotation vector of R_v.
    """

    cameras: int
    views: int
    terms: int

    def split(self, x: Array) -> tuple[Array, Array, Array]:
        """Lenses (cameras, 4 + terms), T_world_cam (cameras, 6) with zeros for the first, T_world_target (views, 6)."""
        lenses, others = self.cameras * (4 + self.terms), 6 * (self.cameras - 1)
        poses = np.concatenate([np.zeros(6), x[lenses:]]).reshape(-1, 6)
        return x[:lenses].reshape(self.cameras, -1), poses[:1 + others // 6], poses[1 + others // 6:]

    def turns(self, x: Array, jacobian: Callable[[Array], Array]) -> Array:
        """Matrix (q, q) that takes changes of the cameras' rotation vectors in x to small rotations in the world."""
        lenses, poses, _ = self.split(x)
        return block_diag(np.eye(lenses.size), *(block_diag(np.eye(3), jacobian(pose[3:])) for pose in poses[1:]))


def pack(layout: Layout, matrices: Sequence[Array], T_world_cam: Sequence[RigidTransform],
         T_world_target: Sequence[RigidTransform]) -> Array:
    """The parameters as a vector, with distortions of zero."""
    lenses = [[K[0, 0], K[1, 1], K[0, 2], K[1, 2]] + [0.0] * layout.terms for K in matrices]
    poses = [np.concatenate([T.translation, T.rotation.as_rotvec()]) for T in [*T_world_cam[1:], *T_world_target]]
    return np.concatenate([np.ravel(lenses), *poses])


def unpack(layout: Layout, x: Array) -> tuple[list[Array], Array, list[RigidTransform], list[RigidTransform]]:
    """Intrinsic matrices, distortions (cameras, 5), T_world_cam and T_world_target from the vector."""
    lenses, cameras, views = layout.split(x)
    matrices = [np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]) for fx, fy, cx, cy in lenses[:, :4]]
    distortions = np.pad(lenses[:, 4:], ((0, 0), (0, 5 - layout.terms)))
    cams, targets = ([RigidTransform.from_components(p[:3], Rotation.from_rotvec(p[3:])) for p in poses]
                     for poses in (cameras, views))
    return matrices, distortions, cams, targets


def residuals(layout: Layout, target: Array, uv: Array, x: Array) -> Array:
    """Projected minus measured, shape (cameras, views, n, 2); NaN where nothing was measured."""
    lenses, cameras, views = layout.split(x)
    world = _moved(target, views)
    return np.stack([_project(lens, _local(world, pose))[0] for lens, pose in zip(lenses, cameras, strict=True)]) - uv


def slopes(layout: Layout, target: Array, x: Array) -> Array:
    """Derivatives of the projected points by the parameters, shape (cameras, views, n, 2, parameters)."""
    lenses, cameras, views = layout.split(x)
    world, arms = _moved(target, views), _moved(target, views) - views[:, None, :3]
    J = np.zeros((layout.cameras, layout.views, len(target), 2, len(x)))
    width, first_view = lenses.shape[1], lenses.size + 6 * (layout.cameras - 1)
    turned = -cross_matrices(arms) @ np.stack([left_jacobian(pose[3:]) for pose in views])[:, None]  # d W / d rotvec
    for c, (lens, pose) in enumerate(zip(lenses, cameras, strict=True)):
        R_cam_world = Rotation.from_rotvec(pose[3:]).as_matrix().T
        _, by_lens, by_local = _project(lens, _local(world, pose))
        J[c, ..., c * width:(c + 1) * width] = by_lens
        by_world = by_local @ R_cam_world  # (views, n, 2, 3)
        if c:
            at = lenses.size + 6 * (c - 1)
            J[c, ..., at:at + 3] = -by_world
            J[c, ..., at + 3:at + 6] = by_world @ cross_matrices(world - pose[:3]) @ left_jacobian(pose[3:])
        for v in range(layout.views):
            at = first_view + 6 * v
            J[c, v, ..., at:at + 3] = by_world[v]
            J[c, v, ..., at + 3:at + 6] = by_world[v] @ turned[v]
    return J


def left_jacobian(rotvec: Array) -> Array:
    """J with R(w + dw) = R(J dw) R(w) to first order, shape (3, 3)."""
    angle = np.linalg.norm(rotvec)
    W = cross_matrices(rotvec)
    if angle < 1e-4:  # two terms of the series: the next is below rounding
        return np.eye(3) + W / 2 + W @ W / 6
    return np.eye(3) + W * (1 - np.cos(angle)) / angle**2 + W @ W * (angle - np.sin(angle)) / angle**3


def _moved(points: Array, poses: Array) -> Array:
    """Points (n, 3) under motions (m, 6), shape (m, n, 3)."""
    return points @ Rotation.from_rotvec(poses[:, 3:]).as_matrix().transpose(0, 2, 1) + poses[:, None, :3]


def _local(world: Array, pose: Array) -> Array:
    """World points (..., 3) in the frame of a camera at the pose T_world_cam, (6,)."""
    return (world - pose[:3]) @ Rotation.from_rotvec(pose[3:]).as_matrix()


def _project(lens: Array, local: Array) -> tuple[Array, Array, Array]:
    """Pixels (..., 2) of points (..., 3) in the camera's frame, and their slopes by the lens and by the points.

    NaN for points that are not in front of the camera.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(local[..., 2] > 0, local[..., 2], np.nan)[..., None]
        xy = local[..., :2] / depth
    distorted, by_xy = (a.reshape(*xy.shape[:-1], *a.shape[1:])
                        for a in distort(xy.reshape(-1, 2), np.pad(lens[4:], (0, 9 - len(lens)))))
    focal, one = lens[:2], np.broadcast_to(np.eye(2), (*xy.shape[:-1], 2, 2))
    by_lens = np.concatenate([one * distorted[..., None], one, _by_distortions(xy)[..., :len(lens) - 4] *
                              focal[:, None]], axis=-1)
    by_local = np.concatenate([one, -xy[..., None]], axis=-1) / depth[..., None]
    return distorted * focal + lens[2:4], by_lens, (focal[:, None] * by_xy) @ by_local


def _by_distortions(xy: Array) -> Array:
    """Slopes of the distorted coordinates by k1, k2, p1, p2, k3, shape (..., 2, 5): the model is linear in them."""
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    tangential = np.stack([np.stack([2 * x * y, r2 + 2 * x * x], -1), np.stack([r2 + 2 * y * y, 2 * x * y], -1)], -2)
    radial = xy[..., None] * np.stack([r2, r2**2, r2**3], -1)[..., None, :]
    return np.concatenate([radial[..., :2], tangential, radial[..., 2:]], axis=-1)
