"""What the mean errors of a track do not show: flips between equivalent poses, poses far off, and time lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .checks import as_number
from .metrics import geodesic_deg, nearest_index, position_errors, track_equivalent

FAR_MM, FAR_DEG = 2.0, 5.0  # beyond either a pose is far off


@dataclass(frozen=True)
class TrackQuality:
    """How well a track follows its truth.

    Attributes
    ----------
    flips : int
        How often the nearest equivalent changes from one measured pose to the next: each is an error.
    far_off : int
        Measured poses that are off by more than 2 mm or 5 deg, by one equivalent for the whole track.
    waits : tuple of int
        For each loss that ended, the instants without a measured pose until the next one, see `waits`.
    unended : int or None
        The same for a loss that did not end; None if the last instant was measured, or none was.
    """

    flips: int
    far_off: int
    waits: tuple[int, ...]
    unended: int | None


def flips(estimates: RigidTransform, truths: RigidTransform, symmetries: Sequence[RigidTransform]) -> int:
    """How often the nearest equivalent changes from one pose of a track to the next.

    Parameters
    ----------
    estimates, truths : RigidTransform of length n
        T_world_handle in the order of time.
    symmetries : sequence of RigidTransform
        `Handle.symmetries`.

    Raises
    ------
    ValueError
        As `metrics.nearest_equivalent`.
    """
    return int(np.count_nonzero(np.diff(nearest_index(estimates, truths, symmetries))))


def far_off(estimates: RigidTransform, truths: RigidTransform, symmetries: Sequence[RigidTransform],
            far_mm: float = FAR_MM, far_deg: float = FAR_DEG) -> int:
    """How many poses of a track are off by more than `far_mm` or `far_deg`, by one equivalent for all.

    Parameters and errors as for `flips`; also raises ValueError for a limit that is no number or negative.
    """
    far_mm, far_deg = as_number(far_mm, "far_mm", 0.0), as_number(far_deg, "far_deg", 0.0)
    turned = track_equivalent(estimates, truths, symmetries)
    beyond = (position_errors(turned, truths) > far_mm) | (geodesic_deg(turned, truths) > far_deg)
    return int(np.count_nonzero(beyond))


def waits(measured: ArrayLike, counted: ArrayLike | None = None) -> tuple[tuple[int, ...], int | None]:
    """How many instants each loss lasted: from a measured pose that no measured one follows, to the next measured one.

    Parameters
    ----------
    measured : array_like of bool, shape (n,)
        Whether an instant has a measured pose, in the order of time. What comes before the first is no loss.
    counted : array_like of bool, shape (n,), optional
        The instants that count, such as those at which the handle can be seen; all by default.

    Returns
    -------
    ended : tuple of int
        One a loss after which the track came back.
    unended : int or None
        Instants of a last loss after which it did not; None if there is none.

    Raises
    ------
    ValueError
        If the arrays are not of one dimension and one length.
    """
    seen = np.asarray(measured, dtype=bool)
    counts = np.ones(seen.shape, bool) if counted is None else np.asarray(counted, dtype=bool)
    if seen.ndim != 1 or counts.shape != seen.shape:
        raise ValueError(f"measured, counted: expected shape (n,) of both, got {seen.shape} and {counts.shape}")
    at = np.flatnonzero(seen)
    ended = tuple(int(counts[a + 1:b].sum()) for a, b in pairwise(at) if b > a + 1)
    if len(at) == 0 or seen[-1]:
        return ended, None
    return ended, int(counts[at[-1] + 1:].sum())
