"""Loops over the pixels of an image, written out as loops, and compiled where Numba is installed
(extra `fast`).

NumPy goes over an image once for each operation; a compiled loop goes over it once. Each loop has a
form in NumPy beside it, which gives the same result bit for bit and runs where there is no Numba.
What is compiled is kept beside the package, or in the user's folder of caches, so that a machine
compiles it once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

__all__ = ["Compiled", "compare_and_renew", "compiled", "regions_of_runs"]


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
        By which the light has become brighter.
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


def regions_of_runs(
    row: np.ndarray, begin: np.ndarray, end: np.ndarray, region: np.ndarray
) -> None:
    """Tell the 8-connected regions of runs of pixels apart (Sect. 4.2).

    Each run points at an earlier one of its region, or at itself; where two regions meet, the later
    one's first run points at the earlier one's (union and find, Tarjan 1975, DOI
    10.1145/321879.321884).

    Parameters
    ----------
    row, begin, end : ndarray of int32, shape (n,)
        See `background.Runs`.
    region : ndarray of int32, shape (n,)
        The first run of each run's region is written into it.
    """
    above = 0  # the first run that may touch the next one
    for run in range(len(row)):
        region[run] = run
        root = run
        while row[above] < row[run] - 1 or (row[above] < row[run] and end[above] < begin[run]):
            above += 1
        other = above
        while row[other] < row[run] and begin[other] <= end[run]:
            first = other
            while region[first] != first:
                region[first] = region[region[first]]  # half the way for the next time
                first = region[first]
            region[max(first, root)] = min(first, root)
            root = min(first, root)
            other += 1
    for run in range(len(row)):
        region[run] = region[region[run]]  # that of the earlier run is known


class Compiled(NamedTuple):
    """The loops as machine code."""

    compare_and_renew: Callable[..., None]
    regions_of_runs: Callable[..., None]


@cache
def compiled() -> Compiled | None:
    """The loops as machine code, or None: without Numba, or where it cannot keep what it compiles.

    The first call loads Numba (0.5 s of processor time), and on a new machine compiles (2 s).
    """
    try:
        import numba  # only here: `import trinolab` stays light
    except ImportError:  # also of a Numba that does not know the NumPy that is installed
        return None
    if numba.config.DISABLE_JIT:
        return None
    from numba import types

    def read(number: types.Type, dimensions: int) -> types.Type:
        return types.Array(number, dimensions, "C", readonly=True)

    def written(number: types.Type, dimensions: int) -> types.Type:
        return types.Array(number, dimensions, "C")

    def machine_code(loop: Callable[..., None], *arguments: types.Type) -> Callable[..., None]:
        options = {"cache": True, "error_model": "numpy", "fastmath": False}
        return numba.njit(types.void(*arguments), **options)(loop)

    try:
        return Compiled(
            machine_code(
                compare_and_renew,
                read(types.uint8, 2),
                read(types.float32, 2),
                *[types.float64] * 5,
                types.int64,
                written(types.float32, 2),
                written(types.uint8, 2),
                written(types.boolean, 2),
            ),
            machine_code(regions_of_runs, *[read(types.int32, 1)] * 3, written(types.int32, 1)),
        )
    except RuntimeError:  # no folder to keep it in, and to compile it for each process takes long
        return None
