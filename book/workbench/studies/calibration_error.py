"""How good a calibration must be: Table 1's frames measured with rigs that are off by known amounts.
``data/tables/calibration_error.py`` makes the table, this reads it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from trinolab.checks import Array, as_number, as_points
from trinolab.methods import BEST
from trinolab.parameters import Parameters

from .pattern import affine_field, without_field

RIGS = ("paper_pair", "raised_40deg")
SETTINGS: Mapping[str, Parameters] = {name: Parameters(estimator=name) for name in ("paper", BEST)}
# Standard deviations at level 1 of what a rig file may have wrong.
CENTRE_PX = 0.1  # each coordinate of each principal point
TURN_DEG = 0.005  # each camera about each axis
DIRECTIONS = "directions"  # principal points and directions of all cameras are off


class Pattern(NamedTuple):
    """What position errors have in common.

    Attributes
    ----------
    common_share : float
        Share of their mean square that is one shift of all poses.
    smooth_share : float
        Share of the rest that is an affine function of the position; NaN if there is no rest.
    """

    common_share: float
    smooth_share: float


def pattern(positions: ArrayLike, errors: ArrayLike) -> Pattern:
    """How much of position errors is one shift, and how much of the rest is smooth.

    Errors that have nothing to do with one another and with the position give 1 / n and 3 / (n - 1)
    in the mean: 5 and 16 % for twenty.

    Parameters
    ----------
    positions, errors : array_like, shape (n, 3)
        mm; five positions or more that are not in a plane.
    """
    x = as_points(positions, "positions", 3)
    e = as_points(errors, "errors", 3)
    about_mean = e - e.mean(axis=0)
    residuals = without_field(e, affine_field(x))
    squares, scatter, rest = ((part**2).sum() for part in (e, about_mean, residuals))
    smooth = float(1.0 - rest / scatter) if scatter > 0 else np.nan
    return Pattern(float(1.0 - scatter / squares), smooth)


def curve(table: pd.DataFrame, rig: str, estimator: str) -> pd.DataFrame:
    """Rows of the shipped table for one rig and estimator, by rising level: principal points and
    directions are off, the handle is the paper's.
    """
    where = (table["changed"] == DIRECTIONS) & (table["handle"] == "paper")
    return table[where & (table["rig"] == rig) & (table["estimator"] == estimator)]


def level_at(
    rows: pd.DataFrame, limit: float, column: str = "E_t_mm"
) -> tuple[float, float, float]:
    """The level at which an error reaches a limit, with its interval of 95 %.

    Parameters
    ----------
    rows : pandas.DataFrame
        Of `curve`. Between two levels the error is a power of the level.
    limit : float
    column : str
        Of `ERRORS`.

    Returns
    -------
    level, low, high : float
        Where the mean, the upper and the lower end of its interval reach the limit first; NaN where
        they do not.
    """
    limit = as_number(limit, "limit", low=0.0, open_low=True)
    drawn = rows[rows["level"] > 0]
    levels = drawn["level"].to_numpy()
    curves = (drawn[name].to_numpy() for name in (column, f"{column}_high", f"{column}_low"))
    level, low, high = (_first_crossing(levels, curve, limit) for curve in curves)
    return level, low, high


def _first_crossing(x: Array, y: Array, limit: float) -> float:
    k = int(np.argmax(y >= limit))
    if k == 0 or np.isnan(y[k - 1]):  # nowhere, before the first, or behind a gap
        return np.nan
    return float(
        np.exp(np.interp(np.log(limit), np.log(y[k - 1 : k + 1]), np.log(x[k - 1 : k + 1])))
    )
