"""Offsets between the clocks of unsynchronised cameras, from the motion that they saw.

A camera's frame labelled t shows what happened at t + offset. Two cameras a and b see a moving
marker where the epipolar constraint allows it only if both look at one moment, so b's pixel is
taken at t + delta, delta = offset_a - offset_b, from a spline through its frames:

    r(delta) = Sampson distance of a's pixel at t and b's pixel at t + delta,    r' = dr/d delta = g . v_b

with g the distance's gradient by b's pixel and v_b the pixel's velocity. A constant is fitted as
well, for a calibration that is slightly wrong: r and r' denote deviations from their means.
Gauss-Newton steps -sum(r r') / sum(r'^2) lead to the least sum of squares. The variance of delta is
s^2 / sum(r'^2) for independent residuals of variance s^2; or, because errors of the calibration
correlate neighbours, the sum over stretches of time of (sum of r r' there)^2, divided by
sum(r'^2)^2, if that is larger. Where little moves across the epipolar lines, r' is the noise of the
velocity and carries no information. Each pair's sum of squares depends on its delta alone: weighted
least squares over the pairs therefore fit one offset per camera to all data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from ..camera import Rig, fundamental_matrix
from ..checks import Array, as_array, as_number, frozen

LARGEST_S = 0.2  # largest offset that is looked for
GAP_S = 0.1  # longest gap over which a track is interpolated
LEAST = 20  # smallest number of residuals for an offset
STRETCH = 10  # instants whose residuals may be correlated
# Noise of the velocity of a cubic spline between its knots, at most: sigma of the velocity x step /
# sigma of a sample.
VELOCITY_NOISE = 1.8
UNSEEN = "no markers in common with another camera"
RESTING = "too little motion across the epipolar lines"
BEYOND = f"no best offset within {LARGEST_S:g} s"


@dataclass(frozen=True, eq=False)
class Offsets:
    """Clock offsets: the delay of each camera.

    Attributes
    ----------
    offset_s : ndarray, shape (cameras,)
        A frame labelled t shows what the first camera shows at t + offset; NaN where the data do
        not determine it, 0 for the first camera.
    sigma_s : ndarray, shape (cameras,)
        Standard deviations; NaN and 0 likewise.
    reasons : tuple of (str or None)
        Why an offset is NaN.
    """

    offset_s: Array
    sigma_s: Array
    reasons: tuple[str | None, ...]


class Delta(NamedTuple):
    """A pair's offset_a - offset_b and its standard deviation, s; NaN with a reason."""

    delta_s: float
    sigma_s: float
    reason: str | None


class Track(NamedTuple):
    """A marker in one camera between two gaps: a spline of its ideal pixels over the labels from
    `first` to `last`.
    """

    marker: int
    first: float
    last: float
    spline: CubicSpline


def estimate_offsets(times_s: ArrayLike, uv: ArrayLike, rig: Rig) -> Offsets:
    """Estimate each camera's offset in time relative to the first one, within +-0.2 s.

    Parameters
    ----------
    times_s : array_like, shape (n,)
        The instants' labels, s, increasing; steps may be uneven.
    uv : array_like, shape (cameras, n, markers, 2)
        Pixels as taken, each marker known by its index; NaN where it is not seen.
    rig : Rig

    Returns
    -------
    Offsets
        NaN with a reason for a camera that shares no moving markers with others.

    Raises
    ------
    ValueError
        If a shape does not fit, the times do not increase, or two cameras stand in one place.
    """
    times = as_array(times_s, "times_s", (None,))
    if (np.diff(times) <= 0).any():
        raise ValueError("times_s: expected increasing times, got a step that is not positive")
    pixels = as_array(uv, "uv", (len(rig.cameras), len(times), None, 2), finite=False)
    ideal = np.stack(
        [
            camera.ideal_pixels(own.reshape(-1, 2)).reshape(own.shape)
            for camera, own in zip(rig.cameras, pixels, strict=True)
        ]
    )
    tracks = [tracks_of(times, one) for one in ideal]
    deltas = {
        (a, b): pair_delta(
            times, ideal[a], tracks[b], fundamental_matrix(rig.cameras[a], rig.cameras[b])
        )
        for a, b in rig.pairs
    }
    return join(deltas, len(rig.cameras))


def significant(offsets: Offsets, sigmas: float = 5.0, least_s: float = 1e-3) -> np.ndarray:
    """Whether each camera's offset is more than `sigmas` standard deviations and more than
    `least_s`, bool (cameras,).

    Never for NaN. Raises ValueError for a limit that is no number or negative.
    """
    as_number(sigmas, "sigmas", 0.0)
    as_number(least_s, "least_s", 0.0)
    size = np.abs(offsets.offset_s)
    return np.asarray((size > sigmas * offsets.sigma_s) & (size > least_s))


def tracks_of(times: Array, uv: Array, gap_s: float = GAP_S) -> list[Track]:
    """Splines of a camera's markers, uv (n, markers, 2), one for each stretch of four or more
    without a long gap.
    """
    tracks = []
    for marker in range(uv.shape[1]):
        at = np.flatnonzero(np.isfinite(uv[:, marker]).all(axis=1))
        for run in np.split(at, 1 + np.flatnonzero(np.diff(times[at]) > gap_s)):
            if len(run) >= 4:
                tracks.append(
                    Track(
                        marker,
                        times[run[0]],
                        times[run[-1]],
                        CubicSpline(times[run], uv[run, marker]),
                    )
                )
    return tracks


def pair_delta(times: Array, uv_a: Array, tracks_b: list[Track], F: Array) -> Delta:
    """The delta (s) at which camera b's tracks fit camera a's ideal pixels, shape (n, markers, 2).

    Parameters
    ----------
    times : ndarray, shape (n,)
    uv_a : ndarray
    tracks_b : list of Track
    F : ndarray, shape (3, 3)
        ``camera.fundamental_matrix`` from a to b.
    """
    grid = np.linspace(-LARGEST_S, LARGEST_S, 41)
    cost = np.array([_typical(residuals(delta, times, uv_a, tracks_b, F)[0]) for delta in grid])
    if not np.isfinite(cost).any():
        return Delta(np.nan, np.nan, UNSEEN)
    delta = float(grid[np.nanargmin(cost)])
    for _ in range(10):
        step, sigma, moves = _step(
            *residuals(delta, times, uv_a, tracks_b, F), float(np.median(np.diff(times)))
        )
        if not moves:
            differs = abs(delta) > 0.9 * LARGEST_S and np.nanmax(cost) > 2 * np.nanmin(cost) + 1e-6
            return Delta(np.nan, np.nan, BEYOND if differs else RESTING)
        delta += float(np.clip(step, -0.02, 0.02))
        if abs(delta) > LARGEST_S:
            return Delta(np.nan, np.nan, BEYOND)
    return Delta(delta, sigma, None)


def residuals(
    delta: float, times: Array, uv_a: Array, tracks_b: list[Track], F: Array
) -> tuple[Array, Array, np.ndarray]:
    """Signed Sampson distances (px) for a delta (s), their derivatives (px/s), and their instants;
    shapes (k,).
    """
    parts = []
    for track in tracks_b:
        inside = (times + delta >= track.first) & (times + delta <= track.last)
        at = np.flatnonzero(inside & np.isfinite(uv_a[:, track.marker]).all(axis=1))
        moved = times[at] + delta
        distance, gradient = sampson(uv_a[at, track.marker], track.spline(moved), F)
        parts.append((distance, (gradient * track.spline(moved, 1)).sum(axis=1), at))
    if not parts:
        return np.zeros(0), np.zeros(0), np.zeros(0, int)
    r, slope, instants = zip(*parts, strict=True)
    return np.concatenate(r), np.concatenate(slope), np.concatenate(instants)


def sampson(uv_a: Array, uv_b: Array, F: Array) -> tuple[Array, Array]:
    """Signed Sampson distances of matches, shape (k,), px, and their gradients by uv_b, shape (k,
    2).

    To first order how far the two pixels must move to match (Hartley and Zisserman 2004, sect.
    11.4.3); the gradient leaves out that of the denominator, which is small where the distance is.
    """
    a = np.column_stack([uv_a, np.ones(len(uv_a))])
    b = np.column_stack([uv_b, np.ones(len(uv_b))])
    line_a = b @ F
    line_b = a @ F.T
    length = np.sqrt((line_b[:, :2] ** 2).sum(axis=1) + (line_a[:, :2] ** 2).sum(axis=1))
    return (b * line_b).sum(axis=1) / length, line_b[:, :2] / length[:, None]


def join(deltas: dict[tuple[int, int], Delta], cameras: int) -> Offsets:
    """One offset per camera from the pairs' deltas, by weighted least squares; NaN where no pairs
    lead to the first.

    If the pairs contradict each other by more than their standard deviations allow, these are
    enlarged.
    """
    good = {pair: delta for pair, delta in deltas.items() if delta.reason is None}
    reached = {0}
    for _ in range(cameras):
        reached |= {camera for pair in good if reached & set(pair) for camera in pair}
    offset = np.full(cameras, np.nan)
    sigma = np.full(cameras, np.nan)
    offset[0] = sigma[0] = 0.0
    if unknown := sorted(reached - {0}):
        used = [(pair, delta) for pair, delta in good.items() if set(pair) <= reached]
        A = np.array([[float(c == a) - float(c == b) for c in unknown] for (a, b), _ in used])
        y, s = np.array([[delta.delta_s, delta.sigma_s] for _, delta in used]).T
        covariance = np.linalg.inv((A / s[:, None] ** 2).T @ A)
        offset[unknown] = covariance @ (A.T @ (y / s**2))
        excess = (((y - A @ offset[unknown]) / s) ** 2).sum() / max(len(y) - len(unknown), 1)
        sigma[unknown] = np.sqrt(np.diag(covariance) * max(excess, 1.0))
    return Offsets(
        frozen(offset), frozen(sigma), tuple(_reason(c, deltas, reached) for c in range(cameras))
    )


def _reason(camera: int, deltas: dict[tuple[int, int], Delta], reached: set[int]) -> str | None:
    if camera in reached:
        return None
    reasons = [delta.reason for pair, delta in deltas.items() if camera in pair]
    return next((reason for reason in (BEYOND, RESTING) if reason in reasons), UNSEEN)


def _typical(r: Array) -> float:
    """Median of the residuals' distances from their median; NaN for too few."""
    return float(np.median(np.abs(r - np.median(r)))) if len(r) >= LEAST else np.nan


def _step(r: Array, slope: Array, at: np.ndarray, dt: float) -> tuple[float, float, bool]:
    """Gauss and Newton's step (s), its standard deviation (s), and whether the slopes are more than
    noise.
    """
    if len(r) < LEAST:
        return 0.0, np.nan, False
    r = r - np.median(r)
    spread = max(1.4826 * _typical(r), 1e-9)
    # a wrong identity counts for little
    w = np.minimum(1.0, 3 * spread / np.maximum(np.abs(r), 1e-12))
    slope = slope - (w * slope).sum() / w.sum()
    r = r - (w * r).sum() / w.sum()
    s2 = float((w * r**2).sum() / w.sum())
    noise = w.sum() * s2 * (VELOCITY_NOISE / dt) ** 2
    information = float((w * slope**2).sum())
    if information <= 4 * noise or information <= w.sum():  # 1 px/s
        return 0.0, np.nan, False
    scores = np.bincount(at // STRETCH, w * r * slope)
    variance = max(s2 * information, float((scores**2).sum())) / (information - noise) ** 2
    return -float((w * r * slope).sum()) / information, float(np.sqrt(variance)), True
