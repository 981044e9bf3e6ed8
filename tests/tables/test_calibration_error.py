"""What a calibration that is off costs: patterns of errors, and the level at a limit."""

import numpy as np
import pandas as pd
import pytest

from trinolab.datasets import load_handle, load_sweep, load_table1
from workbench.studies.calibration_error import (
    curve,
    level_at,
    pattern,
)

HANDLE, TRUTHS = load_handle("paper"), load_table1().set_poses
TABLE = load_sweep("calibration_error")


def shipped(rig, estimator):
    return curve(TABLE, rig, estimator).set_index("level", drop=False)


# --- the pattern of errors


def test_a_shift_and_a_stretch_are_told_apart():
    x = TRUTHS.translation
    stretch = (x - x.mean(axis=0)) @ np.diag([0.001, 0.0, -0.002])
    assert pattern(x, stretch + 1e-9) == pytest.approx((0.0, 1.0), abs=1e-6)
    both = pattern(x, stretch + [0.3, 0.0, 0.0])
    assert both.common_share == pytest.approx(0.09 / (0.09 + (stretch**2).sum() / 20))
    assert both.smooth_share == pytest.approx(1.0)


# --- what a draw and a level give


def test_the_level_at_a_limit_lies_on_the_power_law_between():
    levels = [0.0, 0.1, 1.0, 10.0, 20.0]
    error = [0.001, 0.01, 0.1, np.nan, 1.0]
    rows = pd.DataFrame({"level": levels, "E_t_mm": error, "E_t_mm_high": error})
    rows["E_t_mm_low"] = rows["E_t_mm"] / 2
    level, low, high = level_at(rows, 0.04)
    assert (level, low, high) == pytest.approx((0.4, 0.4, 0.8))
    assert np.isnan(level_at(rows, 0.5)).all()  # a gap is no crossing
    assert np.isnan(level_at(rows, 0.001)).all()  # nor is what lies below the first draw


# --- the theory: a pinhole's slopes
