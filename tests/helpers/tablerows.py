"""Rows of shipped tables, made again beside those that are stored."""

from io import StringIO

import pandas as pd

from trinolab.datasets import load_sweep

GALLERY = "gallery"
SCRIPTS = (
    *("bound", "calibration_error", "elevation", "factors", "fitts", "stress", "webcams"),
    GALLERY,
)


def made_and_stored(script, table):
    """The rows that a table of a script makes again and the stored ones, both with six digits and
    indexed by the columns that identify them.
    """
    text = table.make_again().to_csv(index=False, float_format="%.6g")
    made = pd.read_csv(StringIO(text)).set_index(list(table.by))
    name = f"{GALLERY}/{table.name}" if script == GALLERY else table.name
    stored = load_sweep(name).set_index(list(table.by))
    # a 2 of the one file is a 2.0 of the other
    return made, stored.loc[made.index].set_axis(made.index)
