"""How large a data sheet is, and from which seed it is drawn: asked before anything is loaded that
makes one.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from trinolab.checks import as_whole

POSES = 512
FEWEST_POSES, MOST_POSES = 8, 2**13


def checked_size(poses: int, seed: int) -> tuple[int, int]:
    """The number of poses of the static test, and the seed. Raises ValueError for one out of range."""
    return (
        as_whole(poses, "poses", FEWEST_POSES, MOST_POSES),
        as_whole(seed, "seed", 0, 2**31 - 1),
    )


def check_chart(chart: str | Path | None, recordings: Sequence[str | Path]) -> None:
    """Refuse, with a ValueError, a control chart for a sheet of recordings."""
    if recordings and chart is not None:
        raise ValueError("chart: expected no recordings beside it, it holds what is rendered")
