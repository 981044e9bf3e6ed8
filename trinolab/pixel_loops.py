"""Loops over the pixels of an image, compiled by Numba.

NumPy goes over an image once for each operation; a compiled loop goes over it once. The compiled
code is stored beside the package, or in the user's cache folder, so that a machine compiles it
once.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float32, float64, int64, njit, types, uint8, void


def _read(number: types.Type) -> types.Type:
    """The type of an image that is read."""
    return types.Array(number, 2, "C", readonly=True)


def _written(number: types.Type) -> types.Type:
    """The type of an image that is written into."""
    return types.Array(number, 2, "C")


@njit(
    void(
        _read(uint8),
        _read(float32),
        *[float64] * 5,
        int64,
        _written(float32),
        _written(uint8),
        _written(boolean),
    ),
    cache=True,
    error_model="numpy",
)
def compare_and_renew(
    frame: np.ndarray,
    background: np.ndarray,
    gain: float,
    difference_threshold: float,
    shadow_share: float,
    update_rate: float,
    masked_rate: float,
    white: int,
    renewed: np.ndarray,
    image: np.ndarray,
    mask: np.ndarray,
) -> None:
    """Compare a frame with the background and renew that, pixel by pixel (Eq. 5, 6).

    Parameters
    ----------
    frame : ndarray of uint8, shape (height, width)
        f_k.
    background : ndarray of float32, shape (height, width)
        B_(k-1).
    gain : float
        Factor by which the light has become brighter.
    difference_threshold, shadow_share : float
        Of Eq. 5, see `background.has_moved`.
    update_rate, masked_rate : float
        alpha of Eq. 6, and the one where something moves or is saturated.
    white : int
        Grey level at which a pixel is saturated.
    renewed : ndarray of float32, shape (height, width)
        B_k is written into it.
    image : ndarray of uint8, shape (height, width)
        D_k is written into it.
    mask : ndarray of bool, shape (height, width)
        Where something moves is written into it.
    """
    light = np.float32(gain)
    brightest = np.float32(white)
    threshold = np.float32(difference_threshold)
    shadow = np.float32(-shadow_share)
    keep = np.float32(1 - update_rate)
    take = np.float32(update_rate)
    keep_masked = np.float32(1 - masked_rate)
    take_masked = np.float32(masked_rate)
    for v in range(frame.shape[0]):
        for u in range(frame.shape[1]):
            grey = np.float32(frame[v, u])
            expected = background[v, u] * light
            visible = min(expected, brightest)
            change = grey - visible
            moved = (change > threshold) | (change < visible * shadow - threshold)
            kept = moved | (grey >= brightest)
            as_fresh = expected * keep + grey * take
            as_masked = expected * keep_masked + grey * take_masked
            # no branch: a processor then does several pixels at a time
            mask[v, u] = moved
            image[v, u] = frame[v, u] if moved else np.uint8(0)
            renewed[v, u] = as_masked if kept else as_fresh


@njit(types.UniTuple(int64, 4)(_read(boolean), int64), cache=True, error_model="numpy")
def largest_region(mask: np.ndarray, pixels: int) -> tuple[int, int, int, int]:
    """The bounding rectangle of the largest 8-connected region of a mask (Sect. 4.2).

    The pixels that follow each other in a row are a run. Each run points at an earlier one of its
    region, or at itself; where two regions meet, the later one's first run points at the earlier
    one's (union and find, Tarjan 1975, DOI 10.1145/321879.321884).

    Parameters
    ----------
    mask : ndarray of bool, shape (height, width)
    pixels : int
        How many of it are True, 1 or more.

    Returns
    -------
    u, v, width, height : int
        Of several regions with the most pixels those of the first from the top.
    """
    # of each run; there are no more than pixels
    begin = np.empty(pixels, np.int32)  # its first column
    end = np.empty(pixels, np.int32)  # the one after its last
    row = np.empty(pixels, np.int32)
    first = np.empty(pixels, np.int32)  # an earlier run of its region, or itself
    count = 0
    above = 0  # the first run that may touch the next one
    for v in range(mask.shape[0]):
        if mask[v].sum() == 0:
            continue
        u = 0
        while u < mask.shape[1]:
            if not mask[v, u]:
                u += 1
                continue
            begin[count] = u
            while u < mask.shape[1] and mask[v, u]:
                u += 1
            end[count] = u
            row[count] = v
            first[count] = count
            root = count
            while row[above] < v - 1 or (row[above] < v and end[above] < begin[count]):
                above += 1
            other = above
            while row[other] < v and begin[other] <= u:
                met = other
                while first[met] != met:
                    first[met] = first[first[met]]  # half the way for the next time
                    met = first[met]
                first[max(met, root)] = min(met, root)
                root = min(met, root)
                other += 1
            count += 1
    size = np.zeros(count, np.int64)
    for run in range(count):
        first[run] = first[first[run]]  # that of the earlier run is known
        size[first[run]] += end[run] - begin[run]
    same = np.flatnonzero(first[:count] == size.argmax())
    left = begin[same].min()
    top = row[same[0]]
    return left, top, end[same].max() - left, row[same[-1]] + 1 - top
