"""Whether a camera of the rig has turned within a recording, which one, and when.

In each instant the images' offsets against each other are estimated together with the pose, from
the identified markers alone (`identity.reconcile.fit_with_offsets`). Offsets that a motion of the
handle explains cannot be observed: three of the 2 C are missing. A camera that turns shifts its
image from then on by the same amount, wherever the handle is. For each camera and each moment a
model with such a shift is therefore compared with one without, by least squares; constant offsets
are allowed in both (the likelihood ratio of a change; Csorgo and Horvath 1997, Limit Theorems in
Change-Point Analysis).

Successive instants are correlated, because the remaining bias of the centroids depends on the pose.
The ratio is divided by its inflation for a first-order autoregression, and compared with the value
that such noise exceeds once in a thousand recordings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from ..camera import Rig
from ..checks import Array
from ..handle import Handle
from ..identity.hypotheses import Poses
from ..identity.parameters import IdentityParameters
from ..identity.reconcile import fit_with_offsets
from ..sensitivity import contradicting, pixel_slopes

BLOCK = 5  # instants of which the middle one counts: a wrong marker does not last
FEWEST = 4  # blocks on either side of a change
SMALLEST_PX = 0.3  # shift; markers that are seen from another side make as much
THRESHOLD = 100.0  # of the likelihood ratio: what noise exceeds in fewer than one recording of 1000
ALIKE = 0.5  # share of the threshold by which a camera explains a change better than another
MOST_TESTED = 200  # moments
FEWEST_MARKERS = 3  # that a camera must show
SIGMA_PX = 0.15  # of a centroid whose bias goes with the pose


class Drift(NamedTuple):
    """A camera has turned.

    Attributes
    ----------
    cameras : tuple of int
        The camera; several if the images do not determine which of them it is.
    instant : int
        The first instant after the turn, counted among the given ones.
    shift_px : float
        The observable displacement of its image.
    turned_deg : float
        The angle of the turn.
    """

    cameras: tuple[int, ...]
    instant: int
    shift_px: float
    turned_deg: float


class Series(NamedTuple):
    """Offsets of the images over n instants.

    Attributes
    ----------
    instant : ndarray of int, shape (n,)
        Indices among the given instants.
    shift : ndarray, shape (n, 2 C)
        The observable part of the offsets, px.
    shows : ndarray, shape (n, 2 C, 2 C)
        The projection of any offsets onto that part.
    """

    instant: np.ndarray
    shift: Array
    shows: Array


def image_offsets(
    rig: Rig, handle: Handle, poses: RigidTransform, uv: Array, p: IdentityParameters
) -> Series:
    """The offsets of the images against each other, instant by instant.

    Parameters
    ----------
    rig, handle
    poses : RigidTransform of length n
        T_world_handle, right to some pixels.
    uv : ndarray, shape (n, cameras, markers, 2)
        Identified markers, px; NaN where there is none. An instant counts if two cameras or more
        show three.
    p : IdentityParameters
    """
    C = uv.shape[1]
    seeing = np.isfinite(uv).all(axis=3).sum(axis=2) >= FEWEST_MARKERS
    parts = [(np.zeros(0, int), np.zeros((0, 2 * C)), np.zeros((0, 2 * C, 2 * C)))]
    for pattern in np.unique(seeing, axis=0):
        cameras = np.flatnonzero(pattern)
        if len(cameras) < 2:
            continue
        instant = np.flatnonzero((seeing == pattern).all(axis=1))
        partial_rig = Rig(tuple(rig.cameras[c] for c in cameras))
        shift, shows = _shifts(partial_rig, handle, poses[instant], uv[instant][:, cameras], p)
        rows = (2 * cameras[:, None] + [0, 1]).ravel()
        all_shift = np.zeros((len(instant), 2 * C))
        all_shift[:, rows] = shift
        all_shows = np.zeros((len(instant), 2 * C, 2 * C))
        all_shows[:, rows[:, None], rows] = shows
        parts.append((instant, all_shift, all_shows))
    instant, shift, shows = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(instant)
    whole = order[np.isfinite(shift[order]).all(axis=1)]
    return Series(instant[whole], shift[whole], shows[whole])


def _shifts(
    rig: Rig, handle: Handle, poses: RigidTransform, uv: Array, p: IdentityParameters
) -> tuple[Array, Array]:
    """`Series.shift` and `Series.shows` of instants that all cameras of a rig see."""
    place = poses.translation
    by_position = np.stack([pixel_slopes(camera, place)[1] for camera in rig.cameras], axis=1)
    basis = contradicting(by_position.reshape(len(place), -1, 3))
    m = basis.shape[2]
    start = Poses(poses.rotation.as_matrix(), place)
    nothing = np.zeros((m, m))
    fit = fit_with_offsets(rig, handle, start, uv, basis, nothing, SIGMA_PX, p)
    return (basis @ fit.size[..., None])[..., 0], basis @ basis.mT


def find_drift(series: Series, rig: Rig) -> Drift | None:
    """The most likely turn of a camera, if there is one.

    Parameters
    ----------
    series : Series
    rig : Rig
    """
    blocks = _blocks(series)
    n = len(blocks.instant)
    if n < 2 * FEWEST:
        return None
    moments = np.unique(np.linspace(FEWEST, n - FEWEST, MOST_TESTED).astype(int))
    C = len(rig.cameras)
    gains, shifts = zip(*(_changes(blocks, c, moments) for c in range(C)), strict=True)
    gain = np.array(gains)  # (C, moments)
    best = gain.max(axis=0).argmax()
    first = int(gain[:, best].argmax())
    ratio = gain[:, best] / _noise(blocks, first, moments[best], shifts[first][best])
    shift_px = float(np.linalg.norm(shifts[first][best]))
    if ratio[first] < THRESHOLD or shift_px < SMALLEST_PX:
        return None
    cameras = np.flatnonzero(ratio > ratio[first] - ALIKE * THRESHOLD)
    angle = float(np.rad2deg(shift_px / rig.cameras[first].focal.mean()))
    return Drift(tuple(cameras.tolist()), int(blocks.instant[moments[best]]), shift_px, angle)


def _blocks(series: Series) -> Series:
    """The median of every few instants, by each offset for itself; the first one's number."""
    n = len(series.instant) // BLOCK
    width = series.shift.shape[1]
    whole = slice(n * BLOCK)
    return Series(
        series.instant[whole].reshape(n, BLOCK)[:, 0],
        np.median(series.shift[whole].reshape(n, BLOCK, width), axis=1),
        series.shows[whole].reshape(n, BLOCK, width, width).mean(axis=1),
    )


def _changes(blocks: Series, camera: int, moments: np.ndarray) -> tuple[Array, Array]:
    """Decrease of the sum of squares if a camera's image has shifted at each of the moments, and
    the shifts (moments, 2), px.
    """
    mine = slice(2 * camera, 2 * camera + 2)
    later_A = np.cumsum(blocks.shows[::-1], axis=0)[::-1][moments]
    later_b = np.cumsum(blocks.shift[::-1], axis=0)[::-1][moments]
    free = np.linalg.pinv(blocks.shows.sum(axis=0), rcond=1e-6, hermitian=True)
    # the constant offsets eliminated
    cross = later_A[:, :, mine]
    normal = later_A[:, mine, mine] - cross.mT @ free @ cross
    right = later_b[:, mine] - cross.mT @ (free @ blocks.shift.sum(axis=0))
    shift = (np.linalg.pinv(normal, rcond=1e-3, hermitian=True) @ right[..., None])[..., 0]
    return (shift * right).sum(axis=1), shift


def _noise(blocks: Series, camera: int, moment: int, shift: Array) -> float:
    """The variance of an offset that shows, as if blocks were independent, px^2: what is left of
    the model with the change, times (1 + rho) / (1 - rho) of its autocorrelation rho.
    """
    change = np.zeros(blocks.shift.shape[1])
    change[2 * camera : 2 * camera + 2] = shift
    later = np.arange(len(blocks.instant)) >= moment
    residuals = blocks.shift - later[:, None] * (blocks.shows @ change)
    free = np.linalg.pinv(blocks.shows.sum(axis=0), rcond=1e-6, hermitian=True)
    residuals = residuals - (blocks.shows @ (free @ residuals.sum(axis=0)))
    squares = float((residuals * residuals).sum())
    rho = float((residuals[1:] * residuals[:-1]).sum()) / max(squares, 1e-300)
    rho = min(max(rho + 1 / len(residuals), 0.0), 0.95)  # what was fitted makes it look smaller
    information = np.trace(blocks.shows, axis1=1, axis2=2).sum()
    freedom = max(information - len(change) + 1, 1.0)
    return max(squares / freedom, 1e-8) * (1 + rho) / (1 - rho)
