"""Numbers of the report's table of what each assumption is worth, from ``data/sensitivity.csv``."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from trinolab.datasets import load_sweep

from ..studies.answer import PAPER_MM
from ..studies.pattern import holm

POSES, CALIBRATIONS = 20, 30  # of a number that nothing was left out of
SHOWN = ["number", "unit", "as_assumed", "changed", "low", "high", "n", "whole", "beyond_chance"]


def sensitivity(table: pd.DataFrame) -> dict[str, Any]:
    """Headline numbers as assumed, the range of the position error, the number of intervals that were looked
    at, and the rows that each change of an assumption shows.
    """
    table = table.assign(
        whole=table["n"].isin((POSES, CALIBRATIONS)),
        beyond_chance=after_holm(table),
        shown=is_shown(table),
    )
    rendered = table[table["source"] == "rendered"]
    first = rendered.drop_duplicates("number")
    position = rendered[rendered["number"] == "E_t"].dropna(subset="changed")
    reach = position[position["changed"] >= PAPER_MM]
    registered = load_sweep("budget").set_index(["registration", "source"])["E_t_mm"]
    some = table[tested(table) & table["shown"]]
    return {
        "poses": POSES,
        "draws": int(first["draws"].iloc[0]),
        "seed": int(first["seed"].iloc[0]),
        "as_assumed": first[["number", "as_assumed", "unit", "claim"]].to_dict("records"),
        "least_mm": position["changed"].min(),
        "most_mm": position["changed"].max(),
        "paper_mm": PAPER_MM,
        "reach": reach[["assumption", "changed"]].to_dict("records"),
        "registered_mm": registered["20 poses", "R_rl as printed"],
        "intervals": int(table["low"].notna().sum()),
        "with_width": int(tested(table).sum()),
        "shown": len(some),
        "beyond_chance": int(some["beyond_chance"].sum()),
        "changes": [
            {
                "assumption": assumption,
                "instead": instead,
                "rows": records(rows.loc[rows["shown"], SHOWN]),
            }
            for (assumption, instead), rows in table.groupby(["assumption", "instead"], sort=False)
        ],
    }


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table as dictionaries, with None instead of NaN."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def tested(table: pd.DataFrame) -> pd.Series:
    """Rows whose interval may leave out zero: something was drawn, and it changed."""
    return (table["high"] > table["low"]) & (table["difference"] != 0)


def after_holm(table: pd.DataFrame) -> pd.Series:
    """Differences that stay beyond chance after Holm's correction for all intervals (5 %), each interval of
    95 % being that of a normal distribution; a difference without an interval stays.
    """
    drawn = tested(table)
    sigma = (table["high"] - table["low"])[drawn] / (2 * stats.norm.ppf(0.975))
    p = 2 * stats.norm.sf(np.abs(table["difference"][drawn]) / sigma)
    sure = ~drawn
    sure[drawn] = holm(p) < 0.05
    return sure


def is_shown(table: pd.DataFrame) -> pd.Series:
    """Differences that are shown: more than a hundredth of the value, with an interval that leaves out zero
    where anything was drawn.
    """
    large = table["difference"].abs() > 1e-2 * table["as_assumed"].abs()
    return large & (table["low"].isna() | (table["low"] > 0) | (table["high"] < 0))
