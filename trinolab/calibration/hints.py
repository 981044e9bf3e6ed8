"""What may be wrong where a target is not found: another board that is in the images (Sect. 6.2)."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from tqdm import tqdm

from .target import Look, Target, as_usual, dictionary_of, find_target, sight_target

# of each family of markers its dictionaries, the smallest first
FAMILIES = (
    *([f"{n}X{n}_{size}" for size in (50, 100, 250, 1000)] for n in (4, 5, 6, 7)),
    *([name] for name in ("ARUCO_ORIGINAL", "ARUCO_MIP_36h12")),
    *([f"APRILTAG_{name}"] for name in ("16h5", "25h9", "36h10", "36h11")),
)
FEWEST_MARKERS = 3  # in an image: one or two may be seen in any pattern
MARKERS_IN = 3  # images are looked at: there are many families
FEWEST_SQUARES = 4  # along a side of a ChArUco board
LOOKS = tuple(itertools.starmap(Look, itertools.product((False, True), repeat=2)))
AGREE = 2  # images on a larger chessboard: a shadow may look like one more row of squares
NEARBY = 2  # rows and columns that a grid of circles may have been miscounted by
UNSEEN_MARKERS, UNSEEN_CIRCLES = 2, 3  # of a board, that an image may not show
LONGEST = 3  # times as long as wide: a board


class _Markers(NamedTuple):
    """Markers that are in images: their family, how they look, in how many of the images there are
    several, and the largest number of one.
    """

    family: Sequence[str]
    look: Look
    images: int
    largest: int


def hint(images: Sequence[np.ndarray], target: Target, progress: bool = False) -> str:
    """With which arguments a target would be found in most of the images, for a person to read.

    Parameters
    ----------
    images : sequence of ndarray of uint8, shape (height, width)
        In which the target is not found.
    target : Target
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Returns
    -------
    str
        What is found instead; empty where nothing is known.
    """
    if not images:
        return ""
    if said := _first_that_fits(images, target, _of_its_kind(images, target), progress):
        return said
    markers = _markers(images[:MARKERS_IN])
    others = (
        _of_other_kinds(images, target) if markers is None else _charucos(images, target, markers)
    )
    if said := _first_that_fits(images, target, others, progress):
        return said
    if markers is None or 2 * markers.images <= len(images[:MARKERS_IN]):
        return ""
    return (
        f"markers of {markers.family[0]} are in {markers.images} of {len(images[:MARKERS_IN])} tried: likely a "
        "ChArUco board, of other columns and rows"
    )


def larger(images: Sequence[np.ndarray], target: Target) -> str:
    """Says so if images in which the target was found agree on a chessboard of more squares: a part of a
    board is found as well, and not the same part by each camera.
    """
    if target.kind != "chessboard":
        return ""
    given = max(target.columns, target.rows), min(target.columns, target.rows)
    shapes = Counter(shape for image in images for shape in _chessboards([image]))
    holding = [shape for shape in shapes if shape != given and all(np.greater_equal(shape, given))]
    shape = max(holding, key=lambda one: shapes[one], default=given)
    count = shapes[shape]
    if shape == given or count < max(AGREE, shapes[given] + 1):
        return ""
    return (
        f"a chessboard of {shape[0]} x {shape[1]} inner corners is in {count} of {len(images)} images looked "
        f"at, of which {target.columns} x {target.rows} are a part: likely --columns {shape[0]} "
        f"--rows {shape[1]} is meant, and the places here may be wrong by whole squares"
    )


def _first_that_fits(
    images: Sequence[np.ndarray], target: Target, others: Iterable[Target], progress: bool
) -> str:
    """The first of the boards that is found in most of the images, in words."""
    shown = None if progress else True
    for other in tqdm(others, "trying other boards", unit="board", disable=shown, leave=False):
        count = _found(images, other)
        if 2 * count > len(images):
            return (
                f"with {_difference(target, other)} it is found in {count} of {len(images)} tried"
            )
    return ""


def _found(images: Sequence[np.ndarray], target: Target) -> int:
    """In how many of the images a target is; 0 as soon as it cannot be most of them."""
    count = 0
    for k, image in enumerate(images):
        count += bool(np.isfinite(find_target(image, target)).any())
        if 2 * (count + len(images) - 1 - k) <= len(images):
            return 0
    return count


def _of_its_kind(images: Sequence[np.ndarray], target: Target) -> Iterator[Target]:
    """Boards that may be meant instead, the likelier first; those of ChArUco boards follow from their
    markers.
    """
    if target.kind == "chessboard":
        for columns, rows in _chessboards(images):
            yield replace(target, columns=columns, rows=rows)
    if target.kind == "circles":
        shown = _blobs(images)
        turned = replace(target, columns=target.rows, rows=target.columns)
        for other in (*_miscounted(target), turned):
            if other.columns * other.rows <= shown:
                yield other


def _of_other_kinds(images: Sequence[np.ndarray], target: Target) -> Iterator[Target]:
    """Boards without markers of another kind."""
    if target.kind != "chessboard":
        for columns, rows in _chessboards(images):
            yield Target("chessboard", columns, rows, target.square_mm)
    if target.kind != "circles":
        for columns, rows in _circle_grids(images):
            yield Target("circles", columns, rows, target.square_mm)


def _miscounted(target: Target) -> Iterator[Target]:
    """Grids of a few rows and columns more or less."""
    steps = range(-NEARBY, NEARBY + 1)
    counts = [(target.columns + a, target.rows + b) for a in steps for b in steps]

    def by_likelihood(count: tuple[int, int]) -> tuple[int, int]:
        """The largest first, since a part of a grid is a grid as well; then the least changed."""
        columns, rows = count
        return -columns * rows, abs(columns - target.columns) + abs(rows - target.rows)

    for columns, rows in sorted(counts, key=by_likelihood):
        if min(columns, rows) >= 3:
            yield replace(target, columns=columns, rows=rows)


def _markers(images: Sequence[np.ndarray]) -> _Markers | None:
    """The markers of which most are in the images; None if there are none."""
    seen, holding = Counter[tuple[int, Look]](), Counter[tuple[int, Look]]()
    largest = dict[tuple[int, Look], int]()
    # the corners of an image are looked for once, and read as markers of each family
    detector = cv2.aruco.ArucoDetector([dictionary_of(names[-1]) for names in FAMILIES])
    for image, look in itertools.product(images, LOOKS):
        _, ids, _, families = detector.detectMarkersMultiDict(as_usual(image, look))
        if ids is None:
            continue
        for family in np.unique(families):
            of_family = np.ravel(ids)[np.ravel(families) == family]
            if len(of_family) >= FEWEST_MARKERS:
                at = int(family), look
                seen[at] += len(of_family)
                holding[at] += 1
                largest[at] = max(largest.get(at, 0), int(of_family.max()))
    if not seen:
        return None
    most = seen.most_common(1)[0][0]
    return _Markers(FAMILIES[most[0]], most[1], holding[most], largest[most])


def _charucos(images: Sequence[np.ndarray], target: Target, seen: _Markers) -> list[Target]:
    """ChArUco boards of as many markers as are seen, or a few more: those of which most points are
    found first, then the smallest.
    """
    boards = [
        board
        for count in range(seen.largest + 1, seen.largest + 2 + UNSEEN_MARKERS)
        for size in _sides((2 * count, 2 * count + 1), FEWEST_SQUARES)
        if (board := _charuco(target, size, seen))
    ]

    def points(board: Target) -> int:
        uv = [sight_target(image, board, [seen.look]).uv for image in images]
        return int(np.isfinite(uv).sum())

    return sorted(boards, key=points, reverse=True)


def _charuco(target: Target, size: tuple[int, int], seen: _Markers) -> Target | None:
    """A ChArUco board of that size with the smallest dictionary; None if none is large enough."""
    columns, rows = size
    own = target.dictionary if target.kind == "charuco" else None
    needed = max(columns * rows // 2, seen.largest + 1)
    large = [name for name in seen.family if len(dictionary_of(name).bytesList) >= needed]
    if not large or min(size) < FEWEST_SQUARES:
        return None
    name = own if own in large else large[0]
    marker = target.marker_mm if target.kind == "charuco" else None
    return Target("charuco", columns, rows, target.square_mm, marker, name)


def _sides(counts: Sequence[int], fewest: int) -> list[tuple[int, int]]:
    """Numbers of columns and rows that make one of the counts."""
    return [
        (count // rows, rows)
        for count in counts
        for rows in range(fewest, count // fewest + 1)
        if count % rows == 0 and max(rows, count // rows) <= LONGEST * min(rows, count // rows)
    ]


def _chessboards(images: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Numbers of inner corners (columns, rows) of the largest chessboards found, the commonest
    first.
    """
    shapes = Counter[tuple[int, int]]()
    for image in images:
        for grey in (image, 255 - image):
            detected, _, meta = cv2.findChessboardCornersSBWithMeta(
                grey, (3, 3), cv2.CALIB_CB_LARGER
            )
            if detected:
                rows, columns = sorted(meta.shape[:2])
                shapes[columns, rows] += 1
                break
    return [shape for shape, _ in shapes.most_common()]


def _circle_grids(images: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Numbers of circles (columns, rows) of grids of as many circles as images show, or a few less:
    other things may look like one. The largest first.
    """
    most = _blobs(images)
    counts = range(most, max(most - UNSEEN_CIRCLES - 1, 8), -1)
    return _sides(counts, 3)


def _blobs(images: Sequence[np.ndarray]) -> int:
    """How many dark or light spots an image shows, in the middle of all."""
    detector = cv2.SimpleBlobDetector.create()
    shown = [
        max(len(detector.detect(image)), len(detector.detect(255 - image))) for image in images
    ]
    return int(np.median(shown))


def _difference(target: Target, other: Target) -> str:
    """The arguments of the command that differ."""
    parts = []
    if other.kind != target.kind:
        parts.append(f"--board {other.kind}")
    if other.kind == "charuco" and other.family != target.family:
        parts.append(f"--dictionary {other.dictionary}")
    if other.kind != target.kind or (other.columns, other.rows) != (target.columns, target.rows):
        parts.append(f"--columns {other.columns} --rows {other.rows}")
    return " ".join(parts)
