"""Which sources of error, and how large, would give the means that the paper prints (Sect. 6.5)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform

from .checks import Array, as_array
from .deviations import Source, drawn, first_order, means, registered

TABLES = 100  # that are drawn of each source
_FACTORS = (1e-3, 1e3)  # limits of a size, of what the source is taken for


class Mix(NamedTuple):
    """Sizes of some sources that come closest to the targets.

    Attributes
    ----------
    sources : tuple of Source
        With the sizes found.
    means : ndarray, shape (4,)
        E_t, mm, and E_alpha, E_beta, E_gamma, deg, that they give.
    misfit : float
        The largest ratio of one of these to its target, or of the target to it.
    """

    sources: tuple[Source, ...]
    means: Array
    misfit: float


def mix(free: Sequence[Source], given: Source, truths: RigidTransform, targets: ArrayLike, rows: Sequence[int] = (),
        seed: int = 0) -> Mix:
    """Find how large `free` sources have to be, beside a `given` one, for means as in `targets`.

    The sum of the squared logarithms of the ratios is made least; tables are drawn once, and only scaled after.

    Parameters
    ----------
    free : sequence of Source
    given : Source
    truths : RigidTransform of length n
    targets : array_like, shape (4,)
        E_t, mm, and E_alpha, E_beta, E_gamma, deg.
    rows : sequence of int
        Poses by which the positions are registered, see `registered`; none without it.
    seed : int

    Raises
    ------
    ValueError
        If a target is not positive.
    """
    wanted, rng = as_array(targets, "targets", (4,)), np.random.default_rng(seed)
    if not (wanted > 0).all():
        raise ValueError(f"targets: expected positive numbers, got {wanted.tolist()}")
    base, *parts = (registered(drawn(source, TABLES, rng), truths, rows) for source in (given, *free))

    def found(log_factors: Array) -> Array:
        tables = base + sum(factor * part for factor, part in zip(np.exp(log_factors), parts, strict=True))
        return np.maximum(means(first_order(tables, truths))[:4], 1e-9)

    fits = [least_squares(lambda x: np.log(found(x) / wanted), np.full(len(free), np.log(factor)),
                          bounds=np.log(_FACTORS)) for factor in (0.3, 3.0)]
    factors = np.exp(min(fits, key=lambda fit: fit.cost).x)
    values = found(np.log(factors))
    sized = tuple(scaled(source, factor) for source, factor in zip(free, factors, strict=True))
    return Mix(sized, values, float(np.exp(np.abs(np.log(values / wanted)).max())))


def mixes(free: Sequence[Source], given: Source, truths: RigidTransform, targets: ArrayLike,
          rows: Sequence[int] = ()) -> list[Mix]:
    """`mix` for each of the free sources and for every two that fit better than either alone, the best first."""
    alone = [mix([source], given, truths, targets, rows) for source in free]
    pairs = [(mix([free[i], free[j]], given, truths, targets, rows), min(alone[i].misfit, alone[j].misfit))
             for i, j in combinations(range(len(free)), 2)]
    better = [pair for pair, single in pairs if pair.misfit < 0.99 * single]
    return sorted([*alone, *better], key=lambda found: found.misfit)


def scaled(source: Source, factor: float) -> Source:
    """The same source with another size."""
    return source._replace(size=factor * source.size, fixed=factor * source.fixed, roots=factor * source.roots)
