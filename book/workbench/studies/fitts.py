"""A pointing task under delay: how fast and how accurate two models of an operator are, by scale and
delay. ``data/tables/fitts.py`` makes the table; `one_operator` is a run of it, for `workbench.sweep`.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd

from ..intervals import Interval, of_student
from ..teleop.operators import STRATEGIES, Person, point
from ..teleop.pointing import conditions, difficulty, performance

SCALES = (1.0, 2.0, 3.0, 4.0)
DELAYS_S = (0.0, 0.075, 0.15, 0.225, 0.3)
SEEDS = 20
REPEATS = 10


class LagModels(NamedTuple):
    """Movement time over difficulty and delay, by least squares over the means of the conditions.

    Attributes
    ----------
    r2_product, r2_sum : float
        Share of the variance that a + (b + c delay) difficulty explains, and a + b difficulty +
        c delay.
    a_s, b_s_bit, c_bit : float
        Of the product: s, s/bit, and s a bit and s of delay.
    c : Interval
        Of `c_bit`, over the operators.
    """

    r2_product: float
    r2_sum: float
    a_s: float
    b_s_bit: float
    c_bit: float
    c: Interval


def one_operator(
    strategy: str = STRATEGIES[0],
    scale: float = 1.0,
    delay_s: float = 0.0,
    seed: int = 0,
    repeats: int = REPEATS,
    own_delay_s: float = Person.delay_s,
    miss: float = Person.miss,
    crossover: float = Person.crossover,
) -> dict[str, float]:
    """What one operator reaches: ``throughput_bit_s``, ``movement_s``, ``error_share``, ``moves``.

    Parameters
    ----------
    strategy : str
        One of `teleop.operators.STRATEGIES`.
    scale, delay_s : float
        Tool : handle, and what is added between the tool and its picture, s.
    seed : int
        The operator.
    repeats : int
        Trials of each of the nine targets.
    own_delay_s, miss, crossover : float
        Of `teleop.operators.Person`.
    """
    person = Person(delay_s=own_delay_s, miss=miss, crossover=crossover)
    results = performance(_log(strategy, scale, delay_s, seed, repeats, person))
    return {name: value for name, value in results._asdict().items() if name != "n"}


def lag_models(
    strategy: str = STRATEGIES[0], scale: float = 1.0, seeds: int = SEEDS, repeats: int = REPEATS
) -> LagModels:
    """Whether a delay multiplies the difficulty, as MacKenzie and Ware found (1993, DOI
    10.1145/169059.169431), or is added to the movement time.
    """
    logs = [
        _log(strategy, scale, delay_s, seed, repeats).assign(seed=seed)
        for delay_s, seed in product(DELAYS_S, range(seeds))
    ]
    log = pd.concat(logs)
    keys = ["seed", "distance_mm", "width_mm", "delay_s"]
    means = (
        log.assign(time=log["end_s"] - log["start_s"]).groupby(keys)["time"].mean().reset_index()
    )
    whole = means.groupby(keys[1:])["time"].mean().reset_index()
    (a, b, c), r2_product = fit(whole, product_form=True)
    _, r2_sum = fit(whole, product_form=False)
    each = [fit(one, product_form=True)[0][2] for _, one in means.groupby("seed")]
    return LagModels(r2_product, r2_sum, a, b, c, of_student(each))


def fit(means: pd.DataFrame, product_form: bool) -> tuple[tuple[float, float, float], float]:
    """Coefficients, and the share of the variance that they explain."""
    bits = difficulty(means["distance_mm"].to_numpy(), means["width_mm"].to_numpy())
    delay = means["delay_s"].to_numpy()
    time = means["time"].to_numpy()
    third = delay * bits if product_form else delay
    columns = np.column_stack([np.ones_like(bits), bits, third])
    coefficients = np.linalg.lstsq(columns, time, rcond=None)[0]
    residuals = time - columns @ coefficients
    a, b, c = (float(value) for value in coefficients)
    return (a, b, c), float(1 - residuals.var() / time.var())


def _log(
    strategy: str,
    scale: float,
    delay_s: float,
    seed: int,
    repeats: int,
    person: Person | None = None,
) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    return point(conditions(repeats=repeats), strategy, scale, delay_s, rng, person)
