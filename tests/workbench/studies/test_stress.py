"""The stress table for a reader."""

import numpy as np
import pandas as pd
import pytest

from workbench.studies import stress


def test_a_fault_is_both_handles_together():
    """Two of four poses at 1 mm and 3 sigmas, and one of six at 4 mm and 6 sigmas."""
    table = pd.DataFrame(
        {
            **{"fault": "rain", "rig": "r", "estimator": "e", "unforeseen": 1, "beyond": 2},
            **{"n": [4, 6], "measured": [2, 1], "wrong": [0, 1], "nees": [3.0, 9.0]},
            **{"mean_mm": [1.0, 4.0], "error_by_sigma_mm": [3.0, 6.0]},
            **{"mean_deg": np.nan, "error_by_sigma_deg": np.nan},
        }
    )
    (row,) = stress.by_fault(table, "r", "e").to_dict("records")
    assert (row["n"], row["measured"], row["wrong"], row["unforeseen"]) == (10, 0.3, 1, 2)
    assert row["beyond"] == 4
    assert row["NEES"] == pytest.approx(5.0)
    assert row["mm"] == pytest.approx(2.0)
    assert row["by sigma, mm"] == pytest.approx(np.sqrt((9 + 9 + 36) / 3))
    assert row["wrong, at most"] == pytest.approx(0.394, abs=1e-3)
