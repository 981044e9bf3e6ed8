"""Which found marker is which marker of the handle: hypotheses from triplets of points, verified in every image.

The paper assumes that this is known. Three points that fit three markers of the layout give a pose; the pose predicts
where every marker appears; the pose that explains most of what was found wins. A layout with symmetry has several such
poses: the prior chooses, or the choice is reported as open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .camera import Rig
from .checks import Array, as_number, as_transform
from .handle import Handle
from .hypotheses import explain, triplet_poses
from .pose import rigid_fit
from .triangulation import triangulate


@dataclass(frozen=True)
class IdentityParameters:
    """Parameters of the identification.

    Attributes
    ----------
    gate_px : float
        How far a found marker may lie from where a pose predicts it.
    sigma_px : float
        Error of a centroid, bias included; the tolerance of a triangle's sides is three times what it makes of a point.
    min_markers : int
        Markers that two cameras must share; the paper asks for four.
    max_residual_px : float
        Largest rms distance between found and predicted markers.
    """

    gate_px: float = 4.0
    sigma_px: float = 0.3
    min_markers: int = 4
    max_residual_px: float = 1.5

    def __post_init__(self) -> None:
        as_number(self.gate_px, "gate_px", low=0.0, open_low=True)
        as_number(self.sigma_px, "sigma_px", low=0.0, open_low=True)
        as_number(self.min_markers, "min_markers", low=3)
        as_number(self.max_residual_px, "max_residual_px", low=0.0, open_low=True)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose and what it explains.

    Attributes
    ----------
    T_world_handle : RigidTransform
    labels : tuple of ndarray of int, one a camera, shape (n_c,)
        For each found marker its index on the handle, or -1.
    cost : float
        px^2, see `hypotheses.explain`.
    residual_px : float
        Rms distance of the labelled markers from where the pose predicts them.
    """

    T_world_handle: RigidTransform
    labels: tuple[np.ndarray, ...]
    cost: float
    residual_px: float


def identify(rig: Rig, handle: Handle, found: tuple[Array, ...], points: ArrayLike, covariances: ArrayLike,
             parameters: IdentityParameters | None = None) -> list[Hypothesis]:
    """Find the poses that explain the found markers.

    Parameters
    ----------
    rig : Rig
    handle : Handle
    found : tuple of ndarray, one a camera, shape (n_c, 2)
        Pixels of the markers found.
    points : array_like, shape (m, 3)
        Candidate points from pairs of found markers, world frame, mm; wrong pairs are welcome.
    covariances : array_like, shape (m, 3, 3)
        Of the points for `sigma_px`, mm^2.
    parameters : IdentityParameters, optional

    Returns
    -------
    list of Hypothesis
        The best first, then those that explain the images about as well by another pose. Poses that differ by a
        symmetry of the handle count as one here: see `equivalents`. Empty if nothing fits.

    Raises
    ------
    ValueError
        If a shape is wrong.
    """
    p = parameters or IdentityParameters()
    motions = triplet_poses(points, covariances, handle)
    refined = [h for start in _most_promising(motions, rig, handle, found, 2 * p.gate_px)
               if (h := _refine(start, rig, handle, found, p)) is not None]
    refined.sort(key=lambda h: h.cost)
    alternatives: list[Hypothesis] = []
    for h in refined:
        if h.cost < refined[0].cost + p.gate_px**2 and all(_differ(h, other, handle) for other in alternatives):
            alternatives.append(h)
    return alternatives


def equivalents(T_world_handle: RigidTransform, handle: Handle) -> list[RigidTransform]:
    """The poses that show the same markers, by the handle's symmetries; the given one is the first."""
    return [T_world_handle * S for S in handle.symmetries]


def choose(alternatives: list[RigidTransform], prior: RigidTransform | None) -> tuple[int, bool]:
    """Choose among poses that the images cannot tell apart.

    With a prior: the one with the least turn from it; the choice is sure if the next one is at least twice as far.
    Without: the one with the least turn from the identity; it is sure only if there is no other.

    Parameters
    ----------
    alternatives : list of RigidTransform
        At least one.
    prior : RigidTransform or None
        T_world_handle expected at this instant.

    Returns
    -------
    index : int
    sure : bool
    """
    reference = RigidTransform.identity() if prior is None else as_transform(prior, "prior")
    turns = np.array([(reference.inv() * T).rotation.magnitude() for T in alternatives])
    order = np.argsort(turns)
    if len(order) == 1:
        return 0, True
    return int(order[0]), bool(prior is not None and turns[order[1]] >= 2 * turns[order[0]])


def labelled_pixels(labels: tuple[np.ndarray, ...], found: tuple[Array, ...], markers: int) -> Array:
    """Found pixels by marker, shape (cameras, markers, 2); NaN where a camera has none."""
    uv = np.full((len(found), markers, 2), np.nan)
    for row, label, pixels in zip(uv, labels, found, strict=True):
        row[label[label >= 0]] = pixels[label >= 0]
    return uv


def relabel(labels: np.ndarray, handle: Handle, symmetry: RigidTransform) -> np.ndarray:
    """Labels under the equivalent pose ``T_world_handle * symmetry``; -1 stays -1."""
    images = symmetry.apply(handle.marker_centres)
    source = np.linalg.norm(handle.marker_centres[:, None] - images, axis=2).argmin(axis=1)
    return np.where(labels >= 0, source[labels], -1)


def _most_promising(motions: RigidTransform, rig: Rig, handle: Handle, found: tuple[Array, ...], gate_px: float,
                    keep: int = 20) -> RigidTransform:
    """The best motions by `explain`, one for each different labelling."""
    if len(motions) == 0:
        return motions
    labels, cost, _ = explain(motions, rig, handle, found, gate_px)
    order = np.argsort(cost)
    _, first = np.unique(np.concatenate(labels, axis=1)[order], axis=0, return_index=True)
    return motions[order[np.sort(first)[:keep]]]


def _refine(start: RigidTransform, rig: Rig, handle: Handle, found: tuple[Array, ...],
            p: IdentityParameters) -> Hypothesis | None:
    """Fit the pose to all markers that it explains, twice; None if too few are left or they fit badly."""
    T: RigidTransform | None = start
    for gate_px in (2 * p.gate_px, p.gate_px):
        labels, _, _ = explain(_batch(T), rig, handle, found, gate_px)
        uv = labelled_pixels(tuple(label[0] for label in labels), found, len(handle.marker_centres))
        points = triangulate(rig, uv)
        if np.isfinite(points).all(axis=1).sum() < p.min_markers:
            return None
        if (T := rigid_fit(handle.marker_centres, points)) is None:
            return None
    labels, cost, residual = explain(_batch(T), rig, handle, found, p.gate_px)
    if not residual[0] <= p.max_residual_px:
        return None
    return Hypothesis(T, tuple(label[0] for label in labels), float(cost[0]), float(residual[0]))


def _differ(a: Hypothesis, b: Hypothesis, handle: Handle) -> bool:
    """Whether two poses are more than 10 deg apart, up to the handle's symmetries."""
    turn = min((a.T_world_handle.inv() * T).rotation.magnitude() for T in equivalents(b.T_world_handle, handle))
    return bool(turn > np.deg2rad(10.0))


def _batch(T: RigidTransform) -> RigidTransform:
    return RigidTransform.from_matrix(T.as_matrix()[None])
