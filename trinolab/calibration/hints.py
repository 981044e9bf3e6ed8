"""Advice where a target is not found, or only a part of it (Sect. 6.2)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import cv2
import numpy as np

from .target import COUNTED, Target

AGREE = 2  # images on a larger chessboard: a shadow may look like one more row of squares


def hint(target: Target, markers: Sequence[tuple[int, ...]] = ()) -> str:
    """A line about a target that is not detected: the appearances tried, and the options to check. It
    names the markers seen that are not the board's.
    """
    counts = Counter(number for of in markers for number in set(of))
    others = [n for n, count in counts.items() if count >= AGREE and n not in target.markers]
    if others:
        seen = [n for n, count in counts.items() if count >= AGREE]
        return (
            f"markers {min(seen)} to {max(seen)} of {target.family} are seen, the board has "
            f"{target.markers[0]} to {target.markers[-1]}: likely it begins at another one (--first-marker "
            f"{min(seen)}), or has other --columns and --rows"
        )
    charuco = target.kind == "charuco"
    tried = "dark on light and light on dark" + (", each as in a mirror as well" if charuco else "")
    options = "--board, --dictionary, " if charuco else "--board, "
    return (
        f"tried {tried}: check {options}--columns and --rows, which count {COUNTED[target.kind]}, "
        "and that the board is whole and sharp"
    )


def larger(images: Sequence[np.ndarray], target: Target) -> str:
    """A line for images that agree on a chessboard of more squares; empty if they do not. A part of
    a board is found as well, and not the same part by each camera.
    """
    if target.kind != "chessboard":
        return ""
    given = max(target.columns, target.rows), min(target.columns, target.rows)
    shapes = _chessboards(images)
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


def _chessboards(images: Sequence[np.ndarray]) -> Counter[tuple[int, int]]:
    """Numbers of inner corners (columns, rows) of the largest chessboard in each image that has one."""
    shapes = Counter[tuple[int, int]]()
    for image in images:
        half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        for grey in (half, 255 - half):
            detected, _, meta = cv2.findChessboardCornersSBWithMeta(
                grey, (3, 3), cv2.CALIB_CB_LARGER
            )
            if detected:
                rows, columns = sorted(meta.shape[:2])
                shapes[columns, rows] += 1
                break
    return shapes
