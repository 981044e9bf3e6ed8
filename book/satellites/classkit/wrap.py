"""The handle's markers unrolled: what is printed on a strip of paper and wrapped on a rod.

Seen from outside with the free end up, angles about the axis grow to the right. A strip of the
thickness t on a rod of the diameter d bends about its middle: one turn is pi (d + t) long, and what
is printed on it lies at the radius d / 2 + t. For 0.1 mm of paper on 10 mm of rod the length grows by
1 %: without it, the last of six columns would be 3 deg beside its place.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trinolab.checks import Array, as_number, frozen
from trinolab.handle import Handle

PAPER_MM = 0.1  # of a sheet of 80 g/m^2
SKIRT_MM = 15.0  # of ground beyond the outermost markers, if the body is that long
CLEAR_MM = 2.0  # from a marker to a tab, which lifts the paper by its thickness
TAB_MM = 6.0  # how far a tab reaches beneath the strip's other end
LEAST_TAB_MM = 4.0  # a shorter one does not hold
SEAM_MM = 0.3  # from the seam to a marker: scissors need it


class Wrap(NamedTuple):
    """A strip of paper, in mm from the seam to the right and along the handle's axis.

    Attributes
    ----------
    handle : Handle
        As it is when the strip is wrapped on the rod.
    rod_mm : float
        Diameter of the rod.
    length_mm : float
        Of one turn.
    low_mm, high_mm : float
        Axial coordinates of the strip's edges.
    places : ndarray, shape (markers, 2)
        Of the markers' centres: from the seam, and axial.
    seam_deg : float
        Angle about the axis.
    tabs : tuple of (float, float)
        Axial coordinates between which there is a tab to glue: where no marker is.
    """

    handle: Handle
    rod_mm: float
    length_mm: float
    low_mm: float
    high_mm: float
    places: Array
    seam_deg: float
    tabs: tuple[tuple[float, float], ...]


def wrapped(
    handle: Handle,
    diameter_mm: float | None = None,
    marker_mm: float | None = None,
    paper_mm: float = PAPER_MM,
) -> Handle:
    """The handle that a printed layout becomes on a rod: columns and rows as they are stated.

    Parameters
    ----------
    handle : Handle
        Of its markers' own offsets nothing is printed.
    diameter_mm : float, optional
        Of the rod; the handle's without it.
    marker_mm : float, optional
        Diameter of the markers; the handle's without it.
    paper_mm : float
        Thickness of the paper, with its glue.

    Raises
    ------
    ValueError
        For a size that is not above 0, or markers that do not fit on the rod.
    """
    rod = 2 * handle.radius_mm if diameter_mm is None else diameter_mm
    rod = as_number(rod, "diameter", 0.0, 1e4, open_low=True)
    marker = handle.marker_diameter_mm if marker_mm is None else marker_mm
    marker = as_number(marker, "marker", 0.0, 1e4, open_low=True)
    thickness = as_number(paper_mm, "thickness", 0.0, 10.0)
    try:
        return replace(
            handle,
            radius_mm=rod / 2 + thickness,
            marker_diameter_mm=marker,
            placement_sigma_mm=0.0,
            offsets_mm=(),
        )
    except ValueError as error:
        raise ValueError(f"{handle.name} on a rod of {rod:g} mm: {error}") from None


def unrolled(handle: Handle, paper_mm: float = PAPER_MM) -> Wrap:
    """The strip of a handle that `wrapped` gives, with the same thickness of paper.

    Raises ValueError if no straight seam passes between the columns.
    """
    thickness = as_number(paper_mm, "thickness", 0.0, 10.0)
    length = 2 * np.pi * (handle.radius_mm - thickness / 2)
    seam = _seam_deg(handle, length)
    around = (np.rad2deg(handle.stated_angles) - seam) % 360 / 360 * length
    axial = handle.stated_centres[:, 1]
    half = handle.marker_diameter_mm / 2
    low = max(handle.bottom_mm, axial.min() - half - SKIRT_MM)
    high = min(handle.top_mm, axial.max() + half + SKIRT_MM)
    ends = ((low, axial.min() - half - CLEAR_MM), (axial.max() + half + CLEAR_MM, high))
    return Wrap(
        handle,
        2 * (handle.radius_mm - thickness),
        length,
        low,
        high,
        frozen(np.column_stack([around, axial])),
        seam,
        tuple(
            (float(a), float(b)) for a, b in ends if b - a >= LEAST_TAB_MM and length > 2 * TAB_MM
        ),
    )


def _seam_deg(handle: Handle, length: float) -> float:
    """The angle in the middle of the widest gap between columns, from 0 to 360 deg."""
    columns = np.unique(np.round(np.array(handle.columns_deg) % 360, 9))
    gaps = np.diff(np.append(columns, columns[0] + 360))
    widest = int(np.argmax(gaps))
    needed = handle.marker_diameter_mm + 2 * SEAM_MM
    if gaps[widest] / 360 * length < needed:
        raise ValueError(
            f"{handle.name}: no column is {needed:.3g} mm from the next one: no place for a seam"
        )
    return float((columns[widest] + gaps[widest] / 2) % 360)
