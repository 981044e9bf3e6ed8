"""Verdicts of rows: limits that work either way, and of several cameras or rows the worst one."""

import numpy as np
import pandas as pd
import pytest

from satellites.classkit.criteria import (
    GOOD,
    NOT_MEASURED,
    NOT_USABLE,
    USABLE,
    Criterion,
    of_cameras,
    overall,
)

NAMES = ["ccd1", "ccd2", "ccd3"]
SMALL = Criterion("blur", "px", 1.0, 2.0, "focus", "")
LARGE = Criterion("contrast", "grey", 60.0, 30.0, "more light", "")


@pytest.mark.parametrize(
    ("criterion", "values", "worst", "verdict"),
    [
        (SMALL, [0.5, 1.0, 0.2], 1.0, GOOD),
        (SMALL, [0.5, 1.5, 0.2], 1.5, USABLE),
        (SMALL, [0.5, 3.0, np.nan], 3.0, NOT_USABLE),
        (LARGE, [80.0, 70.0, 60.0], 60.0, GOOD),
        (LARGE, [80.0, 30.0, 61.0], 30.0, USABLE),
        (LARGE, [80.0, 10.0, np.nan], 10.0, NOT_USABLE),
        (SMALL, [np.nan] * 3, np.nan, NOT_MEASURED),
    ],
)
def test_the_worst_camera_decides(criterion, values, worst, verdict):
    row = of_cameras(criterion, NAMES, values)
    assert row["value"] == pytest.approx(worst, nan_ok=True)
    assert row["verdict"] == verdict
    assert row["do"] == ("" if verdict == GOOD else criterion.do)


def test_each_camera_is_named_with_its_value():
    row = of_cameras(LARGE, NAMES, [80.25, np.nan, 61.0], 1, ["", "", " (left)"])
    assert row["measured"] == "ccd1 80.2, ccd2 -, ccd3 61.0 (left) grey"
    assert SMALL.wanted == "at most 1 px (usable: 2)"


@pytest.mark.parametrize(
    ("verdicts", "worst"),
    [
        ([GOOD, NOT_MEASURED], GOOD),
        ([GOOD, USABLE], USABLE),
        ([USABLE, NOT_USABLE, GOOD], NOT_USABLE),
    ],
)
def test_the_worst_row_decides(verdicts, worst):
    assert overall(pd.DataFrame({"verdict": verdicts})) == worst
