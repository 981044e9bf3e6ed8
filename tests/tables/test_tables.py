"""Each shipped table has the columns and rows that its script makes."""

import numpy as np
import pandas as pd
import pytest
from tablerows import SCRIPTS, made_and_stored

from trinolab.datasets import data_path, load_sweep
from workbench.studies.__main__ import MAKES, STUDIES
from workbench.studies.carrier import script

# Tables have six digits. Between instruction sets their numbers differ by at most 1.3e-11 of
# themselves (make verify ARGS="--only spread --groups tables").
DIGITS = 1e-5
# Another rounding may move a trial's end by a tick.
TICK = {"fitts": 2e-3}
TABLES = [
    pytest.param(name, table, id=f"{name} {table.name}")
    for name in SCRIPTS
    for table in script(name).TABLES
    if table.again
]


@pytest.mark.heavy
@pytest.mark.parametrize(("name", "table"), TABLES)
def test_rows_are_made_again(name, table):
    made, stored = made_and_stored(name, table)
    assert len(made)
    pd.testing.assert_frame_equal(made, stored, rtol=TICK.get(name, DIGITS), check_dtype=False)


@pytest.mark.heavy
def test_pairs_of_the_first_draw_are_among_those_counted():
    found = pd.DataFrame(script("match_rivals").one_draw(0))
    shipped = load_sweep("match_rivals")
    columns = ["calibration_px", "gate_px", "rule"]
    assert found[columns].to_numpy().tolist() == shipped[columns].to_numpy().tolist()
    assert (found.given <= shipped.given).all()
    assert found.groupby("rule").due.unique().map(tuple).nunique() == 1


@pytest.mark.heavy
def test_an_assumption_is_replaced_again():
    """The pair measures with R_rl as printed: all draws of its poses."""
    study = script("sensitivity")
    number, case = next(one for one in enumerate(study.CASES, 1) if one[1].assumption == "A4")
    poses = range(20)
    before, after = (
        [study.instant(k, draw, pose) for draw in range(study.DRAWS) for pose in poses]
        for k in (0, number)
    )
    table = pd.read_csv(data_path("sensitivity.csv"))
    rows = table[(table["assumption"] == case.assumption) & (table["instead"] == case.instead)]
    assert len(rows) == 9
    for row in rows.itertuples():
        means = (study.by_pose(numbers, row.number, len(poses)) for numbers in (before, after))
        stored = [row.as_assumed, row.changed, row.difference, row.low, row.high, row.n]
        np.testing.assert_allclose(study.compared(*means), stored, rtol=DIGITS, atol=1e-9)


@pytest.mark.parametrize("name", [name for name, study in STUDIES.items() if not study.make])
def test_a_command_makes_the_tables_of_its_script(name):
    tables = script(name).TABLES
    names = tuple(table.name for table in tables)
    assert MAKES.get(name, names) == names
    for default, _ in STUDIES[name].counts.values():
        assert {table.draws for table in tables} == {default}
