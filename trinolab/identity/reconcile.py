"""The rig, corrected by the pixels of one instant.

If several cameras see the handle, errors of the rig become visible: one image shows it a little
higher than the others allow. The rig is corrected accordingly, weighted by its covariance (the
update of a Kalman filter whose state is the rig). A fit of pixels begins with the corrected rig,
because pixels are linear only over less than a rig's error.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import Rig, displaced
from ..checks import Array
from ..default_covariance import default_covariance, known_covariance, known_placement_mm
from ..handle import Handle
from ..rigid import placed
from ..sensitivity import contradict, contradicting, offsets_at, students_factor
from .hypotheses import FAR, Poses, ideal_pixels, predict, slopes, weights
from .layout import layout_of, views_of
from .parameters import IdentityParameters

STEPS = 3  # Gauss-Newton
HUBER = 3.0  # standard deviations beyond which a marker counts for less
EXACT_PX2 = 1e-6  # variance of an offset that the rig's covariance says is none


class Offsets(NamedTuple):
    """Offsets of the images, found together with the poses of n instants.

    Attributes
    ----------
    size : ndarray, shape (n, m)
        Coefficients of the offsets in the given basis, px.
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
        An exact rig is not corrected, unless the markers contradict it by more than the errors of
        centroids, all biases included (`p.sigma_px`); then it counts as one of default covariance.
    handle : Handle
        The effect of its markers' placement on a pixel counts as noise.
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
    T_world_handle : RigidTransform
        The pose with the corrected rig.
    """
    matrix = T_world_handle.as_matrix()[None]
    poses = Poses(matrix[:, :3, :3], matrix[:, :3, 3])
    exact = known_covariance(rig).is_exact
    if exact and not _contradict(rig, handle, uv, poses, p):
        return rig, T_world_handle
    known = known_covariance(rig)
    if exact:
        known = default_covariance(rig)
    offsets = offsets_at(replace(rig, covariance=known), T_world_handle.translation)
    if offsets is None:
        return rig, T_world_handle
    basis = contradicting(offsets.by_position)
    covariance = basis.T @ offsets.covariance @ basis + EXACT_PX2 * np.eye(basis.shape[1])
    prior = np.linalg.inv(covariance)
    fit = fit_with_offsets(rig, handle, poses, uv[None], basis[None], prior, sigma_px, p)
    size = fit.size[0]
    if exact and not contradict(float(size @ np.linalg.solve(fit.covariance[0], size)), len(size)):
        return rig, T_world_handle
    by_parameters = basis.T @ offsets.by_parameters
    gain = students_factor(known.freedom) * known.matrix @ by_parameters.T @ prior
    T = placed(fit.poses.translations[0], fit.poses.rotations[0])
    return displaced(rig, gain @ size), T


def _contradict(rig: Rig, handle: Handle, uv: Array, poses: Poses, p: IdentityParameters) -> bool:
    """Whether markers lie so far from where a pose predicts them that offsets of the images may
    explain it: by their chi-square, which no fit of offsets lowers by more than itself.
    """
    views = views_of(rig)
    predicted = predict(poses, views, layout_of(handle, p))
    residuals = ideal_pixels(rig, list(uv)) - predicted.uv[0]
    squares = np.where(np.abs(residuals[:, 0]) < FAR / 2, (residuals**2).sum(axis=1), 0.0)
    chi_square = float((weights(predicted.facing[0], p) * squares).sum()) / p.sigma_px**2
    return contradict(chi_square, 2 * len(uv) - 3)


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
        The effect of the markers' placement on a pixel counts as noise.
    poses : Poses
        Of n instants, right to some pixels.
    uv : ndarray, shape (n, C, markers, 2)
        Identified markers, px; NaN where there is none.
    basis : ndarray, shape (n, 2 C, m)
        Offsets, as of `sensitivity.contradicting`.
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
