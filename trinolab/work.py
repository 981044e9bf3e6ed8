"""The work that an instant may take, counted instead of timed: the same images give the same poses on
any computer.
"""

from __future__ import annotations

import numpy as np


class Work:
    """The work that may still be done.

    A unit is a thousand cells in a Gauss-Newton step of the image model with motion blur; other
    work is stated in such units. The units were measured on the films `fast` and `hard` of
    `studies.instant_times` with 10 ms of exposure and seed 0, where an instant takes 7 ms and a
    further 0.43 ms per unit; they were validated on other films.

    Attributes
    ----------
    remaining : float
        Units; without a limit infinitely many.
    cursor : int
        Where a search that was cut short goes on, see `identity.search.search`; 0 is its beginning.
    was_cut : bool
        Whether a search ended because too little remained.
    """

    def __init__(self, units: float = np.inf, cursor: int = 0) -> None:
        self.remaining = units
        self.cursor = cursor
        self.was_cut = False

    def takes(self, units: float) -> bool:
        """Spend so many units if they remain, and return whether they did."""
        if units > self.remaining:
            return False
        self.remaining -= units
        return True
