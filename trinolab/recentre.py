"""Where a handle went that is not quite where it was expected: a coarse search over shifts of the predicted markers."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from .camera import Rig
from .checks import Array
from .handle import Handle
from .window import Window

FURTHEST_PX = 60  # of a shift that is looked for
COARSE = 3  # px to a step of the search
DIMMEST = 2.0  # grey levels, of half of what a marker stands out by; less is noise
SIGMA_PX = 2.0  # standard deviation of a camera's shift
AGREE_PX = 6.0  # to which the cameras' shifts must agree on one motion


def displacement(images: Sequence[np.ndarray], uv: Sequence[Array], size_px: Sequence[float], rig: Rig, handle: Handle,
                 centre: Array) -> tuple[Array, Array] | None:
    """By how much all of the handle has moved from where it was expected, if the cameras agree.

    Parameters
    ----------
    images : sequence of ndarray, shape (height, width)
    uv : sequence of ndarray, one a camera, shape (markers, 2)
        Where the markers are expected, px; NaN for those that are not.
    size_px : sequence of float
        Of a marker's image, one a camera.
    rig, handle
    centre : ndarray, shape (3,)
        Where the handle is expected, world frame, mm.

    Returns
    -------
    (ndarray, ndarray), shapes (3,) and (3, 3), or None
        The shift and its covariance, world frame, mm; None where fewer than two cameras agree.
    """
    shifts = [_shift(image, pixels, size, handle.markers)
              for image, pixels, size in zip(images, uv, size_px, strict=True)]
    seen = [c for c, shift in enumerate(shifts) if shift is not None]
    while len(seen) >= 2:
        J = np.concatenate([_by_position(rig, c, centre) for c in seen])
        wanted = np.concatenate([shifts[c] for c in seen])
        motion = np.linalg.lstsq(J, wanted, rcond=None)[0]
        left = np.linalg.norm((J @ motion - wanted).reshape(-1, 2), axis=1)
        if left.max() <= AGREE_PX:
            return motion, SIGMA_PX**2 * np.linalg.pinv(J.T @ J)
        seen.pop(int(left.argmax()))
    return None


def _by_position(rig: Rig, c: int, centre: Array) -> Array:
    """Derivative of a camera's pixel by a point's position, (2, 3), px/mm."""
    step = 0.5 * np.eye(3)
    ahead, behind = rig.cameras[c].project(centre + step), rig.cameras[c].project(centre - step)
    return np.nan_to_num((ahead - behind).T)


def _shift(image: np.ndarray, uv: Array, size_px: float, markers: str) -> Array | None:
    """The shift (2,), px, that puts most of the expected markers on spots; None if nothing stands out."""
    uv = uv[np.isfinite(uv).all(axis=1)]
    around = Window.around(np.clip(uv, -1e6, 1e6)) if len(uv) >= 2 else None
    window = around and around.grown(FURTHEST_PX + 2 * size_px).clipped((image.shape[1], image.shape[0]))
    if window is None or min(window.width, window.height) < 2 * COARSE:
        return None
    small = cv2.resize(window.crop(image).astype(np.float32), None, fx=1 / COARSE, fy=1 / COARSE,
                       interpolation=cv2.INTER_AREA)
    spots = _spots(small if markers == "bright" else -small, size_px / COARSE)
    if spots.max(initial=0.0) < DIMMEST:
        return None
    reach = FURTHEST_PX // COARSE
    padded = np.pad(spots, reach + 1)
    at = np.rint((uv - [window.u, window.v]) / COARSE - 0.5).astype(int) + reach + 1
    inside = ((at >= reach) & (at < np.array(padded.shape[::-1]) - reach)).all(axis=1)
    if inside.sum() < 2:
        return None
    score = np.add.reduce([padded[v - reach:v + reach + 1, u - reach:u + reach + 1] for u, v in at[inside].tolist()])
    v, u = np.unravel_index(score.argmax(), score.shape)
    return COARSE * (np.array([u, v], dtype=float) - reach)


def _spots(image: np.ndarray, size: float) -> np.ndarray:
    """How much a spot of a size stands out from its surroundings, at most as much as half the spots do."""
    near, wide = (cv2.GaussianBlur(image, (0, 0), sigma) for sigma in (max(size / 4, 0.6), max(size, 1.5)))
    out = np.maximum(near - wide, 0.0)
    return np.minimum(out, 0.5 * out.max(initial=0.0))
