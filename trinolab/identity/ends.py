"""Which way round: the visible end of the body tells poses apart that show the same markers.

Turned end for end, the handle's body lies elsewhere along the axis. Beside the markers there are stretches of the axis
where one pose has the body and the other has not: there an image shows the body's two edges, or it does not. What an
edge looks like is learned where both have it, so the body may be brighter or darker than what is behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, Rig
from ..checks import Array
from ..handle import Handle

STEP_MM, REACH_MM = 1.5, 15.0  # between stations, and how far a stretch is looked at: a hand may hold what follows
SAMPLES = np.array([[0.55, 0.7, 0.85], [1.25, 1.45, 1.65]])  # inside and outside an edge, radii from the axis
RUN = 4  # stations in a row
FAINT = 8.0  # grey levels; an edge of less contrast shows nothing
CLEAR = 0.6  # of an edge's contrast: by so much a camera decides, by half of it it objects


def keep_by_body(images: Sequence[np.ndarray], rig: Rig, handle: Handle,
                 poses: Sequence[RigidTransform]) -> np.ndarray:
    """Which of several poses the body's visible end leaves; all where it does not decide clearly.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
        One a camera, in the rig's order.
    rig : Rig
    handle : Handle
    poses : sequence of RigidTransform
        T_world_handle, one or more.

    Returns
    -------
    ndarray of bool, shape (len(poses),)
    """
    spans, keep = _spans(handle, poses), np.ones(len(poses), dtype=bool)
    for a, b in combinations(np.unique(spans[np.isfinite(spans[:, 0])].round(), axis=0), 2):
        loser = _loser(images, rig, handle, poses[0], a, b)
        if loser is not None:
            keep &= (spans.round() != loser).any(axis=1)
    return keep


def _spans(handle: Handle, poses: Sequence[RigidTransform]) -> Array:
    """Where each body begins and ends on the first pose's axis, shape (k, 2), mm; NaN if its axis is another one."""
    points = np.array([[0.0, handle.bottom_mm, 0.0], [0.0, handle.top_mm, 0.0], [0.0, 0.0, 0.0]])
    matrices = np.linalg.inv(poses[0].as_matrix()) @ [pose.as_matrix() for pose in poses]
    local = points @ matrices[:, :3, :3].transpose(0, 2, 1) + matrices[:, None, :3, 3]  # (k, 3, 3)
    aside = np.hypot(local[..., 0], local[..., 2])
    same = (aside[:, :2].max(axis=1) < 0.05 * handle.length_mm) & (aside[:, 2] < 0.2 * handle.radius_mm)
    return np.where(same[:, None], np.sort(local[:, :2, 1], axis=1), np.nan)


def _loser(images: Sequence[np.ndarray], rig: Rig, handle: Handle, pose: RigidTransform, a: Array,
           b: Array) -> Array | None:
    """The span of two that the images refuse, or None."""
    common = max(a[0], b[0]), min(a[1], b[1])
    below, above = (_stretch(handle, edge, sign) for edge, sign in zip(common, (-1, 1), strict=True))
    if common[1] - common[0] < STEP_MM or (a[0] < b[0]) != (a[1] < b[1]):
        return None  # nothing to learn from, or one span within the other
    learned = _free_stations(handle, common)
    leads = [lead for camera, image in zip(rig.cameras, images, strict=True)
             if (lead := _lead(image, camera, handle, pose, learned, below, above)) is not None]
    lower, upper = (a, b) if a[0] < b[0] else (b, a)
    if max(leads, default=0.0) > CLEAR and min(leads) > -CLEAR / 2:
        return upper
    if min(leads, default=0.0) < -CLEAR and max(leads) < CLEAR / 2:
        return lower
    return None


def _stretch(handle: Handle, edge: float, sign: int) -> Array:
    """Stations beyond an end of the common part; the cap of a tilted body reaches a little over it."""
    return edge + sign * np.arange(0.7 * handle.radius_mm, max(REACH_MM, 2 * handle.radius_mm), STEP_MM)


def _free_stations(handle: Handle, common: tuple[float, float]) -> Array:
    """Stations in the common part that no marker touches, 40 mm from the markers at most."""
    axial = handle.marker_centres[:, 1]
    low, high = max(common[0] + 1, axial.min() - 40), min(common[1] - 1, axial.max() + 40)
    stations = np.arange(low, high, STEP_MM)
    return stations[(np.abs(stations[:, None] - axial) > handle.marker_diameter_mm / 2 + 1).all(axis=1)]


def _lead(image: np.ndarray, camera: Camera, handle: Handle, pose: RigidTransform, learned: Array, below: Array,
          above: Array) -> float | None:
    """By how much of an edge's contrast one camera prefers the body below to above; None if it shows no edges."""
    steps = _steps(image, camera, handle, pose, np.concatenate([learned, below, above]))
    known, rest = steps[:len(learned)], steps[len(learned):]
    known = known[np.isfinite(known).all(axis=1)]
    if len(known) < 3:
        return None
    contrast = np.median(known, axis=0)  # of the left and of the right edge
    if np.abs(contrast).min() < FAINT or (known / contrast < 0.5).mean(axis=0).max() > 0.2:
        return None  # no edges, or one lost in what is behind it
    share = np.clip(rest / contrast, -1.0, 1.5).min(axis=1)  # of a body both edges show
    first, second = _best_run(share[:len(below)]), _best_run(share[len(below):])
    return None if first is None or second is None else first - second


def _best_run(share: Array) -> float | None:
    """Largest mean of `RUN` stations in a row, 0 to 1: a hand may hide some; None without a run inside the image."""
    runs = np.convolve(share, np.full(RUN, 1 / RUN), mode="valid")
    runs = runs[np.isfinite(runs)]
    return float(np.clip(runs.max(), 0.0, 1.0)) if len(runs) else None


def _steps(image: np.ndarray, camera: Camera, handle: Handle, pose: RigidTransform, stations: Array) -> Array:
    """Grey inside minus outside the body's two edges at stations of the axis, shape (n, 2); NaN outside the image."""
    view = pose.inv().apply(camera.centre)
    across = np.array([view[2], 0.0, -view[0]])
    across *= handle.radius_mm / max(float(np.linalg.norm(across)), 1e-12)
    radii = np.multiply.outer([-1.0, 1.0], SAMPLES)  # (side, inside or outside, sample)
    points = stations[:, None] * [0.0, 1.0, 0.0] + (radii[..., None] * across).reshape(-1, 1, 3)
    uv = camera.project(pose.apply(points.reshape(-1, 3)))
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((uv > -0.5) & (uv < np.array(camera.size) - 0.5)).all(axis=1))
    u, v = np.where(inside[:, None], uv, 0.0).round().astype(int).T
    grey = np.where(inside, image[v, u].astype(float), np.nan).reshape(2, 2, SAMPLES.shape[1], -1).mean(axis=2)
    return (grey[:, 0] - grey[:, 1]).T
