"""Scores of the handle's hypothetical poses by what they explain, and those among them that the
images cannot tell apart.

Three markers in one image fix a pose; all further ones are evidence. A found marker counts for more
than a missing one: a hand may hide a marker, but only a marker (or a coincidence) looks like one at
the right place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..checks import Array
from .hypotheses import Explained, Observed, Poses, predict
from .parameters import IdentityParameters


class Verdict(NamedTuple):
    """Verdicts on h poses.

    Attributes
    ----------
    labels : ndarray of int, shape (h, C, N)
        As explained, without those of cameras that do not support the pose.
    supports, against : ndarray of bool, shape (h, C)
        Whether a camera shows the pose, or something else in its place.
    residual_px : ndarray, shape (h,)
        See `identify.Hypothesis`.
    evidence : ndarray, shape (h,)
        Logarithm of the chance that markers thrown at random within the gate fit as well.
    possible, holds : ndarray of bool, shape (h,)
        Whether a pose fits, and whether that is more than a coincidence.
    strained : ndarray of bool, shape (h,)
        Whether a pose explains more than a coincidence would, but does not fit: the file of the
        handle or of the rig is wrong.
    """

    labels: np.ndarray
    supports: np.ndarray
    against: np.ndarray
    residual_px: Array
    evidence: Array
    possible: np.ndarray
    holds: np.ndarray
    strained: np.ndarray


def judge(e: Explained, p: IdentityParameters) -> Verdict:
    """Say which poses hold.

    A camera supports a pose if it shows two of its markers or more, and more than it lacks. It
    speaks against the pose if it does not, and has found other things instead: where two markers or
    so should be, or a handle of its own. A pose holds if it labels enough different markers and
    fits them, if two cameras support it or one does and none speaks against it, and if that is no
    coincidence: by the number of markers and how well they fit, or because every found marker is
    explained and none is missing.
    """
    hits = e.hits
    # Cameras that show a handle by themselves, and how many of its markers at most.
    alone = (hits >= 4) & (e.missing < p.missing_share) & (2 * e.outliers <= hits)
    alone &= np.sqrt(e.squares.sum(axis=2) / np.maximum(2 * hits - 6, 1)) <= p.max_residual_px
    by_itself = np.where(alone, hits, 0).max(axis=0, initial=0)
    goes_along = (hits > np.minimum(e.missing, e.outliers)) & (hits > by_itself - 2)
    supports = goes_along & (hits >= 2)
    labels = np.where(goes_along[..., None], e.labels, -1)
    count = (labels >= 0).sum(axis=(1, 2))
    freedom = np.maximum(2 * count - 6 - e.spared, 1)
    residual = np.sqrt(np.where(labels >= 0, e.squares, 0.0).sum(axis=(1, 2)) / freedom)
    other_things = (e.missing >= 2 * p.missing_share) & (e.outliers > hits)
    against = ~supports & ((by_itself > 0) | other_things)
    evidence = freedom * np.log(np.maximum(residual, 1e-3) / p.gate_px)
    complete = explains_all(e, p) & (residual <= 1.5 * p.sigma_px)
    cameras = supports.sum(axis=1)
    fits = residual <= p.max_residual_px
    enough = (_different(labels) >= p.min_markers) & (2 * e.lacking <= count)
    enough &= (cameras >= 2) | ((cameras == 1) & ~against.any(axis=1))
    possible = fits & enough
    no_chance = evidence <= np.log(p.chance)
    holds = possible & (no_chance | complete)
    strained = ~fits & enough & no_chance
    return Verdict(labels, supports, against, residual, evidence, possible, holds, strained)


def explains_all(e: Explained, p: IdentityParameters) -> np.ndarray:
    """Whether a pose explains every found marker and misses none; bool (h,)."""
    return np.asarray((e.outliers.sum(axis=1) == 0) & (e.lacking < p.missing_share))


def rivals(best: int, e: Explained, v: Verdict, misfit: Array, p: IdentityParameters) -> np.ndarray:
    """The possible poses that the images do not clearly refuse beside the best one, itself
    included, and the strained ones; bool (h,). A strained one with the best one's labels is the best
    one, not quite fitted.

    Unexplained found markers count against a pose in full. Missing markers count only if the best
    pose misses none: otherwise something hides markers, and may hide those as well.
    """
    variance = max(p.sigma_px, float(v.residual_px[best])) ** 2
    against = (
        e.squares.sum(axis=(1, 2)) + p.sigma_px**2 * misfit + p.gate_px**2 * e.outliers.sum(axis=1)
    )
    excused = e.lacking[best] > p.missing_share
    excused |= e.lacking < e.lacking[best] + 2 * p.missing_share
    close = against < against[best] + p.decisive_variances * variance
    strained = v.strained & (v.labels != v.labels[best]).any(axis=(1, 2))
    return np.asarray((v.possible | strained) & close & excused)


def shape_misfit(
    poses: Poses, labels: np.ndarray, observed: Observed, p: IdentityParameters
) -> Array:
    """Misfit of the labelled markers' sizes and roundness to the poses, in variances, shape (h,).

    The longer axis is the marker's diameter at its distance, the shorter one is foreshortened by
    the slant. Both are known only roughly: blur and motion blur change them. Zero without axes.
    """
    views, layout, _, axes = observed[:4]
    if axes is None:
        return np.zeros(len(labels))
    predicted = predict(poses, views, layout)
    nominal = layout.marker_mm * views.focal[:, :1] / predicted.points[:, :, 2]
    nominal = np.take_along_axis(nominal, labels, axis=2)
    facing = np.take_along_axis(predicted.facing, labels, axis=2)
    with np.errstate(invalid="ignore"):
        size = np.log(axes[..., 0] / nominal) / p.size_sigma
        roundness = (axes[..., 1] / axes[..., 0] - np.maximum(facing, 0.2)) / p.roundness_sigma
    # No marker counts more than three standard deviations: one of another shape is no proof.
    terms = np.minimum(size**2, 9.0) + np.minimum(roundness**2, 9.0)
    return np.where((labels >= 0) & (facing > np.cos(np.deg2rad(p.steep_deg))), terms, 0.0).sum(
        axis=(1, 2)
    )


def _different(labels: np.ndarray) -> np.ndarray:
    """Number of different markers among labels (h, C, N), shape (h,)."""
    flat = np.sort(labels.reshape(len(labels), -1), axis=1)
    new = np.diff(flat, axis=1, prepend=-1) > 0
    return np.asarray(new.sum(axis=1))
