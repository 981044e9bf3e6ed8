"""What may be wrong where a target is not found: another board of its kind that is in the images
(Sect. 6.2).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
from tqdm import tqdm

from .target import Target, dictionary_of, find_target

__all__ = ["hint"]

# of each family of markers its dictionaries, the smallest first
FAMILIES = (
    *([f"{n}X{n}_{size}" for size in (50, 100, 250, 1000)] for n in (4, 5, 6, 7)),
    *([name] for name in ("ARUCO_ORIGINAL", "ARUCO_MIP_36h12")),
    *([f"APRILTAG_{name}"] for name in ("16h5", "25h9", "36h10", "36h11")),
)
FEWEST_MARKERS = 3  # in an image: one or two may be seen in any pattern
NEARBY = 2  # rows and columns that a grid of circles may have been miscounted by


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
        Empty where nothing fits.
    """
    others = _others(images, target) if images else iter(())
    shown = None if progress else True
    for other in tqdm(others, "trying other boards", unit="board", disable=shown, leave=False):
        count = sum(bool(np.isfinite(find_target(image, other)).any()) for image in images)
        if 2 * count > len(images):
            return (
                f"with {_difference(target, other)} it is found in {count} of {len(images)} tried"
            )
    return ""


def _others(images: Sequence[np.ndarray], target: Target) -> Iterator[Target]:
    """Boards that may be meant instead, the likelier first."""
    turned = replace(target, columns=target.rows, rows=target.columns)
    if target.kind == "charuco":
        yield turned
        name = _dictionary(images, target)
        if name is not None:
            yield replace(target, dictionary=name)
            yield replace(turned, dictionary=name)
        return
    if target.kind == "chessboard":
        yield from (replace(target, columns=c, rows=r) for c, r in _chessboards(images))
        return
    steps = range(-NEARBY, NEARBY + 1)
    counts = [(target.columns + a, target.rows + b) for a in steps for b in steps]

    def by_likelihood(count: tuple[int, int]) -> tuple[int, int]:
        """The largest first, since a part of a grid is a grid as well; then the least changed."""
        columns, rows = count
        return -columns * rows, abs(columns - target.columns) + abs(rows - target.rows)

    for columns, rows in sorted(counts, key=by_likelihood):
        if min(columns, rows) >= 3:
            yield replace(target, columns=columns, rows=rows)
    yield turned


def _dictionary(images: Sequence[np.ndarray], target: Target) -> str | None:
    """The dictionary whose markers are in the images, large enough for the target."""
    needed = target.columns * target.rows // 2
    seen = Counter[int]()
    for k, names in enumerate(FAMILIES):
        detector = cv2.aruco.ArucoDetector(dictionary_of(names[-1]))
        for image in images:
            for grey in (image, 255 - image):
                corners = detector.detectMarkers(grey)[0]
                seen[k] += len(corners) if len(corners) >= FEWEST_MARKERS else 0
    (family, count) = seen.most_common(1)[0]
    large = [name for name in FAMILIES[family] if len(dictionary_of(name).bytesList) >= needed]
    return large[0] if count and large else None


def _chessboards(images: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Numbers of inner corners (columns, rows) of the largest chessboards found, the commonest
    first.
    """
    shapes = Counter[tuple[int, int]]()
    for image in images:
        detected, _, meta = cv2.findChessboardCornersSBWithMeta(image, (3, 3), cv2.CALIB_CB_LARGER)
        if detected:
            rows, columns = sorted(meta.shape[:2])
            shapes[columns, rows] += 1
    return [shape for shape, _ in shapes.most_common()]


def _difference(target: Target, other: Target) -> str:
    """The arguments of the command that differ."""
    parts = []
    if other.dictionary != target.dictionary:
        parts.append(f"--dictionary {other.dictionary}")
    if (other.columns, other.rows) != (target.columns, target.rows):
        parts.append(f"--columns {other.columns} --rows {other.rows}")
    return " ".join(parts)
