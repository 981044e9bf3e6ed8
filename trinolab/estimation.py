"""From labelled markers to the pose: the paper's estimate, and three better ones beside it (Sect. 5.2-5.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from .camera import Rig
from .checks import Array
from .handle import Handle, slants
from .identity import labelled_pixels
from .matching import candidates
from .parameters import Parameters
from .pose import LOST, Pose, apart, motion_between, rigid_fit, rigid_fit_covariance
from .refine import Fit, fit_patches
from .reprojection import fit_centroids
from .triangulation import triangulate, triangulate_with_covariance
from .weighted import fit_weighted

APART_MM, APART_RAD = 1.5, np.deg2rad(4.0)  # a little less than what a measured pose may be off


class Identified(NamedTuple):
    """An instant with its markers identified.

    Attributes
    ----------
    images : sequence of ndarray, shape (height, width)
        One a camera.
    pixels : tuple of ndarray, one a camera, shape (n_c, 2)
        Of the markers found.
    labels : tuple of ndarray of int, one a camera, shape (n_c,)
        For each found marker its index on the handle, or -1.
    T_world_handle : RigidTransform
        The pose that identified them.
    smear : (ndarray, ndarray) or None
        The motion expected while the shutter is open, for the estimators that fit pixels, see `refine.fit_patches`.
    """

    images: Sequence[np.ndarray]
    pixels: tuple[Array, ...]
    labels: tuple[np.ndarray, ...]
    T_world_handle: RigidTransform
    smear: tuple[Array, Array] | None = None


def candidate_pairs(images: Sequence[np.ndarray], rig: Rig, pixels: Sequence[Array],
                    parameters: Parameters) -> list[np.ndarray]:
    """Found markers that may be the same one, rows (k, 2) for each pair of cameras of `Rig.pairs` (Eq. 17, 18)."""
    return [candidates(rig.cameras[i], rig.cameras[j], images[i], images[j], pixels[i], pixels[j],
                       parameters.matching).index for i, j in rig.pairs]


def estimate(instant: Identified, rig: Rig, handle: Handle, parameters: Parameters) -> Pose:
    """The pose by the estimator that the parameters name.

    ``paper``: pairs, mean, rigid fit (Eq. 20-24). ``weighted``: centroids registered and moved to the centres,
    pairs and points weighted by their covariances. ``reprojection``: all views at once, by predicted centroids.
    ``patches``: all views at once, by the pixels. ``outline``: as ``patches``, with the body's outline.

    Returns
    -------
    Pose
        With status ``measured``; `LOST` if too little is seen, or what is seen is not what the pose predicts.
    """
    return _ESTIMATES[parameters.estimator](instant, rig, handle, parameters)


def fit_pose(labels: tuple[np.ndarray, ...], rig: Rig, handle: Handle, pixels: tuple[Array, ...],
             parameters: Parameters, known: RigidTransform | None = None) -> Pose:
    """The paper's estimate from labelled markers: pairs, mean, rigid fit (Eq. 20-24).

    Parameters
    ----------
    labels : tuple of ndarray of int, one a camera
        For each found marker its index on the handle, or -1.
    rig, handle
    pixels : tuple of ndarray, one a camera, shape (n_c, 2)
    parameters : Parameters
        Markers turned beyond its `max_slant_deg` are left out if four others remain.
    known : RigidTransform, optional
        T_world_handle that says how far they are turned; by default a fit to all of them.

    Returns
    -------
    Pose
        With status ``measured``; `LOST` if fewer than three markers that are not on a line were triangulated.
    """
    p = parameters
    uv = labelled_pixels(labels, pixels, len(handle.marker_centres))
    T = rigid_fit(handle.marker_centres, triangulate(rig, uv)) if known is None else known
    if T is None:
        return LOST
    for some in (_facing(uv, rig, handle, T, p.max_slant_deg), uv):
        points, covariances = triangulate_with_covariance(rig, some, p.sigma_px)
        used = np.asarray(np.isfinite(points).all(axis=1))
        if used.sum() >= 4:
            break
    T = rigid_fit(handle.marker_centres, points)
    if T is None:
        return LOST
    covariance = rigid_fit_covariance(handle.marker_centres[used], T, covariances[used])
    return _pose(T, covariance, some, used, rig, handle)


def _facing(uv: Array, rig: Rig, handle: Handle, T_world_handle: RigidTransform, max_slant_deg: float) -> Array:
    """The pixels without those of markers that are turned away."""
    turned = np.stack([slants(handle, T_world_handle, camera.centre) for camera in rig.cameras])
    return np.where((turned > np.deg2rad(max_slant_deg))[..., None], np.nan, uv)


def _paper_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    """The paper's estimate, without markers that something hides in part: where the image model shows that, see `Fit`.

    The paper has no test of a pose. Here it is lost if the image model, where it applies, leads far away from it. Its
    covariance, of pixel noise alone, does not know of the centroids' bias: where the image model applies, the mean
    square of the error is that of the better pose, and the square of the way from there.
    """
    check = fit_patches(instant.images, rig, handle, instant.T_world_handle, p.max_slant_deg)
    if check is None or not check.shown.any():
        return fit_pose(instant.labels, rig, handle, instant.pixels, p)
    hidden = {(int(c), int(m)) for c, m, shown in zip(*check.views, check.shown, strict=True) if not shown}
    labels = tuple(np.array([-1 if (c, int(m)) in hidden else m for m in row], dtype=int)
                   for c, row in enumerate(instant.labels))
    pose, better = fit_pose(labels, rig, handle, instant.pixels, p), judged(check)
    if pose.T_world_handle is None or better.T_world_handle is None:
        return pose
    if apart(pose.T_world_handle, better.T_world_handle, APART_MM, APART_RAD):
        return LOST
    away = motion_between(pose.T_world_handle, better.T_world_handle)
    return replace(pose, covariance=better.covariance + np.outer(away, away))


def _weighted_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    fit = fit_weighted(instant.images, rig, handle, instant.T_world_handle, p.max_slant_deg)
    if fit is None:
        return LOST
    T, covariance, uv = fit
    return _pose(T, covariance, uv, np.asarray(np.isfinite(triangulate(rig, uv)).all(axis=1)), rig, handle)


def _pose(T: RigidTransform, covariance: Array, uv: Array, used: np.ndarray, rig: Rig, handle: Handle) -> Pose:
    """A measured pose, with the reprojection error of the markers that were used (markers,), those triangulated."""
    centres = T.apply(handle.marker_centres)
    error = np.stack([camera.project(centres) for camera in rig.cameras]) - uv
    seen = np.asarray(np.isfinite(error).all(axis=2)) & used
    residual = float(np.sqrt((error[seen] ** 2).sum(axis=1).mean()))
    return Pose("measured", T, covariance, residual, int(used.sum()), int(seen.any(axis=1).sum()))


def _centroids_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    return judged(fit_centroids(instant.images, rig, handle, instant.T_world_handle, p.max_slant_deg))


def _patches_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    return judged(fit_patches(instant.images, rig, handle, instant.T_world_handle, p.max_slant_deg,
                               smear=instant.smear))


def _outline_pose(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    return judged(fit_patches(instant.images, rig, handle, instant.T_world_handle, p.max_slant_deg, True,
                               instant.smear))


def judged(fit: Fit | None) -> Pose:
    """A measured pose if enough views show what it predicts, and fix it, else `LOST`."""
    if fit is None or fit.shown.sum() < 4 or len(np.unique(fit.views.marker[fit.shown])) < 3:
        return LOST
    return Pose("measured", fit.T_world_handle, fit.covariance, fit.residual_px,
                len(np.unique(fit.views.marker[fit.shown])), len(np.unique(fit.views.camera[fit.shown])))


_ESTIMATES = {"paper": _paper_pose, "weighted": _weighted_pose, "reprojection": _centroids_pose,
              "patches": _patches_pose, "outline": _outline_pose}
