"""The simulated bench broken on purpose, one thing at a time, for a reader. ``data/tables/stress.py``
makes ``stress.csv`` and ``stress_silent.csv``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from ..intervals import highest_share

SEED = 15
# Faults of where and when the cameras look: an image by itself does not show them.
GEOMETRY = (
    "rolling shutter 10 ms",
    "calibration 0.1 px, 0.005 deg",
    "calibration 0.3 px, 0.02 deg",
    "frames 5 ms apart",
    "calibration 0.1 px, 0.005 deg, stated",
    "calibration 0.3 px, 0.02 deg, stated",
)


def by_fault(table: pd.DataFrame, rig: str, estimator: str) -> pd.DataFrame:
    """The shipped table for a reader: a row per fault, both handles together.

    Parameters
    ----------
    table : pandas.DataFrame
        ``data/sweeps/stress.csv`` or ``stress_silent.csv``.
    rig, estimator : str
        Whose rows are shown.

    Returns
    -------
    pandas.DataFrame
        The fault; instants `n`; the share `measured`; how many were `wrong`, the upper 95 % bound of
        their share, how many of them were `unforeseen`, and how many of all were `beyond` five of
        their own sigmas; mean error and rms of error by reported sigma for mm and deg; mean NEES.
    """
    rows = []
    mine = table[(table["rig"] == rig) & (table["estimator"] == estimator)]
    for fault, both in mine.groupby("fault", sort=False):
        n, measured, wrong = (int(both[name].sum()) for name in ("n", "measured", "wrong"))
        share = both["measured"] / max(measured, 1)
        row: dict[str, Any] = {
            "fault": fault,
            "n": n,
            "measured": measured / n,
            "wrong": wrong,
            "wrong, at most": highest_share(wrong, n),
            "unforeseen": int(both["unforeseen"].sum()),
            "beyond": int(both["beyond"].sum()),
        }
        for unit in ("mm", "deg"):
            squares = both[f"error_by_sigma_{unit}"] ** 2
            row[unit] = float((both[f"mean_{unit}"] * share).sum()) if measured else np.nan
            row[f"by sigma, {unit}"] = (
                float(np.sqrt((squares * share).sum())) if measured else np.nan
            )
        row["NEES"] = float((both["nees"] * share).sum()) if measured else np.nan
        rows.append(row)
    return pd.DataFrame(rows)
