"""The four factors of Sect. 6.5, a table each; see `workbench.studies.factors`."""

from __future__ import annotations

from trinolab.datasets import load_handle, load_rig
from workbench.studies.carrier import Row, Table
from workbench.studies.factors import ERRORS, FACTORS, cell

# The values that a test makes again.
AGAIN = {"distortion": -0.05, "distance": 750.0, "marker_size": 2.0, "speed": 25.0, "turn": 100.0}


def rows(factor: str, value: float, draw: int) -> list[Row]:
    """One value of a factor under one draw of the noise, by CCD1 and CCD2 on the paper's handle."""
    return list(cell(factor, value, draw, load_rig("paper_pair"), load_handle("paper")))


TABLES = [
    Table(
        name,
        rows,
        [{"factor": [name], "value": factor.values}],
        by=(factor.column, "seed", "method"),
        columns=(factor.column, "seed", "method", "poses", "n", *ERRORS),
        draws=1,
        again={"value": AGAIN[name]},
    )
    for name, factor in FACTORS.items()
]
