"""Hypotheses for the handle's pose: from triplets of points that fit the layout, judged by what they explain.

Three points that fit three markers of the layout give a pose; a pose predicts where each marker appears in each image.
"""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from .camera import Rig
from .checks import Array, as_array, as_points
from .handle import Handle, slant_angles

VISIBLE = np.deg2rad(75.0)  # a marker turned further away is not looked for
CERTAIN = np.deg2rad(50.0)  # a marker turned less than this should have been found


def triplet_poses(points: ArrayLike, covariances: ArrayLike, handle: Handle, sigmas: float = 3.0) -> RigidTransform:
    """Poses that carry three markers of the layout onto three of the points.

    Parameters
    ----------
    points : array_like, shape (m, 3)
        Candidate points, mm.
    covariances : array_like, shape (m, 3, 3)
        Of the points, mm^2: the sides of a triangle may differ from the layout's by `sigmas` standard deviations.
    handle : Handle
    sigmas : float

    Returns
    -------
    RigidTransform
        A batch of T_target_handle, possibly of length 0.

    Raises
    ------
    ValueError
        If a shape is wrong or a number is not finite.
    """
    points = as_points(points, "points", 3, finite=True)
    spread = np.trace(as_array(covariances, "covariances", (len(points), 3, 3)), axis1=1, axis2=2)
    corners, found = _layout_triplets(handle), _all_triplets(len(points))
    wanted = _sides(handle.marker_centres[corners])
    sides, slack = _sides(points[found]), sigmas * np.sqrt(spread[found] + spread[np.roll(found, -1, axis=1)])
    small = (sides < wanted.max(initial=0.0) + slack).all(axis=1)
    found, sides, slack = found[small], sides[small], slack[small]
    hits = [np.argwhere((np.abs(wanted - side) < tolerance).all(axis=1))[:, 0]
            for side, tolerance in zip(sides, slack, strict=True)]
    f = np.repeat(np.arange(len(found)), [len(hit) for hit in hits])
    c = np.concatenate([np.empty(0, dtype=int), *hits])
    return _frames(points[found[f]]) * _frames(handle.marker_centres[corners[c]]).inv()


def explain(motions: RigidTransform, rig: Rig, handle: Handle, found: tuple[Array, ...],
            gate_px: float) -> tuple[list[np.ndarray], Array, Array]:
    """Label the found markers by each of a batch of poses, and say how well it explains them.

    A found marker and a predicted one go together if each is the other's nearest and they lie within `gate_px`.

    Parameters
    ----------
    motions : RigidTransform
        A batch of T_world_handle, length h.
    rig, handle
    found : tuple of ndarray, one a camera, shape (n_c, 2)
    gate_px : float

    Returns
    -------
    labels : list of ndarray of int, one a camera, shape (h, n_c)
        Index on the handle, or -1.
    cost : ndarray, shape (h,)
        Sum of squared distances of the labelled markers, with ``gate_px**2`` for each marker without a label and for
        each that faces a camera (under 50 deg, inside the image) and was not found; px^2.
    residual_px : ndarray, shape (h,)
        Rms distance of the labelled markers; NaN without any.
    """
    R = motions.rotation.as_matrix()
    centres = handle.marker_centres @ R.transpose(0, 2, 1) + motions.translation[:, None]
    normals = handle.marker_normals @ R.transpose(0, 2, 1)
    labels, squares, missing = [], [], np.zeros(len(R))
    for camera, uv in zip(rig.cameras, found, strict=True):
        slant = slant_angles(centres, normals, camera.centre)
        predicted = camera.project(centres.reshape(-1, 3)).reshape(*slant.shape, 2)
        label, square = _mutual_nearest(np.where((slant < VISIBLE)[..., None], predicted, np.nan), uv, gate_px)
        expected = (slant < CERTAIN) & camera.sees(centres.reshape(-1, 3), margin_px=10.0).reshape(slant.shape)
        hit = (label[:, :, None] == np.arange(slant.shape[1])).any(axis=1)
        missing += (expected & ~hit).sum(axis=1)
        labels.append(label)
        squares.append(square)
    square = np.concatenate(squares, axis=1)
    cost = np.where(np.isnan(square), gate_px**2, square).sum(axis=1) + missing * gate_px**2
    count = np.isfinite(square).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return labels, cost, np.sqrt(np.nansum(square, axis=1) / count)


def _mutual_nearest(predicted: Array, uv: Array, gate_px: float) -> tuple[np.ndarray, Array]:
    """Labels (h, n) of found pixels (n, 2) by predictions (h, m, 2), and squared distances with NaN for no label."""
    square = ((predicted[:, :, None] - uv) ** 2).sum(axis=3)  # (h, m, n)
    square = np.where(square < gate_px**2, square, np.inf)
    marker = square.argmin(axis=1)
    best = np.take_along_axis(square, marker[:, None], axis=1)[:, 0]
    mutual = np.isfinite(best) & (best <= np.take_along_axis(square.min(axis=2, initial=np.inf), marker, axis=1))
    return np.where(mutual, marker, -1), np.where(mutual, best, np.nan)


def _all_triplets(n: int) -> np.ndarray:
    return np.array(list(combinations(range(n), 3)), dtype=int).reshape(-1, 3)


def _layout_triplets(handle: Handle, widest_deg: float = 125.0) -> np.ndarray:
    """Ordered triplets of markers that one viewpoint can see and that are not on a line, shape (k, 3).

    Of a symmetric layout only those that start at the first marker of an orbit: the others give equivalent poses.
    """
    centres, normals = handle.marker_centres, handle.marker_normals
    together = normals @ normals.T > np.cos(np.deg2rad(widest_deg))
    triplets = [t for t in permutations(range(len(centres)), 3)
                if together[t[0], t[1]] and together[t[0], t[2]] and together[t[1], t[2]]]
    array = np.array(triplets, dtype=int).reshape(-1, 3)
    a, b, c = (centres[array[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return array[np.isin(array[:, 0], _orbit_starts(handle)) & (area > 0.05 * handle.radius_mm**2)]


def _orbit_starts(handle: Handle) -> np.ndarray:
    """The markers that no symmetry carries to a marker with a lower index."""
    images = np.stack([S.apply(handle.marker_centres) for S in handle.symmetries])
    index = np.linalg.norm(images[:, :, None] - handle.marker_centres, axis=3).argmin(axis=2)
    return np.flatnonzero(index.min(axis=0) == np.arange(index.shape[1]))


def _sides(triangles: Array) -> Array:
    """Lengths of the sides 01, 12, 20 of triangles (k, 3, 3), shape (k, 3)."""
    return np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2)


def _frames(triangles: Array) -> RigidTransform:
    """A frame for each triangle (k, 3, 3): origin at its mean, x along 01, z across its plane."""
    x = triangles[:, 1] - triangles[:, 0]
    z = np.cross(x, triangles[:, 2] - triangles[:, 0])
    x, z = x / np.linalg.norm(x, axis=1, keepdims=True), z / np.linalg.norm(z, axis=1, keepdims=True)
    axes = np.stack([x, np.cross(z, x), z], axis=2)
    return RigidTransform.from_components(triangles.mean(axis=1), Rotation.from_matrix(axes))
