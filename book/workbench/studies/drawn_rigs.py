"""Rig files that are off, and three sets of frames: the errors of the poses, and their covariances,
for a reader.
"""

from __future__ import annotations

import pandas as pd

from .second_renderer import SECOND

THIRD = "third"  # stands in the column of renderers for the set that judges


def by_file(table: pd.DataFrame, estimator: str, stated: bool) -> pd.DataFrame:
    """The shipped table for a reader: errors and covariances of an estimator with rig files that are
    off, on the third set of frames, and on the second renderer's, which constants were chosen on.

    Parameters
    ----------
    table : pandas.DataFrame
        Of `make_table`.
    estimator : str
    stated : bool
        Whether the files state how far they may be off.

    Returns
    -------
    pandas.DataFrame
        Indexed by what the file is off by, rig and handle: `n` poses and the share `measured`; mean
        errors, rms of error divided by sigma for mm and deg, and mean NEES of the third set; in the
        columns ``..., second`` those of the second renderer's stills.
    """
    columns = {
        "mm": "mean_mm",
        "deg": "mean_deg",
        "by sigma, mm": "error_by_sigma_mm",
        "by sigma, deg": "error_by_sigma_deg",
        "NEES": "nees",
    }
    mine = table[(table["estimator"] == estimator) & (table["stated"] == stated)]
    off = mine[mine["off_px"] > 0].set_index(["off_px", "rig", "handle"])
    third, second = (off[off["renderer"] == name] for name in (THIRD, SECOND))
    rows = third[["n"]].assign(measured=third["measured"] / third["n"])
    for name, column in columns.items():
        rows[name] = third[column]
        rows[f"{name}, second"] = second[column]
    return rows.sort_index(level="off_px", sort_remaining=False)
