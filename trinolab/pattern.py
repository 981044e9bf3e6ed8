"""The pattern of Table 1's errors against a model's: statistics without a scale, and how often the model has them.

Sizes agree by chance, since a model has a free one; these numbers stay what they are when all errors of a table grow.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from .checks import Array
from .deviations import Errors
from .metrics import euler_deg

NEAR_LOCK_DEG = 75.0
STATISTICS = {
    "growth_alpha": "scatter of alpha near the gimbal lock by that elsewhere",
    "growth_gamma": "scatter of gamma near the gimbal lock by that elsewhere",
    "offset_alpha": "mean of alpha's errors by its standard error",
    "offset_beta": "mean of beta's errors by its standard error",
    "offset_gamma": "mean of gamma's errors by its standard error",
    "depth": "scatter of z by that of x and y",
}


def statistics(errors: Errors, truths: RigidTransform) -> Array:
    """The numbers of `STATISTICS` for tables of errors, shape (..., 6).

    Scatter is the rms about the mean over all n poses; the t of an offset is taken without its sign.
    """
    n, near = len(truths), np.abs(euler_deg(truths)[:, 1]) > NEAR_LOCK_DEG
    mean = errors.angles_deg.mean(axis=-2, keepdims=True)
    square = (errors.angles_deg - mean) ** 2
    growth = np.sqrt(square[..., near, :].mean(axis=-2) / square[..., ~near, :].mean(axis=-2))
    t = np.abs(mean[..., 0, :]) / np.sqrt(square.sum(axis=-2) / (n - 1) / n)
    spread = errors.position_mm.var(axis=-2)
    depth = np.sqrt(2 * spread[..., 2] / (spread[..., 0] + spread[..., 1]))
    return np.concatenate([growth[..., [0, 2]], t, depth[..., None]], axis=-1)


def compare(errors: Errors, truths: RigidTransform, observed: Array) -> pd.DataFrame:
    """Hold observed statistics against those of the tables that a model draws.

    Parameters
    ----------
    errors : Errors, shape (count, n, 3)
        Of the model's tables.
    truths : RigidTransform of length n
    observed : ndarray, shape (6,)

    Returns
    -------
    pandas.DataFrame
        A row a statistic: the observed one; the model's median and its range from 2.5 to 97.5 %; p, two-sided: twice
        the share of tables, the observed one among them, that lie as far out on the observed one's side.
    """
    model = statistics(errors, truths)
    side = np.minimum((model <= observed).sum(axis=0), (model >= observed).sum(axis=0))
    low, middle, high = np.quantile(model, [0.025, 0.5, 0.975], axis=0)
    return pd.DataFrame({"statistic": list(STATISTICS), "observed": observed, "model_median": middle, "model_low": low,
                         "model_high": high, "p": np.minimum(2 * (1 + side) / (1 + len(model)), 1.0)})
