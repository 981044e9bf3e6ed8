"""The estimators on frames of the second renderer, beside frames of our own bench at the same poses: the
shipped table for a reader.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from trinolab.methods import BEST

from .replication import CHECKED

SECOND, OURS = "second", "bench"  # the renderers
FILM = "film"  # stands in the column of estimators for the best one that follows


def side_by_side(table: pd.DataFrame, estimators: Sequence[str] = (CHECKED, BEST)) -> pd.DataFrame:
    """The shipped table for a reader: what an estimator gives on the second renderer's images, and
    beside it what it gives on our own bench at the same poses.

    Parameters
    ----------
    table : pandas.DataFrame
        ``data/sweeps/second_renderer.csv``.
    estimators : sequence of str
        Whose rows are shown; the film comes last.

    Returns
    -------
    pandas.DataFrame
        The columns ``..., own`` are those of our own bench; errors are means, `by sigma` is the rms
        of error by reported sigma.
    """
    columns = {
        "mm": "mean_mm",
        "by sigma, mm": "error_by_sigma_mm",
        "deg": "mean_deg",
        "by sigma, deg": "error_by_sigma_deg",
    }
    rows = with_own(table, ["rig", "handle", "estimator"], columns)
    chosen = rows.index.get_level_values("estimator").isin([*estimators, FILM])
    return rows[chosen].reset_index()


def with_own(table: pd.DataFrame, keys: Sequence[str], columns: Mapping[str, str]) -> pd.DataFrame:
    """The second renderer's rows by their keys, and in columns ``..., own`` those of our own bench.

    Parameters
    ----------
    table : pandas.DataFrame
        Rows of both renderers.
    keys : sequence of str
        The columns that tell the rows of a renderer apart.
    columns : mapping of str to str
        From a name for a reader to a column of the table.

    Returns
    -------
    pandas.DataFrame
        `n` and `measured` of the second renderer, and the columns.
    """
    second, own = (
        table[table["renderer"] == renderer].set_index(list(keys)) for renderer in (SECOND, OURS)
    )
    rows = second[["n", "measured"]].copy()
    for name, column in columns.items():
        rows[name] = second[column]
        rows[f"{name}, own"] = own[column]
    return rows


class Factor(NamedTuple):
    """A factor of 1 or more with its 95 % interval, of n instants and a seed."""

    value: float
    low: float
    high: float
    n: int
    seed: int


def largest_sigma_factor(table: pd.DataFrame, estimator: str) -> Factor:
    """The largest factor, either way, between the rms error and the sigma of a rig, a handle and a
    unit, on the second renderer's stills.

    Parameters
    ----------
    table : pandas.DataFrame
        ``data/sweeps/second_renderer.csv``.
    estimator : str
    """
    factors = []
    for _, row in stills(table, estimator).iterrows():
        for unit in ("mm", "deg"):
            names = ("error_by_sigma", "error_by_sigma_low", "error_by_sigma_high")
            value, low, high = (row[f"{name}_{unit}"] for name in names)
            if value < 1:  # the sigma is too large
                value, low, high = 1 / value, 1 / high, 1 / low
            factors.append(Factor(value, low, high, row["n"], row["seed"]))
    return max(factors)


def stills(table: pd.DataFrame, estimator: str) -> pd.DataFrame:
    """The rows of the second renderer's stills, by an estimator."""
    return table[(table["renderer"] == SECOND) & (table["estimator"] == estimator)]
