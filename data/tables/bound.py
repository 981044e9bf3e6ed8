"""The Cramer-Rao bound at Table 1's poses, for every shipped rig."""

from __future__ import annotations

from workbench.studies.bound import COLUMNS, RIGS, SHIPPED_PIXELS, table1_bounds
from workbench.studies.carrier import Row, Table


def rows(rig: str, pixels: str) -> list[Row]:
    """A row for each row of Table 1."""
    return [
        {"row": row, **{name: getattr(bound, name) for name in COLUMNS}}
        for row, bound in enumerate(table1_bounds(rig, pixels), start=1)
    ]


TABLES = [
    Table(
        "bound",
        rows,
        [{"rig": RIGS, "pixels": SHIPPED_PIXELS}],
        by=("rig", "pixels", "row"),
        again={"rig": "paper_pair", "pixels": "markers"},
    )
]
