"""Which of the handle's hypothetical poses hold, by what they explain, and which of those the images cannot tell apart.

Three markers in one image fix a pose; all further ones are evidence. What is found counts for more than what is not: a
hand may hide a marker, and nothing but a marker (or a coincidence) looks like one at the right place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..checks import Array, as_number
from .hypotheses import STEEP, Explained, Poses, predict
from .layout import Layout, Views

CHANCE = np.log(4e-8)  # of markers thrown at random within the gate to fit as well; thousands of poses are tried
PART = 0.7  # from so much of a missing marker on something is missing
DECIDED = 25.0  # variances by which the images must prefer one pose to another


@dataclass(frozen=True)
class IdentityParameters:
    """Parameters of the identification.

    Attributes
    ----------
    gate_px : float
        How far a found marker may lie from where a pose predicts it.
    sigma_px : float
        Standard deviation of a centroid's coordinate from where a pose predicts it, all biases included: of the
        detector, the calibration, the markers' places on the handle.
    min_markers : int
        Different markers that a pose must label; the paper asks for four.
    max_residual_px : float
        Largest residual, see `Hypothesis`.
    """

    gate_px: float = 4.0
    sigma_px: float = 0.3
    min_markers: int = 4
    max_residual_px: float = 0.8

    def __post_init__(self) -> None:
        as_number(self.gate_px, "gate_px", low=0.0, open_low=True)
        as_number(self.sigma_px, "sigma_px", low=0.0, open_low=True)
        as_number(self.min_markers, "min_markers", low=3)
        as_number(self.max_residual_px, "max_residual_px", low=0.0, open_low=True)


class Verdict(NamedTuple):
    """What is to be said of h poses.

    Attributes
    ----------
    labels : ndarray of int, shape (h, C, N)
        As explained, without those of cameras that do not go along with the pose.
    supports, against : ndarray of bool, shape (h, C)
        Whether a camera shows the pose, or something else in its place.
    residual_px : ndarray, shape (h,)
        See `identify.Hypothesis`.
    evidence : ndarray, shape (h,)
        Logarithm of the chance that markers thrown at random within the gate fit as well.
    possible, holds : ndarray of bool, shape (h,)
        Whether a pose fits, and whether that is more than a coincidence.
    """

    labels: np.ndarray
    supports: np.ndarray
    against: np.ndarray
    residual_px: Array
    evidence: Array
    possible: np.ndarray
    holds: np.ndarray


def judge(e: Explained, p: IdentityParameters) -> Verdict:
    """Say which poses hold.

    A camera supports a pose if it shows two of its markers or more, and more than it lacks. It speaks against the pose
    if it does not, and has found other things instead: where two markers or so should be, or a handle of its own. A
    pose holds if it labels enough different markers and fits them, if two cameras support it or one does and none
    speaks against it, and if that is no coincidence: by the number of markers and how well they fit, or because
    nothing that was found is left over and nothing is missing.
    """
    hits = e.hits
    alone = (hits >= 4) & (e.missing < PART) & (2 * e.strangers <= hits)
    alone &= (np.sqrt(e.squares.sum(axis=2) / np.maximum(2 * hits - 6, 1)) <= p.max_residual_px)
    by_itself = np.where(alone, hits, 0).max(axis=0, initial=0)  # what one handle explains in each camera
    goes_along = (hits > np.minimum(e.missing, e.strangers)) & (hits > by_itself - 2)
    supports = goes_along & (hits >= 2)
    labels = np.where(goes_along[..., None], e.labels, -1)
    count = (labels >= 0).sum(axis=(1, 2))
    freedom = np.maximum(2 * count - 6, 1)
    residual = np.sqrt(np.where(labels >= 0, e.squares, 0.0).sum(axis=(1, 2)) / freedom)
    against = ~supports & ((by_itself > 0) | ((e.missing >= 2 * PART) & (e.strangers > hits)))
    evidence = freedom * np.log(np.maximum(residual, 1e-3) / p.gate_px)
    complete = (e.strangers.sum(axis=1) == 0) & (e.lacking < PART) & (residual <= 1.5 * p.sigma_px)
    cameras = supports.sum(axis=1)
    possible = (residual <= p.max_residual_px) & (_different(labels) >= p.min_markers) & (2 * e.lacking <= count)
    possible &= (cameras >= 2) | ((cameras == 1) & ~against.any(axis=1))
    holds = possible & ((evidence <= CHANCE) | complete)
    return Verdict(labels, supports, against, residual, evidence, possible, holds)


def rivals(best: int, e: Explained, v: Verdict, misfit: Array, p: IdentityParameters) -> np.ndarray:
    """The possible poses that the images do not clearly refuse beside the best one, itself included; bool (h,).

    What a pose leaves over counts against it in full. What it lacks counts only if the best pose lacks nothing:
    otherwise something is hidden, and may hide that too.
    """
    variance = max(p.sigma_px, float(v.residual_px[best])) ** 2
    against = e.squares.sum(axis=(1, 2)) + p.sigma_px**2 * misfit + p.gate_px**2 * e.strangers.sum(axis=1)
    excused = (e.lacking[best] > PART) | (e.lacking < e.lacking[best] + 2 * PART)
    return np.asarray(v.possible & (against < against[best] + DECIDED * variance) & excused)


def shape_misfit(poses: Poses, labels: np.ndarray, views: Views, layout: Layout, axes: Array | None) -> Array:
    """How badly the labelled markers' sizes and roundness fit the poses, in variances, shape (h,).

    The longer axis is the marker's diameter at its distance, the shorter one is foreshortened by the slant. Both are
    known only roughly: blur and motion smear them. Zero without `axes`.
    """
    if axes is None:
        return np.zeros(len(labels))
    predicted = predict(poses, views, layout)
    nominal = layout.marker_mm * views.focal[:, :1] / predicted.points[:, :, 2]
    nominal, facing = (np.take_along_axis(part, labels, axis=2) for part in (nominal, predicted.facing))
    with np.errstate(invalid="ignore"):
        size = np.log(axes[..., 0] / nominal) / 0.2
        roundness = (axes[..., 1] / axes[..., 0] - np.maximum(facing, 0.2)) / 0.15
    terms = np.minimum(size**2, 9.0) + np.minimum(roundness**2, 9.0)
    return np.where((labels >= 0) & (facing > STEEP), terms, 0.0).sum(axis=(1, 2))


def _different(labels: np.ndarray) -> np.ndarray:
    """Number of different markers among labels (h, C, N), shape (h,)."""
    flat = np.sort(labels.reshape(len(labels), -1), axis=1)
    new = np.diff(flat, axis=1, prepend=-1) > 0
    return np.asarray(new.sum(axis=1))
