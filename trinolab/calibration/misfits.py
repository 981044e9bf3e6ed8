"""Views of a recording that do not fit the others: detected and left out of a bundle adjustment, each
with its reason.

A view is one camera's image of one instant. A hand in front of a marker, a late camera or a wrong
identity spoils it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from .bundle import Bundle, Centres, adjust
from .outliers import far_above
from .prior import Prior

FEWEST, FEWEST_MARKERS = 4, 3  # centres of an instant, and markers: what fixes a pose


class Cleaned(NamedTuple):
    """A bundle adjustment without the views that do not fit.

    Attributes
    ----------
    bundle : Bundle
    instants : ndarray of int
        The instants used, in the order of `bundle.poses`.
    seen : Centres
        The centres used, row by row as `bundle.residuals_px`; `seen.instant` counts along `instants`.
    reasons : ndarray of str, shape (n, cameras)
        The reason for leaving out a camera's view of an instant; empty for views that were used, and
        where nothing was seen.
    """

    bundle: Bundle
    instants: np.ndarray
    seen: Centres
    reasons: np.ndarray


def adjust_robustly(
    rig: Rig, handle: Handle, poses: RigidTransform, seen: Centres, prior: Prior
) -> Cleaned:
    """Adjust without the views whose residuals are far above those of the camera's other views.

    Parameters
    ----------
    rig, handle, poses, seen, prior
        As for `adjust`; instants that show too little are left out.

    Raises
    ------
    ValueError
        If no instant shows enough, or as `adjust` does for what is left.
    """
    reasons = np.full((len(poses), len(rig.cameras)), "", object)
    while True:
        used = reasons[seen.instant, seen.camera] == ""
        enough = _enough(seen.take(used), len(poses))
        few = used & ~enough[seen.instant]
        reasons[seen.instant[few], seen.camera[few]] = "the cameras show too little of the instant"
        if not enough.any():
            raise ValueError("centres: expected instants of four or more, got none that fit")
        instants = np.flatnonzero(enough)
        remaining = seen.take(used & enough[seen.instant])
        remaining = remaining._replace(instant=np.searchsorted(instants, remaining.instant))
        bundle = adjust(rig, handle, poses[instants], remaining, prior)
        why = far_above(view_rms(remaining, bundle, reasons[instants].shape).T).T
        if not (why != "").any():
            return Cleaned(bundle, instants, remaining, reasons)
        new = np.nonzero(why != "")
        reasons[instants[new[0]], new[1]] = why[new]


def _enough(seen: Centres, count: int) -> np.ndarray:
    """Whether each instant shows enough to fix a pose, bool (count,)."""
    markers = np.zeros((count, int(seen.marker.max(initial=0)) + 1), int)
    np.add.at(markers, (seen.instant, seen.marker), 1)
    return (markers.sum(axis=1) >= FEWEST) & ((markers > 0).sum(axis=1) >= FEWEST_MARKERS)


def view_rms(seen: Centres, bundle: Bundle, shape: tuple[int, int]) -> Array:
    """Rms distance of measured and predicted centres of each view, shape (n, cameras), px; NaN
    where a camera has none.
    """
    square, count = np.zeros(shape), np.zeros(shape)
    np.add.at(square, (seen.instant, seen.camera), (bundle.residuals_px**2).sum(axis=1))
    np.add.at(count, (seen.instant, seen.camera), 1)
    return np.sqrt(square / np.where(count > 0, count, np.nan))
