"""The four factors of Sect. 6.5, a table each; see `workbench.studies.factors`."""

from __future__ import annotations

import numpy as np

from trinolab.datasets import load_handle, load_rig
from workbench.studies.carrier import Row, Table
from workbench.studies.factors import FACTORS, errors_of, measured, table1_setup
from workbench.studies.replication import PAPER

# The values that a test makes again.
AGAIN = {"distortion": -0.05, "distance": 750.0, "marker_size": 2.0, "speed": 25.0, "turn": 100.0}


def rows(factor: str, value: float, draw: int) -> list[Row]:
    """One value of a factor under one draw of the noise, by CCD1 and CCD2 on the paper's handle."""
    column, *_, change = FACTORS[factor]
    setup = change(table1_setup(load_rig("paper_pair"), load_handle("paper")), value)
    by_method = measured(setup, PAPER, np.random.default_rng(draw))
    return [
        {column: value, "seed": draw, "method": method, **errors_of(measurements, setup)}
        for method, measurements in by_method.items()
    ]


TABLES = [
    Table(
        name,
        rows,
        [{"factor": [name], "value": factor.values}],
        by=(factor.column, "seed", "method"),
        draws=1,
        again={"value": AGAIN[name]},
    )
    for name, factor in FACTORS.items()
]
