"""Each shipped table has the columns and rows that its script makes."""

import pandas as pd
import pytest
from tablerows import SCRIPTS, made_and_stored

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


@pytest.mark.parametrize("name", [name for name, study in STUDIES.items() if not study.make])
def test_a_command_makes_the_tables_of_its_script(name):
    tables = script(name).TABLES
    names = tuple(table.name for table in tables)
    assert MAKES.get(name, names) == names
    for default, _ in STUDIES[name].counts.values():
        assert {table.draws for table in tables} == {default}
