"""Candidates for bright markers in an image: contours, spots that stand out, one blob (Sect. 5.1).

Contours are cheap and show every marker that is brighter than all noise, but in noise they are
expensive and show little. A large image is therefore searched at half its size, thresholds that
show noise are skipped, and spots that stand out from their surroundings are examined as well. This
yields candidates only, whose pixels are cut out of the full image.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .checks import Array, as_image, frozen

RING_PX = 3  # from a blob's outermost pixels to the ring around it
SQUARE = np.ones((3, 3), np.uint8)
_LARGE = 2**19  # px: larger images are searched at half their size, or a quarter
# More than this at one threshold is noise: at least the first number, and the second one for each
# blob wanted.
_RUNS = (700, 40)  # of bright pixels along the rows
_CONTOURS = (80, 4)
_SPOTS = 120  # those that stand out most are looked at
_ANGLES = np.arange(16) * np.pi / 8
RAYS = (
    np.linspace(0.25, 1.0, 10)[:, None] * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])[:, None]
).astype(np.float32)


class Places(NamedTuple):
    """Candidate places of n blobs: centre (n, 2), px; largest radius (n,), px; threshold (n,) that
    shows it, or inf.
    """

    uv: Array
    reach: Array
    threshold: Array


class Candidate(NamedTuple):
    """A place that is worth measuring, which of the `Places` it is, and the thresholds to do it at,
    the likelier one first.
    """

    place: int
    uv: tuple[float, float]
    reach: float
    thresholds: tuple[float, float]


class Cutout(NamedTuple):
    """A patch: its first pixel (u, v), its greys, the mask (0 and 1) of one blob, and that of what
    else is bright.
    """

    corner: tuple[int, int]
    grey: np.ndarray
    inside: np.ndarray
    others: np.ndarray


def searchable(image: np.ndarray) -> np.ndarray:
    """The image in a type that OpenCV's functions take, without loss."""
    return (
        image
        if image.dtype in (np.uint8, np.uint16, np.float32, np.float64)
        else image.astype(float)
    )


def reduced(image: np.ndarray) -> tuple[np.ndarray, int]:
    """The image, halved until it is small enough to be searched, and the side of one of its pixels
    in original pixels.
    """
    scale = 1
    while image.size > _LARGE:
        image = _halved(image)
        scale = 2 * scale
    return image, scale


def contours(
    image: np.ndarray, brightest: np.ndarray, threshold: float, wanted: int
) -> list[np.ndarray] | None:
    """The contours, 8-connected, of what exceeds a threshold, (k, 1, 2) each; None if that is
    noise.

    `brightest` holds the largest grey of each row, (height,).
    """
    rows = np.flatnonzero(brightest > threshold)
    top, bottom = (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 1)
    every_13th = image[top + 6 : bottom : 13]
    sampled_rows = _above(every_13th, threshold) if len(every_13th) else every_13th
    if 13 * np.count_nonzero(sampled_rows[:, 1:] > sampled_rows[:, :-1]) > max(
        _RUNS[0], _RUNS[1] * wanted
    ):
        return None
    binary = _above(image[top:bottom], threshold)
    outlines, tree = cv2.findContours(
        binary, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE, offset=(0, top)
    )
    # not those of holes
    return [] if tree is None else [outlines[k] for k in np.flatnonzero(tree[0, :, 3] < 0).tolist()]


def count_contours(image: np.ndarray, threshold: float, enough: int) -> int:
    """Count the contours; if the middle of a large image has more than enough of them for certain,
    only those there.
    """
    binary = _above(image, threshold)
    if binary.size > _LARGE // 2:
        middle = binary[7 * len(binary) // 16 : 9 * len(binary) // 16]
        cut = middle[[0, -1]]  # what goes on beyond these rows may be one there
        going_on = np.count_nonzero(cut[:, 0]) + np.count_nonzero(cut[:, 1:] > cut[:, :-1])
        certain = cv2.connectedComponents(middle)[0] - 1 - int(going_on)
        if certain > enough:
            return certain
    return cv2.connectedComponents(binary)[0] - 1


def places(
    image: np.ndarray,
    scale: int,
    outlines_at: Mapping[float, list[np.ndarray] | None],
    wanted: int,
    diameter_px: tuple[float, float],
    min_contrast: float,
) -> Places:
    """Candidate places of markers: the contours `found` at each threshold, and spots that stand
    out; each place once.

    A pixel of `image` covers `scale` x `scale` pixels of the whole image, to which the diameters
    refer.
    """
    lines = {
        t: outlines
        for t, outlines in outlines_at.items()
        if outlines and len(outlines) <= max(_CONTOURS[0], _CONTOURS[1] * wanted)
    }
    parts = (
        _of_contours(lines, scale, diameter_px),
        _of_spots(image, scale, diameter_px[1], min_contrast / 2),
    )
    uv, reach, threshold = (np.concatenate(part) for part in zip(*parts, strict=True))
    cell = np.column_stack([uv // 4, np.log2(reach) // 1]).astype(np.int64) @ [1, 1 << 24, 1 << 48]
    first = np.unique(cell, return_index=True)[1]
    return Places(uv[first], reach[first], threshold[first])


def candidates(image: np.ndarray, where: Places, min_contrast: float) -> list[Candidate]:
    """The places with some contrast, by falling contrast, as sixteen rays from each to its reach
    show it.

    The darkest pixel on a ray has the level of the surroundings, or is the saddle between the blob
    and its neighbour. The threshold is halfway up from that level, but above the saddle, or else
    the one that showed the place.
    """
    inside, valley = _along_rays(image, where)
    top = inside.mean(axis=1)
    level = valley[:, 7]
    saddle = valley[:, -1]
    peak = np.maximum(top, inside[:, -3])  # a bright pixel or two may be noise
    halfway = np.maximum((level + peak) / 2, 0.75 * saddle + 0.25 * peak)
    second = np.where(np.isinf(where.threshold), 0.4 * saddle + 0.6 * peak, where.threshold)
    clear = (peak - saddle >= min_contrast / 2) | (peak - where.threshold >= min_contrast / 4)
    order = np.argsort(level - top, kind="stable")
    order = order[(clear & (top - level >= 0.8 * min_contrast))[order]]
    columns = (
        order.tolist(),
        where.uv[order].tolist(),
        where.reach[order].tolist(),
        np.stack([halfway, second], axis=1)[order].tolist(),
    )
    return [Candidate(*row) for row in zip(*columns, strict=True)]


def cut_out(
    image: np.ndarray, uv: tuple[float, float], reach: float, threshold: float
) -> Cutout | None:
    """Cut out what exceeds a threshold at a place; None if nothing does, or it goes beyond its
    reach or the image.
    """
    margin = int(reach) + RING_PX + 1
    u = round(uv[0])
    v = round(uv[1])
    u0 = max(u - margin, 0)
    v0 = max(v - margin, 0)
    grey = image[v0 : v + margin + 1, u0 : u + margin + 1]
    labels = cv2.connectedComponents(_above(grey, threshold))[1]
    label = labels[v - v0, u - u0]
    if label == 0:  # the middle is dark: what surrounds it
        near = max(int(reach / 4), 1)
        middle = labels[
            max(v - v0 - near, 0) : v - v0 + near + 1, max(u - u0 - near, 0) : u - u0 + near + 1
        ]
        label = np.bincount(middle[middle > 0], minlength=1).argmax()
    inside = (labels == label).view(np.uint8)
    x, y, width, height = cv2.boundingRect(inside)
    if label == 0 or x == 0 or y == 0 or x + width == grey.shape[1] or y + height == grey.shape[0]:
        return None
    x = max(x - RING_PX - 1, 0)
    y = max(y - RING_PX - 1, 0)
    around = 2 * RING_PX + 2
    part = np.s_[y : y + height + around, x : x + width + around]
    inside = inside[part]
    return Cutout((u0 + x, v0 + y), grey[part], inside, (labels[part] > 0) & (inside == 0))


def ellipse(mask: np.ndarray) -> tuple[float, float, float]:
    """Area, px^2, and axes, px, of the ellipse with a mask's second moments; a pixel's own 1/12
    px^2 is included.
    """
    m = cv2.moments(mask)
    mean = (m["mu20"] + m["mu02"]) / 2
    half = math.hypot((m["mu20"] - m["mu02"]) / 2, m["mu11"])
    major, minor = ((mean + sign * half) / m["m00"] + 1 / 12 for sign in (1, -1))
    return m["m00"], 4 * math.sqrt(major), 4 * math.sqrt(max(minor, 1 / 12))


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
        u, v in px from the centre of the image's first pixel; NaN if nothing is brighter than the
        background.
    """
    image = as_image(image, "image")
    mask = np.asarray(mask, dtype=bool)
    if mask.shape != image.shape:
        raise ValueError(f"mask: expected shape {image.shape}, got {mask.shape}")
    return centre_of_light(image, mask, background)


def centre_of_light(image: np.ndarray, mask: np.ndarray, background: float) -> Array:
    """`centroid` of an image and a mask that need no check."""
    weight = np.where(mask, np.maximum(image.astype(float) - background, 0.0), 0.0)
    m = cv2.moments(weight)
    if m["m00"] == 0:
        return frozen(np.full(2, np.nan))
    return frozen(np.array([m["m10"], m["m01"]]) / m["m00"])


def _above(image: np.ndarray, threshold: float) -> np.ndarray:
    """255 where the image exceeds a threshold, else 0."""
    return cv2.compare(image, threshold, cv2.CMP_GT)  # type: ignore[call-overload]  # the stubs know no numbers


def _halved(image: np.ndarray) -> np.ndarray:
    """Each pixel the mean of four; an odd last row or column is left out."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    return cv2.resize(
        image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA
    )


def _of_contours(
    outlines_at: Mapping[float, list[np.ndarray]], scale: int, diameter_px: tuple[float, float]
) -> Places:
    """The contours that are neither too small nor too large for a marker."""
    low, high = diameter_px
    lines = [
        (t, line)
        for t, outlines in outlines_at.items()
        for line in outlines
        if len(line) <= 8 * (high / scale + 1)
    ]
    if not lines:
        return Places(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    n = np.array([len(line) for _, line in lines])
    xy = np.ascontiguousarray(np.concatenate([line for _, line in lines])[:, 0].T)
    starts = np.cumsum(n) - n
    first = np.minimum.reduceat(xy, starts, axis=1)
    last = np.maximum.reduceat(xy, starts, axis=1)
    longest = scale * (1 + (last - first).max(axis=0))
    fits = (longest + scale >= 0.7 * low) & (longest - scale <= high + 2)
    uv = scale * (first + last + 1).T / 2 - 0.5
    return Places(
        uv[fits], longest[fits] / 2 + RING_PX + scale, np.array([t for t, _ in lines])[fits]
    )


def _of_spots(image: np.ndarray, scale: int, largest: float, least: float) -> Places:
    """Spots that stand out by `least` grey levels in the image at a quarter of its size, an eighth,
    ...
    """
    spots = [np.zeros((4, 0))]
    while min(image.shape) > 8 and scale <= max(largest / 4, 4):
        if scale >= 4:
            rise = _rise(image)
            peak = cv2.compare(rise, cv2.dilate(rise, SQUARE), cv2.CMP_EQ) & _above(rise, least)
            at = np.flatnonzero(peak.view(bool))
            v, u = np.divmod(at, image.shape[1])
            spots.append(
                np.stack(
                    [
                        scale * (u + 0.5) - 0.5,
                        scale * (v + 0.5) - 0.5,
                        0 * u + 3.0 * scale,
                        rise.ravel()[at],
                    ]
                )
            )
        image = _halved(image)
        scale = 2 * scale
    u, v, reach, rise = np.hstack(spots)
    best = np.argsort(-rise)[:_SPOTS]
    return Places(np.column_stack([u, v])[best], reach[best], np.full(len(best), np.inf))


def _rise(image: np.ndarray) -> np.ndarray:
    """Grey levels by which a pixel exceeds the darker of two opposite neighbours 2 px away,
    whichever way they lie.
    """
    grey = cv2.blur(image, (3, 3))
    height, width = grey.shape
    wide = cv2.copyMakeBorder(grey, 2, 2, 2, 2, cv2.BORDER_REFLECT_101)
    darker = [
        cv2.min(
            wide[2 + y : 2 + y + height, 2 + x : 2 + x + width],
            wide[2 - y : 2 - y + height, 2 - x : 2 - x + width],
        )
        for x, y in ((2, 0), (0, 2), (2, 2), (2, -2))
    ]
    return cv2.subtract(grey, cv2.max(cv2.max(darker[0], darker[1]), cv2.max(darker[2], darker[3])))


def _along_rays(image: np.ndarray, where: Places) -> tuple[Array, Array]:
    """The greys where rays begin, and the least along each, (n, 16) both, sorted."""
    (height, width) = image.shape
    reach = where.reach.astype(np.float32)[:, None, None]
    # (n, points, rays)
    u, v = (where.uv[:, k, None, None].astype(np.float32) + RAYS[k] * reach for k in (0, 1))
    u, v = (
        np.clip(np.rint(x), 0, most - 1).astype(np.intp) for x, most in ((u, width), (v, height))
    )
    grey = image.ravel().take(v * width + u)
    return np.sort(grey[:, 0], axis=1).astype(float), np.sort(grey.min(axis=1), axis=1).astype(
        float
    )
