"""Finding a chessboard's inner corners in an image, with OpenCV (Sect. 6.2)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from .board import Board
from .checks import Array, as_image, as_whole, frozen

_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-4)  # of the sub-pixel search: px


def find_corners(image: ArrayLike, board: Board, half_window_px: int | None = 7) -> Array:
    """Find the inner corners of a board to sub-pixel accuracy.

    The search fits the corner at which the grey gradients in a window are all perpendicular to the line to it. The
    half window should stay below half of the smallest distance between corners: beyond, other edges pull some away.

    Parameters
    ----------
    image : array_like of uint8, shape (height, width)
    board : Board
    half_window_px : int or None
        The window is ``2 * half_window_px + 1`` px wide. None for what suits the image: 7, or less if corners are near.

    Returns
    -------
    ndarray, shape (rows * columns, 2)
        Pixels, in the order of `Board.points`; all NaN where the board is not found whole.

    Raises
    ------
    ValueError
        If `image` is no grey image of 8 bit, or `half_window_px` no whole number from 1.
    """
    grey = as_image(image, "image")
    if grey.dtype != np.uint8:
        raise ValueError(f"image: expected 8 bit, got {grey.dtype}")
    half = None if half_window_px is None else as_whole(half_window_px, "half_window_px", low=1)
    found, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows), flags=_FLAGS)
    if not found:
        return frozen(np.full((board.rows * board.columns, 2), np.nan))
    corners = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    half = half or _half_window(corners.reshape(board.rows, board.columns, 2))
    return frozen(cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), _STOP).reshape(-1, 2).astype(float))


def _half_window(grid: np.ndarray) -> int:
    """A half window (px) for corners (rows, columns, 2): 0.4 of the smallest distance, from 2 to 7."""
    nearest = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
    return int(np.clip(0.4 * nearest, 2, 7))
