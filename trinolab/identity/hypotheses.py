"""Hypotheses for the handle's pose, many at once: what each predicts, what it explains, its fit to
what it explains.

A pose predicts where each marker's centroid appears in each image. Images are meant without lens
distortion throughout. Arrays have the axes h poses, C cameras, n markers of the handle, N markers
found (of the camera with the most).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..camera import Rig
from ..checks import Array
from ..sensitivity import ImageOffsets
from .layout import Layout, Views
from .parameters import IdentityParameters

# px; where a marker stands that was not found: near nothing.
FAR = 1e9
# chi-square of offsets of the cameras' images up to which the rig's covariance explains them: with
# three degrees of freedom, as three cameras have, one instant in 100,000 has more
GRANTED = 25.0


class Poses(NamedTuple):
    """A batch of T_world_handle: rotations (h, 3, 3), translations (h, 3), mm."""

    rotations: Array
    translations: Array

    def take(self, index: np.ndarray) -> Poses:
        return Poses(self.rotations[index], self.translations[index])


class Observed(NamedTuple):
    """The markers found at one instant, and the rig and the handle that they are compared with.

    Attributes
    ----------
    views : Views
    layout : Layout
    uv : ndarray, shape (C, 2, N)
        Pixels of the found markers, see `ideal_pixels`.
    axes : ndarray, shape (C, N, 2), or None
        Major and minor axes of their images, px.
    pairs : sequence of (int, int)
        Of the cameras.
    matches : sequence of ndarray of int, or None
        For each pair the found markers, shape (k, 2), that may be the same one; None if unknown.
    offsets : ImageOffsets, optional
        Possible shifts of the images against each other by the rig's errors.
    """

    views: Views
    layout: Layout
    uv: Array
    axes: Array | None = None
    pairs: Sequence[tuple[int, int]] = ()
    matches: Sequence[np.ndarray] | None = None
    offsets: ImageOffsets | None = None

    def only(self, camera: int) -> Observed:
        """The observations of one camera alone."""
        axes = None if self.axes is None else self.axes[[camera]]
        return Observed(self.views.only(camera), self.layout, self.uv[[camera]], axes)

    def axes_of(self, camera: int) -> Array | None:
        """Axes of one camera's markers, shape (N, 2)."""
        return None if self.axes is None else self.axes[camera]


class Predicted(NamedTuple):
    """Predicted images of poses: centroids in pixels (h, C, 2, n), the cosines of the slants (h, C,
    n), and the points in the cameras' frames of which the centroids are images (h, C, 3, n), mm.
    """

    uv: Array
    facing: Array
    points: Array


class Explained(NamedTuple):
    """The observations that poses explain.

    Attributes
    ----------
    labels : ndarray of int, shape (h, C, N)
        For each found marker its index on the handle, or -1.
    squares : ndarray, shape (h, C, N)
        Weighted squared distances of the labelled markers from where they are predicted, px^2; 0
        for the others.
    missing : ndarray, shape (h, C)
        Expected markers that were not found; the steeper one is, the less it counts.
    outliers : ndarray of int, shape (h, C)
        Found markers without a label.
    cost : ndarray, shape (h,)
        Sum of the squares, and the gate's square for each outlier and for each missing marker,
        px^2. A camera counts at most as many missing ones as it labels, because it may be covered,
        or see another object.
    spared : ndarray of int, shape (h,)
        Degrees of freedom of the squares that went into offsets of the images.
    """

    labels: np.ndarray
    squares: Array
    missing: Array
    outliers: np.ndarray
    cost: Array
    spared: np.ndarray

    def take(self, index: np.ndarray) -> Explained:
        return Explained(*(part[index] for part in self))

    @property
    def hits(self) -> np.ndarray:
        """Labelled markers by camera, shape (h, C)."""
        return np.asarray((self.labels >= 0).sum(axis=2))

    @property
    def lacking(self) -> Array:
        """The missing markers that the cost counts, shape (h,)."""
        return np.minimum(self.missing, self.hits).sum(axis=1)


def ideal_pixels(rig: Rig, found: Sequence[Array]) -> Array:
    """Found pixels without lens distortion, one array for all cameras, shape (C, 2, N); `FAR` where
    there is none.
    """
    uv = np.full((len(found), 2, max(map(len, found))), FAR)
    for row, camera, pixels in zip(uv, rig.cameras, found, strict=True):
        ideal = camera.ideal_pixels(pixels) if camera.distortions.any() else pixels
        row[:, : len(pixels)] = np.where(np.isfinite(ideal), ideal, FAR).T
    return uv


def predict(poses: Poses, views: Views, layout: Layout) -> Predicted:
    """The markers' centroids that poses predict, to first order in a marker's size."""
    h = len(poses.rotations)
    C = len(views.rotations)
    n = len(layout.centres)
    rotations = views.rotations @ poses.rotations[:, None]  # (h, C, 3, 3)
    vectors = np.concatenate([layout.centres, layout.normals, layout.tangents])
    # (h, C, axis, vector, n)
    turned = (rotations.reshape(-1, 3) @ vectors.T).reshape(h, C, 3, 3, n)
    arm, normal, tangent = turned.transpose(3, 0, 1, 2, 4)
    X = arm + _origins(poses, views)[..., None]
    towards = -(normal * X).sum(axis=2)
    across = -(tangent * X).sum(axis=2)
    slant = np.arctan2(np.abs(across), towards)
    along = np.interp(slant, layout.slants, layout.shift[0])
    aside = np.copysign(np.interp(slant, layout.slants, layout.shift[1]), across)
    points = X + along[:, :, None] * normal + aside[:, :, None] * tangent
    facing = np.where(points[:, :, 2] > 0, towards / np.sqrt((X * X).sum(axis=2)), -1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        uv = (
            points[:, :, :2] / points[:, :, 2:] * views.focal[:, :, None]
            + views.principal[:, :, None]
        )
    return Predicted(uv, facing, points)


def explain(poses: Poses, observed: Observed, gate_px: float, p: IdentityParameters) -> Explained:
    """Label the found markers by each pose, and say how well it explains them.

    A found marker and a predicted one are matched if each is the other's nearest and they lie
    within `gate_px`. The offsets of the images are removed from their squared distances as far as
    the rig's covariance allows.
    """
    views, layout, uv = observed[:3]
    predicted = predict(poses, views, layout)
    visible = np.where(predicted.facing[:, :, None] > layout.limb, predicted.uv, -FAR)
    labels, squares = _mutual_nearest(visible, uv, gate_px)
    spared = np.zeros(len(labels), int)
    if observed.offsets is not None:
        squares, spared = _without_offsets(predicted.uv, labels, uv, observed.offsets, p)
    squares *= np.take_along_axis(weights(predicted.facing, p), labels, axis=2)
    missing = _unseen(predicted, labels, views, layout, p)
    outliers = ((labels < 0) & (uv[:, 0] < FAR)).sum(axis=2)
    explained = Explained(labels, squares, missing, outliers, squares.sum(axis=(1, 2)), spared)
    explained.cost[:] += gate_px**2 * (explained.lacking + outliers.sum(axis=1))
    return explained


def _without_offsets(
    predicted: Array, labels: np.ndarray, uv: Array, offsets: ImageOffsets, p: IdentityParameters
) -> tuple[Array, np.ndarray]:
    """Squared distances (h, C, N) of labelled markers without the images' offsets, and how many
    degrees of freedom (h,) these took.

    An image's offset is the mean of its distances. All of it is granted, unless the offsets
    together are less likely than `GRANTED`: what a motion of the handle explains is free.
    """
    h, C, _ = labels.shape
    labelled = labels >= 0
    expected = np.take_along_axis(predicted, np.maximum(labels, 0)[:, :, None], axis=3)
    away = np.where(labelled[:, :, None], uv - expected, 0.0)  # (h, C, 2, N)
    count = labelled.sum(axis=2)
    mean = away.sum(axis=3) / np.maximum(count, 1)[..., None]
    noise = np.where(count > 0, p.sigma_px**2 / np.maximum(count, 1), FAR)
    V = offsets.covariance + np.repeat(noise, 2, axis=1)[..., None] * np.eye(2 * C)
    J = offsets.by_position
    W = np.linalg.inv(V)
    WJ = W @ J
    # a single camera leaves the distance free: a metre is as good as infinity
    P = W - WJ @ np.linalg.solve(J.T @ WJ + 1e-6 * np.eye(3), WJ.transpose(0, 2, 1))
    flat = mean.reshape(h, 2 * C)
    chi_square = np.einsum("hi,hij,hj->h", flat, P, flat)
    share = np.sqrt(np.minimum(GRANTED / np.maximum(chi_square, 1e-12), 1.0))
    residuals = np.where(labelled[:, :, None], away - (share[:, None, None] * mean)[..., None], 0.0)
    spared = np.maximum(2 * (count > 0).sum(axis=1) - 3, 0)
    return (residuals * residuals).sum(axis=2), spared


def _unseen(
    predicted: Predicted, labels: np.ndarray, views: Views, layout: Layout, p: IdentityParameters
) -> Array:
    """Markers that should have been found and have no label, shape (h, C): whole inside the image,
    not too steep.
    """
    steep, certain = np.cos(np.deg2rad([p.steep_deg, p.certain_deg]))
    expected = np.clip((predicted.facing - steep) / (certain - steep), 0.0, 1.0)
    margin = p.edge_px + layout.marker_mm / 2 * views.focal[:, :1] / predicted.points[:, :, 2]
    expected *= views.inside(predicted.uv, margin)
    # One more column takes the label -1.
    missed = np.concatenate([expected, np.zeros((*expected.shape[:2], 1))], axis=2)
    np.put_along_axis(missed, labels, 0.0, axis=2)
    return np.asarray(missed.sum(axis=2))


def fit(
    poses: Poses, labels: np.ndarray, observed: Observed, p: IdentityParameters, steps: int = 1
) -> Poses:
    """Move each pose by Gauss-Newton steps towards the markers that it labels, large residuals held
    back (Huber).
    """
    views, layout, uv = observed[:3]
    h = len(poses.rotations)
    C = len(views.rotations)
    n = len(layout.centres)
    target = np.full((h, C, 2, n + 1), np.nan)  # one more column takes the label -1
    np.put_along_axis(
        target,
        np.repeat(labels[:, :, None], 2, axis=2),
        np.broadcast_to(uv, (h, *uv.shape)),
        axis=3,
    )
    for _ in range(steps):
        predicted = predict(poses, views, layout)
        poses = _stepped(poses, target[..., :n] - predicted.uv, predicted, views, p)
    return poses


def _stepped(
    poses: Poses, error: Array, predicted: Predicted, views: Views, p: IdentityParameters
) -> Poses:
    """One Gauss-Newton step for errors (h, C, 2, n); NaN counts nothing. Slightly damped: little
    may be determined.
    """
    size = np.sqrt((error * error).sum(axis=2))
    weight = np.where(np.isfinite(size), weights(predicted.facing, p) / np.maximum(size, 1.0), 0.0)
    slope = slopes(poses, predicted.points, views).reshape(len(size), -1, 6)
    weighted = slope * np.repeat(weight.reshape(len(size), -1), 2, axis=1)[..., None]
    error = np.where(np.isfinite(error), error, 0.0).transpose(0, 1, 3, 2).reshape(len(size), -1, 1)
    right = weighted.transpose(0, 2, 1) @ error
    normal = weighted.transpose(0, 2, 1) @ slope
    diagonal = range(6)
    normal[:, diagonal, diagonal] = normal[:, diagonal, diagonal] * (1 + 1e-6) + 1e-6
    step = np.linalg.solve(normal, right)[..., 0]
    turn = Rotation.from_rotvec(step[:, 3:]).as_matrix()
    return Poses(turn @ poses.rotations, poses.translations + step[:, :3])


def slopes(poses: Poses, points: Array, views: Views) -> Array:
    """Derivatives of the pixels, (h, C, n, 2, 6), by translation and rotation vector about the
    handle's origin (world frame).
    """
    x, y, z = points.transpose(2, 0, 1, 3)[..., None]  # each (h, C, n, 1)
    right, down, ahead = views.rotations.transpose(1, 0, 2)[:, :, None]  # each (C, 1, 3)
    fx, fy = views.focal.T[:, :, None, None]
    # (h, C, n, 2, 3)
    by_shift = np.stack([fx / z * (right - x / z * ahead), fy / z * (down - y / z * ahead)], axis=3)
    # world frame
    arms = (points - _origins(poses, views)[..., None]).transpose(0, 1, 3, 2) @ views.rotations
    a, b, c = np.moveaxis(arms[:, :, :, None], -1, 0)
    u, v, w = np.moveaxis(by_shift, -1, 0)
    return np.concatenate(
        [by_shift, np.stack([b * w - c * v, c * u - a * w, a * v - b * u], axis=-1)], axis=4
    )


def _origins(poses: Poses, views: Views) -> Array:
    """The handle's origin in the cameras' frames, (h, C, 3)."""
    return (
        poses.translations @ views.rotations.transpose(0, 2, 1) + views.translations[:, None]
    ).transpose(1, 0, 2)


def weights(facing: Array, p: IdentityParameters) -> Array:
    """Weights of squared distances by the cosine of the slant: at the body's limb a centroid
    depends on everything.
    """
    return np.clip(facing / np.cos(np.deg2rad(p.steep_deg)), 0.1, 1.0)


def _mutual_nearest(predicted: Array, uv: Array, gate_px: float) -> tuple[np.ndarray, Array]:
    """Labels (h, C, N) of found pixels (C, 2, N) by predictions (h, C, 2, n), and squared
    distances, 0 for no label.
    """
    square = (predicted[:, :, 0, :, None] - uv[:, 0, None]) ** 2
    square += (predicted[:, :, 1, :, None] - uv[:, 1, None]) ** 2  # (h, C, n, N)
    marker = square.argmin(axis=2)
    best = np.take_along_axis(square, marker[:, :, None], axis=2)[:, :, 0]
    mutual = (best < gate_px**2) & (
        best <= np.take_along_axis(square.min(axis=3, initial=np.inf), marker, axis=2)
    )
    return np.where(mutual, marker, -1), np.where(mutual, best, 0.0)
