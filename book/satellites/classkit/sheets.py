"""The pages of the kit: bars that check the printer, a wrap for the rod, a ChArUco board.

Each page has a bar of 100 mm, because pages are printed again one by one.
"""

from __future__ import annotations

import cv2
import numpy as np

from trinolab.calibration.target import Target, dictionary_of
from trinolab.checks import Array

from .shapes import Area, Disc, Frame, Line, Page, Shape, Words
from .wrap import TAB_MM, Wrap

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}  # mm
EDGE_MM = 10.0  # which no printer reaches
BAR_MM = 100.0
BAR_WIDTH_MM = 1.5
HEAD_MM = 26.0  # above what a page is for
FOOT_MM = 30.0  # below it: the bar, and a command
SQUARES = (7, 9)  # of the board, in a row and in a column
DICTIONARY = "4X4_50"
_MODULES = 8  # a square of the board, by the side of a marker's smallest part
_CUT = "Cut along the edge of the dark area; where it is white, along the thin line."


def page_of_bars(size: tuple[float, float], what: str) -> Page:
    """The first page: a bar each way, and what to do with the kit."""
    left_edge, top = EDGE_MM + 8, size[1] - EDGE_MM
    across = (left_edge + 12, top - 52)
    shapes: list[Shape] = [
        Words((left_edge, top), "Class kit", 18),
        Words((left_edge, top - 10), what, 10),
        Words((left_edge, top - 22), "1  Check the printer", 12),
        Words(
            (left_edge, top - 29),
            "Print at 100 % (“actual size”), not “fit to page”. Then measure both bars with a steel ruler.\n"
            "They are 100 mm from end to end.",
        ),
        *bar(across, upright=False),
        *bar((left_edge + 3, across[1] - 16 - BAR_MM), upright=True),
    ]
    beside = left_edge + 24
    shapes += [
        Words((beside, across[1] - 14), "across:  ________ mm        along:  ________ mm", 11),
        Words(
            (beside, across[1] - 28),
            "99.8 to 100.2 mm, both: go on.\n\n"
            "Both the same, but off (96 or 97 mm is usual): the page was fitted to the\n"
            "paper. Print again at 100 %, from another program if this one insists.\n\n"
            "Off by 0.2 to 1 mm, and no setting helps: the board may be used. Give\n"
            "calibrate --square (its mm) x (your mm) / 100. A wrap does not close\n"
            "then: print it on another printer.\n\n"
            "Across and along differ by more than 0.3 mm: the paper slips. Use another\n"
            "printer: a board that is stretched one way cannot be repaired by a number.",
        ),
        Words((left_edge, across[1] - 128), "2  Make the rod", 12),
        Words(
            (left_edge, across[1] - 135),
            "Cut the wrap out and glue it on all of its back, or print it on label paper. Lay its upper edge flush\n"
            "with the free end of the rod and turn the rod along the paper. The two edges of the seam meet and\n"
            "do not overlap; the tabs go beneath. Matt paper, matt ink: a shining stripe hides markers.\n"
            "Edges that miss each other by 0.3 mm or less are good; else measure the rod again.",
        ),
        Words((left_edge, across[1] - 160), "3  Mount the board", 12),
        Words(
            (left_edge, across[1] - 167),
            "Glue the board's page on glass, acrylic or thick foam board: it must be flat to 0.2 mm. A sheet that\n"
            "bends is worse than a small board.",
        ),
    ]
    return Page(size, shapes)


def bar(corner: tuple[float, float], upright: bool) -> list[Shape]:
    """A bar of 100 mm from its lower left corner, with a scale of 10 mm.

    Its own ends are what is measured: a line at an end would add half its width.
    """
    x, y = corner
    long = (BAR_WIDTH_MM, BAR_MM) if upright else (BAR_MM, BAR_WIDTH_MM)
    shapes: list[Shape] = [Area(np.array([[x, y, *long]]))]
    for k in range(1, 10):
        at = BAR_MM * k / 10
        reach = 3.0 if k % 5 == 0 else 1.5
        begin = (x + BAR_WIDTH_MM, y + at) if upright else (x + at, y + BAR_WIDTH_MM)
        end = (begin[0] + reach, begin[1]) if upright else (begin[0], begin[1] + reach)
        shapes.append(Line(begin, end))
    return shapes


def page_of_wrap(size: tuple[float, float], wrap: Wrap, toml: str) -> Page:
    """The page of one layout.

    Raises ValueError if it is larger than the paper.
    """
    handle = wrap.handle
    wide = wrap.length_mm + (TAB_MM if wrap.tabs else 0.0)
    tall = wrap.high_mm - wrap.low_mm
    free = (size[0] - 2 * EDGE_MM - 12, size[1] - 2 * EDGE_MM - HEAD_MM - FOOT_MM - 16)
    if wide > free[0] or tall > free[1]:
        raise ValueError(
            f"{handle.name}: a wrap of {wide:.0f} x {tall:.0f} mm for a rod of {wrap.rod_mm:g} mm does not "
            f"fit on the paper, which has room for {free[0]:.0f} x {free[1]:.0f} mm"
        )
    left_edge = EDGE_MM + 10 + (free[0] - wide) / 2
    bottom = size[1] - EDGE_MM - HEAD_MM - 12 - tall
    dark = handle.markers == "bright"
    ground, marker = (0.0, 1.0) if dark else (1.0, 0.0)
    shapes: list[Shape] = [
        Words((EDGE_MM + 8, size[1] - EDGE_MM), f"Wrap “{handle.name}”", 14),
        Words(
            (EDGE_MM + 8, size[1] - EDGE_MM - 8),
            f"For a rod of {wrap.rod_mm:g} mm. One turn is {wrap.length_mm:.2f} mm: pi x (rod + paper of "
            f"{handle.radius_mm - wrap.rod_mm / 2:g} mm).\n"
            f"{len(wrap.places)} markers of {handle.marker_diameter_mm:g} mm. {_CUT}\n"
            f"The handle file that belongs to it: {toml}",
        ),
    ]
    for low, high in wrap.tabs:
        shapes.append(
            Frame(
                (left_edge + wrap.length_mm, bottom + low - wrap.low_mm, TAB_MM, high - low), True
            )
        )
    if not wrap.tabs:
        shapes.append(
            Words((left_edge, bottom - 14), "No room for tabs: glue the whole back, edge to edge.")
        )
    shapes.append(Area(np.array([[left_edge, bottom, wrap.length_mm, tall]]), ground))
    shapes.append(Frame((left_edge, bottom, wrap.length_mm, tall)))
    for around, axial in wrap.places:
        at = (left_edge + around, bottom + axial - wrap.low_mm)
        shapes.append(Disc(at, handle.marker_diameter_mm, marker))
    shapes += _marks(wrap, left_edge, bottom)
    shapes += foot()
    return Page(size, shapes)


def _marks(wrap: Wrap, left: float, bottom: float) -> list[Shape]:
    """What tells up from down, and where the seam and the origin are; all beside the strip."""
    top = bottom + wrap.high_mm - wrap.low_mm
    right = left + wrap.length_mm
    below = wrap.handle.top_mm - wrap.high_mm
    end = "the free end of the rod" if below < 1e-9 else f"{below:g} mm below the rod's free end"
    shapes: list[Shape] = [
        Words(((left + right) / 2, top + 11), f"up: this edge is {end}", 9, centred=True),
        Words((left, bottom - 6), "seam: this edge meets the other one", 7),
    ]
    for x in (left, right):
        shapes += [Line((x, top + 1), (x, top + 6)), Line((x, bottom - 1), (x, bottom - 5))]
    pitch = wrap.length_mm / len(wrap.handle.columns_deg)
    points = min(6.0, 0.85 * pitch)  # "300°" is as wide as a pitch then
    for column in wrap.handle.columns_deg:
        x = left + (column - wrap.seam_deg) % 360 / 360 * wrap.length_mm
        shapes.append(Words((x, top + 5), f"{column:g}°", points, centred=True))
    if wrap.low_mm <= 0 <= wrap.high_mm:
        origin = bottom - wrap.low_mm
        shapes.append(Line((left - 6, origin), (left - 1, origin)))
        shapes.append(Words((left - 9, origin + 1.2), "0", 7))
    return shapes


def board_target(size: tuple[float, float]) -> Target:
    """The ChArUco board of a paper: squares of whole mm, as large as fit."""
    columns, rows = SQUARES
    across = (size[0] - 2 * EDGE_MM) / columns
    along = (size[1] - 2 * EDGE_MM - FOOT_MM) / rows
    return Target("charuco", columns, rows, float(np.floor(min(across, along))), None, DICTIONARY)


def page_of_board(size: tuple[float, float]) -> Page:
    """The page of the board that `trinolab calibrate` reads."""
    target = board_target(size)
    square = target.square_mm
    left_edge = (size[0] - target.columns * square) / 2
    top = size[1] - EDGE_MM
    return Page(size, [Area(_board_boxes(target, left_edge, top)), *foot(), _command(target)])


def _board_boxes(target: Target, left: float, top: float) -> Array:
    """The board's dark parts, (n, 4), with its upper left corner at a place, mm.

    A marker is three quarters of a square, and six parts wide: a square is eight parts.
    """
    board = cv2.aruco.CharucoBoard(
        (target.columns, target.rows),
        float(_MODULES),
        0.75 * _MODULES,
        dictionary_of(target.dictionary or DICTIONARY),
    )
    parts = board.generateImage((_MODULES * target.columns, _MODULES * target.rows))
    side = target.square_mm / _MODULES
    boxes = []
    for row, line in enumerate(parts < 128):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        for begin, end in edges.reshape(-1, 2):
            boxes.append([left + side * begin, top - side * (row + 1), side * (end - begin), side])
    return np.array(boxes)


def _command(target: Target) -> Words:
    """What to type for the board, beside the bar."""
    text = (
        "trinolab calibrate --images ccd1=board/images/ccd1 ccd2=board/images/ccd2 \\\n"
        "    ccd3=board/images/ccd3 --board charuco --columns "
        f"{target.columns} --rows {target.rows} --square {target.square_mm:g} --out rig.toml"
    )
    return Words((EDGE_MM + 8, EDGE_MM + 22), text, 7.5, code=True)


def foot() -> list[Shape]:
    """The bar of a page, with its words."""
    return [
        *bar((EDGE_MM + 8, EDGE_MM + 3), upright=False),
        Words(
            (EDGE_MM + 8 + BAR_MM + 4, EDGE_MM + 7),
            "100 mm: print at 100 %, not “fit to page”;  ______ mm",
            8,
        ),
    ]
