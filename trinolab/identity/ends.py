"""The direction of the handle's axis: the visible end of the body tells poses apart that show the
same markers.

In a pose that is turned end for end, the body lies elsewhere along the axis. On some stretches of
the axis, beside the markers, only one of the two poses has the body; an image shows the body's two
edges there, or it does not. The appearance of an edge is learned where both poses have it, so that
the body may be brighter or darker than its background.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig
from ..checks import Array
from ..handle import Handle
from .parameters import IdentityParameters

# Where the intensity is sampled inside and outside of an edge, in radii from the axis.
SAMPLES = np.array([[0.55, 0.7, 0.85], [1.25, 1.45, 1.65]])


class Stations(NamedTuple):
    """Places on the axis of the body, mm: of the part that two poses share, and of what follows
    below and above it.
    """

    shared: Array
    below: Array
    above: Array


def keep_by_body(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    poses: Sequence[RigidTransform],
    parameters: IdentityParameters | None = None,
) -> np.ndarray:
    """The poses that agree with the body's visible end, bool; all where it does not decide clearly.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
        One per camera, in the rig's order.
    rig : Rig
    handle : Handle
    poses : sequence of RigidTransform
        T_world_handle, one or more.
    parameters : IdentityParameters, optional

    Returns
    -------
    ndarray of bool, shape (len(poses),)
    """
    p = parameters or IdentityParameters()
    spans = _spans(handle, poses)
    keep = np.ones(len(poses), dtype=bool)
    for a, b in combinations(np.unique(spans[np.isfinite(spans[:, 0])].round(), axis=0), 2):
        loser = _loser(images, rig, handle, poses[0], a, b, p)
        if loser is not None:
            keep &= (spans.round() != loser).any(axis=1)
    return keep


def _spans(handle: Handle, poses: Sequence[RigidTransform]) -> Array:
    """Both ends of each body on the first pose's axis, shape (k, 2), mm; NaN if its axis is another
    one.
    """
    points = np.array([[0.0, handle.bottom_mm, 0.0], [0.0, handle.top_mm, 0.0], [0.0, 0.0, 0.0]])
    matrices = np.linalg.inv(poses[0].as_matrix()) @ [pose.as_matrix() for pose in poses]
    local = points @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]  # (k, 3, 3)
    aside = np.hypot(local[..., 0], local[..., 2])
    same = aside[:, :2].max(axis=1) < 0.05 * handle.length_mm
    same &= aside[:, 2] < 0.2 * handle.radius_mm
    return np.where(same[:, None], np.sort(local[:, :2, 1], axis=1), np.nan)


def _loser(
    images: Sequence[np.ndarray],
    rig: Rig,
    handle: Handle,
    pose: RigidTransform,
    a: Array,
    b: Array,
    p: IdentityParameters,
) -> Array | None:
    """The span of two that the images refuse, or None."""
    low = max(a[0], b[0])
    high = min(a[1], b[1])
    if high - low < p.end_step_mm or (a[0] < b[0]) != (a[1] < b[1]):
        return None  # nothing to learn from, or one span within the other
    shared = _free_stations(handle, low, high, p)
    stations = Stations(shared, _stretch(handle, low, -1, p), _stretch(handle, high, 1, p))
    leads = [
        lead
        for camera, image in zip(rig.cameras, images, strict=True)
        if (lead := _lead(image, camera, handle, pose, stations, p)) is not None
    ]
    lower, upper = (a, b) if a[0] < b[0] else (b, a)
    if max(leads, default=0.0) > p.end_lead and min(leads) > -p.end_lead / 2:
        return upper
    if min(leads, default=0.0) < -p.end_lead and max(leads) < p.end_lead / 2:
        return lower
    return None


def _stretch(handle: Handle, edge: float, sign: int, p: IdentityParameters) -> Array:
    """Stations beyond an end of the common part; the cap of a tilted body reaches a little over
    it.
    """
    reach = max(p.end_reach_mm, 2 * handle.radius_mm)
    return edge + sign * np.arange(0.7 * handle.radius_mm, reach, p.end_step_mm)


def _free_stations(handle: Handle, low: float, high: float, p: IdentityParameters) -> Array:
    """Stations between two ends that no marker touches, 40 mm from the markers at most."""
    axial = handle.marker_centres[:, 1]
    stations = np.arange(
        max(low + 1, axial.min() - 40), min(high - 1, axial.max() + 40), p.end_step_mm
    )
    return stations[
        (np.abs(stations[:, None] - axial) > handle.marker_diameter_mm / 2 + 1).all(axis=1)
    ]


def _lead(
    image: np.ndarray,
    camera: Camera,
    handle: Handle,
    pose: RigidTransform,
    stations: Stations,
    p: IdentityParameters,
) -> float | None:
    """Share of an edge's contrast by which one camera prefers the body below to above; None if it
    shows no edges.
    """
    steps = _steps(image, camera, handle, pose, np.concatenate(stations))
    shared = steps[: len(stations.shared)]
    shared = shared[np.isfinite(shared).all(axis=1)]
    if len(shared) < 3:
        return None
    contrast = np.median(shared, axis=0)  # of the left and of the right edge
    if (
        np.abs(contrast).min() < p.end_contrast
        or (shared / contrast < 0.5).mean(axis=0).max() > 0.2
    ):
        return None  # no edges, or one lost in what is behind it
    # of a body both edges show
    share = np.clip(steps[len(stations.shared) :] / contrast, -1.0, 1.5).min(axis=1)
    below = _best_run(share[: len(stations.below)], p.end_run)
    above = _best_run(share[len(stations.below) :], p.end_run)
    return None if below is None or above is None else below - above


def _best_run(share: Array, length: int) -> float | None:
    """Largest mean of some stations in a row, 0 to 1: a hand may hide some; None without a run
    inside the image.
    """
    if len(share) < length:
        return None
    runs = np.convolve(share, np.full(length, 1 / length), mode="valid")
    runs = runs[np.isfinite(runs)]
    return float(np.clip(runs.max(), 0.0, 1.0)) if len(runs) else None


def _steps(
    image: np.ndarray, camera: Camera, handle: Handle, pose: RigidTransform, stations: Array
) -> Array:
    """Intensity inside minus outside the body's two edges at stations of the axis, (n, 2); NaN
    outside the image.
    """
    view = pose.inv().apply(camera.centre)
    across = np.array([view[2], 0.0, -view[0]])
    across *= handle.radius_mm / max(float(np.linalg.norm(across)), 1e-12)
    radii = np.multiply.outer([-1.0, 1.0], SAMPLES)  # (side, inside or outside, sample)
    points = stations[:, None] * [0.0, 1.0, 0.0] + (radii[..., None] * across).reshape(-1, 1, 3)
    uv = camera.project(pose.apply(points.reshape(-1, 3)))
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((uv > -0.5) & (uv < np.array(camera.size) - 0.5)).all(axis=1))
    u, v = np.where(inside[:, None], uv, 0.0).round().astype(int).T
    intensity = np.where(inside, image[v, u].astype(float), np.nan)
    # (side, inside or outside, station)
    mean = intensity.reshape(2, 2, SAMPLES.shape[1], -1).mean(axis=2)
    return (mean[:, 0] - mean[:, 1]).T
