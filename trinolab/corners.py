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
    half = half or half_window(corners.reshape(board.rows, board.columns, 2))
    return frozen(sharpened(grey, corners, half))


def sharpened(grey: np.ndarray, corners: np.ndarray, half: int) -> Array:
    """Corners (n, 2) to sub-pixel accuracy, px, from places near them in an image of uint8 and half a window, px."""
    start = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    return np.asarray(cv2.cornerSubPix(grey, start, (half, half), (-1, -1), _STOP), float).reshape(-1, 2)


def half_window(grid: np.ndarray, share: float = 0.4) -> int:
    """Half a window (px) for corners (rows, columns, 2), NaN where missing: a share of the least distance, 2 to 7."""
    between = np.concatenate([np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)])
    nearest = np.min(between, where=np.isfinite(between), initial=7 / share)
    return int(np.clip(share * nearest, 2, 7))
