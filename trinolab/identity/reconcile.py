"""The rig as the pixels of one instant leave it.

Where several cameras see the handle, the rig's errors show: one image has it a little higher than
the others allow. What shows is no longer an error, it is measured, and the rig is corrected by it
as far as its covariance lets that be (the update of a Kalman filter, whose state is the rig). What
a motion of the handle explains as well does not show, and stays in the covariance. Where more shows
than the covariance makes likely, the rig is worse known than its file says, also in what does not
show: its covariance is scaled by that (Birge 1932, DOI 10.1103/PhysRev.40.207). Where the size of
the covariance is itself hardly known, as for a rig whose file says nothing, what shows is counted
together with what was assumed, each with its degrees of freedom. A rig that is said to be exact gets
a covariance only where it is contradicted: offsets of all images that are as large as those that
show.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import CAMERA_PARAMETERS, Rig, RigCovariance, displaced
from ..checks import Array
from ..handle import Handle
from ..rigid import placed
from ..uncertainty.systematic import (
    contradict,
    contradicting,
    offsets_at,
    pixel_slopes,
)
from ..uncertainty.usual import known_covariance, known_placement_mm
from .hypotheses import FAR, Poses, ideal_pixels, predict, slopes, weights
from .layout import layout_of, views_of
from .parameters import IdentityParameters

STEPS = 3  # Gauss-Newton
HUBER = 3.0  # standard deviations beyond which a marker counts for less
FEWEST_MARKERS = 2  # that a camera must show to contradict another
PRINCIPAL_POINT = slice(2, 4)  # in `CAMERA_PARAMETERS`
EXACT_PX2 = 1e-6  # variance of an offset that the rig's covariance says is none


class Offsets(NamedTuple):
    """Offsets of the images, found together with the poses of n instants.

    Attributes
    ----------
    size : ndarray, shape (n, m)
        By the offsets of the given basis, px.
    covariance : ndarray, shape (n, m, m)
        px^2.
    poses : Poses
    """

    size: Array
    covariance: Array
    poses: Poses


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
        If it is exact nothing is corrected, unless the images contradict each other by more than
        centroids may be off, all biases included (`p.sigma_px`).
    handle : Handle
        What its markers' places make of a pixel counts as noise.
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
    matrix = T_world_handle.as_matrix()[None]
    poses = Poses(matrix[:, :3, :3], matrix[:, :3, 3])
    sized = False
    if known_covariance(rig).is_exact and _exceeds_biases(rig, handle, uv, poses, p):
        rig = _doubted(rig, handle, uv, poses, p)
        sized = True
    offsets = offsets_at(rig, T_world_handle.translation)
    if offsets is None:
        return rig, T_world_handle
    stated = known_covariance(rig)
    basis = contradicting(offsets.by_position)
    m = basis.shape[1]
    shifts = basis.T @ offsets.by_parameters
    before = shifts @ stated.matrix @ shifts.T + EXACT_PX2 * np.eye(m)
    prior = np.linalg.inv(before)
    fit = fit_with_offsets(rig, handle, poses, uv[None], basis[None], prior, sigma_px, p)
    surprise = float(fit.size[0] @ prior @ fit.size[0])
    # of an offset that no camera shows nothing is learnt
    shown = m - float(np.trace(prior @ fit.covariance[0]))
    scale, freedom = 1.0, stated.freedom
    if np.isfinite(freedom) and not sized:
        scale, freedom = (freedom + surprise) / (freedom + shown), freedom + shown
    elif contradict(surprise, m):
        scale, freedom = max(surprise / shown, 1.0), shown
    if scale != 1:
        prior = prior / scale
        fit = fit_with_offsets(rig, handle, poses, uv[None], basis[None], prior, sigma_px, p)
    known = scale * stated.matrix
    gain = known @ shifts.T @ prior
    learnt = gain @ (scale * before - fit.covariance[0]) @ gain.T
    remaining = replace(stated, matrix=known - (learnt + learnt.T) / 2, freedom=freedom)
    T = placed(fit.poses.translations[0], fit.poses.rotations[0])
    return replace(displaced(rig, gain @ fit.size[0]), covariance=remaining), T


def _exceeds_biases(
    rig: Rig, handle: Handle, uv: Array, poses: Poses, p: IdentityParameters
) -> bool:
    """Whether markers lie so far from where a pose predicts them that offsets may explain it: by
    their chi-square, which no fit of offsets lowers by more than itself. Most instants end here.
    """
    views = views_of(rig)
    predicted = predict(poses, views, layout_of(handle, p))
    residuals = ideal_pixels(rig, list(uv)) - predicted.uv[0]
    squares = np.where(np.abs(residuals[:, 0]) < FAR / 2, (residuals**2).sum(axis=1), 0.0)
    chi_square = float((weights(predicted.facing[0], p) * squares).sum()) / p.sigma_px**2
    return contradict(chi_square, 2 * len(uv) - 3)


def _doubted(rig: Rig, handle: Handle, uv: Array, poses: Poses, p: IdentityParameters) -> Rig:
    """An exact rig with the covariance that its contradictions say, if two cameras or more show
    enough markers to contradict each other.
    """
    seeing = np.flatnonzero(np.isfinite(uv).all(axis=2).sum(axis=1) >= FEWEST_MARKERS)
    if len(seeing) < 2:
        return rig
    cameras = tuple(rig.cameras[c] for c in seeing)
    by_position = np.concatenate([pixel_slopes(c, poses.translations)[1][0] for c in cameras])
    basis = contradicting(by_position)
    m = basis.shape[1]
    free = np.zeros((m, m))
    partial_rig = Rig(cameras)
    fit = fit_with_offsets(
        partial_rig, handle, poses, uv[None, seeing], basis[None], free, p.sigma_px, p
    )
    size = fit.size[0]
    if not contradict(float(size @ np.linalg.solve(fit.covariance[0], size)), m):
        return rig
    variances = np.zeros((len(rig.cameras), len(CAMERA_PARAMETERS)))
    variances[:, PRINCIPAL_POINT] = float(size @ size) / m
    covariance = RigCovariance(rig.names, np.diag(variances.ravel()), m, doubted=True)
    return replace(rig, covariance=covariance)


def fit_with_offsets(
    rig: Rig,
    handle: Handle,
    poses: Poses,
    uv: Array,
    basis: Array,
    prior: np.ndarray,
    sigma_px: float,
    p: IdentityParameters,
) -> Offsets:
    """Fit poses and offsets of the images together, by least squares, large residuals held back
    (Huber).

    Parameters
    ----------
    rig, handle
        What the markers' places make of a pixel counts as noise.
    poses : Poses
        Of n instants, right to some pixels.
    uv : ndarray, shape (n, C, markers, 2)
        Identified markers, px; NaN where there is none.
    basis : ndarray, shape (n, 2 C, m)
        Offsets, as of `systematic.contradicting`.
    prior : ndarray, shape (m, m)
        Inverse covariance of their sizes, px^-2, about zero.
    sigma_px : float
        Standard deviation of a centroid.
    p : IdentityParameters
    """
    views = views_of(rig)
    layout = layout_of(handle, p)
    n, C, markers, _ = uv.shape
    m = basis.shape[2]
    seen = np.stack([ideal_pixels(rig, list(one)) for one in uv])  # (n, C, 2, markers)
    visible = seen[:, :, 0] < FAR
    by_offset = np.broadcast_to(basis.reshape(n, C, 1, 2, m), (n, C, markers, 2, m))
    size = np.zeros((n, m))
    for _ in range(STEPS):
        predicted = predict(poses, views, layout)
        residuals = (seen - predicted.uv).transpose(0, 1, 3, 2)
        residuals = residuals - (by_offset @ size[:, None, None, :, None])[..., 0]
        residuals = np.where(visible[..., None], residuals, 0.0)
        scale = views.focal[:, :1] / predicted.points[:, :, 2]  # px/mm
        variance = sigma_px**2 + (known_placement_mm(handle) * scale) ** 2
        weight = visible * weights(predicted.facing, p) / variance
        distance = np.linalg.norm(residuals, axis=3) * np.sqrt(weight)
        weight = weight * HUBER / np.maximum(distance, HUBER)
        J = np.concatenate([slopes(poses, predicted.points, views), by_offset], axis=4)
        J = np.where(visible[..., None, None], J, 0.0).reshape(n, -1, 6 + m)
        JW = J.mT * weight.reshape(n, 1, -1).repeat(2, axis=2)
        information = JW @ J
        information[:, 6:, 6:] += prior
        right = JW @ residuals.reshape(n, -1, 1)
        right[:, 6:] -= prior @ size[..., None]
        spread = np.linalg.pinv(information, hermitian=True)
        step = (spread @ right)[..., 0]
        turn = Rotation.from_rotvec(step[:, 3:6]).as_matrix()
        poses = Poses(turn @ poses.rotations, poses.translations + step[:, :3])
        size = size + step[:, 6:]
    return Offsets(size, spread[:, 6:, 6:], poses)
