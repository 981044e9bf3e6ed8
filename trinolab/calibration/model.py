"""Images of a flat target in several cameras: its points' pixels, their derivatives, and the normal
equations of an adjustment (Sect. 6.2).

A target point P is at W = R_v P + t_v in the world, which is the first camera's frame, at L = R_c^T
(W - T_c) in camera c's, and from there goes through the lens. R_c, T_c are T_world_cam, the
direction of Eq. 25.

The common unknowns are for each camera fx, fy, cx, cy and distortions, then for each camera but the
first a small shift (mm) and turn (rad, world frame) of T_world_cam; the poses are those of
T_world_target, with shifts and turns of the same kind.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..checks import Array
from ..lens import project_with_slopes
from ..rigid import cross_matrices
from .normal import Normal


class State(NamedTuple):
    """The state of an adjustment.

    Attributes
    ----------
    lenses : ndarray, shape (cameras, 4 + m)
        fx, fy, cx, cy (px) and the first m of k1, k2, p1, p2, k3, k4, k5, k6; the others are zero.
    T_world_cam : ndarray, shape (cameras, 4, 4)
    T_world_target : ndarray, shape (views, 4, 4)
        Matrices, because SciPy's motions check themselves at every step.
    """

    lenses: Array
    T_world_cam: Array
    T_world_target: Array

    @property
    def common(self) -> int:
        """The number of common unknowns."""
        return self.lenses.size + 6 * (len(self.lenses) - 1)


class Images(NamedTuple):
    """The target's points in all images, and their derivatives.

    Attributes
    ----------
    uv : ndarray, shape (cameras, views, n, 2)
        px; NaN behind a camera and beyond its lens model's range.
    by_lens : ndarray, shape (cameras, views, n, 2, 4 + m)
    by_camera, by_view : ndarray, shape (cameras, views, n, 2, 6)
        With respect to a shift and a turn of T_world_cam and of T_world_target.
    """

    uv: Array
    by_lens: Array
    by_camera: Array
    by_view: Array


def images(state: State, target: Array) -> Images:
    """The images of the target's points (n, 3) in each camera and view."""
    arms = target @ state.T_world_target[:, :3, :3].transpose(0, 2, 1)  # (views, n, 3)
    world = arms + state.T_world_target[:, None, :3, 3]
    cameras = [
        _of_camera(lens, T, world, arms)
        for lens, T in zip(state.lenses, state.T_world_cam, strict=True)
    ]
    return Images(*(np.stack(parts) for parts in zip(*cameras, strict=True)))


def _of_camera(lens: Array, T_world_cam: Array, world: Array, arms: Array) -> Images:
    """The images of one camera, of points (views, n, 3) at the ends of arms from their views'
    places.
    """
    R = T_world_cam[:3, :3]
    sight = world - T_world_cam[:3, 3]
    uv, by_lens, by_local = project_with_slopes(lens, sight @ R)
    by_world = by_local @ R.T
    by_camera = np.concatenate([-by_world, by_world @ cross_matrices(sight)], axis=-1)
    by_view = np.concatenate([by_world, -by_world @ cross_matrices(arms)], axis=-1)
    return Images(uv, by_lens, by_camera, by_view)


def normal_equations(
    at: Images,
    uv: Array,
    velocity: Array | None = None,
    whitened: Callable[[int, Array], Array] | None = None,
) -> Normal:
    """The normal equations of an adjustment.

    Parameters
    ----------
    at : Images
    uv : ndarray, shape (cameras, views, n, 2)
        Measured points, NaN where there is none.
    velocity : ndarray, shape (cameras, views, n, 2), optional
        Derivatives with respect to the delays of all cameras but the first; these are then the last of
        the common unknowns.
    whitened : callable, optional
        Makes the columns (views, 2 n, k) of a camera, given by its number, those of unit noise.
    """
    valid = np.isfinite(uv)[..., None]
    cameras, views = uv.shape[:2]
    width = at.by_lens.shape[-1]
    first_delay = cameras * width + 6 * (cameras - 1)
    q = first_delay + (0 if velocity is None else cameras - 1)
    A, a = np.zeros((q, q)), np.zeros(q)
    E, D, b = np.zeros((views, 6, q)), np.zeros((views, 6, 6)), np.zeros((views, 6))
    for c in range(cameras):
        lens = np.arange(c * width, (c + 1) * width)
        place = cameras * width + np.arange(6 * (c - 1), 6 * c)
        unknowns, slopes = [lens], [at.by_lens[c]]
        if c:
            unknowns.append(place)
            slopes.append(at.by_camera[c])
        if c and velocity is not None:
            unknowns.append(np.array([first_delay + c - 1]))
            slopes.append(velocity[c][..., None])
        common = np.concatenate(unknowns)  # of this camera
        m = len(common)
        missing = (uv[c] - at.uv[c])[..., None]
        columns = np.concatenate([*slopes, at.by_view[c], missing], axis=-1)
        # what was not measured has no weight
        columns = np.where(valid[c], columns, 0.0).reshape(views, -1, m + 7)
        if whitened is not None:
            columns = whitened(c, columns)
        # view by view, since BLAS would start its threads for one large product
        products = columns.transpose(0, 2, 1) @ columns
        whole = products.sum(axis=0)
        A[np.ix_(common, common)] = whole[:m, :m]
        a[common] = whole[:m, -1]
        E[:, :, common] = products[:, m:-1, :m]
        D += products[:, m:-1, m:-1]
        b += products[:, m:-1, -1]
    return Normal(A, a, E, D, b)


def stepped(state: State, common: Array, views: Array) -> State:
    """The state after a step of the common unknowns and of the views' poses (views, 6)."""
    lenses, places = np.split(common, [state.lenses.size])
    cameras = np.concatenate([np.zeros(6), places]).reshape(-1, 6)
    return State(
        state.lenses + lenses.reshape(state.lenses.shape),
        _moved(state.T_world_cam, cameras),
        _moved(state.T_world_target, views),
    )


def stepped_views(state: State, views: Array) -> State:
    """The state after a step of the views' poses (views, 6) alone."""
    return state._replace(T_world_target=_moved(state.T_world_target, views))


def _moved(T: Array, steps: Array) -> Array:
    """Poses (m, 4, 4) after shifts and turns, (m, 6)."""
    moved = T.copy()
    moved[:, :3, :3] = Rotation.from_rotvec(steps[:, 3:]).as_matrix() @ T[:, :3, :3]
    moved[:, :3, 3] += steps[:, :3]
    return moved
