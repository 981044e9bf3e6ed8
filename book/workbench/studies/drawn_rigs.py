"""Rig files that are off, before the frames of two renderers: how far the poses are off then, and
what they say of that, for a reader.
"""

from __future__ import annotations

import pandas as pd

from .second_renderer import with_own


def by_file(table: pd.DataFrame, estimator: str, stated: bool) -> pd.DataFrame:
    """The shipped table for a reader: what rig files that are off do to an estimator's poses, on the
    second renderer's images and beside it on our own bench's.

    Parameters
    ----------
    table : pandas.DataFrame
        ``data/sweeps/drawn_rigs.csv``.
    estimator : str
    stated : bool
        Whether the files state how far they may be off.

    Returns
    -------
    pandas.DataFrame
        What the file is off by, rig and handle; `n` poses and the share `measured`; rms of error by
        reported sigma for mm and deg, and mean NEES. The columns ``..., own`` are those of our bench.
    """
    columns = {
        "by sigma, mm": "error_by_sigma_mm",
        "by sigma, deg": "error_by_sigma_deg",
        "NEES": "nees",
    }
    mine = table[(table["estimator"] == estimator) & (table["stated"] == stated)]
    rows = with_own(mine[mine["off_px"] > 0], ["off_px", "rig", "handle"], columns)
    rows["measured"] /= rows["n"]
    return rows.sort_index(level="off_px", sort_remaining=False).reset_index()
