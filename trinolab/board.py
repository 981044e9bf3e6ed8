"""The calibration target: a chessboard, flat, known by its inner corners (Sect. 6.2).

The board's frame: origin at the first inner corner, x along a row of corners, y along a column, z away from a viewer
who sees x point right and y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .checks import Array, as_number, as_whole, frozen


@dataclass(frozen=True)
class Board:
    """A chessboard.

    Attributes
    ----------
    columns, rows : int
        Inner corners in a row and in a column, at least 3 each. One odd and one even leave no two ways to count them.
    square_mm : float
        Side of a square.

    Raises
    ------
    ValueError
        Names the field: no whole number from 3, or a side that is not positive.
    """

    columns: int = 9
    rows: int = 6
    square_mm: float = 15.0

    def __post_init__(self) -> None:
        for name in ("columns", "rows"):
            as_whole(getattr(self, name), name, low=3)
        as_number(self.square_mm, "square_mm", low=0.0, open_low=True)

    @cached_property
    def points(self) -> Array:
        """The inner corners, row by row, shape (rows * columns, 3), mm, board frame."""
        y, x = np.divmod(np.arange(self.rows * self.columns), self.columns)
        return frozen(np.column_stack([x, y, np.zeros(len(x))]) * self.square_mm)

    @cached_property
    def outline(self) -> Array:
        """The board's own corners, a white margin of one square included, shape (4, 3), mm, board frame."""
        low, right, bottom = -2.0, self.columns + 1.0, self.rows + 1.0
        return frozen(np.array([[low, low, 0], [right, low, 0], [right, bottom, 0], [low, bottom, 0]]) * self.square_mm)
