"""Finding the markers in one image: the iterative threshold, shape filters, and the intensity
centroid (Sect. 5.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from . import blobs
from .checks import Array, as_image, as_number, as_points, check_numbers, frozen

LADDER = 8  # even thresholds tried besides the bisection's
_TRIES = 10  # places looked at for each marker wanted
_FOUND = 100  # marks a place where a marker was accepted; smaller values count attempts
LARGEST_REACH_PX = 1e6  # beyond any image, and still a whole number in a loop


@dataclass(frozen=True)
class MarkerParameters:
    """Criteria for a marker in an image.

    Attributes
    ----------
    surplus : float
        Lambda of Sect. 5.1: the bisection looks for ``surplus * expected`` contours (Eq. 16).
    diameter_px : (float, float)
        Smallest and largest major axis of a marker's image.
    min_axis_ratio : float
        Minor axis divided by the major one; 0.17 is a disc turned by 80 deg.
    min_fill : float
        Area of the contour divided by that of the ellipse of the same moments.
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
        check_numbers(self, "min_axis_ratio", "min_fill", "min_contrast", low=0.0)


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
        Grey levels between the marker and its ring; the threshold of its contour.
    steps : tuple of ThresholdStep
        Thresholds tried by the bisection, with their contour counts.
    """

    uv: Array
    axes_px: Array
    contrast: Array
    threshold: Array
    steps: tuple[ThresholdStep, ...]


class Blob(NamedTuple):
    """A blob that may be a marker, as measured."""

    u: float
    v: float
    major: float
    minor: float
    contrast: float
    threshold: float
    level: float


def iterative_threshold(
    image: ArrayLike, contours: int, count: Callable[[float], int] | None = None
) -> tuple[ThresholdStep, ...]:
    """Bisect the threshold until the binary image has a wanted number of contours (Eq. 16).

    Too many contours raise the threshold, too few lower it. The count is not monotone and may never
    be the wanted one, so the bisection also ends when the interval is under one grey level. In the
    noise of a large image it counts no further than is needed to know that there are too many.

    Parameters
    ----------
    image : array_like, shape (height, width)
    contours : int
        N, the number of (bright) contours to reach.
    count : callable, optional
        Counts the contours at a threshold; those of `image` by default.

    Returns
    -------
    tuple of ThresholdStep
        Every threshold tried, in order; the last one is the paper's choice.
    """
    image = blobs.searchable(as_image(image, "image"))
    as_number(contours, "contours", low=1)
    count = count or (lambda threshold: blobs.count_contours(image, threshold, contours))
    t_min = float(image.min())
    t_max = float(image.max())
    steps = []
    while t_max - t_min >= 1.0:
        threshold = (t_max + t_min) / 2
        n = count(threshold)
        steps.append(ThresholdStep(threshold, n))
        if n == contours:
            break
        t_min, t_max = (threshold, t_max) if n > contours else (t_min, threshold)
    return tuple(steps)


def find_markers(
    image: ArrayLike,
    expected: int,
    markers: str = "bright",
    parameters: MarkerParameters | None = None,
) -> Markers:
    """Find the markers of one image and their sub-pixel centroids (Eq. 16).

    The bisection's last threshold need not show any marker, and it leaves out whole ranges.
    Contours are therefore taken from all thresholds that it visits and from evenly spaced ones;
    where these show only noise, spots that stand out from their surroundings are examined. Each
    candidate is measured at the threshold halfway up its flank. The result contains those that
    resemble a marker, each once, up to ``surplus * expected`` of the highest contrast.

    Parameters
    ----------
    image : array_like, shape (height, width)
        If it has more than 2^19 px it is searched at half its size, or a quarter; centroids come
        from all its pixels.
    expected : int
        N_0, the number of markers on the handle.
    markers : {"bright", "dark"}
    parameters : MarkerParameters, optional

    Returns
    -------
    Markers
        Empty if there is nothing like a marker.
    """
    p = parameters or MarkerParameters()
    bright = brightened(image, markers)
    wanted = most_markers(as_number(expected, "expected", low=1), p)
    steps, where = _search(bright, wanted, p)
    table = np.array(_once_each(bright, where, wanted, p), dtype=float).reshape(-1, 7)
    return Markers(
        frozen(table[:, :2]), frozen(table[:, 2:4]), frozen(table[:, 4]), frozen(table[:, 5]), steps
    )


def most_markers(expected: float, p: MarkerParameters) -> int:
    """The most markers that are looked for in an image of a handle with `expected` of them."""
    return math.ceil(p.surplus * expected)


def _search(
    image: np.ndarray, wanted: int, p: MarkerParameters
) -> tuple[tuple[ThresholdStep, ...], blobs.Places]:
    """The thresholds that the bisection tried, and what its thresholds and those of the ladder
    show.
    """
    small, scale = blobs.reduced(image)
    brightest = small.max(axis=1)
    outlines: dict[float, list[np.ndarray] | None] = {}

    def look(threshold: float) -> list[np.ndarray] | None:
        # the same pixels exceed it
        level = float(math.floor(threshold)) if small.dtype.kind == "u" else threshold
        if level not in outlines:
            outlines[level] = blobs.contours(small, brightest, level, wanted)
        return outlines[level]

    def count(threshold: float) -> int:
        lines = look(threshold)
        return blobs.count_contours(small, threshold, wanted) if lines is None else len(lines)

    steps = iterative_threshold(small, wanted, count)
    low = float(small.min())
    high = float(brightest.max())
    for threshold in np.linspace(low, high, LADDER + 2)[1:-1].tolist() if steps else ():
        if all(abs(threshold - level) > (high - low) / 30 for level in outlines):
            look(threshold)
    return steps, blobs.places(small, scale, outlines, wanted, p.diameter_px, p.min_contrast)


def _once_each(
    image: np.ndarray, where: blobs.Places, most: int, p: MarkerParameters
) -> list[Blob]:
    """Blobs like a marker, each once, by falling contrast as it seems from afar."""
    # how often, of every second pixel
    tried = np.zeros((image.shape[0] // 2 + 2, image.shape[1] // 2 + 2), np.uint8)
    blobs_found: list[Blob] = []
    for candidate in blobs.candidates(image, where, p.min_contrast)[: _TRIES * most]:
        x = round(candidate.uv[0] / 2)
        y = round(candidate.uv[1] / 2)
        if tried[y, x] > 1:
            continue
        tried[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] += 1
        blob = _first_blob(image, candidate, p)
        if blob is None or tried[round(blob.v / 2), round(blob.u / 2)] >= _FOUND:
            continue
        blobs_found.append(halfway(image, blob, p))
        if len(blobs_found) == most:
            break
        cv2.circle(
            tried,
            (round(blob.u / 2), round(blob.v / 2)),
            round(blobs_found[-1].major / 4),
            _FOUND,
            -1,
        )
    return blobs_found


def markers_at(
    image: ArrayLike,
    uv: ArrayLike,
    reach_px: float,
    markers: str = "bright",
    parameters: MarkerParameters | None = None,
) -> Array:
    """Measure markers where they are expected, instead of looking for them in all of an image.

    Parameters
    ----------
    image : array_like, shape (height, width)
        May be a part of an image.
    uv : array_like, shape (n, 2)
        px, off by at most half a marker. Rows with a NaN, or outside the image, are skipped.
    reach_px : float
        How far a marker may reach from there.
    markers : {"bright", "dark"}
    parameters : MarkerParameters, optional

    Returns
    -------
    ndarray, shape (n, 6)
        Centroid u, v, px; major and minor axis, px; contrast, threshold, grey levels. NaN where
        there is nothing like a marker.
    """
    from . import marker_loops  # only here: a browser has no Numba

    p = parameters or MarkerParameters()
    places = as_points(uv, "uv", 2)
    reach_px = as_number(reach_px, "reach_px", low=1.0)
    bright = brightened(image, markers)
    # a copy: the loop is compiled for few types, and for memory that may be written to
    bright = np.array(bright, np.uint8 if bright.dtype == np.uint8 else float, order="C")
    limits = np.array([*p.diameter_px, p.min_axis_ratio, p.min_fill, p.min_contrast])
    table = np.empty((len(places), 6))
    marker_loops.measure(bright, places, min(reach_px, LARGEST_REACH_PX), limits, table)
    return table


def _first_blob(image: np.ndarray, candidate: blobs.Candidate, p: MarkerParameters) -> Blob | None:
    """The blob at a place, at the first of its thresholds that shows one like a marker."""
    for threshold in candidate.thresholds:
        blob = blob_at(image, candidate.uv, candidate.reach, threshold, p)
        if blob is not None:
            return blob
    return None


def blob_at(
    image: np.ndarray, uv: tuple[float, float], reach: float, threshold: float, p: MarkerParameters
) -> Blob | None:
    """The blob above a threshold at a place, or None if it is not like a marker."""
    cut = blobs.cut_out(image, uv, reach, threshold)
    if cut is None:
        return None
    area, major, minor = blobs.ellipse(cut.inside)
    if not (
        p.diameter_px[0] <= major <= p.diameter_px[1]
        and minor >= p.min_axis_ratio * major
        and area >= p.min_fill * np.pi / 4 * major * minor
    ):
        return None
    near = cv2.dilate(cut.inside, blobs.SQUARE, iterations=blobs.RING_PX - 1)
    # others' light is not the surroundings'
    ring = cut.grey[(cv2.dilate(near, blobs.SQUARE) > near) & ~cut.others]
    # the median
    level = float(np.partition(ring, len(ring) // 2)[len(ring) // 2]) if len(ring) else np.inf
    contrast = cv2.mean(cut.grey, cut.inside)[0] - level
    if contrast < p.min_contrast:
        return None
    u, v = blobs.centre_of_light(cut.grey, near.view(bool) & ~cut.others, level) + cut.corner
    return Blob(float(u), float(v), major, minor, contrast, threshold, level)


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
