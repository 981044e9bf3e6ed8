"""What is printed on a page at true scale: shapes in mm.

The origin of a page is its lower left corner, x points right and y up. A grey of 0 is black ink, 1
bare paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from trinolab.checks import Array


class Area(NamedTuple):
    """Rectangles of one grey, (n, 4): left, bottom, width and height, mm. What they cover together
    has no seams.
    """

    boxes: Array
    grey: float = 0.0


class Disc(NamedTuple):
    """A filled circle: its centre and its diameter, mm."""

    centre: tuple[float, float]
    diameter: float
    grey: float


class Line(NamedTuple):
    """A thin line from point to point, mm."""

    begin: tuple[float, float]
    end: tuple[float, float]
    dashed: bool = False


class Frame(NamedTuple):
    """The thin outline of a rectangle: left, bottom, width and height, mm."""

    box: tuple[float, float, float, float]
    dashed: bool = False


class Words(NamedTuple):
    """Text, whose place is its upper left corner, or the middle of its upper edge, mm."""

    place: tuple[float, float]
    text: str
    points: float = 9.0
    centred: bool = False
    code: bool = False
    turned_deg: float = 0.0


Shape = Area | Disc | Line | Frame | Words


class Page(NamedTuple):
    """A sheet of paper of a size, mm, and what is printed on it; later shapes cover earlier ones."""

    size: tuple[float, float]
    shapes: Sequence[Shape]
