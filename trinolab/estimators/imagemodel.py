"""An image model: what it predicts for windows of pixels, and how that changes with its unknowns.

In each window the grey is

    marker * shading * m  +  (body * shading + gloss) * b  +  background * (1 - b),

m and b being the shares of `appearance.layers` after a Gaussian blur, and the shading a sum of
`shading_basis`. The gloss is what varnish sends back of marker and body alike, whatever their paint,
a sum of the same functions; it is in the model where the windows show it. These greys of a window are
eliminated (Schur complement; Triggs et al. 2000, DOI 10.1007/3-540-44480-7_21), so that none has to
be known. The noise of the pixels is estimated from what a fit leaves.

All is computed in double precision: in single precision a fit would end a thousandth of its error
elsewhere on another processor, which rounds in another order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from .appearance import Layers, Windows, by_motion, layers, shading_basis
from .patches import BORDER_PX, Patches

__all__ = [
    "Lights",
    "Linear",
    "MotionBlur",
    "Noise",
    "Reduced",
    "State",
    "advanced",
    "blur_matrices",
    "blurred",
    "by_grey_motion",
    "estimate_noise",
    "explained",
    "first_state",
    "half_laplacian",
    "has_contrast",
    "has_gloss",
    "inverse",
    "limited",
    "linearise",
    "longer_than_wide",
    "marker_is_shown",
    "marker_shading",
    "misfit",
    "noise_of",
    "reduce",
    "shows_gloss",
    "unblurred",
    "with_gloss",
]

ENOUGH = 30  # pixels for a variance
CLEAR_PX = 2.5  # pixels nearer than this to another marker or to the body's end have no weight
BLUR_PX = 0.8  # where the search for a camera's blur begins
# Of an unknown of gloss: on images of the simulated bench it is 2.1 at most (200 instants), on those
# of varnish 2.5 to 72 (60 instants).
LEAST_GAIN = 2.3


class Noise(NamedTuple):
    """Variance of a pixel, ``base + slope * grey``, and of the background's texture; grey levels
    squared.
    """

    base: float = 4.0
    slope: float = 0.05
    texture: float = 100.0


def estimate_noise(
    residual: Array, predicted: Array, used: np.ndarray, marker: Array, body: Array
) -> Noise:
    """Estimate the noise from residuals on the body and on markers, away from all edges.

    Parameters
    ----------
    residual, predicted : ndarray, shape (...)
        Grey levels.
    used : ndarray of bool, shape (...)
    marker, body : ndarray, shape (...)
        Share of each pixel that the marker, and the body, covers.

    Returns
    -------
    Noise
        From medians, so that wrong pixels do not count; what too few pixels show is left at a usual
        value.
    """
    dark, bright = (used & (body > 0.99) & part for part in (marker < 0.01, marker > 0.99))
    if min(dark.sum(), bright.sum()) < ENOUGH:
        return Noise()
    low = _robust_variance(residual[dark])
    high = _robust_variance(residual[bright])
    level = float(predicted[dark].mean())
    higher = float(predicted[bright].mean())
    slope = min(max((high - low) / (higher - level or 1.0), 0.0), 0.7 * low / max(level, 1.0))
    beyond = residual[used & (body < 0.05)]
    texture = (
        max(_robust_variance(beyond) - low, 25.0) if beyond.size >= ENOUGH else Noise().texture
    )
    return Noise(max(low - slope * level, 0.01), slope, texture)


def _robust_variance(residual: Array) -> float:
    """From the median of sizes, for a normal distribution; grey levels squared."""
    return float((1.4826 * np.median(np.abs(residual))) ** 2)


def blur_matrices(side: int, blur_px2: Array) -> Array:
    """Matrices (n, side, side) that blur a row of pixels by a Gaussian; its weights at a border sum
    up to 1, too.
    """
    x = np.arange(side)
    weight = np.exp(-0.5 * (x[:, None] - x) ** 2 / blur_px2[:, None, None])
    return weight / weight.sum(axis=2, keepdims=True)


def blurred(B: Array, stack: Array) -> Array:
    """Windows (k, m, p) blurred in both directions by their matrices (k, side, side)."""
    k, m, p = stack.shape
    side = B.shape[1]
    rows = (stack.reshape(k, m * side, side) @ B.transpose(0, 2, 1)).reshape(k, m, side, side)
    return np.matmul(B[:, None], rows).reshape(k, m, p)


def half_laplacian(grey: Array, at: Windows) -> Array:
    """Derivative of blurred windows (k, p) by the blur's variance, px^2: the heat equation."""
    window = grey.reshape(-1, *at.shape)
    middle = 2 * window[:, 1:-1, 1:-1]
    across = window[:, 1:-1, 2:] + window[:, 1:-1, :-2] - middle
    down = window[:, 2:, 1:-1] + window[:, :-2, 1:-1] - middle
    result = np.zeros_like(window)
    result[:, 1:-1, 1:-1] = (across / at.cell[0] ** 2 + down / at.cell[1] ** 2) / 2
    return result.reshape(grey.shape)


def longer_than_wide(grey: Array, at: Windows) -> Array:
    """Derivatives (k, 2, p) of blurred windows of pixels (k, p), by variance that the blur gains
    along u and loses along v, and that it gains along the falling diagonal and loses along the
    rising one.
    """
    window = grey.reshape(-1, *at.shape)
    result = np.zeros((len(grey), 2, *at.shape))
    across = window[:, 1:-1, 2:] + window[:, 1:-1, :-2]
    down = window[:, 2:, 1:-1] + window[:, :-2, 1:-1]
    falling = window[:, 2:, 2:] + window[:, :-2, :-2]
    rising = window[:, 2:, :-2] + window[:, :-2, 2:]
    result[:, 0, 1:-1, 1:-1] = (across - down) / 2
    result[:, 1, 1:-1, 1:-1] = (falling - rising) / 4
    return result.reshape(len(grey), 2, -1)


class MotionBlur(NamedTuple):
    """The handle's motion while the shutter is open, (6,) mm and rad, world frame, and what was
    expected of it before: a motion (6,) and the information on it, (6, 6), an inverse
    covariance.
    """

    motion: Array
    expected: Array
    information: Array


class State(NamedTuple):
    """All unknowns.

    Attributes
    ----------
    T_world_handle : RigidTransform
    greys : ndarray, shape (k, 6 or 9), or None
        Marker (above the body), body, three of shading, where there is gloss three of that,
        background; None as long as they are unknown.
    blur_px2 : ndarray, shape (cameras,)
        Variance of each camera's blur.
    noise : Noise
    motion_blur : MotionBlur or None
        None: the handle is still.
    """

    T_world_handle: RigidTransform
    greys: Array | None
    blur_px2: Array
    noise: Noise
    motion_blur: MotionBlur | None = None


class Linear(NamedTuple):
    """The model about a state.

    Attributes
    ----------
    greys : ndarray, shape (k, 6 or 9)
        Of the state, or found where it had none.
    predicted, residual, weight : ndarray, shape (k, p)
    by_pose : ndarray, shape (k, 7 or 13, p)
        Derivatives by a small motion of the handle (nu mm, omega rad; handle frame), where there is
        motion blur by that (handle frame), and by the blur's variance.
    by_greys : ndarray, shape (k, 6 or 9, p)
    by_gloss : ndarray, shape (k, 3, p)
        Derivatives by the gloss, whether it is among the greys or not.
    marker, body : ndarray, shape (k, p)
        Shares after the blur.
    """

    greys: Array
    predicted: Array
    residual: Array
    weight: Array
    by_pose: Array
    by_greys: Array
    by_gloss: Array
    marker: Array
    body: Array


class Reduced(NamedTuple):
    """Normal equations of each window with its greys eliminated.

    Attributes
    ----------
    information : ndarray, shape (k, m, m)
    gradient : ndarray, shape (k, m)
    greys : ndarray, shape (k, 6 or 9)
        Step of the greys if the other unknowns stay.
    greys_by_other : ndarray, shape (k, 6 or 9, m)
        What a step of the others takes from it.
    """

    information: Array
    gradient: Array
    greys: Array
    greys_by_other: Array


def first_state(
    T_world_handle: RigidTransform, rig: Rig, motion_blur: MotionBlur | None = None
) -> State:
    """A pose with nothing known of greys, and a usual blur and noise."""
    return State(T_world_handle, None, np.full(len(rig.cameras), BLUR_PX**2), Noise(), motion_blur)


def linearise(state: State, here: Patches, rig: Rig, handle: Handle) -> Linear:
    """The model and its derivatives at a state, of a handle that is still."""
    shown = layers(rig, handle, state.T_world_handle, here.views, here.at)
    B = blur_matrices(here.at.shape[0], state.blur_px2)[here.views.camera]
    usable = here.valid & (shown.clear > CLEAR_PX) & _inner(here.at.shape[0])
    basis = shading_basis(shown.turn).transpose(1, 0, 2)
    lights = Lights(
        blurred(B, shown.marker[:, None] * basis), blurred(B, shown.body[:, None] * basis)
    )
    at = explained(state, here, usable, lights)
    moves = blurred(B, by_grey_motion(shown, basis, at.greys))
    by_blur = half_laplacian(at.predicted, here.at)[:, None]
    return at._replace(by_pose=np.concatenate([moves, by_blur], axis=1))


class Lights(NamedTuple):
    """What markers and body send to each cell, at grey level 1 and for each function of
    `shading_basis`, shapes (k, 4, p).
    """

    marker: Array
    body: Array


def explained(state: State, here: Patches, usable: np.ndarray, lights: Lights) -> Linear:
    """What blurred lights make of the windows with the greys of a state, or the best ones where it
    has none; `by_pose` is left empty.
    """
    b = lights.body[:, 0]
    greys = state.greys
    if greys is None:
        columns = [lights.marker[:, :1], lights.body, 1 - b[:, None]]
        greys = _first_greys(np.concatenate(columns, axis=1), usable, here.grey)
    marker, body, background = greys[:, :1], greys[:, 1:2], greys[:, -1:]
    shade = _shade(greys)
    m_shaded = (shade @ lights.marker)[:, 0]
    b_shaded = (shade @ lights.body)[:, 0]
    predicted = marker * m_shaded + body * b_shaded + background * (1 - b)
    by_shade = marker[..., None] * lights.marker[:, 1:] + body[..., None] * lights.body[:, 1:]
    by_gloss = lights.body[:, 1:]
    gloss = _gloss(greys)
    if gloss.size:
        predicted = predicted + (gloss @ by_gloss)[:, 0]
    by_greys = np.concatenate(
        [
            m_shaded[:, None],
            b_shaded[:, None],
            by_shade,
            by_gloss[:, : gloss.shape[2]],
            1 - b[:, None],
        ],
        axis=1,
    )
    noise = state.noise
    variance = noise.base + noise.slope * np.maximum(predicted, 0) + noise.texture * (1 - b) ** 2
    return Linear(
        greys,
        predicted,
        here.grey - predicted,
        usable * (here.at.pixels / variance),
        np.empty((len(greys), 0, b.shape[1])),
        by_greys,
        by_gloss,
        lights.marker[:, 0],
        b,
    )


def unblurred(shown: Layers, basis: Array, greys: Array) -> Array:
    """The grey levels before any blur, shape (k, p); `basis` (k, 4, p) is `shading_basis` there."""
    shading = (_shade(greys) @ basis)[:, 0]
    marker, body, background = greys[:, :1], greys[:, 1:2], greys[:, -1:]
    lit = marker * shown.marker + body * shown.body
    sent_back = _sent_back(basis, greys) * shown.body
    return lit * shading + sent_back + background * (1 - shown.body)


def by_grey_motion(shown: Layers, basis: Array, greys: Array) -> Array:
    """Derivative of the unblurred grey levels by a motion of the handle, shape (k, 6, p); `basis`
    (k, 4, p) is `shading_basis` there.
    """
    shading = (_shade(greys) @ basis)[:, 0]
    of_body = greys[:, 1:2] * shading + _sent_back(basis, greys)
    return by_motion(shown, greys[:, :1] * shading, of_body - greys[:, -1:])


def _shade(greys: Array) -> Array:
    """The factors of `shading_basis`, shape (k, 1, 4)."""
    return np.concatenate([np.ones((len(greys), 1)), greys[:, 2:5]], axis=1)[:, None]


def _gloss(greys: Array) -> Array:
    """The factors of `shading_basis` but the first, in grey levels, shape (k, 1, 3); (k, 1, 0) where
    there is no gloss.
    """
    return greys[:, None, 5:-1]


def _sent_back(basis: Array, greys: Array) -> Array:
    """The grey levels that gloss adds to marker and body, shape (k, p), or (k, 1)."""
    gloss = _gloss(greys)
    return (gloss @ basis[:, 1:])[:, 0] if gloss.size else np.zeros((len(greys), 1))


def has_gloss(state: State) -> bool:
    """Whether the gloss is among the greys of a state."""
    return state.greys is not None and _gloss(state.greys).size > 0


def marker_shading(greys: Array) -> Array | None:
    """The shading of each window's marker, shape (k, 3), for `centroids.predict_centroids`; None
    where there is gloss, beside which that of a marker alone is hardly known.
    """
    return None if _gloss(greys).size else greys[:, 2:5]


def with_gloss(state: State) -> State:
    """The same state with the gloss among its greys."""
    if state.greys is None or has_gloss(state):
        return state
    none_yet = np.zeros((len(state.greys), 3))
    greys = np.concatenate([state.greys[:, :5], none_yet, state.greys[:, 5:]], axis=1)
    return state._replace(greys=greys)


def shows_gloss(at: Linear, handle: Handle, least_gain: float = LEAST_GAIN) -> bool:
    """Whether the windows show gloss, of which the greys have none as yet.

    What a window's chi-square gains by gloss (score test, Rao 1948, DOI
    10.1017/S0305004100023987) is 1 an unknown by noise alone, where the median misfit is the noise.
    They have to gain `least_gain` times as much, those that show a marker: three unknowns more a window
    make a pose worse by a tenth, so that a little gloss is left out.
    """
    counts = marker_is_shown(at, handle)
    if _gloss(at.greys).size or not counts.any():
        return False
    normal = reduce(at.by_gloss, at)
    information = normal.information[counts]
    scale = np.trace(information, axis1=1, axis2=2)[:, None, None]
    information = information + (1e-9 * scale + 1e-12) * np.eye(3)
    gradient = normal.gradient[counts]
    gain = (gradient * np.linalg.solve(information, gradient[..., None])[..., 0]).mean()
    usual = max(float(np.median(misfit(at)[counts])), 1.0)
    return float(gain) > least_gain * usual


def reduce(by_other: Array, at: Linear) -> Reduced:
    """Normal equations for unknowns with derivatives `by_other` (k, m, p), the greys of each window
    eliminated.
    """
    n = by_other.shape[1]
    r = at.residual[:, None]
    C = at.by_greys
    every = np.concatenate([by_other, C, r], axis=1, dtype=float)
    products = (every * at.weight[:, None]) @ every.transpose(0, 2, 1)
    CC, OC = products[:, n:-1, n:-1], products[:, :n, n:-1]
    CC += 1e-9 * np.trace(CC, axis1=1, axis2=2)[:, None, None] * np.eye(
        CC.shape[1]
    ) + 1e-12 * np.eye(CC.shape[1])
    solved = np.asarray(np.linalg.solve(CC, products[:, n:-1][..., np.r_[:n, -1]]), dtype=float)
    gain, greys = solved[..., :-1], solved[..., -1]
    gradient = products[:, :n, -1] - (OC @ greys[..., None])[..., 0]
    return Reduced(products[:, :n, :n] - OC @ gain, gradient, greys, gain)


def advanced(at: Linear, by_other: Array, normal: Reduced, step: Array) -> Linear:
    """The model after a step (k, m) of the other unknowns, to first order; the greys follow."""
    greys = normal.greys - (normal.greys_by_other @ step[..., None])[..., 0]
    change = (step[:, None] @ by_other + greys[:, None] @ at.by_greys)[:, 0]
    return at._replace(
        greys=at.greys + greys, predicted=at.predicted + change, residual=at.residual - change
    )


def noise_of(at: Linear, pixels: int) -> Noise:
    """The noise of a pixel that a fit leaves in its windows, whose cells are means of so many."""
    residual = np.sqrt(pixels) * at.residual
    return estimate_noise(residual, at.predicted, at.weight > 0, at.marker, at.body)


def misfit(at: Linear) -> Array:
    """Reduced chi-square of each window, shape (k,): about 1 where the window shows what the state
    predicts.
    """
    count = (at.weight > 0).sum(axis=1)
    return (at.weight * at.residual**2).sum(axis=1) / np.maximum(count - at.greys.shape[1], 1)


def has_contrast(at: Linear, handle: Handle) -> np.ndarray:
    """Whether there is anything like a marker in each window, bool (k,): as contrasty as half the
    others.
    """
    contrast = at.greys[:, 0] * (1 if handle.markers == "bright" else -1)
    clear = contrast > 3 * np.sqrt(1 / at.weight.max(initial=1e-12))  # the noise of a dark pixel
    return clear & (contrast > np.median(contrast[clear]) / 2) if clear.any() else clear


def marker_is_shown(
    at: Linear, handle: Handle, max_misfit: float = 4.0, max_rms: float = 0.15
) -> np.ndarray:
    """Whether each window shows a marker where it is predicted, bool (k,).

    A window fits if its misfit is small against the noise, or what is left against the marker's
    contrast: a real marker is never quite what the model says.
    """
    used = at.weight > 0
    rms = np.sqrt((used * at.residual**2).sum(axis=1) / np.maximum(used.sum(axis=1), 1))
    fits = (misfit(at) < max_misfit) | (rms < max_rms * np.abs(at.greys[:, 0]))
    return has_contrast(at, handle) & fits & (used.sum(axis=1) > 20)


def inverse(matrices: Array) -> Array:
    """Inverse of symmetric positive matrices, shape (..., n, n); all NaN if one is singular."""
    try:
        return np.asarray(np.linalg.inv(matrices), dtype=float)
    except np.linalg.LinAlgError:
        return np.full(np.shape(matrices), np.nan)


def limited(blur_px2: Array, step: Array) -> Array:
    """The blurs' variances after a step: no further than a factor of two away, and from 0.2 to 5 px
    squared.
    """
    return np.clip(np.clip(blur_px2 + step, 0.5 * blur_px2, 2 * blur_px2), 0.04, 25.0)


def _first_greys(C: Array, usable: np.ndarray, grey: Array) -> Array:
    """Greys (k, 6) by linear least squares, the marker's shading left out."""
    weighted = C * usable[:, None]
    CC = weighted @ C.transpose(0, 2, 1)
    CC += (1e-6 * np.trace(CC, axis1=1, axis2=2)[:, None, None] + 1e-12) * np.eye(CC.shape[1])
    greys = np.linalg.solve(CC, weighted @ grey[..., None])[..., 0]
    greys[:, 2:-1] = np.clip(greys[:, 2:-1] / np.maximum(np.abs(greys[:, 1:2]), 1.0), -1, 1)
    return greys


def _inner(side: int) -> np.ndarray:
    """Pixels of a window that are not at its border, bool (p,)."""
    inside = np.minimum(np.arange(side), np.arange(side)[::-1]) >= BORDER_PX
    return (inside[:, None] & inside).ravel()
