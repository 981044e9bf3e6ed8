"""An image model: what it predicts for windows of pixels, and how that changes with its unknowns.

In each window the grey is

    marker * shading * m  +  (body * shading + gloss) * b  +  background * (1 - b),

m and b being the shares that `loops.draw` gives after a Gaussian blur, and the shading a sum of
`shading_basis`. The gloss is light that varnish reflects from marker and body alike, whatever their
paint; it is a sum of the same functions, and is in the model where the windows show it. The greys
of a window are eliminated (Schur complement; Triggs et al. 2000, DOI 10.1007/3-540-44480-7_21), so
that none has to be known. The noise of the pixels is estimated from the residuals of a fit.

`loops` computes the model in double precision: in single precision the results of a fit would
differ between processors, which round in different orders, by a thousandth of its error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..memory import room
from .appearance import Windows, geometry_of
from .patches import BORDER_PX, Patches
from .rows import BLUR, EXPOSURE, GLOSS, GREYS, MARKER, MODEL, POSE, PREDICTED, RESIDUAL, WEIGHT

ENOUGH = 30  # pixels for a variance
CLEAR_PX = 2.5  # pixels nearer than this to another marker or to the body's end have no weight
BLUR_PX = 0.8  # where the search for a camera's blur begins
REACH_SIGMAS = 5.0  # beyond which a blur carries nothing: 1e-6 of a grey level
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
    rows : ndarray, shape (k, MODEL, p)
        As `loops.linearise` fills them.
    greys : ndarray, shape (k, 6 or 9)
        Of the state, or estimated where it had none.
    unknowns : ndarray of int, shape (7,) or (13,)
        The rows with derivatives by a small motion of the handle (nu mm, omega rad; handle frame),
        where there is motion blur by that (handle frame), and by the blur's variance.
    sums : ndarray, shape (k, 4)
        Of each window, see `loops.tally`.
    """

    rows: Array
    greys: Array
    unknowns: np.ndarray
    sums: Array

    @property
    def predicted(self) -> Array:
        """Grey levels, (k, p)."""
        return self.rows[:, PREDICTED]

    @property
    def residual(self) -> Array:
        """Grey levels seen less those predicted, (k, p)."""
        return self.rows[:, RESIDUAL]

    @property
    def weight(self) -> Array:
        """Inverse of a cell's variance, 0 where it does not count, (k, p)."""
        return self.rows[:, WEIGHT]

    @property
    def by_pose(self) -> Array:
        """Derivatives of the grey levels by the unknowns, (k, 7 or 13, p)."""
        return self.rows[:, self.unknowns]

    @property
    def marker(self) -> Array:
        """The marker's share of each cell after the blur, (k, p)."""
        return self.rows[:, MARKER]

    @property
    def by_greys(self) -> Array:
        """Derivatives of the grey levels by the window's greys, (k, 6 or 9, p)."""
        return self.rows[:, GREYS : GREYS + self.greys.shape[1]]


STILL = np.r_[POSE : POSE + 6, BLUR]
MOVING = np.r_[POSE : POSE + 6, EXPOSURE : EXPOSURE + 6, BLUR]


class Reduced(NamedTuple):
    """Normal equations of each window with its greys eliminated.

    Attributes
    ----------
    information : ndarray, shape (k, m, m)
    gradient : ndarray, shape (k, m)
    greys : ndarray, shape (k, 6 or 9)
        Step of the greys if the other unknowns stay.
    greys_by_other : ndarray, shape (k, 6 or 9, m)
        Reduction of that step per unit step of the other unknowns.
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
    from . import loops

    k, p = here.grey.shape
    rows = room((k, MODEL, p))
    greys, known = greys_of(state, here)
    taps, reaches = _taps(state.blur_px2, here.at.shape[0])
    loops.linearise(
        here.at.xy,
        *geometry_of(rig, handle, state.T_world_handle, here.views, here.at),
        here.at.shape[0],
        taps,
        reaches,
        here.views.camera,
        here.grey,
        here.valid,
        int(BORDER_PX),
        CLEAR_PX,
        greys,
        known,
        np.array(state.noise),
        float(here.at.pixels),
        rows,
    )
    return tallied(rows, greys, STILL)


def greys_of(state: State, here: Patches) -> tuple[Array, bool]:
    """A copy of a state's greys, or room for those that are to be estimated; and whether they are
    known.
    """
    if state.greys is None:
        return np.empty((len(here.grey), 6)), False
    return np.array(state.greys, dtype=float), True


def tallied(rows: Array, greys: Array, unknowns: np.ndarray) -> Linear:
    """A model with its sums."""
    from . import loops

    sums = np.empty((len(rows), 4))
    loops.tally(rows, sums)
    return Linear(rows, greys, unknowns, sums)


def _taps(blur_px2: Array, side: int) -> tuple[Array, np.ndarray]:
    """Weights of Gaussian blurs (cameras, n), and how many there are beside the middle one."""
    reaches = np.minimum(np.ceil(REACH_SIGMAS * np.sqrt(blur_px2)).astype(int), side - 1)
    taps = np.zeros((len(reaches), 2 * int(reaches.max()) + 1))
    for row, reach, variance in zip(taps, reaches, blur_px2, strict=True):
        weights = np.exp(-0.5 * np.arange(-reach, reach + 1) ** 2 / variance)
        row[: 2 * reach + 1] = weights / weights.sum()
    return taps, reaches


def _gloss(greys: Array) -> Array:
    """The factors of `shading_basis` but the first, in grey levels, shape (k, 3); (k, 0) where there
    is no gloss.
    """
    return greys[:, 5:-1]


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

    By noise alone, gloss improves a window's chi-square by 1 per unknown (score test, Rao 1948, DOI
    10.1017/S0305004100023987), where the median misfit is the noise. The windows that show a marker
    must improve by `least_gain` times as much: three more unknowns per window make a pose worse by
    a tenth, so that a little gloss is not modelled.
    """
    counts = marker_is_shown(at, handle)
    if _gloss(at.greys).size or not counts.any():
        return False
    normal = reduce(at, np.arange(GLOSS, GLOSS + 3))
    information = normal.information[counts]
    scale = np.trace(information, axis1=1, axis2=2)[:, None, None]
    information = information + (1e-9 * scale + 1e-12) * np.eye(3)
    gradient = normal.gradient[counts]
    gain = (gradient * np.linalg.solve(information, gradient[..., None])[..., 0]).mean()
    usual = max(float(np.median(misfit(at)[counts])), 1.0)
    return float(gain) > least_gain * usual


def reduce(at: Linear, unknowns: np.ndarray) -> Reduced:
    """Normal equations for unknowns, given by the rows of their derivatives, the greys of each window
    eliminated.
    """
    from . import loops

    k, count = at.greys.shape
    n = len(unknowns)
    normal = Reduced(
        np.empty((k, n, n)), np.empty((k, n)), np.empty((k, count)), np.empty((k, count, n))
    )
    loops.reduce(at.rows, np.r_[unknowns, GREYS : GREYS + count, RESIDUAL], n, *normal)
    return normal


def advanced(at: Linear, normal: Reduced, step: Array) -> Linear:
    """The model after a step (k, m) of the other unknowns, to first order; the greys follow.

    The rows of the given model are changed in place.
    """
    from . import loops

    greys = np.array(at.greys)
    rows = np.r_[at.unknowns, GREYS : GREYS + greys.shape[1]]
    loops.advance(at.rows, rows, len(at.unknowns), step, normal.greys, normal.greys_by_other, greys)
    return tallied(at.rows, greys, at.unknowns)


def noise_of(at: Linear, pixels: int, used: np.ndarray | None = None) -> Noise:
    """Estimate the noise of a pixel from what a fit leaves in windows whose cells are means of so many
    pixels; in those that are `used`, bool (k,), or in all.

    Residuals on the body, on markers and beyond the body, away from all edges, count by their
    medians, so that outliers do not. A variance that too few pixels determine keeps its default.
    """
    from . import loops

    k, _, p = at.rows.shape
    used = np.ones(k, bool) if used is None else used
    dark, bright, beyond = room((3, k * p))
    darks, brights, beyonds, level, higher = loops.residuals_by_layer(
        at.rows, used, np.sqrt(pixels), dark, bright, beyond
    )
    if min(darks, brights) < ENOUGH:
        return Noise()
    low = _robust_variance(dark[:darks])
    high = _robust_variance(bright[:brights])
    slope = min(max((high - low) / (higher - level or 1.0), 0.0), 0.7 * low / max(level, 1.0))
    texture = Noise().texture
    if beyonds >= ENOUGH:
        texture = max(_robust_variance(beyond[:beyonds]) - low, 25.0)
    return Noise(max(low - slope * level, 0.01), slope, texture)


def _robust_variance(sizes: Array) -> float:
    """A variance from the median absolute residual of a normal distribution; grey levels squared."""
    return float((1.4826 * np.median(sizes)) ** 2)


def misfit(at: Linear) -> Array:
    """Reduced chi-square of each window, shape (k,): about 1 where the window shows what the state
    predicts.
    """
    return at.sums[:, 0] / np.maximum(at.sums[:, 1] - at.greys.shape[1], 1)


def has_contrast(at: Linear, handle: Handle) -> np.ndarray:
    """Whether there is anything like a marker in each window, bool (k,): as contrasty as half the
    others.
    """
    contrast = at.greys[:, 0] * (1 if handle.markers == "bright" else -1)
    heaviest = at.sums[:, 3].max(initial=1e-12)  # of a dark pixel
    clear = contrast > 3 * np.sqrt(1 / heaviest)
    return clear & (contrast > np.median(contrast[clear]) / 2) if clear.any() else clear


def marker_is_shown(
    at: Linear, handle: Handle, max_misfit: float = 4.0, max_rms: float = 0.15
) -> np.ndarray:
    """Whether each window shows a marker where it is predicted, bool (k,).

    A window fits if its misfit is small compared with the noise, or its residuals compared with the
    marker's contrast, because a real marker never matches the model exactly.
    """
    _, count, squares, _ = at.sums.T
    rms = np.sqrt(squares / np.maximum(count, 1))
    fits = (misfit(at) < max_misfit) | (rms < max_rms * np.abs(at.greys[:, 0]))
    return has_contrast(at, handle) & fits & (count > 20)


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
