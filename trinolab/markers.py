"""Finding the markers in one image: the iterative threshold, shape filters, and the intensity centroid (Sect. 5.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .checks import Array, as_image, as_number, frozen

LADDER = 8  # even thresholds tried besides the bisection's


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


class ThresholdStep(NamedTuple):
    """One step of the bisection: the threshold tried and the number of contours it gave."""

    threshold: float
    contours: int


@dataclass(frozen=True, eq=False)
class Markers:
    """The markers found in one image.

    Attributes
    ----------
    uv : ndarray, shape (n, 2)
        Centroids, px.
    axes_px : ndarray, shape (n, 2)
        Full major and minor axis of the ellipse with the contour's moments.
    contrast, threshold : ndarray, shape (n,)
        Grey levels between the marker and its ring; the threshold at which it was found.
    steps : tuple of ThresholdStep
        The bisection's way.
    """

    uv: Array
    axes_px: Array
    contrast: Array
    threshold: Array
    steps: tuple[ThresholdStep, ...]

class _Blob(NamedTuple):
    """A contour that may be a marker's; `off_halfway` is how far its threshold lies from halfway up its flank."""

    u: float
    v: float
    major: float
    minor: float
    contrast: float
    threshold: float
    off_halfway: float


def iterative_threshold(image: ArrayLike, contours: int) -> tuple[ThresholdStep, ...]:
    """Bisect the threshold until the binary image has a wanted number of contours (Eq. 16).

    Too many contours raise the threshold, too few lower it. The count is not monotone and may never be the wanted one,
    so the bisection also ends when the interval is under one grey level.

    Parameters
    ----------
    image : array_like, shape (height, width)
    contours : int
        N, the number of (bright) contours to reach.

    Returns
    -------
    tuple of ThresholdStep
        Every threshold tried, in order; the last one is the paper's choice.

    Raises
    ------
    ValueError
        If `image` is no grey image or `contours` is not positive.
    """
    image = as_image(image, "image")
    as_number(contours, "contours", low=1)
    t_min, t_max = float(image.min()), float(image.max())
    steps = []
    while t_max - t_min >= 1.0:
        threshold = (t_max + t_min) / 2
        n = cv2.connectedComponents((image > threshold).astype(np.uint8))[0] - 1
        steps.append(ThresholdStep(threshold, n))
        if n == contours:
            break
        t_min, t_max = (threshold, t_max) if n > contours else (t_min, threshold)
    return tuple(steps)


def find_markers(image: ArrayLike, expected: int, markers: str = "bright",
                 parameters: MarkerParameters | None = None) -> Markers:
    """Find the markers of one image and their sub-pixel centroids (Eq. 16).

    The bisection's last threshold need not show any marker, and it leaves out whole ranges. So the marker-like contours
    of all thresholds that it visits and of a ladder of even ones are kept, each at the threshold nearest to halfway up
    its flank, and of these the ``surplus * expected`` with the highest contrast.

    Parameters
    ----------
    image : array_like, shape (height, width)
    expected : int
        N_0, the number of markers on the handle.
    markers : {"bright", "dark"}
    parameters : MarkerParameters, optional

    Returns
    -------
    Markers
        Empty if there is nothing like a marker.

    Raises
    ------
    ValueError
        If `image` is no grey image, `expected` is not positive or `markers` is another word.
    """
    if markers not in ("bright", "dark"):
        raise ValueError(f"markers: expected 'bright' or 'dark', got {markers!r}")
    p = parameters or MarkerParameters()
    image = as_image(image, "image")
    bright = image if markers == "bright" else image.max() - image
    wanted = int(np.ceil(p.surplus * as_number(expected, "expected", low=1)))
    steps = iterative_threshold(bright, wanted)
    thresholds = [*(step.threshold for step in steps), *np.linspace(bright.min(), bright.max(), LADDER + 2)[1:-1]]
    blobs = [blob for threshold in thresholds for blob in _blobs(bright, threshold, p)] if steps else []
    table = np.array(_once_each(blobs, wanted), dtype=float).reshape(-1, 7)
    return Markers(frozen(table[:, :2]), frozen(table[:, 2:4]), frozen(table[:, 4]), frozen(table[:, 5]), steps)


def centroid(image: ArrayLike, mask: ArrayLike, background: float) -> Array:
    """Intensity centroid of the pixels under a mask, above a background level (Sect. 5.1).

    Parameters
    ----------
    image : array_like, shape (height, width)
    mask : array_like of bool, shape (height, width)
    background : float
        Grey level that counts as zero; what is darker has no weight.

    Returns
    -------
    ndarray, shape (2,)
        u, v in px from the centre of the image's first pixel; NaN if nothing is brighter than the background.

    Raises
    ------
    ValueError
        If `image` is no grey image or `mask` has another shape.
    """
    image = as_image(image, "image")
    mask = np.asarray(mask, dtype=bool)
    if mask.shape != image.shape:
        raise ValueError(f"mask: expected shape {image.shape}, got {mask.shape}")
    weight = np.where(mask, np.maximum(image.astype(float) - background, 0.0), 0.0)
    total = weight.sum()
    if total == 0:
        return frozen(np.full(2, np.nan))
    v, u = np.indices(image.shape)
    return frozen(np.array([(u * weight).sum(), (v * weight).sum()]) / total)


def _blobs(image: np.ndarray, threshold: float, p: MarkerParameters) -> list[_Blob]:
    """The marker-like contours at one threshold."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats((image > threshold).astype(np.uint8), connectivity=8)
    low, high = p.diameter_px
    longest = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    size_fits = (longest >= 0.7 * low) & (longest <= high + 2)
    size_fits[0] = False  # label 0 is the background
    found = (_blob(image, labels, stats[k], int(k), threshold, p) for k in np.flatnonzero(size_fits))
    return [blob for blob in found if blob is not None]


def _blob(image: np.ndarray, labels: np.ndarray, stats: np.ndarray, k: int, threshold: float, p: MarkerParameters,
          ring_px: int = 3) -> _Blob | None:
    """One contour, or None if it is no marker's."""
    x, y, w, h, area = stats
    if x == 0 or y == 0 or x + w == image.shape[1] or y + h == image.shape[0]:
        return None  # cut by the image's edge: its centroid means nothing
    around = (slice(max(y - ring_px - 1, 0), y + h + ring_px + 1), slice(max(x - ring_px - 1, 0), x + w + ring_px + 1))
    patch, inside = image[around], (labels[around] == k).astype(np.uint8)
    major, minor = _axes(inside)
    if not (p.diameter_px[0] <= major <= p.diameter_px[1] and minor >= p.min_axis_ratio * major
            and area >= p.min_fill * np.pi / 4 * major * minor):
        return None
    near = cv2.dilate(inside, np.ones((3, 3), np.uint8), iterations=ring_px - 1)
    dark = labels[around] == 0  # what is bright and not of this contour is another thing's light
    ring = cv2.dilate(near, np.ones((3, 3), np.uint8)).astype(bool) & ~near.astype(bool) & dark
    if not ring.any():
        return None
    level = float(np.median(patch[ring]))
    contrast = float(patch[inside.astype(bool)].mean()) - level
    if contrast < p.min_contrast:
        return None
    u, v = centroid(patch, near & (dark | inside), level) + [around[1].start, around[0].start]
    return _Blob(float(u), float(v), major, minor, contrast, threshold, abs(threshold - level - contrast / 2))


def _once_each(blobs: list[_Blob], most: int) -> list[_Blob]:
    """The blobs of highest contrast, each place once: the one nearest to halfway of those about as contrasty there."""
    left = sorted(blobs, key=lambda b: -b.contrast)
    kept: list[_Blob] = []
    while left and len(kept) < most:
        here = np.linalg.norm(np.array(left)[:, :2] - left[0][:2], axis=1) <= left[0].major / 2
        rivals = [b for b, near in zip(left, here, strict=True) if near and b.contrast >= left[0].contrast / 2]
        kept.append(min(rivals, key=lambda b: b.off_halfway))
        left = [b for b, near in zip(left, here, strict=True) if not near]
    return kept


def _axes(mask: np.ndarray) -> tuple[float, float]:
    """Major and minor axis of the ellipse with a mask's second moments, px; a pixel's own 1/12 px^2 is included."""
    m = cv2.moments(mask, binaryImage=True)
    mean, half = (m["mu20"] + m["mu02"]) / 2, np.hypot((m["mu20"] - m["mu02"]) / 2, m["mu11"])
    major, minor = (mean + half) / m["m00"], (mean - half) / m["m00"]
    return 4 * float(np.sqrt(major + 1 / 12)), 4 * float(np.sqrt(max(minor, 0.0) + 1 / 12))
