"""A pointing task under delay: how fast and how accurate two models of an operator are, by scale and
delay. Nine targets (40, 80, 160 mm away, 5, 10, 20 mm wide, at the tool), ten times each, by twenty
operators, which are twenty seeds.
"""

from __future__ import annotations

import pandas as pd

from workbench.intervals import of_share, of_student
from workbench.studies.carrier import Row, Table, means
from workbench.studies.fitts import DELAYS_S, REPEATS, SCALES, SEEDS, one_operator
from workbench.teleop.operators import STRATEGIES
from workbench.teleop.pointing import DISTANCES_MM, WIDTHS_MM


def operator(strategy: str, scale: float, delay_s: float, draw: int) -> Row:
    """One operator's results."""
    return one_operator(strategy, scale, delay_s, seed=draw)


def over_operators(runs: pd.DataFrame) -> Row:
    """Means over the operators with Student's interval, and the share of errors with Wilson's, over
    all trials.
    """
    trials = len(runs) * REPEATS * len(DISTANCES_MM) * len(WIDTHS_MM)
    errors = round(runs["error_share"].mean() * trials)
    return {
        **{"seeds": len(runs), "trials": trials},
        **means(runs, ("throughput_bit_s", "movement_s", "moves"), of_student),
        **means(runs, ("error_share",), lambda _: of_share(errors, trials)),
    }


TABLES = [
    Table(
        "fitts",
        operator,
        [{"strategy": STRATEGIES, "scale": SCALES, "delay_s": DELAYS_S}],
        by=("strategy", "scale", "delay_s"),
        draws=SEEDS,
        summary=over_operators,
        again={"scale": 2.0, "delay_s": 0.15},
    )
]
