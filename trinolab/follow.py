"""The handle measured where it is expected: markers at their predicted places, and the pose from them (Sect. 4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from .appearance import Views
from .blobs import RING_PX
from .camera import Camera, Rig
from .centroids import predict_centroids
from .checks import Array, frozen
from .estimation import APART_MM, APART_RAD, Identified, estimate, fit_pose
from .handle import Handle
from .hypotheses import FAR, Poses, explain, fit, ideal_pixels, predict
from .layout import layout_of, views_of
from .markers import Markers
from .parameters import Parameters
from .pose import LOST, Pose, motion_between
from .reprojection import fit_pixels
from .spot import markers_at
from .window import Window

SEEN_DEG = 76.0  # markers turned further away are not expected
LEAST_PX = 0.1  # a plain centroid is not trusted to better than this
SURE_MM, SURE_DEG = 0.6, 1.5  # standard deviations with which a pose from centroids alone counts as measured


class Sight(NamedTuple):
    """What one camera shows where the handle is expected.

    Attributes
    ----------
    window : Window or None
        In which the markers lie; None if the handle is expected outside the image.
    found : ndarray, shape (markers, 6)
        As `spot.markers_at` gives it, in pixels of the whole image.
    """

    window: Window | None
    found: Array


def look(images: Sequence[np.ndarray], rig: Rig, handle: Handle, T_world_handle: RigidTransform,
         p: Parameters) -> list[Sight]:
    """Measure the markers at the places where a pose predicts them; half a marker's diameter off is near enough."""
    predicted = predict(_batch(T_world_handle), views_of(rig), layout_of(handle))
    uv = np.where((predicted.facing > np.cos(np.deg2rad(SEEN_DEG)))[:, :, None], predicted.uv, np.nan)[0]
    depths = predicted.points[0, :, 2].mean(axis=1)
    return [_look(image, camera, handle, _as_taken(camera, pixels.T), depth, p)
            for image, camera, pixels, depth in zip(images, rig.cameras, uv, depths, strict=True)]


def _look(image: np.ndarray, camera: Camera, handle: Handle, uv: Array, depth_mm: float, p: Parameters) -> Sight:
    reach = 0.75 * handle.marker_diameter_mm * camera.focal.max() / max(depth_mm, 1.0) + RING_PX
    around = Window.around(np.clip(uv, -1e6, 1e6))
    window = around and around.grown(2 * reach).clipped(camera.size)
    if window is None:
        return Sight(None, np.full((len(uv), 6), np.nan))
    corner = np.array([window.u, window.v, 0, 0, 0, 0])
    return Sight(window, markers_at(window.crop(image), uv - corner[:2], reach, handle.markers, p.markers) + corner)


def _as_taken(camera: Camera, ideal: Array) -> Array:
    """Ideal pixels as those of the distorted image."""
    if not camera.distortions.any():
        return ideal
    return camera.to_pixels((ideal - camera.principal_point) / camera.focal)


def _batch(T: RigidTransform) -> Poses:
    matrix = T.as_matrix()
    return Poses(matrix[None, :3, :3], matrix[None, :3, 3])


def follow(images: Sequence[np.ndarray], sights: Sequence[Sight], rig: Rig, handle: Handle, start: RigidTransform,
           p: Parameters) -> tuple[Pose, tuple[np.ndarray, ...]]:
    """The pose of markers that were looked for where `start` predicts them.

    Where the estimator gives no pose, because one camera alone sees enough, or because motion has smeared what the
    image model knows, the centroids of all views give one, see `reprojection.fit_pixels`.

    Returns
    -------
    pose : Pose
        ``measured``; `LOST` if too few markers agree.
    labels : tuple of ndarray of int, one a camera, shape (markers,)
        The marker's index where it was found and agrees, else -1.
    """
    T, labels = _agreed([sight.found[:, :2] for sight in sights], rig, handle, start, p)
    counts = np.array([(row >= 0).sum() for row in labels])
    if T is None or not (counts.max() >= 4 or (counts >= 3).sum() >= 2):
        return LOST, labels
    pixels = tuple(sight.found[:, :2] for sight in sights)
    pose = _estimated(Identified(images, pixels, labels, T), rig, handle, p)
    if pose.T_world_handle is None or apart(pose.T_world_handle, T, APART_MM, APART_RAD):
        pose = _from_centroids(pixels, labels, rig, handle, T)
    return pose, labels


def found_markers(sight: Sight) -> Markers:
    """What a camera shows, with a row for each marker; NaN where there is none."""
    table = sight.found
    return Markers(frozen(table[:, :2]), frozen(table[:, 2:4]), frozen(table[:, 4]), frozen(table[:, 5]), ())


def apart(a: RigidTransform, b: RigidTransform, most_mm: float, most_rad: float) -> bool:
    """Whether two poses differ by more than a distance or an angle."""
    away = motion_between(a, b)
    return bool(np.linalg.norm(away[:3]) > most_mm or np.linalg.norm(away[3:]) > most_rad)


def _agreed(pixels: list[Array], rig: Rig, handle: Handle, start: RigidTransform,
            p: Parameters) -> tuple[RigidTransform | None, tuple[np.ndarray, ...]]:
    """The pose that most of the markers agree with, and those that do."""
    views, layout, uv = views_of(rig), layout_of(handle), ideal_pixels(rig, pixels)
    shown = uv[:, 0] < FAR
    poses, labels = _batch(start), np.where(shown, np.arange(shown.shape[1]), -1)[None]
    for gate, steps in ((4.0, 2), (1.5, 1)):
        poses = fit(poses, labels, views, layout, uv, steps)
        explained = explain(poses, views, layout, uv, gate * p.identity.gate_px)
        labels = np.where(explained.labels == np.arange(shown.shape[1]), explained.labels, -1)
    count = int((labels >= 0).sum())
    residual = np.sqrt(np.where(labels >= 0, explained.squares, 0.0).sum() / max(2 * count - 6, 1))
    if count < 4 or not residual <= p.identity.max_residual_px or not np.isfinite(poses.rotations).all():
        return None, tuple(labels[0])
    turn = Rotation.from_matrix(poses.rotations[0])
    return RigidTransform.from_components(poses.translations[0], turn), tuple(labels[0])


def _estimated(instant: Identified, rig: Rig, handle: Handle, p: Parameters) -> Pose:
    """The pose by the estimator; the paper's as it is, without the image model that checks it in a single instant."""
    if p.estimator == "paper":
        return fit_pose(instant.labels, rig, handle, instant.pixels, p, instant.T_world_handle)
    return estimate(instant, rig, handle, p)


def _from_centroids(pixels: tuple[Array, ...], labels: tuple[np.ndarray, ...], rig: Rig, handle: Handle,
                    start: RigidTransform) -> Pose:
    """The pose with the least reprojection error of plain centroids, `LOST` if they do not fix it well."""
    table = np.stack(labels)
    views = Views(*np.nonzero(table >= 0))
    uv = np.stack(pixels)[views]
    T, covariance = fit_pixels(uv, np.broadcast_to(np.eye(2), (len(uv), 2, 2)), rig, handle, views, start)
    if not np.isfinite(covariance).all():
        return LOST
    left = uv - predict_centroids(rig, handle, T, views)[0]
    sigma = max(LEAST_PX, float(np.sqrt((left**2).sum() / max(2 * len(uv) - 6, 1))))
    pose = Pose("measured", T, sigma**2 * covariance, float(np.sqrt((left**2).sum(axis=1).mean())),
                len(np.unique(views.marker)), len(np.unique(views.camera)))
    return pose if pose.sigma_mm < SURE_MM and pose.sigma_deg < SURE_DEG else LOST
