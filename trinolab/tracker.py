"""From the frames of one instant to the pose: the chain of Sect. 5, composed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .camera import Rig
from .checks import Array, as_image, as_number
from .handle import Handle, slants
from .identity import Hypothesis, IdentityParameters, choose, identify, labelled_pixels, relabel
from .markers import MarkerParameters, Markers, find_markers
from .matching import MatchParameters, candidates
from .pose import LOST, Pose, rigid_fit, rigid_fit_covariance
from .triangulation import triangulate, triangulation_covariance


@dataclass(frozen=True)
class Parameters:
    """Parameters of a measurement, stage by stage.

    Attributes
    ----------
    markers : MarkerParameters
    matching : MatchParameters
    identity : IdentityParameters
    max_slant_deg : float
        Markers turned further away are identified but not measured, as long as four are left: beyond 70 deg the
        centroid of a wrapped marker lies more than 1 px beside the image of its centre.
    sigma_px : float
        Standard deviation of a centroid for the pose's covariance.
    """

    markers: MarkerParameters = field(default_factory=MarkerParameters)
    matching: MatchParameters = field(default_factory=MatchParameters)
    identity: IdentityParameters = field(default_factory=IdentityParameters)
    max_slant_deg: float = 70.0
    sigma_px: float = 0.1

    def __post_init__(self) -> None:
        as_number(self.max_slant_deg, "max_slant_deg", low=0.0, high=90.0)
        as_number(self.sigma_px, "sigma_px", low=0.0, open_low=True)


@dataclass(frozen=True, eq=False)
class Measurement:
    """A pose and what it was made of, for pictures and tests.

    Attributes
    ----------
    pose : Pose
    found : tuple of Markers
        One a camera.
    labels : tuple of ndarray of int
        For each found marker its index on the handle, or -1.
    """

    pose: Pose
    found: tuple[Markers, ...]
    labels: tuple[np.ndarray, ...]


def measure(frames: Sequence[ArrayLike], rig: Rig, handle: Handle, prior: RigidTransform | None = None,
            parameters: Parameters | None = None) -> Measurement:
    """Measure the handle's pose from the frames of one instant by the paper's method (Eq. 16-24).

    Parameters
    ----------
    frames : sequence of array_like, shape (height, width)
        One grey image a camera, in the rig's order.
    rig : Rig
    handle : Handle
    prior : RigidTransform, optional
        T_world_handle expected at this instant; chooses among poses that look alike.
    parameters : Parameters, optional

    Returns
    -------
    Measurement
        With a pose ``measured``, ``ambiguous`` or ``lost``.

    Raises
    ------
    ValueError
        If the frames do not fit the rig in number or size.
    """
    p = parameters or Parameters()
    if len(frames) != len(rig.cameras):
        raise ValueError(f"frames: expected one for each of {len(rig.cameras)} cameras, got {len(frames)}")
    images = [as_image(frame, f"frames: {camera.name}", camera.size)
              for frame, camera in zip(frames, rig.cameras, strict=True)]
    found = tuple(find_markers(image, len(handle.marker_centres), handle.markers, p.markers) for image in images)
    pixels = tuple(markers.uv for markers in found)
    points, covariances = candidate_points(images, rig, pixels, p)
    hypotheses = identify(rig, handle, pixels, points, covariances, p.identity)
    if not hypotheses:
        return Measurement(LOST, found, tuple(np.full(len(uv), -1) for uv in pixels))
    return _conclude(hypotheses, rig, handle, found, prior, p)


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


def _conclude(hypotheses: list[Hypothesis], rig: Rig, handle: Handle, found: tuple[Markers, ...],
              prior: RigidTransform | None, p: Parameters) -> Measurement:
    """Choose among the hypotheses and their equivalents, relabel, and estimate."""
    options = [(h, S) for h in hypotheses for S in handle.symmetries]
    index, sure = choose([h.T_world_handle * S for h, S in options], prior)
    h, S = options[index]
    pixels = tuple(markers.uv for markers in found)
    labels = tuple(relabel(label, handle, S) for label in h.labels)
    pose = fit_pose(labels, rig, handle, pixels, p)
    return Measurement(pose if sure or pose is LOST else replace(pose, status="ambiguous"), found, labels)
