"""The rig as the pixels of one instant leave it.

Where several cameras see the handle, the rig's errors show: one image has it a little higher than
the others allow. What shows is no longer an error, it is measured, and the rig is corrected by it
as far as its covariance lets that be (the update of a Kalman filter, whose state is the rig). What
a motion of the handle explains as well does not show, and stays in the covariance.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import Rig, RigCovariance, displaced
from ..checks import Array
from ..handle import Handle
from ..systematic import ImageOffsets, offsets_at
from .hypotheses import Poses, predict, slopes, weights
from .layout import layout_of, views_of
from .parameters import IdentityParameters

STEPS = 3
HUBER = 3.0  # standard deviations beyond which a marker counts for less
EXACT_PX2 = 1e-6  # variance of an offset that the rig's covariance says is none


class _Contradiction(NamedTuple):
    """Offsets of the images that no motion of the handle explains.

    Attributes
    ----------
    basis : ndarray, shape (2 C, n)
        Orthonormal, across `ImageOffsets.by_position`.
    before, after : ndarray, shape (n, n)
        Covariance of their sizes, px^2, by the rig's covariance and with what was seen.
    size : ndarray, shape (n,)
        What was seen, px.
    """

    basis: Array
    before: Array
    after: Array
    size: Array


def reconciled(
    rig: Rig,
    handle: Handle,
    uv: Array,
    T_world_handle: RigidTransform,
    sigma_px: float,
    p: IdentityParameters,
) -> tuple[Rig, RigidTransform]:
    """Correct a rig by what the images of one instant contradict each other.

    Parameters
    ----------
    rig : Rig
        With a covariance; without one nothing is corrected.
    handle : Handle
        What its `placement_sigma_mm` makes of a pixel counts as noise.
    uv : ndarray, shape (cameras, markers, 2)
        Centroids of identified markers, px; NaN where there is none.
    T_world_handle : RigidTransform
        The pose that they agree on.
    sigma_px : float
        Standard deviation of a centroid.
    p : IdentityParameters

    Returns
    -------
    rig : Rig
        With the covariance that is left.
    T_world_handle : RigidTransform
        As the corrected rig has it.
    """
    offsets = offsets_at(rig, T_world_handle.translation)
    if rig.covariance is None or offsets is None:
        return rig, T_world_handle
    found, T = _contradiction(rig, handle, uv, T_world_handle, offsets, sigma_px, p)
    by_offset = found.basis @ np.linalg.inv(found.before)  # (2 C, n)
    gain = rig.covariance.matrix @ offsets.by_parameters.T @ by_offset
    learnt = gain @ (found.before - found.after) @ gain.T
    left = RigCovariance(rig.names, rig.covariance.matrix - (learnt + learnt.T) / 2)
    return replace(displaced(rig, gain @ found.size), covariance=left), T


def _contradiction(
    rig: Rig,
    handle: Handle,
    uv: Array,
    T: RigidTransform,
    offsets: ImageOffsets,
    sigma_px: float,
    p: IdentityParameters,
) -> tuple[_Contradiction, RigidTransform]:
    """Pose and contradicting offsets together, by least squares with the offsets' prior."""
    views = views_of(rig)
    layout = layout_of(handle, p)
    seen = np.isfinite(uv).all(axis=2)
    basis = np.linalg.svd(offsets.by_position)[0][:, 3:]
    before = basis.T @ offsets.covariance @ basis + EXACT_PX2 * np.eye(basis.shape[1])
    prior = np.linalg.inv(before)
    by_offset = basis.reshape(len(uv), 1, 2, -1).repeat(uv.shape[1], axis=1)[seen]
    size = np.zeros(basis.shape[1])
    for _ in range(STEPS):
        matrix = T.as_matrix()[None]
        poses = Poses(matrix[:, :3, :3], matrix[:, :3, 3])
        predicted = predict(poses, views, layout)
        shown = views.as_taken(predicted.uv)[0].transpose(0, 2, 1)
        left = (uv - shown)[seen] - by_offset @ size
        by_pose = slopes(poses, predicted.points, views)[0][seen]
        scale = views.focal[:, :1] / predicted.points[0, :, 2]
        variance = sigma_px**2 + (handle.placement_sigma_mm * scale) ** 2
        weight = (weights(predicted.facing[0], p) / variance)[seen]
        distance = np.linalg.norm(left, axis=1) * np.sqrt(weight)
        weight = weight * HUBER / np.maximum(distance, HUBER)
        J = np.concatenate([by_pose, by_offset], axis=2)
        JW = J * weight[:, None, None]
        information = np.einsum("kda,kdb->ab", JW, J)
        information[6:, 6:] += prior
        right = np.einsum("kda,kd->a", JW, left)
        right[6:] -= prior @ size
        spread = np.linalg.pinv(information, hermitian=True)
        step = spread @ right
        turn = Rotation.from_rotvec(step[3:6]) * T.rotation
        T = RigidTransform.from_components(T.translation + step[:3], turn)
        size = size + step[6:]
    return _Contradiction(basis, before, spread[6:, 6:], size), T
