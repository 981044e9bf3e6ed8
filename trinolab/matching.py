"""Matches between the markers of two images: epipolar gate, grey correlation, ordering, uniqueness
(Sect. 5.2), and the view of a third camera.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .camera import Camera, Rig, epipolar_lines, ideal_pixels_of, lines_of
from .checks import Array, as_array, as_image, as_number, as_points, check_numbers, frozen
from .sensitivity import offsets_of
from .triangulation import triangulate_pair

# contrast of a window by its largest value; one grey level in one pixel of 16 bit is 1.5e-5
FLAT = 1e-6
RIG_SIGMAS = 4.0  # of the rig's errors that a gate lets through


@dataclass(frozen=True)
class MatchParameters:
    """Parameters of the matching.

    Attributes
    ----------
    epipolar_gate_px : float
        D_0, the largest distance from the epipolar line (Eq. 17).
    ncc_threshold : float
        epsilon_0, the smallest correlation of the windows (Eq. 18); -1 switches the test off.
    window_px : int
        Side of the square windows, odd, from 3 to 1001.
    """

    epipolar_gate_px: float = 2.0
    ncc_threshold: float = 0.5
    window_px: int = 21

    def __post_init__(self) -> None:
        check_numbers(self, "epipolar_gate_px", low=0.0, open_low=True)
        check_numbers(self, "ncc_threshold", low=-1.0, high=1.0)
        object.__setattr__(self, "window_px", _as_window(self.window_px))


@dataclass(frozen=True, eq=False)
class Matches:
    """Pairs of markers in two images.

    Attributes
    ----------
    index : ndarray of int, shape (k, 2)
        Rows of the left and of the right markers.
    distance_px : ndarray, shape (k,)
        D_ij (Eq. 17).
    ncc : ndarray, shape (k,)
        S_ij (Eq. 18).
    """

    index: np.ndarray
    distance_px: Array
    ncc: Array

    def __post_init__(self) -> None:
        index = as_array(self.index, "index", (None, 2))
        if (index < 0).any() or (index % 1).any() or (index > 2**31).any():
            raise ValueError(f"index: expected whole numbers from 0, got {index.tolist()}")
        object.__setattr__(self, "index", frozen(index.astype(int)))
        for name in ("distance_px", "ncc"):
            object.__setattr__(self, name, as_array(getattr(self, name), name, (len(index),)))

    def __len__(self) -> int:
        return len(self.index)


def epipolar_distances(
    left: Camera, right: Camera, uv_left: ArrayLike, uv_right: ArrayLike
) -> Array:
    """Distance of each right point from each left point's epipolar line (Eq. 17).

    Parameters
    ----------
    left, right : Camera
    uv_left, uv_right : array_like, shapes (n, 2) and (m, 2)
        Pixels as taken (distorted).

    Returns
    -------
    ndarray, shape (n, m)
        Pixels with the lens distortion removed; NaN for missing points.

    Raises
    ------
    ValueError
        If both cameras stand in one place.
    """
    lines = epipolar_lines(left, right, uv_left)
    return distances_from_lines(lines, right.ideal_pixels(uv_right))


def distances_from_lines(lines: Array, points: Array) -> Array:
    """Distance of each point (m, 2) from each line (n, 3), shape (n, m) (Eq. 17)."""
    return np.abs(lines[:, :2] @ points.T + lines[:, 2:])


def ncc(template: ArrayLike, window: ArrayLike) -> float:
    """Normalised cross-correlation of two windows of one shape (Eq. 18).

    Returns
    -------
    float
        In [-1, 1] but for rounding; 0 if either window is flat.
    """
    t = as_image(template, "template")
    w = as_image(window, "window")
    if t.shape != w.shape:
        raise ValueError(f"window: expected shape {t.shape} like the template, got {w.shape}")
    return float(correlations(standardised(t[None]), standardised(w[None]))[0, 0])


def correlations(left: Array, right: Array) -> Array:
    """Normalised cross-correlation of each left window (n, k) with each right one (m, k), shape
    (n, m) (Eq. 18).

    The windows are `standardised`: the subtraction and the division of Eq. 18 are done once per
    window, and the remaining sum over the pixels is a product of matrices.
    """
    return left @ right.T


def standardised(windows: np.ndarray) -> Array:
    """Windows (n, height, width) as rows with mean 0 and sum of squares 1, for `correlations`; zeros
    if flat.
    """
    rows = windows.reshape(len(windows), windows.shape[1] * windows.shape[2]).astype(float)
    flat = FLAT * np.abs(rows).max(axis=1, keepdims=True)
    rows -= rows.mean(axis=1, keepdims=True)
    norm = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.divide(rows, norm, out=np.zeros_like(rows), where=norm > flat)


def ncc_matrix(
    image_left: ArrayLike,
    image_right: ArrayLike,
    uv_left: ArrayLike,
    uv_right: ArrayLike,
    window_px: int,
) -> Array:
    """Correlation of the windows centred on each pair of points, shape (n, m) (Eq. 18).

    The windows are cut between pixels (bilinear), so that both are centred on their point; beyond
    the image's edge the last pixel repeats; 0 where a point is missing or a window flat. A window's
    side is odd, from 3 to 1001.
    """
    window_px = _as_window(window_px)
    left = _windows(as_image(image_left, "image_left"), as_points(uv_left, "uv_left", 2), window_px)
    right = _windows(
        as_image(image_right, "image_right"), as_points(uv_right, "uv_right", 2), window_px
    )
    return correlations(left, right)


def candidates(
    left: Camera,
    right: Camera,
    image_left: ArrayLike,
    image_right: ArrayLike,
    uv_left: ArrayLike,
    uv_right: ArrayLike,
    parameters: MatchParameters | None = None,
) -> Matches:
    """All pairs that pass the epipolar gate and the correlation threshold, several for a point if
    need be (Eq. 17-18).

    Parameters
    ----------
    left, right : Camera
    image_left, image_right : array_like, shape (height, width)
    uv_left, uv_right : array_like, shapes (n, 2) and (m, 2)
    parameters : MatchParameters, optional

    Raises
    ------
    ValueError
        If both cameras stand in one place.
    """
    p = parameters or MatchParameters()
    similarity = ncc_matrix(image_left, image_right, uv_left, uv_right, p.window_px)
    return _passing(epipolar_distances(left, right, uv_left, uv_right), similarity, p)


def rig_candidates(
    rig: Rig,
    images: Sequence[ArrayLike],
    uv: Sequence[ArrayLike],
    parameters: MatchParameters | None = None,
) -> list[Matches]:
    """`candidates` for each pair of a rig's cameras, in the order of `Rig.pairs` (Eq. 17-18).

    The rig's uncertainty widens the epipolar gate.
    """
    p = parameters or MatchParameters()
    points = [as_points(pixels, "uv", 2) for pixels in uv]
    cameras = rig.cameras
    windows = [
        _windows(as_image(image, "images"), pixels, p.window_px)
        for image, pixels in zip(images, points, strict=True)
    ]
    ideal = [ideal_pixels_of(*each) for each in zip(cameras, points, strict=True)]
    matches = []
    for (i, j), gate in zip(rig.pairs, _epipolar_gates(rig, points, p), strict=True):
        distance = distances_from_lines(lines_of(cameras[i], cameras[j], ideal[i]), ideal[j])
        matches.append(_passing(distance, correlations(windows[i], windows[j]), gate))
    return matches


def _epipolar_gates(rig: Rig, uv: Sequence[Array], p: MatchParameters) -> list[MatchParameters]:
    """The parameters for each pair of cameras."""
    offsets = offsets_of(rig, list(uv))
    if offsets is None:
        return [p] * len(rig.pairs)
    wider = (RIG_SIGMAS * offsets.apart_px(i, j) for i, j in rig.pairs)
    return [replace(p, epipolar_gate_px=float(np.hypot(p.epipolar_gate_px, w))) for w in wider]


def match(
    left: Camera,
    right: Camera,
    image_left: ArrayLike,
    image_right: ArrayLike,
    uv_left: ArrayLike,
    uv_right: ArrayLike,
    parameters: MatchParameters | None = None,
) -> Matches:
    """The paper's matching: candidates, then both directions, then order along the epipolar lines
    (Sect. 5.2).

    Parameters and errors as in `candidates`.
    """
    p = parameters or MatchParameters()
    candidate_pairs = candidates(left, right, image_left, image_right, uv_left, uv_right, p)
    return in_order(mutual(candidate_pairs), left, right, uv_left, uv_right, p.epipolar_gate_px)


def mutual(matches: Matches) -> Matches:
    """Keep the pairs that are each other's best by correlation: uniqueness in both directions
    (Sect. 5.2, step 3).
    """
    keep = [
        k
        for k, (i, j) in enumerate(matches.index)
        if matches.ncc[k] >= matches.ncc[matches.index[:, 0] == i].max()
        and matches.ncc[k] >= matches.ncc[matches.index[:, 1] == j].max()
    ]
    return _subset(matches, keep)


def in_order(
    matches: Matches,
    left: Camera,
    right: Camera,
    uv_left: ArrayLike,
    uv_right: ArrayLike,
    gate_px: float,
) -> Matches:
    """Drop pairs that break the order along an epipolar line, the weaker of two first (Sect. 5.2,
    step 3).

    The paper names the constraint and does not define it. Here: of two pairs whose points could be
    exchanged within the epipolar gate, the points must follow each other in the same sense on the
    left and on the right line.

    Raises ValueError if a match has an index beyond the points, or as `epipolar_distances`.
    """
    as_number(gate_px, "gate_px", low=0.0)
    uv_left = as_points(uv_left, "uv_left", 2)
    uv_right = as_points(uv_right, "uv_right", 2)
    swap = epipolar_distances(left, right, uv_left, uv_right)
    _check_indices(matches, swap.shape)
    baseline = right.centre - left.centre
    along_left = left.rays(uv_left) @ baseline
    along_right = right.rays(uv_right) @ baseline
    keep: list[int] = []
    for k in np.argsort(-matches.ncc, kind="stable"):
        i, j = matches.index[k]
        rivals = [matches.index[n] for n in keep]
        if all(
            swap[i, b] >= gate_px
            or swap[a, j] >= gate_px
            or (along_left[i] - along_left[a]) * (along_right[j] - along_right[b]) > 0
            for a, b in rivals
        ):
            keep.append(int(k))
    return _subset(matches, sorted(keep))


def confirmed(
    matches: Matches, cameras: Sequence[Camera], uv: Sequence[ArrayLike], tolerance_px: float
) -> Matches:
    """Keep the pairs whose point in space falls on a spot of a third camera.

    Of pairs that share a spot only the one nearest to a spot of the third camera stays. A marker
    that the third camera does not see is lost.

    Parameters
    ----------
    matches : Matches
        Pairs of the first two cameras, for example all that pass the epipolar gate.
    cameras : sequence of Camera
        The left, the right and the third one.
    uv : sequence of array_like, shape (n, 2)
        The points of each, px.
    tolerance_px : float
        Largest distance of a spot from the image of the pair's point, px.

    Raises
    ------
    ValueError
        If there are not three cameras with their points, a match has an index beyond the
        points, or as `triangulate_pair`.
    """
    tolerance_px = as_number(tolerance_px, "tolerance_px", low=0.0)
    if not len(cameras) == len(uv) == 3:
        raise ValueError(f"cameras, uv: expected three of each, got {len(cameras)} and {len(uv)}")
    left, right, third = cameras
    uv_left, uv_right, uv_third = (as_points(pixels, "uv", 2) for pixels in uv)
    shape = len(uv_left), len(uv_right)
    _check_indices(matches, shape)
    i, j = matches.index.T
    images = third.project(triangulate_pair(left, right, uv_left[i], uv_right[j]))
    away = np.linalg.norm(images[:, None] - uv_third, axis=2)
    miss = np.full(shape, np.inf)
    miss[i, j] = np.nan_to_num(away, nan=np.inf).min(axis=1, initial=np.inf)
    best_of_left = miss == miss.min(axis=1, keepdims=True, initial=np.inf)
    best = best_of_left & (miss == miss.min(axis=0, initial=np.inf))
    return _subset(matches, list(np.flatnonzero((best & (miss <= tolerance_px))[i, j])))


def _check_indices(matches: Matches, shape: tuple[int, ...]) -> None:
    if (matches.index >= shape).any():
        raise ValueError(
            f"matches: expected indices below {shape}, got {matches.index.max(axis=0).tolist()}"
        )


def _windows(image: np.ndarray, uv: Array, window_px: int) -> Array:
    """Windows about points as rows of zero mean and length 1 (zero where flat or the point is
    missing).
    """
    if image.dtype != np.uint8:
        image = image.astype(np.float32)
    cuts = np.zeros((len(uv), window_px, window_px))
    outside = np.array(image.shape[::-1]) + window_px  # from there on all windows are the same
    for k in np.flatnonzero(np.isfinite(uv).all(axis=1)):
        centre = np.clip(uv[k], -window_px, outside)
        cuts[k] = cv2.getRectSubPix(
            image, (window_px, window_px), tuple(centre), patchType=cv2.CV_32F
        )
    return standardised(cuts)


def _as_window(value: int) -> int:
    if as_number(value, "window_px", low=3, high=1001) % 2 != 1:
        raise ValueError(f"window_px: expected an odd whole number from 3, got {value!r}")
    return int(value)


def _passing(distance: Array, similarity: Array, p: MatchParameters) -> Matches:
    i, j = index = np.nonzero((distance < p.epipolar_gate_px) & (similarity > p.ncc_threshold))
    return Matches(np.transpose(index), frozen(distance[i, j]), frozen(similarity[i, j]))


def _subset(matches: Matches, keep: list[int]) -> Matches:
    rows = np.array(keep, dtype=int)
    return Matches(
        frozen(matches.index[rows]), frozen(matches.distance_px[rows]), frozen(matches.ncc[rows])
    )
