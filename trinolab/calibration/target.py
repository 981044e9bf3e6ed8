"""Calibration targets and their detection in an image: chessboards, symmetric and asymmetric grids of
circles, ChArUco boards (Sect. 6.2).

The target's frame: origin at its first point, x along a row of points, y along a column, z away
from a viewer who sees x point right and y down. The detectors are OpenCV's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from ..checks import Array, as_image, as_number, as_whole, frozen

_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-4)  # of the sub-pixel search: px
# of each kind of target what its columns and rows count
COUNTED = {
    "chessboard": "inner corners",
    "circles": "circles",
    "acircles": "circles",
    "charuco": "squares",
}
KINDS = tuple(COUNTED)
_MOST_POINTS = 200  # along a side of a target
_LEAST_PX = 3  # along a side of an image, for a point of the target
_MARKER_SHARE = 0.75  # of a square's side, where nothing else is said
_DICTIONARY = "4X4_50"
# of a ChArUco board: with fewer, markers may have been read into any pattern
_ENOUGH = 6
# of the distance of neighbours, by which a point may lie off the middle of those beside it
_UNEVEN = 0.4


@dataclass(frozen=True)
class Board:
    """A chessboard.

    Attributes
    ----------
    columns, rows : int
        Inner corners in a row and in a column, at least 3 each. If one number is odd and the other
        even, the order of the corners is unique.
    square_mm : float
        Side of a square.
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
        """The board's own corners, a white margin of one square included, shape (4, 3), mm, board
        frame.
        """
        low = -2.0
        right = self.columns + 1.0
        bottom = self.rows + 1.0
        return frozen(
            np.array([[low, low, 0], [right, low, 0], [right, bottom, 0], [low, bottom, 0]])
            * self.square_mm
        )


def find_corners(image: ArrayLike, board: Board, half_window_px: int | None = 7) -> Array:
    """Find the inner corners of a board to sub-pixel accuracy.

    The search fits the point to which the lines from all pixels of a window are perpendicular to the
    grey gradients. The half window should be less than half of the smallest distance between corners,
    lest other edges shift some of them.

    Parameters
    ----------
    image : array_like of uint8, shape (height, width)
    board : Board
    half_window_px : int or None
        The window is ``2 * half_window_px + 1`` px wide. None for 7, or less if corners are closer
        together.

    Returns
    -------
    ndarray, shape (rows * columns, 2)
        Pixels, in the order of `Board.points`; all NaN where the board is not detected as a whole.

    Raises
    ------
    ValueError
        If `image` is no grey image of 8 bit, or `half_window_px` no whole number from 1.
    """
    grey = as_image(image, "image")
    if grey.dtype != np.uint8:
        raise ValueError(f"image: expected 8 bit, got {grey.dtype}")
    half = None if half_window_px is None else as_whole(half_window_px, "half_window_px", low=1)
    detected, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows), flags=_FLAGS)
    if not detected:
        return frozen(np.full((board.rows * board.columns, 2), np.nan))
    half = half or half_window(corners.reshape(board.rows, board.columns, 2))
    return frozen(sharpened(grey, corners, half))


def sharpened(grey: np.ndarray, corners: np.ndarray, half: int) -> Array:
    """Corners (n, 2) to sub-pixel accuracy, px, from places near them in an image of uint8 and half
    a window, px.
    """
    start = np.ascontiguousarray(corners, np.float32).reshape(-1, 1, 2)
    return np.asarray(cv2.cornerSubPix(grey, start, (half, half), (-1, -1), _STOP), float).reshape(
        -1, 2
    )


def half_window(grid: np.ndarray, share: float = 0.4) -> int:
    """Half a window (px) for corners (rows, columns, 2), NaN where missing: a share of the least
    distance, 2 to 7.
    """
    between = np.concatenate(
        [np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)]
    )
    nearest = np.min(between, where=np.isfinite(between), initial=7 / share)
    return int(np.clip(share * nearest, 2, 7))


@dataclass(frozen=True)
class Target:
    """A flat target.

    Attributes
    ----------
    kind : {"chessboard", "circles", "acircles", "charuco"}
        Circles are in rows one below the other; asymmetric ones have every second row shifted by half of
        the distance in a row. Each may be printed in light on dark as well.
    columns, rows : int
        As OpenCV counts: **inner corners** of a chessboard, **circles** of a grid, both from 3;
        **squares** of a ChArUco board, from 4.
    square_mm : float
        Side of a square, or distance of the centres of neighbouring circles; of asymmetric ones the
        distance of two rows, half of that in a row.
    marker_mm : float, optional
        Side of a ChArUco board's markers; three quarters of a square without it.
    dictionary : str, optional
        Of a ChArUco board's markers, an OpenCV name, with or without ``DICT_``; 4X4_50 without it.
    first_marker : int
        Number of a ChArUco board's first marker.

    Raises
    ------
    ValueError
        If the kind is unknown, or markers are given to a target that has none.
    """

    kind: str
    columns: int
    rows: int
    square_mm: float
    marker_mm: float | None = None
    dictionary: str | None = None
    first_marker: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"board: expected one of {', '.join(KINDS)}, got {self.kind!r}")
        for name in ("columns", "rows"):
            as_whole(getattr(self, name), name, 3 + (self.kind == "charuco"), _MOST_POINTS)
        if self.kind == "acircles" and self.rows % 2 == 0:
            raise ValueError(
                f"rows: expected an odd number, got {self.rows}: asymmetric circles in even rows look the "
                "same when they are turned, and are not found in order"
            )
        square = as_number(self.square_mm, "square_mm", 0.0, 1e6, open_low=True)
        if self.kind == "charuco":
            self._check_markers(square)
        elif given := [
            name for name in ("marker_mm", "dictionary", "first_marker") if getattr(self, name)
        ]:
            name = given[0]
            raise ValueError(
                f"{name}: a {self.kind} target has no markers; expected it with charuco only"
            )

    def _check_markers(self, square: float) -> None:
        marker = as_number(self.side_of_marker, "marker_mm", low=0.0, open_low=True)
        if marker >= square:
            raise ValueError(f"marker_mm: expected less than a square ({square:g}), got {marker:g}")
        name = self.family
        if not hasattr(cv2.aruco, f"DICT_{name}"):
            raise ValueError(
                f"dictionary: expected a name such as {_DICTIONARY} or 5X5_250, got {name!r}"
            )
        available = len(dictionary_of(name).bytesList)
        as_whole(self.first_marker, "first_marker", 0)
        if self.markers[-1] >= available:
            after = f" from {self.first_marker} on" if self.first_marker else ""
            raise ValueError(
                f"dictionary: {name} has {available} markers, the board has {len(self.markers)}{after}"
            )

    @property
    def side_of_marker(self) -> float:
        """Side of a ChArUco board's marker, mm."""
        return _MARKER_SHARE * self.square_mm if self.marker_mm is None else self.marker_mm

    @property
    def family(self) -> str:
        """The dictionary of a ChArUco board's markers."""
        return (self.dictionary or _DICTIONARY).removeprefix("DICT_")

    @property
    def markers(self) -> range:
        """The numbers of a ChArUco board's markers."""
        return range(self.first_marker, self.first_marker + self.columns * self.rows // 2)

    @property
    def board(self) -> Board:
        """The points as the inner corners of a chessboard, which for a grid of circles need not be
        one.
        """
        border = int(self.kind == "charuco")
        return Board(self.columns - border, self.rows - border, self.square_mm)

    @cached_property
    def points(self) -> Array:
        """Corners or centres, row by row, shape (n, 3), mm, target frame; z = 0."""
        if self.kind != "acircles":
            return self.board.points
        y, x = np.divmod(np.arange(self.rows * self.columns), self.columns)
        return frozen(np.column_stack([2 * x + y % 2, y, np.zeros(len(x))]) * self.square_mm)

    @property
    def two_ways(self) -> bool:
        """Whether the target looks the same from two sides, so that its points can be counted in two
        ways.
        """
        return self.kind == "circles" or (
            self.kind == "chessboard" and (self.columns - self.rows) % 2 == 0
        )

    @property
    def turns(self) -> tuple[int, ...]:
        """The quarters of a turn after which the target looks the same."""
        if not self.two_ways:
            return (0,)
        return (0, 1, 2, 3) if self.columns == self.rows else (0, 2)

    def __str__(self) -> str:
        return f"{self.kind}, {self.columns} x {self.rows} {COUNTED[self.kind]}"


class Appearance(NamedTuple):
    """The appearance of a target in an image.

    Attributes
    ----------
    inverted : bool
        Light on dark: what is printed black elsewhere is white.
    mirrored : bool
        As in a mirror: a board seen from behind, or by a camera that mirrors its images.
    """

    inverted: bool = False
    mirrored: bool = False


class Detection(NamedTuple):
    """A target in an image: its points, shape (n, 2), px, with NaN for those not detected, its
    appearance, and the numbers of the markers seen.
    """

    uv: Array
    appearance: Appearance
    markers: tuple[int, ...] = ()


def appearances(target: Target) -> tuple[Appearance, ...]:
    """Possible appearances of a target, the usual first. Chessboards and circles look in a mirror
    as they do without one.
    """
    usual = (Appearance(), Appearance(inverted=True))
    if target.kind != "charuco":
        return usual
    return (*usual, *(one._replace(mirrored=True) for one in usual))


def find_target(image: ArrayLike, target: Target) -> Array:
    """Find a target's points in an image, to sub-pixel accuracy.

    Where the target could be counted in two ways, its rows are taken to run to the right in the
    image: `mirrors.upright` counts them as several cameras agree. Boards in light on
    dark, and ChArUco boards as in a mirror, are found as well.

    Parameters
    ----------
    image : array_like of uint8, shape (height, width)
    target : Target

    Returns
    -------
    ndarray, shape (n, 2)
        Pixels, in the order of `Target.points`; NaN for points not detected. Of a ChArUco board some
        points may be detected; of the others all or none.

    Raises
    ------
    ValueError
        If `image` is no grey image of 8 bit.
    """
    return detect_target(image, target, appearances(target)).uv


def detect_target(image: ArrayLike, target: Target, tried: Sequence[Appearance]) -> Detection:
    """Find a target's points as `find_target` does, and its appearance.

    Parameters
    ----------
    image : array_like of uint8, shape (height, width)
    target : Target
    tried : sequence of Appearance
        Possible appearances, one or more, the likeliest first: the first with enough points is taken,
        else the one with the most.

    Raises
    ------
    ValueError
        If `image` is no grey image of 8 bit.
    """
    grey = as_image(image, "image")
    if grey.dtype != np.uint8:
        raise ValueError(f"image: expected 8 bit, got {grey.dtype}")
    best = Detection(frozen(np.full((len(target.points), 2), np.nan)), tried[0])
    # OpenCV refuses images of a few pixels
    if min(grey.shape) < _LEAST_PX * min(target.columns, target.rows):
        return best
    most = 0
    for appearance in tried:
        uv, markers = _points_of(grey, target, appearance)
        count = int(np.isfinite(uv).all(axis=1).sum())
        if count > most:
            most = count
            best = Detection(
                frozen(upright_corners(uv, target) if target.two_ways else uv), appearance, markers
            )
        elif not most and len(markers) > len(best.markers):
            best = best._replace(markers=markers)
        if count >= _ENOUGH:
            break
    return best


def as_usual(grey: np.ndarray, appearance: Appearance) -> np.ndarray:
    """The image as it would be if the target were dark on light and not mirrored."""
    dark = 255 - grey if appearance.inverted else grey
    return np.ascontiguousarray(dark[:, ::-1]) if appearance.mirrored else dark


def _points_of(
    grey: np.ndarray, target: Target, appearance: Appearance
) -> tuple[Array, tuple[int, ...]]:
    """The points (n, 2) of a target of this appearance, NaN for those not detected, and the numbers of
    the markers seen.
    """
    usual = as_usual(grey, appearance)
    if target.kind == "charuco":
        uv, markers = _charuco(usual, target)
        if appearance.mirrored:
            uv[:, 0] = grey.shape[1] - 1 - uv[:, 0]
        return uv, markers
    if target.kind == "chessboard":
        uv = find_corners(usual, target.board, None)
        # OpenCV counts from the corner at which a square of one colour is: here of the other one
        uv = uv[::-1] if appearance.inverted else uv
    else:
        uv = _circles(usual, target)
    return (uv if _is_grid(uv, target) else np.full(uv.shape, np.nan)), ()


def _is_grid(uv: Array, target: Target) -> bool:
    """Whether each point (n, 2) lies near the middle of its neighbours along a line of the target, as in
    any view of one, and not as in what OpenCV makes of other circles and corners.
    """
    grid = uv.reshape(target.rows, target.columns, 2)
    lines = [grid, grid.transpose(1, 0, 2)]
    if target.kind == "acircles":  # where every second row stands below another
        lines = [grid, grid[::2].transpose(1, 0, 2), grid[1::2].transpose(1, 0, 2)]
    for line in lines:
        off = np.linalg.norm(line[:, 2:] - 2 * line[:, 1:-1] + line[:, :-2], axis=2) / 2
        across = np.linalg.norm(line[:, 2:] - line[:, :-2], axis=2) / 2
        if not (off <= _UNEVEN * across).all():
            return False
    return True


def _circles(grey: np.ndarray, target: Target) -> Array:
    """Centres of a grid of circles, (n, 2). A centre is its blob's, off the circle's own by the
    perspective.
    """
    grid = (
        cv2.CALIB_CB_ASYMMETRIC_GRID if target.kind == "acircles" else cv2.CALIB_CB_SYMMETRIC_GRID
    )
    for flags in (grid, grid + cv2.CALIB_CB_CLUSTERING):
        detected, centres = cv2.findCirclesGrid(grey, (target.columns, target.rows), flags=flags)
        if detected:
            return np.asarray(centres, float).reshape(-1, 2)
    return np.full((len(target.points), 2), np.nan)


def _charuco(grey: np.ndarray, target: Target) -> tuple[Array, tuple[int, ...]]:
    """Corners of a ChArUco board, (n, 2), NaN for those whose markers are not seen, and the markers."""
    uv = np.full((len(target.points), 2), np.nan)
    markers: tuple[int, ...] = ()
    # with even rows OpenCV before 4.6 drew another board
    for old in (False, True)[: 1 + (target.rows % 2 == 0)]:
        corners, ids, _, seen = _detector(target, old).detectBoard(grey)
        markers = () if seen is None else tuple(int(number) for number in np.ravel(seen))
        if ids is not None and len(ids):
            uv[np.ravel(ids)] = np.reshape(corners, (-1, 2))
            detected = np.isfinite(uv).all(axis=1)
            uv[detected] = sharpened(
                grey,
                uv[detected],
                half_window(uv.reshape(target.rows - 1, -1, 2), _free_share(target)),
            )
            break
    return uv, markers


def _free_share(target: Target) -> float:
    """The distance from a corner to the nearest marker, as a share of a square; a window should not
    reach the marker.
    """
    return (1 - target.side_of_marker / target.square_mm) / 2


def upright_corners(uv: Array, target: Target) -> Array:
    """The points (n, 2) in the one of the possible orders whose rows run most to the right."""
    grid = uv.reshape(target.rows, target.columns, 2)
    along = grid[:, -1].mean(axis=0) - grid[:, 0].mean(axis=0)
    down = grid[-1].mean(axis=0) - grid[0].mean(axis=0)
    if along[0] * down[1] < along[1] * down[0]:
        grid = grid[:, ::-1]  # counted as in a mirror
    ways = [np.rot90(grid, k) for k in target.turns]
    return max(ways, key=lambda way: float((way[:, -1] - way[:, 0])[:, 0].sum())).reshape(-1, 2)


def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of markers by its name without ``DICT_``."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


@lru_cache(maxsize=8)
def _detector(target: Target, old: bool) -> cv2.aruco.CharucoDetector:
    board = cv2.aruco.CharucoBoard(
        (target.columns, target.rows),
        target.square_mm,
        target.side_of_marker,
        dictionary_of(target.family),
        np.array(target.markers),
    )
    board.setLegacyPattern(old)
    return cv2.aruco.CharucoDetector(board)
