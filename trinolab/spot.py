"""One marker of an image, measured at a place: is it like a marker, and where is its centroid (Sect. 5.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from . import blobs
from .checks import Array, as_image, as_number, as_points


@dataclass(frozen=True)
class MarkerParameters:
    """What passes for a marker in an image.

    Attributes
    ----------
    surplus : float
        Lambda of Sect. 5.1: the bisection looks for ``surplus * expected`` contours (Eq. 16).
    diameter_px : (float, float)
        Smallest and largest major axis of a marker's image.
    min_axis_ratio : float
        Minor by major axis; 0.17 is a disc turned by 80 deg.
    min_fill : float
        Area of the contour by that of the ellipse of the same moments.
    min_contrast : float
        Grey levels between a marker and the ring around it.
    """

    surplus: float = 1.5
    diameter_px: tuple[float, float] = (4.0, 80.0)
    min_axis_ratio: float = 0.17
    min_fill: float = 0.85
    min_contrast: float = 20.0

    def __post_init__(self) -> None:
        as_number(self.surplus, "surplus", low=1.0)
        low = as_number(self.diameter_px[0], "diameter_px[0]", low=0.0, open_low=True)
        as_number(self.diameter_px[1], "diameter_px[1]", low=low)
        for name in ("min_axis_ratio", "min_fill", "min_contrast"):
            as_number(getattr(self, name), name, low=0.0)


class Blob(NamedTuple):
    """What may be a marker, as measured."""

    u: float
    v: float
    major: float
    minor: float
    contrast: float
    threshold: float
    level: float


def markers_at(image: ArrayLike, uv: ArrayLike, reach_px: float, markers: str = "bright",
               parameters: MarkerParameters | None = None) -> Array:
    """Measure markers where they are expected, instead of looking for them in all of an image.

    Parameters
    ----------
    image : array_like, shape (height, width)
        May be a part of an image.
    uv : array_like, shape (n, 2)
        px; half a marker off at most. A row with a NaN, or outside the image: not looked for.
    reach_px : float
        How far a marker may reach from there.
    markers : {"bright", "dark"}
    parameters : MarkerParameters, optional

    Returns
    -------
    ndarray, shape (n, 6)
        Centroid u, v, px; major and minor axis, px; contrast, threshold, grey levels. NaN where there is nothing like a
        marker.

    Raises
    ------
    ValueError
        If `image` is no grey image, a shape is wrong, or `markers` is another word.
    """
    p, places = parameters or MarkerParameters(), as_points(uv, "uv", 2)
    bright = brightened(image, markers)
    found = np.full((len(places), 6), np.nan)
    rows = np.flatnonzero(((places > -0.5) & (places < np.array(bright.shape[::-1]) - 0.5)).all(axis=1))
    reach = np.full(len(rows), as_number(reach_px, "reach_px", low=1.0))
    index = {tuple(places[k]): k for k in rows.tolist()}
    for candidate in blobs.candidates(bright, blobs.Places(places[rows], reach, 0 * reach + np.inf), p.min_contrast):
        tried = (blob_at(bright, candidate.uv, candidate.reach, threshold, p) for threshold in candidate.thresholds)
        if (blob := next((blob for blob in tried if blob is not None), None)) is not None:
            found[index[tuple(candidate.uv)]] = halfway(bright, blob, p)[:6]
    return found


def brightened(image: ArrayLike, markers: str) -> np.ndarray:
    """The image, inverted where markers are dark, in a type that can be searched."""
    if markers not in ("bright", "dark"):
        raise ValueError(f"markers: expected 'bright' or 'dark', got {markers!r}")
    grey = blobs.searchable(as_image(image, "image"))
    return grey if markers == "bright" else grey.max() - grey


def halfway(image: np.ndarray, blob: Blob, p: MarkerParameters) -> Blob:
    """The same blob, its contour taken about halfway up its flank if it is like a marker there."""
    for _ in range(2):
        halfway = blob.level + blob.contrast / 2
        if abs(blob.threshold - halfway) > blob.contrast / 5:
            blob = blob_at(image, (blob.u, blob.v), blob.major, halfway, p) or blob
    return blob


def blob_at(image: np.ndarray, uv: tuple[float, float], reach: float, threshold: float,
          p: MarkerParameters) -> Blob | None:
    """What exceeds a threshold at a place, or None if it is not like a marker."""
    cut = blobs.cut_out(image, uv, reach, threshold)
    if cut is None:
        return None
    area, major, minor = blobs.ellipse(cut.inside)
    if not (p.diameter_px[0] <= major <= p.diameter_px[1] and minor >= p.min_axis_ratio * major
            and area >= p.min_fill * np.pi / 4 * major * minor):
        return None
    near = cv2.dilate(cut.inside, blobs.SQUARE, iterations=blobs.RING_PX - 1)
    ring = cut.grey[(cv2.dilate(near, blobs.SQUARE) > near) & ~cut.others]  # others' light is not the surroundings'
    level = float(np.partition(ring, len(ring) // 2)[len(ring) // 2]) if len(ring) else np.inf  # the median
    contrast = cv2.mean(cut.grey, cut.inside)[0] - level
    if contrast < p.min_contrast:
        return None
    u, v = blobs.centroid(cut.grey, near.view(bool) & ~cut.others, level) + cut.corner
    return Blob(float(u), float(v), major, minor, contrast, threshold, level)
