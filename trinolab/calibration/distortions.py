"""The number of distortion coefficients that the views of a target determine, by cross-validation
over the views (Sect. 6.2).

A lens model with more coefficients always fits its own views better, and its reported uncertainty
speaks of noise alone. Views that were not used show whether it describes the lens: cameras are
calibrated without some of the views, the target's pose in each of these is fitted with the cameras
held, and the remaining residuals are the model's error. The fewest coefficients are chosen whose error
is not worse than the best by more than its standard error (Hastie, Tibshirani and Friedman 2009, The
Elements of Statistical Learning, sect. 7.10). The rational model's eight are tried where five are
better than any fewer, and taken where they are better still.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..camera import DISTORTIONS
from ..checks import Array, as_array, frozen
from ..rigid import motion_between
from .adjust import PLUMB_BOB, TERMS, Calibrated, calibrate, lenses_of, posed
from .outliers import calibrate_robustly, silent

FOLDS = 5  # parts of the views, each of which is left out once
MOST_VIEWS = 25  # that are asked: a calibration of many takes long
# times the least noise that is left with any number of coefficients, beyond which one does not describe
# the lens, whatever its views left out say: those of the others may lie beyond what its folds can see
FAR_WORSE = 1.5


class Choice(NamedTuple):
    """The number of distortion coefficients, and the evidence for it.

    Attributes
    ----------
    terms : int
        How many of `camera.DISTORTIONS` are fitted, in this order.
    left_out_px : dict of int to float
        For each number that can be fitted the rms distance of points in views that were left out, px.
        Empty where there are too few views to leave some out.
    undecided : tuple of int
        The numbers that the views do not distinguish from the best one, the smallest first; `terms` is
        the first of them.
    """

    terms: int
    left_out_px: dict[int, float]
    undecided: tuple[int, ...]


def calibrate_by_choice(
    target: Array,
    uv: ArrayLike,
    sizes: Sequence[tuple[int, int]],
    names: Sequence[str],
    report: Callable[[str], object] = silent,
) -> tuple[Calibrated, np.ndarray, Choice]:
    """Calibrate with as many distortion coefficients as the views determine.

    Where several numbers of coefficients do equally well, the fewest are taken, and the covariance
    has, beside that of noise, the mean square of the others' differences from this result.

    Parameters
    ----------
    target, uv, sizes, names, report
        As `outliers.calibrate_robustly` takes them.

    Returns
    -------
    Calibrated
    reasons : ndarray of str, shape (cameras, views)
        Why a view was left out of all.
    Choice

    Raises
    ------
    ValueError
        As `outliers.calibrate_robustly`.
    """
    calibrated, reasons = _of_most_terms(target, uv, sizes, names, report)
    pixels = np.array(as_array(uv, "uv", (None, None, len(target), 2), finite=False))
    pixels[reasons != ""] = np.nan
    every, squares = dict[int, Calibrated](), dict[int, Array]()
    most = calibrated.distortion_terms

    def tried(terms: int) -> None:
        report(f"distortions: {terms}")
        try:
            every[terms] = (
                calibrated
                if terms == most
                else calibrate(target, pixels, sizes, names, terms, start=calibrated)
            )
        except ValueError:  # no lens of so few describes the views
            return
        left_out = left_out_squares(target, pixels, every[terms])
        if left_out is not None:
            squares[terms] = left_out

    for terms in TERMS[: TERMS.index(most) + 1]:
        tried(terms)
    choice = _describing(every, squares, most)
    if choice.terms == PLUMB_BOB:
        tried(TERMS[-1])
        wider = _describing(every, squares, most)
        choice = choice if PLUMB_BOB in wider.undecided else wider
    best = every[choice.terms]
    if not choice.left_out_px:
        return best, reasons, choice
    spread = np.mean([spread_of_cameras(every[terms], best) for terms in choice.undecided], axis=0)
    return replace(best, covariance=frozen(best.covariance + spread)), reasons, choice


def _describing(every: dict[int, Calibrated], squares: dict[int, Array], most: int) -> Choice:
    """The choice by the left-out views or, without them, that of the most coefficients; never one whose
    residuals are far above another's.
    """
    choice = chosen(squares) if squares else Choice(most, {}, ())
    closest = min(every, key=lambda terms: every[terms].sigma_px)
    if every[choice.terms].sigma_px > FAR_WORSE * every[closest].sigma_px:
        return Choice(closest, {}, ())
    return choice


def _of_most_terms(
    target: Array,
    uv: ArrayLike,
    sizes: Sequence[tuple[int, int]],
    names: Sequence[str],
    report: Callable[[str], object],
) -> tuple[Calibrated, np.ndarray]:
    """The calibration with the largest number of coefficients that the views determine."""
    for terms in TERMS[-2:0:-1]:
        try:
            return calibrate_robustly(target, uv, sizes, names, terms, report)
        except ValueError:  # the views leave some of them free
            continue
    return calibrate_robustly(target, uv, sizes, names, TERMS[0], report)


def left_out_squares(target: Array, uv: Array, calibrated: Calibrated) -> Array | None:
    """Mean squared distance of the points of each view from where cameras that were calibrated
    without the view see them, px^2, shape (views used,).

    Parameters
    ----------
    target : ndarray, shape (n, 3)
    uv : ndarray, shape (cameras, views, n, 2)
        NaN for what was not found or is not used.
    calibrated : Calibrated
        The calibration from all of them.

    Returns
    -------
    ndarray, shape (views used,)
        None if what is left does not determine the cameras.
    """
    poses = {v: T for v, T in enumerate(calibrated.T_world_target) if T is not None}
    used = np.array(list(poses))
    views = used[:: -(-len(used) // MOST_VIEWS)]
    folds = min(FOLDS, len(views))
    squares = np.empty(len(views))
    for fold in range(folds):
        out = np.arange(fold, len(views), folds)
        try:
            others = _without(target, uv, calibrated, np.delete(views, out))
            left = posed(others, target, uv[:, views[out]], [poses[v] for v in views[out]])
        except ValueError:
            return None
        squares[out] = np.nanmean((left**2).sum(axis=3), axis=(0, 2))
    return squares


def _without(target: Array, uv: Array, calibrated: Calibrated, views: np.ndarray) -> Calibrated:
    """The calibration from some of the views alone."""
    pixels = np.full_like(uv, np.nan)
    pixels[:, views] = uv[:, views]
    sizes = [camera.size for camera in calibrated.cameras]
    names = [camera.name for camera in calibrated.cameras]
    return calibrate(target, pixels, sizes, names, calibrated.distortion_terms, start=calibrated)


def chosen(squares: dict[int, Array]) -> Choice:
    """The choice by the left-out views' mean squares (views,), px^2, of each number of terms."""
    if not squares:
        return Choice(0, {}, ())
    rms = {terms: float(np.sqrt(one.mean())) for terms, one in squares.items()}
    best = min(rms, key=lambda terms: rms[terms])
    undecided = []
    for terms, one in squares.items():
        worse = one - squares[best]  # view by view: some are blurred for all models
        if worse.mean() <= worse.std(ddof=1) / np.sqrt(len(worse)):
            undecided.append(terms)
    return Choice(min(undecided), rms, tuple(sorted(undecided)))


def spread_of_cameras(other: Calibrated, best: Calibrated) -> Array:
    """The outer product (q, q) of the difference between another calibration's cameras and the best
    one's, in the order of `Calibrated.covariance`.
    """
    a, b = (lenses_of(calibrated.cameras, best.distortion_terms) for calibrated in (other, best))
    places = [
        motion_between(a.T_world_cam, b.T_world_cam)
        for a, b in zip(other.cameras[1:], best.cameras[1:], strict=True)
    ]
    change = np.concatenate([(a - b).ravel(), *places])
    return np.outer(change, change)


def as_lines(choice: Choice) -> list[str]:
    """The choice as lines of text."""
    if not choice.left_out_px:
        return [
            f"distortions: {choice.terms}; the views are too few, or the lens is too wide, to leave some out "
            "and choose by them"
        ]
    errors = ", ".join(f"{terms}: {rms:.4f}" for terms, rms in choice.left_out_px.items())
    lines = [
        f"distortions: {choice.terms} of {', '.join(DISTORTIONS)}",
        f"  rms / px in views left out, by their number: {errors}",
    ]
    if len(choice.undecided) > 1:
        *most, last = map(str, choice.undecided)
        lines.append(
            f"  the views cannot decide between {', '.join(most)} and {last}: the fewest are taken, "
            "and +- holds how far the others lie away"
        )
    return lines
