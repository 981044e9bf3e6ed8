"""Pages of shapes, drawn at true scale into a PDF for a printer."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import Circle, PathPatch, Rectangle
from matplotlib.path import Path as Outline

from trinolab.checks import Array

from .shapes import Area, Disc, Frame, Line, Page, Shape, Words

MM_PER_INCH = 25.4


def as_pdf(pages: Sequence[Page]) -> bytes:
    """The pages as a PDF; the same pages give the same bytes."""
    file = io.BytesIO()
    # the user's own settings would change fonts and the place of text
    with rc_context(), PdfPages(file, metadata={"CreationDate": None, "ModDate": None}) as pdf:
        for page in pages:
            pdf.savefig(_drawn(page))
    return file.getvalue()


def _drawn(page: Page) -> Figure:
    width, height = page.size
    figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH), facecolor="white")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0, width), ylim=(0, height))
    ax.set_axis_off()
    for order, shape in enumerate(page.shapes):
        _draw(ax, shape, order)
    return figure


def _draw(ax: Axes, shape: Shape, order: int) -> None:
    line: dict[str, Any] = {"color": "0.35", "linewidth": 0.5, "zorder": order}
    match shape:
        case Area(boxes, grey):
            ax.add_patch(PathPatch(_path(boxes), facecolor=str(grey), linewidth=0, zorder=order))
        case Disc(centre, diameter, grey):
            ax.add_patch(
                Circle(centre, diameter / 2, facecolor=str(grey), linewidth=0, zorder=order)
            )
        case Line(begin, end, dashed):
            style = "--" if dashed else "-"
            ax.plot(*zip(begin, end, strict=True), style, **line)
        case Frame((left, bottom, width, height), dashed):
            style = "--" if dashed else "-"
            ax.add_patch(
                Rectangle((left, bottom), width, height, fill=False, linestyle=style, **line)
            )
        case Words(place, text, points, centred, code, turned):
            ax.text(
                *place,
                # a file's name may have bytes that this locale has not decoded
                text.encode(errors="surrogateescape").decode(errors="replace"),
                fontsize=points,
                family="DejaVu Sans Mono" if code else "DejaVu Sans",
                ha="center" if centred else "left",
                va="top",
                rotation=turned,
                parse_math=False,
                linespacing=1.35,
                zorder=order,
            )


def _path(boxes: Array) -> Outline:
    """One path of all rectangles: filled at once, neighbours have no line of paper between them."""
    left, bottom, width, height = np.asarray(boxes, float).T
    right, top = left + width, bottom + height
    corners = np.stack(
        [left, bottom, right, bottom, right, top, left, top, left, bottom], axis=1
    ).reshape(-1, 2)
    codes = [Outline.MOVETO, *[Outline.LINETO] * 3, Outline.CLOSEPOLY] * len(left)
    return Outline(corners, codes)
