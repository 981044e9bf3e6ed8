"""The stress table: sums and bounds worked out by hand, and a small trial."""

import numpy as np
import pandas as pd
import pytest

from trinolab.datasets import load_handle, load_table1
from trinolab.pose import LOST, Pose
from trinolab.studies import replication, stress
from trinolab.studies.replication import Deviation, deviation

HELD = [Deviation(0.3, 1.0, 0.1, 1.0), Deviation(2.5, 2.0, 0.5, 1.0)]
MISSING = Deviation(np.nan, np.nan, np.nan, np.nan)


def test_a_pose_is_held_against_the_nearest_equivalent_of_its_truth():
    handle, T = load_handle("paper"), load_table1().set_poses[3]
    spread = np.diag([0.03**2] * 3 + [np.deg2rad(0.5) ** 2] * 3)
    found = deviation(Pose("measured", T * handle.symmetries[4], spread, 0.1, 4, 2), T, handle)
    assert found.measured
    assert not found.wrong
    assert (found.mm, found.deg) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert found.sigma_mm == pytest.approx(0.03 * np.sqrt(3))
    assert found.sigma_deg == pytest.approx(0.5 * np.sqrt(3))
    for pose in (LOST, Pose("ambiguous", T, spread, 0.1, 4, 2)):
        lost = deviation(pose, T, handle)
        assert not lost.measured
        assert not lost.wrong


def test_wrong_is_beyond_two_millimetres_or_five_degrees():
    pairs = [(1.9, 4.9), (2.1, 0.0), (0.0, 5.1)]
    assert [Deviation(mm, deg, 1.0, 1.0).wrong for mm, deg in pairs] == [False, True, True]


def test_blocks_add_up_to_a_row():
    """Of three instants two were measured, one of them wrongly: means 1.4 mm and 1.5 deg."""
    first, second = (stress._sums(part) for part in ([HELD[0], MISSING], [HELD[1]]))
    blocks = pd.DataFrame(
        [{f"r/e/{name}": value for name, value in part.items()} for part in (first, second)]
    )
    row = stress._judged(blocks, "r/e")
    assert (row["n"], row["measured"], row["wrong"]) == (3, 2, 1)
    assert (row["mean_mm"], row["mean_deg"]) == pytest.approx((1.4, 1.5))
    assert (row["largest_mm"], row["largest_deg"]) == (2.5, 2.0)
    assert row["error_by_sigma_mm"] == pytest.approx(np.sqrt((3.0**2 + 5.0**2) / 2))
    half = 1.96 * 1.1 / np.sqrt(2)
    assert (row["low_mm"], row["high_mm"]) == pytest.approx((1.4 - half, 1.4 + half))


def test_nothing_measured_has_no_mean():
    row = stress._judged(
        pd.DataFrame([{f"r/e/{k}": v for k, v in stress._sums([MISSING] * 4).items()}]), "r/e"
    )
    assert row["measured"] == 0
    assert np.isnan([row["mean_mm"], row["error_by_sigma_deg"]]).all()


def test_bound_of_a_share():
    """None of n: (1 - p) ** n = 0.05, about 3 / n; one of ten: 39.4 %, from a table of the binomial."""
    assert stress.share_below(0, 1000) == pytest.approx(3 / 1000, rel=0.01)
    assert stress.share_below(1, 10) == pytest.approx(0.394, abs=1e-3)
    assert stress.share_below(5, 5) == 1.0


def test_a_block_without_a_fault(monkeypatch):
    monkeypatch.setattr(stress, "BLOCK", 1)
    monkeypatch.setattr(stress, "EVERY", {name: replication.EVERY[name] for name in ("patches",)})
    found = stress.trial("none", "coded", 0)
    assert set(found) == {f"{rig}/patches/{name}" for rig in stress.RIGS for name in stress.SUMS}
    assert found["paper_pair/patches/measured"] == found["paper_pair/patches/n"] == 1
    assert found["raised_40deg/patches/wrong"] == 0
    assert 0 < found["raised_40deg/patches/largest_mm"] < 0.05
    assert found == stress.trial("none", "coded", 0)
    assert found != stress.trial("none", "coded", 1)


def test_an_unknown_fault_is_refused():
    with pytest.raises(ValueError, match=r"fault: expected one of none, lens blur 2 px, .*'rain'"):
        stress.trial("rain", "coded", 0)
