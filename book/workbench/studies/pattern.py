"""The pattern of a table of errors, whatever its size, held against models that draw such tables.

Sizes agree by chance, since a model has a free one; these statistics stay what they are when all
errors of a table grow. Chapter 9.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from trinolab.checks import Array, as_array, as_number
from trinolab.metrics import euler_deg
from trinolab.rigid import cross_matrices

from .deviations import Errors, Source, drawn, first_order, together

NEAR_LOCK_DEG = 75.0
STATISTICS = {
    "growth_alpha": "scatter of alpha near the gimbal lock by that elsewhere",
    "growth_gamma": "scatter of gamma near the gimbal lock by that elsewhere",
    "offset_alpha": "mean of alpha's errors by its standard error",
    "offset_beta": "mean of beta's errors by its standard error",
    "offset_gamma": "mean of gamma's errors by its standard error",
    "depth": "scatter of z by that of x and y",
    "smooth": "share of the positions' scatter that is affine in the position",
}
_STEPS = 24  # of the search for a size: to 1e-7 of its range


def statistics(errors: Errors, truths: RigidTransform) -> Array:
    """The numbers of `STATISTICS` for tables of errors, shape (..., 7).

    The scatter of angles is the rms about the mean over all n poses, that of positions what a rigid
    motion of all of them leaves; the t of an offset is taken without its sign.
    """
    n = len(truths)
    near = np.abs(euler_deg(truths)[:, 1]) > NEAR_LOCK_DEG
    mean = errors.angles_deg.mean(axis=-2, keepdims=True)
    square = (errors.angles_deg - mean) ** 2
    growth = np.sqrt(square[..., near, :].mean(axis=-2) / square[..., ~near, :].mean(axis=-2))
    t = np.abs(mean[..., 0, :]) / np.sqrt(square.sum(axis=-2) / (n - 1) / n)
    rest = without_field(errors.position_mm, rigid_field(truths.translation))
    x, y, z = np.moveaxis((rest**2).mean(axis=-2), -1, 0)
    depth = np.sqrt(2 * z / (x + y))
    smooth = smooth_share(truths.translation, errors.position_mm)
    return np.concatenate(
        [growth[..., [0, 2]], t, depth[..., None], np.asarray(smooth)[..., None]], axis=-1
    )


def rigid_field(positions: ArrayLike) -> Array:
    """What a small motion of all positions does to each: its six columns, shape (n, 3, 6)."""
    arms = _centred(positions)
    shift = np.broadcast_to(np.eye(3), (len(arms), 3, 3))
    return np.concatenate([shift, -cross_matrices(arms)], axis=2)


def affine_field(positions: ArrayLike) -> Array:
    """What a shift and any linear change of the positions does to each: twelve columns, shape
    (n, 3, 12).
    """
    arms = _centred(positions)
    ones = np.column_stack([np.ones(len(arms)), arms])
    return np.einsum("nk,ij->nikj", ones, np.eye(3)).reshape(len(arms), 3, 12)


def without_field(errors: ArrayLike, field: Array) -> Array:
    """Errors (..., n, 3) without what the columns of a field (n, 3, q) explain, by least
    squares.
    """
    e = np.asarray(errors, dtype=float)
    flat = e.reshape(*e.shape[:-2], -1)
    basis, _ = np.linalg.qr(field.reshape(-1, field.shape[2]))
    return (flat - flat @ basis @ basis.T).reshape(e.shape)


def smooth_share(positions: ArrayLike, errors: ArrayLike) -> Array:
    """How much of position errors is smooth: the share of their squares that an affine function of
    the position explains, after a rigid motion has been taken away.

    Errors that are independent, normal and equal on all axes give a beta distribution with the
    parameters 3 and (3 n - 12) / 2, whose mean is 1/9 for twenty.

    Parameters
    ----------
    positions : array_like, shape (n, 3)
        mm; five or more that are not in a plane.
    errors : array_like, shape (..., n, 3)
        mm.
    """
    scatter = (without_field(errors, rigid_field(positions)) ** 2).sum(axis=(-2, -1))
    rest = (without_field(errors, affine_field(positions)) ** 2).sum(axis=(-2, -1))
    return 1.0 - rest / scatter


def compare(errors: Errors, truths: RigidTransform, observed: Array) -> pd.DataFrame:
    """Hold observed statistics against those of the tables that a model draws.

    Parameters
    ----------
    errors : Errors, shape (count, n, 3)
        Of the model's tables.
    truths : RigidTransform of length n
    observed : ndarray, shape (7,)

    Returns
    -------
    pandas.DataFrame
        A row a statistic: the observed one; the model's median and its range from 2.5 to 97.5 %; p,
        two-sided: twice the share of tables, the observed one among them, that lie as far out on
        the observed one's side.
    """
    model = statistics(errors, truths)
    low, middle, high = np.quantile(model, [0.025, 0.5, 0.975], axis=0)
    return pd.DataFrame(
        {
            "statistic": list(STATISTICS),
            "observed": observed,
            "model_median": middle,
            "model_low": low,
            "model_high": high,
            "p": p_values(model, observed),
        }
    )


def p_values(model: Array, observed: Array) -> Array:
    """Two-sided p of observed statistics (q,) under those of a model's tables (count, q), shape
    (q,).
    """
    side = np.minimum((model <= observed).sum(axis=0), (model >= observed).sum(axis=0))
    return np.minimum(2 * (1 + side) / (1 + len(model)), 1.0)


def holm(p: ArrayLike) -> Array:
    """p values of m tests corrected for their number, shape (m,) (Holm 1979).

    The smallest is multiplied by m, the next by m - 1, and so on, none below the one before it: the
    chance that any true model is refused at a level is at most that level.
    """
    values = as_array(p, "p", (None,))
    order = np.argsort(values)
    corrected = np.empty_like(values)
    corrected[order] = np.maximum.accumulate(values[order] * np.arange(len(values), 0, -1))
    return np.minimum(corrected, 1.0)


def filled_up(source: Source, places: Source, truths: RigidTransform, rms_mm: float) -> Source:
    """A source together with so much of `places`, independent in each pose, that the position
    errors have an rms, mm, after a rigid registration; without any where it is too large itself.
    """
    field = rigid_field(truths.translation)
    missing = max(rms_mm**2 - _rms_after(source, field) ** 2, 0.0)
    factor = np.sqrt(missing) / _rms_after(places, field)
    return together([source, scaled(places, factor)], source.name)


def scaled(source: Source, factor: float) -> Source:
    """The same source with another size."""
    return source._replace(
        size=factor * source.size, fixed=factor * source.fixed, roots=factor * source.roots
    )


def largest_size(
    source: Source,
    places: Source,
    truths: RigidTransform,
    observed: ArrayLike,
    level: float = 0.05,
    tables: int = 4000,
    seed: int = 0,
) -> tuple[float, float]:
    """How large a cause of position errors may be before the spatial test refuses it.

    The cause is filled up with errors that are independent in each pose, so that it always has the
    observed rms (`filled_up`); the larger it is, the larger its smooth share.

    Parameters
    ----------
    source, places : Source
        The cause, and independent position errors.
    truths : RigidTransform of length n
    observed : array_like, shape (n, 3)
        Position errors, mm.
    level : float
        Of the test, one-sided: a model whose smooth share is as small as the observed one with a
        smaller probability is refused.
    tables, seed : int
        Of the model's draws.

    Returns
    -------
    size : float
        In the source's unit.
    share : float
        Of the observed mean square that it makes then.
    """
    wanted = as_number(level, "level", low=0.0, high=1.0)
    e = as_array(observed, "observed", (len(truths), 3))
    field = rigid_field(truths.translation)
    rms = float(np.sqrt((without_field(e, field) ** 2).sum() / len(truths)))
    at = smooth_share(truths.translation, e)

    def refused(factor: float) -> bool:
        model = filled_up(scaled(source, factor), places, truths, rms)
        errors = drawn(model, tables, np.random.default_rng(seed))[..., :3]
        return float((smooth_share(truths.translation, errors) <= at).mean()) < wanted

    whole = _rms_after(source, field)
    low, high = 0.0, rms / whole  # in units of its size; all of the scatter is its own there
    if not refused(high):
        return source.size * high, 1.0
    for _ in range(_STEPS):
        middle = (low + high) / 2
        low, high = (low, middle) if refused(middle) else (middle, high)
    return source.size * low, (low * whole / rms) ** 2


def pattern_table(
    models: Sequence[tuple[Source, Sequence[str]]],
    truths: RigidTransform,
    observed: Array,
    tables: int,
    seed: int = 0,
) -> pd.DataFrame:
    """`compare` for each of several models, corrected for the number of all tests.

    Parameters
    ----------
    models : sequence of (Source, sequence of str)
        Each with the statistics that it was fitted to, which test nothing.
    truths, observed
        See `compare`.
    tables, seed : int
        Of each model's draws.

    Returns
    -------
    pandas.DataFrame
        Columns: model, those of `compare`, fitted, p_holm (NaN where fitted), n, seed.
    """
    lines = []
    for model, made_by in models:
        errors = first_order(drawn(model, tables, np.random.default_rng(seed)), truths)
        line = compare(errors, truths, observed)
        line.insert(0, "model", model.name)
        line["fitted"] = line["statistic"].isin(made_by)
        lines.append(line)
    table = pd.concat(lines, ignore_index=True)
    tested = ~table["fitted"]
    table.loc[tested, "p_holm"] = holm(table.loc[tested, "p"])
    return table.assign(n=tables, seed=seed)


def _rms_after(source: Source, field: Array) -> float:
    """Rms position error of a source, mm, without what a field explains."""
    parts = np.moveaxis(np.concatenate([source.fixed[..., None], source.roots], axis=2), 2, 0)
    return float(np.sqrt((without_field(parts[..., :3], field) ** 2).sum() / len(source.fixed)))


def _centred(positions: ArrayLike) -> Array:
    x = as_array(positions, "positions", (None, 3))
    return x - x.mean(axis=0)
