"""How the spots of two images can be paired: by the line alone, by the looks alone, by the best set,
by the view of the third camera, by the paper's four constraints and by the layout.
``data/tables/match_rivals.py`` makes the table. Chapter 6.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import RigidTransform

from trinolab.camera import Rig
from trinolab.checks import Array
from trinolab.handle import Handle, slants
from trinolab.matching import Matches, confirmed
from trinolab.pose import rigid_fit
from trinolab.triangulation import triangulate_pair

from .claim_trials import true_labels
from .ground_truth import Instant

FACING_DEG = 70.0  # a marker that is turned away further need not be paired
# Distance of a third camera's spot, in epipolar gates. Of 0.5, 0.75, 1, 1.5, 2, 3 and 4 those from 1.5 on
# have the least mean error of the pose, to 0.1 %, on `calm`, seed 0, where every instant has a pose.
TOLERANCE = 2.0


class Spots(NamedTuple):
    """What a rule is given of two images.

    Attributes
    ----------
    distance_px : ndarray, shape (n, m)
        Distance of each right spot from each left one's line, px (Eq. 17).
    ncc : ndarray, shape (n, m)
        Correlation of their windows (Eq. 18).
    """

    distance_px: Array
    ncc: Array


class Shot(NamedTuple):
    """An instant, the spots in it, and the truth.

    Attributes
    ----------
    now : Instant
    uv : tuple of ndarray, shape (n, 2)
        The spots of each camera, px.
    labels : tuple of ndarray of int, shape (n,)
        The true marker of each spot, -1 for none.
    facing : tuple of set of int
        The markers among these that face the camera.
    handle : Handle
    """

    now: Instant
    uv: tuple[Array, ...]
    labels: tuple[np.ndarray, ...]
    facing: tuple[set[int], ...]
    handle: Handle


def both_directions(score: Array, allowed: np.ndarray) -> np.ndarray:
    """The pairs, shape (k, 2), that are allowed and of which neither spot has a better partner."""
    scores = np.where(allowed, score, -np.inf)
    best_of_row = scores == scores.max(axis=1, keepdims=True, initial=-np.inf)
    best_of_column = scores == scores.max(axis=0, keepdims=True, initial=-np.inf)
    return np.argwhere(allowed & best_of_row & best_of_column)


def by_line(spots: Spots, gate_px: float) -> np.ndarray:
    """Nearest to the line, in both directions; no grey levels."""
    return both_directions(-spots.distance_px, spots.distance_px < gate_px)


def by_looks(spots: Spots, gate_px: float) -> np.ndarray:
    """Most alike of those near the line, in both directions."""
    return both_directions(spots.ncc, spots.distance_px < gate_px)


def best_set(spots: Spots, gate_px: float) -> np.ndarray:
    """The set without a spot twice whose sum of S - D / gate is the largest."""
    score = spots.ncc - spots.distance_px / gate_px
    value = np.where(spots.distance_px < gate_px, score, 0.0)
    pairs = np.column_stack(linear_sum_assignment(-np.maximum(value, 0.0)))
    return pairs[value[tuple(pairs.T)] > 0]


RULES: Mapping[str, Callable[[Spots, float], np.ndarray]] = {
    "line": by_line,
    "looks": by_looks,
    "best set": best_set,
}


def by_third_view(
    shot: Shot, rig: Rig, i: int, j: int, spots: Spots, gate_px: float, tolerance_px: float
) -> np.ndarray:
    """Near the line, and the point on a spot of the third of three cameras; no grey levels."""
    order = (i, j, 3 - i - j)
    near = np.argwhere(spots.distance_px < gate_px)
    matches = Matches(near, *(values[tuple(near.T)] for values in spots))
    cameras, uv = [rig.cameras[k] for k in order], [shot.uv[k] for k in order]
    return confirmed(matches, cameras, uv, tolerance_px).index


def by_layout(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The pairs, shape (k, 2), of spots that were given the same marker, -1 for none."""
    return np.argwhere((left[:, None] == right) & (left[:, None] >= 0))


def shot_of(now: Instant, rig: Rig, uv: tuple[Array, ...], handle: Handle) -> Shot:
    """Ask the truth what each spot is."""
    labels, facing = [], []
    for camera, spots in zip(rig.cameras, uv, strict=True):
        label = true_labels(camera, handle, now.T_world_handle, spots)
        slant = slants(handle, now.T_world_handle, camera.centre)
        labels.append(label)
        facing.append({int(k) for k in label if k >= 0 and slant[k] <= np.deg2rad(FACING_DEG)})
    return Shot(now, uv, tuple(labels), tuple(facing), handle)


def counts(shot: Shot, i: int, j: int, pairs: np.ndarray) -> dict[str, int]:
    """Pairs of cameras i and j against the truth: how many are `given`, and `wrong`; how many are
    `due`, and `missing`.
    """
    left, right = shot.labels[i][pairs[:, 0]], shot.labels[j][pairs[:, 1]]
    is_right = (left == right) & (left >= 0)
    due = shot.facing[i] & shot.facing[j]
    return {
        "given": len(pairs),
        "wrong": int(np.sum(~is_right)),
        "due": len(due),
        "missing": len(due - {int(k) for k in left[is_right]}),
    }


def pose_by_pairs(
    shot: Shot, rig: Rig, pairs: Mapping[tuple[int, int], np.ndarray]
) -> RigidTransform | None:
    """Pose from the pairs of each two cameras by the paper's way, the truth naming the left spots; None
    if there are too few (Eq. 20-24).
    """
    points: list[list[Array]] = [[] for _ in shot.handle.marker_centres]
    for (i, j), index in pairs.items():
        a, b = index.T
        found = triangulate_pair(rig.cameras[i], rig.cameras[j], shot.uv[i][a], shot.uv[j][b])
        for marker, point in zip(shot.labels[i][a], found, strict=True):
            if marker >= 0 and np.isfinite(point).all():
                points[marker].append(point)
    means = [np.mean(some, axis=0) if some else np.full(3, np.nan) for some in points]
    return rigid_fit(shot.handle.marker_centres, means)
