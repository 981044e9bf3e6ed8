"""A row of several cameras: the worst one counts, whichever direction is the bad one."""

import numpy as np
import pytest

from satellites.classkit.criteria import GOOD, NOT_MEASURED, NOT_USABLE, Criterion, of_cameras

NAMES = ["ccd1", "ccd2", "ccd3"]
SMALL = Criterion("blur", "px", 1.0, 2.0, "focus", "")
LARGE = Criterion("contrast", "grey", 60.0, 30.0, "more light", "")


@pytest.mark.parametrize(
    ("criterion", "values", "worst", "verdict"),
    [
        (SMALL, [0.5, 0.9, 0.2], 0.9, GOOD),
        (SMALL, [0.5, 3.0, np.nan], 3.0, NOT_USABLE),
        (LARGE, [80.0, 70.0, 61.0], 61.0, GOOD),
        (LARGE, [80.0, 10.0, np.nan], 10.0, NOT_USABLE),
    ],
)
def test_the_worst_camera_decides(criterion, values, worst, verdict):
    row = of_cameras(criterion, NAMES, values)
    assert (row["value"], row["verdict"]) == (worst, verdict)


def test_each_camera_is_named_with_its_value():
    row = of_cameras(LARGE, NAMES, [80.25, np.nan, 61.0], 1, ["", "", " (left)"])
    assert row["measured"] == "ccd1 80.2, ccd2 -, ccd3 61.0 (left) grey"


def test_without_a_value_nothing_is_judged():
    row = of_cameras(SMALL, NAMES, [np.nan] * 3)
    assert np.isnan(row["value"])
    assert row["verdict"] == NOT_MEASURED
