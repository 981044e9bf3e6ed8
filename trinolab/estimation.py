"""The paper's estimate: candidate points from found markers, and the pose from labelled ones (Sect. 5.2-5.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .camera import Rig
from .checks import Array
from .handle import Handle, slants
from .identity import labelled_pixels
from .matching import candidates
from .parameters import Parameters
from .pose import LOST, Pose, rigid_fit, rigid_fit_covariance
from .triangulation import triangulate, triangulation_covariance


def candidate_points(images: Sequence[np.ndarray], rig: Rig, pixels: Sequence[Array],
                     parameters: Parameters) -> tuple[Array, Array]:
    """Points of all candidate pairs of found markers, world frame (Eq. 17, 18, 20, 21).

    Returns
    -------
    points : ndarray, shape (m, 3)
        mm.
    covariances : ndarray, shape (m, 3, 3)
        mm^2, for the identification's `sigma_px`.
    """
    columns = [np.empty((len(rig.cameras), 0, 2))]
    for i, j in rig.pairs:
        pairs = candidates(rig.cameras[i], rig.cameras[j], images[i], images[j], pixels[i], pixels[j],
                           parameters.matching).index
        column = np.full((len(rig.cameras), len(pairs), 2), np.nan)
        column[i], column[j] = pixels[i][pairs[:, 0]], pixels[j][pairs[:, 1]]
        columns.append(column)
    uv = np.concatenate(columns, axis=1)
    points = triangulate(rig, uv)
    covariances = triangulation_covariance(rig, uv, parameters.identity.sigma_px)
    valid = np.isfinite(points).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    return points[valid], covariances[valid]


def fit_pose(labels: tuple[np.ndarray, ...], rig: Rig, handle: Handle, pixels: tuple[Array, ...],
             parameters: Parameters) -> Pose:
    """The paper's estimate from labelled markers: pairs, mean, rigid fit (Eq. 20-24).

    Parameters
    ----------
    labels : tuple of ndarray of int, one a camera
        For each found marker its index on the handle, or -1.
    rig, handle
    pixels : tuple of ndarray, one a camera, shape (n_c, 2)
    parameters : Parameters

    Returns
    -------
    Pose
        With status ``measured``; `LOST` if fewer than three markers that are not on a line were triangulated.
    """
    uv = labelled_pixels(labels, pixels, len(handle.marker_centres))
    T = rigid_fit(handle.marker_centres, triangulate(rig, uv))
    if T is None:
        return LOST
    facing = uv.copy()
    for row, camera in zip(facing, rig.cameras, strict=True):
        row[slants(handle, T, camera.centre) > np.deg2rad(parameters.max_slant_deg)] = np.nan
    if np.isfinite(triangulate(rig, facing)).all(axis=1).sum() >= 4:
        uv = facing
    return _fit(uv, rig, handle, parameters.sigma_px)


def _fit(uv: Array, rig: Rig, handle: Handle, sigma_px: float) -> Pose:
    """Rigid fit of the markers at pixels uv (cameras, markers, 2), with covariance and residual."""
    points = triangulate(rig, uv)
    used = np.isfinite(points).all(axis=1)
    T = rigid_fit(handle.marker_centres, points)
    if T is None:
        return LOST
    point_covariances = triangulation_covariance(rig, uv[:, used], sigma_px)
    covariance = rigid_fit_covariance(handle.marker_centres[used], T, point_covariances)
    centres = T.apply(handle.marker_centres)
    error = np.stack([camera.project(centres) for camera in rig.cameras]) - uv
    seen = np.asarray(np.isfinite(error).all(axis=2)) & used
    residual = float(np.sqrt((error[seen] ** 2).sum(axis=1).mean()))
    return Pose("measured", T, covariance, residual, int(used.sum()), int(seen.any(axis=1).sum()))
