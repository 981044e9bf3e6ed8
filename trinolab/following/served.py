"""Cameras that the poses of a track do without: knocked, frozen, mirrored, covered, or one frame
ahead. They do not harm the poses, so that only a count reveals them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..camera import Rig

# instants from which on a camera serves less than every other one: how many are named, and what
# share of all that are measured
SEVERAL, SHARE = 10, 0.1


def idle_lines(frames: ArrayLike, serves: ArrayLike, rig: Rig) -> list[str]:
    """A line for each camera that serves few measured poses from some instant on.

    Parameters
    ----------
    frames : array_like of int, shape (n,)
        Of the measured instants, which increase.
    serves : array_like of bool, shape (n, cameras)
        Whether a pose rests on markers of the camera.
    rig : Rig
    """
    numbers = np.asarray(frames, int)
    lines = []
    for name, served in zip(rig.names, np.reshape(serves, (-1, len(rig.cameras))).T, strict=True):
        # from where on there are fewer of them than of the others, whichever way one goes on
        since = int(np.append(0, np.cumsum(2 * served.astype(int) - 1)).argmax())
        after = served[since:]
        if len(after) < max(SEVERAL, SHARE * len(served)):
            continue
        later = f", {after.sum()} of the {len(after)} from frame {numbers[since]} on"
        lines.append(
            f"{name}: serves {served.sum()} of {len(served)} measured instants{later if since else ''}; "
            "it is knocked, frozen, mirrored, covered or not in step, or does not see the handle"
        )
    return lines
