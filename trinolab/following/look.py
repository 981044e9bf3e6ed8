"""The handle looked for where it is expected: markers at their predicted places, and the pose from them (Sect. 4.2).

Where too few are found, a coarse search over shifts of the predicted markers says where the handle went.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from ..blobs import RING_PX
from ..camera import Camera, Rig
from ..checks import Array, frozen
from ..estimators import estimate
from ..estimators.checked import APART_MM
from ..estimators.identified import Identified
from ..estimators.pixels import Fit, fit_patches, judged
from ..handle import Handle
from ..identity import labelled_pixels
from ..identity.hypotheses import FAR, Poses, explain, fit, ideal_pixels, predict
from ..identity.layout import layout_of, views_of
from ..markers import Markers, markers_at
from ..methods import BEST
from ..pose import LOST, Pose, fit_pose
from ..rigid import apart, motion_between, shifted
from ..window import Window
from .parameters import FollowParameters
from .posefilter import Motion, is_new

SEEN_DEG = 76.0  # markers turned further away are not expected
MORE_MM_S, MORE_RAD_S = 50.0, 0.3  # added to the standard deviations of the predicted rates
SMEARED_PX = 1.5  # a marker that moves less while the shutter is open is as good as still
STRETCHED = 1.15  # times its size that a marker is long when it is smeared
CLEAR = 1.5  # misfit (1 is noise) up to which there is no smear
LEFT_PX = 1.0  # distance that the windows of a good fit may be left with, rms
SURE_MM, SURE_DEG = 0.5, 1.2  # standard deviations with which a pose is measured: four of them are 2 mm and 5 deg
AGREED_RAD = np.deg2rad(2.5)  # by which an estimator's pose may differ from that on which the markers agree
LEAST = 3  # found markers, in all cameras, that make it worth to fit pixels
MOST = 0.55  # share of the expected markers that a camera must show to count
FURTHEST_PX = 60  # of a shift that is looked for
COARSE = 3  # px to a step of the search
DIMMEST = 2.0  # grey levels, of half of what a marker stands out by; less is noise
SIGMA_PX = 2.0  # standard deviation of a camera's shift
AGREE_PX = 6.0  # to which the cameras' shifts must agree on one motion


class Sight(NamedTuple):
    """What one camera shows where the handle is expected.

    Attributes
    ----------
    window : Window or None
        In which the markers lie; None if the handle is expected outside the image.
    found : ndarray, shape (markers, 6)
        As `markers.markers_at` gives it, in pixels of the whole image.
    """

    window: Window | None
    found: Array


class Followed(NamedTuple):
    """What was measured where a motion had the handle.

    Attributes
    ----------
    pose : Pose
        ``measured``; `LOST` if too little fits.
    labels : tuple of ndarray of int, one a camera, shape (markers,)
        The marker's index where it was found and agrees, else -1.
    """

    pose: Pose
    labels: tuple[np.ndarray, ...]


class Expected(NamedTuple):
    """Where a motion predicts the markers in each camera: pixels (markers, 2), NaN for those turned away, a marker's
    size and how far it moves while the shutter is open, px."""

    uv: Array
    size_px: float
    smear_px: float


def expect(rig: Rig, handle: Handle, motion: Motion, p: FollowParameters) -> list[Expected]:
    """Where a motion predicts the markers, one a camera."""
    views, layout = views_of(rig), layout_of(handle)
    predicted = predict(_batch(motion.pose), views, layout)
    ahead = predict(_batch(shifted(motion.pose, p.exposure_s * motion.rates[:6])), views, layout)
    smear = np.linalg.norm(ahead.uv - predicted.uv, axis=2)[0].max(axis=1)
    facing = predicted.facing[0] > np.cos(np.deg2rad(SEEN_DEG))
    uv = np.where(facing[..., None], views.as_taken(predicted.uv)[0].transpose(0, 2, 1), np.nan)
    depths = np.maximum(predicted.points[0, :, 2].mean(axis=1), 1.0)
    sizes = handle.marker_diameter_mm * views.focal.max(axis=1) / depths
    return [Expected(*one) for one in zip(uv, sizes.tolist(), smear.tolist(), strict=True)]


def look(images: Sequence[np.ndarray], expected: Sequence[Expected], rig: Rig, handle: Handle,
         p: FollowParameters) -> list[Sight]:
    """Measure the markers where they are expected; half a marker's diameter off is near enough.

    A marker reaches further where it moves: by half of its way in the exposure.
    """
    return [_look(image, camera, handle, one.uv, 0.75 * one.size_px + RING_PX + one.smear_px / 2, p)
            for image, camera, one in zip(images, rig.cameras, expected, strict=True)]


def _look(image: np.ndarray, camera: Camera, handle: Handle, uv: Array, reach_px: float, p: FollowParameters) -> Sight:
    around = Window.around(np.clip(uv, -1e6, 1e6))
    window = around and around.grown(2 * reach_px).clipped(camera.size)
    if window is None:
        return Sight(None, np.full((len(uv), 6), np.nan))
    corner = np.array([window.u, window.v, 0, 0, 0, 0])
    return Sight(window, markers_at(window.crop(image), uv - corner[:2], reach_px, handle.markers, p.markers) + corner)


def _batch(T: RigidTransform) -> Poses:
    matrix = T.as_matrix()
    return Poses(matrix[None, :3, :3], matrix[None, :3, 3])


def follow(images: Sequence[np.ndarray], expected: Sequence[Expected], sights: Sequence[Sight], rig: Rig,
           handle: Handle, motion: Motion, p: FollowParameters, smeared: bool = False) -> Followed:
    """The pose of markers that were looked for where a motion predicts them.

    Where the estimator gives no pose, or another one than the markers agree on, the image model does: a single camera
    is enough for it. With `smeared` it is the image model of a handle that moves while the shutter is open, from the
    predicted pose: centroids are worth less than that when limb and neighbours are smeared together.
    """
    pixels = tuple(sight.found[:, :2] for sight in sights)
    T, labels = _agreed(list(pixels), rig, handle, motion.pose, p)
    if T is None and sum(np.isfinite(sight.found[:, 0]).sum() for sight in sights) < LEAST:
        return Followed(LOST, labels)  # it is elsewhere
    if smeared:
        fit = fit_patches(images, rig, handle, motion.pose, p.max_slant_deg, smear=_smear(motion, p))
        return Followed(_judged(fit, rig), labels)
    may_be_smeared = max(one.smear_px for one in expected) > SMEARED_PX or is_new(motion, p.motion)
    if may_be_smeared and _stretched(expected, sights):
        return Followed(LOST, labels)
    if T is not None and p.estimator != BEST:
        pose = _estimated(Identified(images, pixels, labels, T, _smear(motion, p)), rig, handle, p)
        if pose.T_world_handle is not None and not apart(pose.T_world_handle, T, APART_MM, AGREED_RAD):
            return Followed(pose, labels)
    fit = fit_patches(images, rig, handle, motion.pose if T is None else T, p.max_slant_deg)
    return Followed(LOST if may_be_smeared and not _clear(fit) else _judged(fit, rig), labels)


def _smear(motion: Motion, p: FollowParameters) -> tuple[Array, Array]:
    """The motion expected while the shutter is open, (6,), and its covariance, (6, 6); it may be wrong by some more."""
    spread = motion.covariance[6:12, 6:12] + np.diag(np.repeat([MORE_MM_S, MORE_RAD_S], 3) ** 2)
    return p.exposure_s * motion.rates[:6], p.exposure_s**2 * spread


def _stretched(expected: Sequence[Expected], sights: Sequence[Sight]) -> bool:
    """Whether in some camera most markers are longer than any disc of their size would be."""
    return any(np.nanmedian(sight.found[:, 2]) > STRETCHED * one.size_px
               for one, sight in zip(expected, sights, strict=True) if np.isfinite(sight.found[:, 2]).any())


def _clear(fit: Fit | None) -> bool:
    """Whether the image model of a handle that is still leaves nothing but noise."""
    return fit is not None and bool(fit.shown.sum() >= 4 and np.median(fit.misfit[fit.shown]) < CLEAR)


def _judged(fit: Fit | None, rig: Rig) -> Pose:
    """The image model's pose, if in some cameras most of what it predicts is there, and the windows agree on it."""
    if fit is None:
        return LOST
    cameras = fit.views.camera
    share = np.array([fit.shown[cameras == c].mean() if (cameras == c).any() else 0.0 for c in range(len(rig.cameras))])
    pose = judged(fit._replace(shown=fit.shown & (share > MOST)[cameras]))
    return pose if _sure(pose) and pose.residual_px < LEFT_PX else LOST


def _sure(pose: Pose) -> bool:
    return bool(pose.sigma_mm < SURE_MM and pose.sigma_deg < SURE_DEG)


def found_markers(sight: Sight) -> Markers:
    """What a camera shows, with a row for each marker; NaN where there is none."""
    table = sight.found
    return Markers(frozen(table[:, :2]), frozen(table[:, 2:4]), frozen(table[:, 4]), frozen(table[:, 5]), ())


def _agreed(pixels: list[Array], rig: Rig, handle: Handle, start: RigidTransform,
            p: FollowParameters) -> tuple[RigidTransform | None, tuple[np.ndarray, ...]]:
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


def _estimated(instant: Identified, rig: Rig, handle: Handle, p: FollowParameters) -> Pose:
    """The pose by the estimator, `LOST` if it is not sure; the paper's without the image model that checks an instant.

    The covariance of the paper's takes in the way to the pose that all pixels agree on.
    """
    if p.estimator != "paper_checked":
        pose = estimate(instant, rig, handle, p)
        return pose if _sure(pose) else LOST
    uv = labelled_pixels(instant.labels, instant.pixels, len(handle.marker_centres))
    pose = fit_pose(uv, rig, handle, p.max_slant_deg, p.sigma_px, instant.T_world_handle)
    if pose.T_world_handle is None or not _sure(pose):
        return LOST
    away = motion_between(pose.T_world_handle, instant.T_world_handle)
    return replace(pose, covariance=pose.covariance + np.outer(away, away))


def displacement(images: Sequence[np.ndarray], uv: Sequence[Array], size_px: Sequence[float], rig: Rig, handle: Handle,
                 centre: Array) -> tuple[Array, Array] | None:
    """By how much all of the handle has moved from where it was expected, if the cameras agree.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
    uv : sequence of ndarray, one a camera, shape (markers, 2)
        Where the markers are expected, px; NaN for those that are not.
    size_px : sequence of float
        Of a marker's image, one a camera.
    rig, handle
    centre : ndarray, shape (3,)
        Where the handle is expected, world frame, mm.

    Returns
    -------
    (ndarray, ndarray), shapes (3,) and (3, 3), or None
        The shift and its covariance, world frame, mm; None where fewer than two cameras agree.
    """
    shifts = [_shift(image, pixels, size, handle.markers)
              for image, pixels, size in zip(images, uv, size_px, strict=True)]
    seen = [c for c, shift in enumerate(shifts) if shift is not None]
    while len(seen) >= 2:
        J = np.concatenate([_by_position(rig, c, centre) for c in seen])
        wanted = np.concatenate([shifts[c] for c in seen])
        motion = np.linalg.lstsq(J, wanted, rcond=None)[0]
        left = np.linalg.norm((J @ motion - wanted).reshape(-1, 2), axis=1)
        if left.max() <= AGREE_PX:
            return motion, SIGMA_PX**2 * np.linalg.pinv(J.T @ J)
        seen.pop(int(left.argmax()))
    return None


def _by_position(rig: Rig, c: int, centre: Array) -> Array:
    """Derivative of a camera's pixel by a point's position, (2, 3), px/mm."""
    step = 0.5 * np.eye(3)
    ahead, behind = rig.cameras[c].project(centre + step), rig.cameras[c].project(centre - step)
    return np.nan_to_num((ahead - behind).T)


def _shift(image: np.ndarray, uv: Array, size_px: float, markers: str) -> Array | None:
    """The shift (2,), px, that puts most of the expected markers on spots; None if nothing stands out."""
    uv = uv[np.isfinite(uv).all(axis=1)]
    around = Window.around(np.clip(uv, -1e6, 1e6)) if len(uv) >= 2 else None
    window = around and around.grown(FURTHEST_PX + 2 * size_px).clipped((image.shape[1], image.shape[0]))
    if window is None or min(window.width, window.height) < 2 * COARSE:
        return None
    small = cv2.resize(window.crop(image).astype(np.float32), None, fx=1 / COARSE, fy=1 / COARSE,
                       interpolation=cv2.INTER_AREA)
    spots = _spots(small if markers == "bright" else -small, size_px / COARSE)
    if spots.max(initial=0.0) < DIMMEST:
        return None
    reach = FURTHEST_PX // COARSE
    padded = np.pad(spots, reach + 1)
    at = np.rint((uv - [window.u, window.v]) / COARSE - 0.5).astype(int) + reach + 1
    inside = ((at >= reach) & (at < np.array(padded.shape[::-1]) - reach)).all(axis=1)
    if inside.sum() < 2:
        return None
    score = np.add.reduce([padded[v - reach:v + reach + 1, u - reach:u + reach + 1] for u, v in at[inside].tolist()])
    v, u = np.unravel_index(score.argmax(), score.shape)
    return COARSE * (np.array([u, v], dtype=float) - reach)


def _spots(image: np.ndarray, size: float) -> np.ndarray:
    """How much a spot of a size stands out from its surroundings, at most as much as half the spots do."""
    near, wide = (cv2.GaussianBlur(image, (0, 0), sigma) for sigma in (max(size / 4, 0.6), max(size, 1.5)))
    out = np.maximum(near - wide, 0.0)
    return np.minimum(out, 0.5 * out.max(initial=0.0))
