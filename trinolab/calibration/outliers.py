"""Views of a target that do not fit the others: detected and left out, each with its reason (Sect.
6.2).

A least squares over all views has no defence against a target that moved during the exposure, or
two images that do not belong together. Each camera is calibrated alone first; then the relative poses
of every two cameras (Eq. 25) are compared; at last the residuals of the joint adjustment decide.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from ..camera import Camera
from ..checks import Array, as_array
from .adjust import Calibrated, Poses, calibrate
from .eq25 import relative_pose
from .start import homography

FEWEST_POINTS = 6  # of a view: two more than a homography needs, so that a wrong one shows
UNSEEN = "no target found"
# times the median residual of the camera's views; a blurred or steep view has up to twice it
FAR_ABOVE = 3.0
# what two cameras may disagree by, the shift as a share of the target's distance
_TURN_DEG, _SHIFT = 5.0, 0.05
_ROUNDING_PX = 1e-3  # residuals that are no reason to leave out a view


def silent(step: str) -> None:
    """A report that shows nothing."""


def calibrate_robustly(
    target: Array,
    uv: ArrayLike,
    sizes: Sequence[tuple[int, int]],
    names: Sequence[str],
    distortion_terms: int = 5,
    report: Callable[[str], object] = silent,
    lenses: Sequence[Camera] | None = None,
) -> tuple[Calibrated, np.ndarray]:
    """Calibrate without the views that do not fit the others.

    Parameters
    ----------
    target, uv, sizes, names, distortion_terms, lenses
        As `adjust.calibrate` takes them.
    report : callable, optional
        Called with the name of each step, to show progress.

    Returns
    -------
    Calibrated
        Of the views that were used.
    reasons : ndarray of str, shape (cameras, views)
        The reason for leaving out a view; empty for views that were used.

    Raises
    ------
    ValueError
        As `adjust.calibrate` does for what is left.
    """
    uv = np.array(as_array(uv, "uv", (None, None, len(target), 2), finite=False))
    reasons = np.full(uv.shape[:2], "", object)
    _leave_out(uv, reasons, too_few(target, uv))
    alone = []
    for k in range(len(uv)):
        report(f"camera {names[k]} alone")
        try:
            calibrated = _fitted(
                target,
                uv[k : k + 1],
                reasons[k : k + 1],
                sizes[k : k + 1],
                names[k : k + 1],
                distortion_terms,
                None if lenses is None else lenses[k : k + 1],
            )
            alone.append(list(calibrated.T_world_target))
        except ValueError:  # too little for a camera alone may be enough for all together
            alone.append([None] * uv.shape[1])
    _leave_out(uv, reasons, _disagreeing(alone, names))
    report("all cameras together")
    return _fitted(target, uv, reasons, sizes, names, distortion_terms, lenses), reasons


def _leave_out(uv: Array, reasons: np.ndarray, why: np.ndarray) -> None:
    """Drop, in place, the views (cameras, views) that have a reason for the first time."""
    new = (why != "") & (reasons == "")
    reasons[new], uv[new] = why[new], np.nan


def too_few(target: Array, uv: Array) -> np.ndarray:
    """Reasons (cameras, views) from the number and the places of the points."""
    counts = np.isfinite(uv).all(axis=3).sum(axis=2)
    why = np.full(counts.shape, "", object)
    for at in np.ndindex(counts.shape):
        if counts[at] == 0:
            why[at] = UNSEEN
        elif counts[at] < FEWEST_POINTS:
            why[at] = (
                f"too few points: {counts[at]} of {len(target)}, expected {FEWEST_POINTS} or more"
            )
        elif homography(target[:, :2], uv[at]) is None:
            why[at] = f"the {counts[at]} points found lie on one line"
    return why


def _fitted(
    target: Array,
    uv: Array,
    reasons: np.ndarray,
    sizes: Sequence[tuple[int, int]],
    names: Sequence[str],
    terms: int,
    lenses: Sequence[Camera] | None,
) -> Calibrated:
    """Calibrate until no view's residual is far above those of its camera's others; drops views in
    place.
    """
    while True:
        calibrated = calibrate(target, uv, sizes, names, terms, lenses=lenses)
        why = far_above(calibrated.view_rms_px)
        if not (why != "").any():
            return calibrated
        _leave_out(uv, reasons, why)


def far_above(rms: Array) -> np.ndarray:
    """Reasons (cameras, views) from the residuals, for the worst views only: these may raise the
    residuals of the others.
    """
    typical = np.array([np.median(row[np.isfinite(row)]) for row in rms])[:, None]
    excess = np.nan_to_num(rms / np.maximum(FAR_ABOVE * typical, _ROUNDING_PX))
    why = np.full(rms.shape, "", object)
    for k, v in zip(*np.nonzero(excess > max(1.0, excess.max() / 2)), strict=True):
        why[k, v] = (
            f"residual {rms[k, v]:.2f} px, far above the others ({typical[k, 0]:.2f} px in the middle)"
        )
    return why


def _disagreeing(T_cam_target: list[Poses], names: Sequence[str]) -> np.ndarray:
    """Reasons (cameras, views) from the relative poses: cameras that see the target in different
    places.
    """
    against = np.zeros((len(names), len(names), len(T_cam_target[0])), bool)
    for a in range(len(names)):
        for b in range(a):
            against[a, b] = against[b, a] = _unlike(T_cam_target[a], T_cam_target[b])
    why = np.full(against.shape[1:], "", object)
    while against.any():
        v = int(np.flatnonzero(against.any(axis=(0, 1)))[0])
        counts = against[:, :, v].sum(axis=1)
        # of two cameras that contradict each other, the later one
        k = int(np.flatnonzero(counts == counts.max())[-1])
        others = ", ".join(
            name for name, other in zip(names, against[k, :, v], strict=True) if other
        )
        why[k, v] = f"the target lies elsewhere than for {others}, against all other views"
        against[k, :, v] = against[:, k, v] = False
    return why


def _unlike(first: Poses, second: Poses) -> np.ndarray:
    """The views, bool (views,), in which the relative pose of two cameras is far from that in most
    views; none if fewer than three.
    """
    shared = [
        v
        for v, (a, b) in enumerate(zip(first, second, strict=True))
        if a is not None and b is not None
    ]
    unlike = np.zeros(len(first), bool)
    if len(shared) < 3:
        return unlike
    left, right = (
        RigidTransform.concatenate([side[v] for v in shared]) for side in (first, second)
    )
    each = relative_pose(left, right)
    # (shared, shared)
    turns = np.rad2deg([(each.rotation * R.inv()).magnitude() for R in each.rotation])
    shifts = np.linalg.norm(each.translation[:, None] - each.translation, axis=2)
    shifts /= np.median(np.linalg.norm(left.translation, axis=1))
    off = np.maximum(turns / _TURN_DEG, shifts / _SHIFT)
    middle = off[np.argmin(np.median(off, axis=1))]
    unlike[shared] = middle > max(1.0, 5 * float(np.median(middle)))
    return unlike
