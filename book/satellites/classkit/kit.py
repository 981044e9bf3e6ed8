"""What `trinolab kit` does: from a handle file to a PDF at true scale, and the handle files of its
wraps.
"""

from __future__ import annotations

import logging
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from trinolab.calibration.target import Target
from trinolab.datasets import load_handle
from trinolab.files.outputs import check_targets, write_together
from trinolab.files.rigs import handle_text, read_handle
from trinolab.handle import Handle

from .sheets import PAPERS, board_target, page_of_bars, page_of_board, page_of_wrap
from .wrap import PAPER_MM, Wrap, unrolled, wrapped

# Standard deviation of a marker's place on a rod that a student has wrapped: a guess, which `refine`
# replaces by a measurement.
PLACEMENT_MM = 0.1

log = logging.getLogger("trinolab")


class Printed(NamedTuple):
    """What a kit has: its PDF, the handle files by their wraps, and the board."""

    pdf: Path
    wraps: dict[Path, Wrap]
    target: Target


def make_kit(
    handle: str | Path,
    out: str | Path,
    diameter_mm: float | None = None,
    marker_mm: float | None = None,
    paper: str = "a4",
    thickness_mm: float = PAPER_MM,
) -> Printed:
    """Make a printable PDF at true scale: bars that check the printer, the wrap of a handle and that
    of another layout, a ChArUco board.

    The handle file of each wrap appears beside the PDF, as ``KIT_NAME.toml``: with the radius at which
    the print lies on the rod, and a guess of how well markers are placed.

    Parameters
    ----------
    handle : path
        Handle file. The other layout is the paper's, or `coded` beside that.
    out : path
        The PDF to write.
    diameter_mm : float, optional
        Of the rod; the handle's without it.
    marker_mm : float, optional
        Diameter of the markers; the handle's without it.
    paper : {"a4", "letter"}
    thickness_mm : float
        Of the paper with its glue.

    Raises
    ------
    ValueError
        Names the file or the size that does not fit; what `wrapped`, `unrolled` and `page_of_wrap`
        refuse.
    """
    if paper not in PAPERS:
        raise ValueError(f"paper: expected one of {', '.join(PAPERS)}, got {paper!r}")
    if Path(out).suffix.lower() != ".pdf":
        raise ValueError(f"{out}: expected a name that ends in .pdf")
    size = PAPERS[paper]
    given = read_handle(handle)
    alternative = load_handle("coded" if given.name == "paper" else "paper")
    wraps = {
        _toml(out, given): unrolled(
            wrapped(given, diameter_mm, marker_mm, thickness_mm), thickness_mm
        )
    }
    pages = [page_of_wrap(size, wrap, path.name) for path, wrap in wraps.items()]
    rod = wraps[_toml(out, given)].rod_mm
    try:
        beside = unrolled(wrapped(alternative, rod, marker_mm, thickness_mm), thickness_mm)
        pages.append(page_of_wrap(size, beside, _toml(out, alternative).name))
        wraps[_toml(out, alternative)] = beside
    except ValueError as error:
        log.info("the other layout is left out: %s", error)
    check_targets([out, *wraps], [handle])
    names = " and ".join(f"“{wrap.handle.name}”" for wrap in wraps.values())
    what = f"A rod of {rod:g} mm: wraps {names}, a ChArUco board, and what checks the printer."
    from .prints import as_pdf  # it loads matplotlib, which a refusal need not wait for

    pdf = as_pdf([page_of_bars(size, what), *pages, page_of_board(size)])
    contents: dict[str | Path, str | bytes] = {out: pdf}
    contents |= {path: _file_text(wrap.handle) for path, wrap in wraps.items()}
    write_together(contents)
    return Printed(Path(out), wraps, board_target(size))


def _toml(out: str | Path, handle: Handle) -> Path:
    """The handle file beside a PDF; of the name what every system allows in a file's name."""
    name = re.sub(r"[^\w-]+", "-", handle.name)
    return Path(out).with_name(f"{Path(out).stem}_{name}.toml")


def _file_text(handle: Handle) -> str:
    """The handle file of a wrap, which says what is a guess in it."""
    told = (
        "# Printed by trinolab kit. radius_mm is that of the print: of the rod, and the paper on it.\n"
        "# length_mm and top_mm are the layout's: give your rod's. placement_sigma_mm is a guess, until "
        "trinolab refine\n# has measured where each marker lies.\n"
    )
    return told + handle_text(replace(handle, placement_sigma_mm=PLACEMENT_MM))


def as_lines(printed: Printed) -> list[str]:
    """What a person should know of a kit."""
    target = printed.target
    lines = [
        f"{path}: {wrap.handle.name}, {len(wrap.places)} markers of {wrap.handle.marker_diameter_mm:g} mm, "
        f"one turn of {wrap.length_mm:.2f} mm on a rod of {wrap.rod_mm:g} mm"
        for path, wrap in printed.wraps.items()
    ]
    board = (
        f"{printed.pdf}: print it at 100 %, and measure its bars; for its board type calibrate --board charuco "
        f"--columns {target.columns} --rows {target.rows} --square {target.square_mm:g}"
    )
    return [*lines, board]
