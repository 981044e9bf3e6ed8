"""Identification of the markers in all images of an instant: poses from triplets, verified in every
image.

The paper assumes that this is known. Three markers that fit three of the layout give a pose; the
pose predicts where every marker appears; the pose that explains most of what was found wins. A
layout with symmetry has several such poses: the prior chooses, or the choice is reported as open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array, as_array, as_transform
from ..handle import Handle
from ..rigid import placed
from ..sensitivity import offsets_of
from ..work import Work
from .hypotheses import Explained, Observed, Poses, ideal_pixels
from .layout import layout_of, views_of
from .parameters import IdentityParameters
from .scoring import judge, rivals, shape_misfit
from .search import search


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose and what it explains.

    Attributes
    ----------
    T_world_handle : RigidTransform
        Fitted to the labelled markers.
    labels : tuple of ndarray of int, one per camera, shape (n_c,)
        For each found marker its index on the handle, or -1.
    cameras : tuple of int
        Those that support the pose, each by two markers or more.
    cost : float
        px^2, see `hypotheses.Explained`.
    residual_px : float
        Standard deviation of a coordinate of the labelled markers from where the pose predicts
        them: the sum of squares divided by the degrees of freedom.
    """

    T_world_handle: RigidTransform
    labels: tuple[np.ndarray, ...]
    cameras: tuple[int, ...]
    cost: float
    residual_px: float


def identify(
    rig: Rig,
    handle: Handle,
    found: Sequence[Array],
    parameters: IdentityParameters | None = None,
    axes_px: Sequence[Array] | None = None,
    matches: Sequence[np.ndarray] | None = None,
    work: Work | None = None,
) -> list[Hypothesis]:
    """Find the poses that explain the found markers.

    Parameters
    ----------
    rig : Rig
    handle : Handle
    found : sequence of array_like, one per camera, shape (n_c, 2)
        Pixels of the markers found, the best first: beyond `tried_per_marker` times the handle's
        they are not tried.
    parameters : IdentityParameters, optional
    axes_px : sequence of array_like, one per camera, shape (n_c, 2), optional
        Major and minor axis of each marker's image. They help where one camera sees the handle
        alone.
    matches : sequence of array_like of int, one per pair of cameras, shape (k, 2), optional
        Rows of the markers of both cameras, in the order of `Rig.pairs`, that may be the same
        marker (Eq. 17-18). With them poses are sought by these pairs alone, as in the paper;
        without, by epipolar lines and in single cameras.
    work : Work, optional
        The work that the search may take, and where it resumes, see `search.search`; unlimited
        without it.

    Returns
    -------
    list of Hypothesis
        The best first, then those between which the images do not decide. Poses that differ by a
        symmetry of the handle count as one here: see `equivalents`. Empty if nothing fits.
    """
    p = parameters or IdentityParameters()
    pixels = _one_each(found, "found", rig.names, None)
    counts = [len(uv) for uv in pixels]
    most = p.tried_per_marker * len(handle.marker_centres)
    uv = ideal_pixels(rig, [uv[:most] for uv in pixels])
    axes = (
        None
        if axes_px is None
        else _padded(_one_each(axes_px, "axes_px", rig.names, counts), uv.shape[2])
    )
    observed = Observed(
        views_of(rig),
        layout_of(handle, p),
        uv,
        axes,
        rig.pairs,
        _as_matches(matches, rig),
        offsets_of(rig, pixels),
    )
    tried = search(observed, p, work or Work())
    if tried is None:
        return []
    poses, explained = tried
    misfit = shape_misfit(poses, explained.labels, observed, p)
    return _alternatives(poses, explained, misfit, counts, handle, p)


def equivalents(T_world_handle: RigidTransform, handle: Handle) -> list[RigidTransform]:
    """The poses that show the same markers, by the handle's symmetries; the given one is the
    first.
    """
    return [T_world_handle * S for S in handle.symmetries]


def choose(alternatives: list[RigidTransform], prior: RigidTransform | None) -> tuple[int, bool]:
    """Choose among poses that the images cannot tell apart.

    With a prior, the pose with the least rotation from it is chosen, and the choice is unambiguous
    if the next one is at least twice as far. Without a prior, it is the pose with the least
    rotation from the identity, which is unambiguous only if there is no other.

    Parameters
    ----------
    alternatives : list of RigidTransform
        At least one.
    prior : RigidTransform or None
        T_world_handle expected at this instant.

    Returns
    -------
    index : int
    unambiguous : bool
    """
    reference = RigidTransform.identity() if prior is None else as_transform(prior, "prior")
    if len(alternatives) == 1:
        return 0, True
    turns = np.array([(reference.inv() * T).rotation.magnitude() for T in alternatives])
    order = np.argsort(turns)
    return int(order[0]), bool(prior is not None and turns[order[1]] >= 2 * turns[order[0]])


def labelled_pixels(
    labels: tuple[np.ndarray, ...], found: tuple[Array, ...], markers: int
) -> Array:
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


def _alternatives(
    poses: Poses,
    e: Explained,
    misfit: Array,
    counts: list[int],
    handle: Handle,
    p: IdentityParameters,
) -> list[Hypothesis]:
    """The best of the poses that hold, and its rivals; none if one of these is strained.

    A strained rival may well be the true pose, and its misfit that of a bent handle: a pose that
    fits only because it leaves out what another one explains is no better than that.
    """
    v = judge(e, p)
    if not v.holds.any():
        return []
    cost = e.cost + p.sigma_px**2 * misfit
    best = int(np.where(v.holds, cost, np.inf).argmin())
    others = np.flatnonzero(rivals(best, e, v, misfit, p))
    turns = np.trace(poses.rotations[others] @ poses.rotations[best].T, axis1=1, axis2=2)
    # the rest is the same pose found again
    others = others[turns < 1 + 2 * np.cos(np.deg2rad(p.same_pose_deg))]
    alternatives: list[Hypothesis] = []
    for k in (best, *others[np.argsort(cost[others], kind="stable")]):
        T = placed(poses.translations[k], poses.rotations[k])
        if all(_differ(T, other.T_world_handle, handle, p) for other in alternatives):
            if v.strained[k]:
                return []
            labels = tuple(
                np.pad(row, (0, max(counts) - len(row)), constant_values=-1)[:n]
                for row, n in zip(v.labels[k], counts, strict=True)
            )
            cameras = tuple(int(c) for c in np.flatnonzero(v.supports[k]))
            alternatives.append(
                Hypothesis(T, labels, cameras, float(cost[k]), float(v.residual_px[k]))
            )
    return alternatives


def _differ(a: RigidTransform, b: RigidTransform, handle: Handle, p: IdentityParameters) -> bool:
    """Whether two poses are turned against each other, up to the handle's symmetries."""
    turn = min((a.inv() * T).rotation.magnitude() for T in equivalents(b, handle))
    return turn > np.deg2rad(p.same_pose_deg)


def _one_each(
    arrays: Sequence[ArrayLike], name: str, names: Sequence[str], counts: list[int] | None
) -> list[Array]:
    """Check arrays (n_c, 2), one per camera."""
    if len(arrays) != len(names):
        raise ValueError(
            f"{name}: expected one for each of {len(names)} cameras, got {len(arrays)}"
        )
    rows = [None] * len(names) if counts is None else counts
    return [
        as_array(array, f"{name}: {camera}", (n, 2))
        for array, camera, n in zip(arrays, names, rows, strict=True)
    ]


def _padded(axes: list[Array], most: int) -> Array:
    """One array for all cameras, shape (C, most, 2)."""
    return np.stack(
        [np.concatenate([part, np.ones((max(most - len(part), 0), 2))])[:most] for part in axes]
    )


def _as_matches(matches: Sequence[ArrayLike] | None, rig: Rig) -> list[np.ndarray] | None:
    if matches is None:
        return None
    if len(matches) != len(rig.pairs):
        raise ValueError(
            f"matches: expected one for each of {len(rig.pairs)} pairs of cameras, got {len(matches)}"
        )
    return [
        as_array(rows, f"matches[{k}]", (None, 2)).astype(int) for k, rows in enumerate(matches)
    ]
