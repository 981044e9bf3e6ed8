"""The stress table: a row and bounds worked out by hand, a small trial, and the shipped table."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
import stress
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import load_handle, load_sweep, load_table1
from trinolab.measurement import measure
from trinolab.methods import BEST
from trinolab.pose import LOST, Pose
from workbench.studies.broken import FAULTS
from workbench.studies.replication import EVERY, Deviation, deviation

HELD = [Deviation(0.3, 1.0, 0.1, 1.0, 10.0), Deviation(2.5, 2.0, 0.5, 1.0, 30.0)]
MISSING = Deviation(*[np.nan] * 5)


def test_a_pose_is_held_against_the_nearest_equivalent_of_its_truth():
    handle, T = load_handle("paper"), load_table1().set_poses[3]
    spread = np.diag([0.03**2] * 3 + [np.deg2rad(0.5) ** 2] * 3)
    found = deviation(Pose("measured", T * handle.symmetries[4], spread, 0.1, 4, 2), T, handle)
    assert found.measured
    assert not found.wrong
    assert (found.mm, found.deg) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert found.sigma_mm == pytest.approx(0.03 * np.sqrt(3))
    assert found.sigma_deg == pytest.approx(0.5 * np.sqrt(3))
    assert found.nees == pytest.approx(0.0, abs=1e-9)
    off = T * handle.symmetries[4] * RigidTransform.from_translation([0.0, 0.06, 0.0])
    # two sigmas along one axis of the position
    assert deviation(Pose("measured", off, spread, 0.1, 4, 2), T, handle).nees == pytest.approx(4)
    for pose in (LOST, Pose("ambiguous", T, spread, 0.1, 4, 2)):
        lost = deviation(pose, T, handle)
        assert not lost.measured
        assert not lost.wrong


def rows_of(*blocks):
    """Of the deviations of each block."""
    each = [{"block": k, **stress.as_row(one)} for k, block in enumerate(blocks) for one in block]
    return pd.DataFrame(each)


def test_blocks_add_up_to_a_row():
    """Of three instants two were measured, one of them wrongly: means 1.4 mm and 1.5 deg."""
    row = stress.judged(rows_of([HELD[0], MISSING], [HELD[1]]))
    assert (row["n"], row["measured"], row["wrong"]) == (3, 2, 1)
    assert (row["mean_mm"], row["mean_deg"]) == pytest.approx((1.4, 1.5))
    assert (row["largest_mm"], row["largest_deg"]) == (2.5, 2.0)
    assert row["error_by_sigma_mm"] == pytest.approx(np.sqrt((3.0**2 + 5.0**2) / 2))
    half = 1.96 * 1.1 / np.sqrt(2)
    assert (row["low_mm"], row["high_mm"]) == pytest.approx((1.4 - half, 1.4 + half))
    # two blocks with a pose each: drawn again, both are one of them in half of the cases
    assert row["error_by_sigma_low_mm"] == pytest.approx(3.0)
    assert row["error_by_sigma_high_mm"] == pytest.approx(5.0)
    # NEES 10 and 30: the quantiles lie between them, as far along
    assert (row["nees"], row["nees_95"], row["nees_99"]) == pytest.approx((20.0, 29.0, 29.8))


def test_unforeseen_is_what_five_sigmas_do_not_cover():
    poses = [(2.5, 0.6, 1.0), (2.5, 0.4, 1.0), (1.9, 0.1, 1.0), (0.1, 0.1, 6.0)]  # mm, sigma, deg
    found = [stress.unforeseen(Deviation(mm, deg, sigma, 1.0, 1.0)) for mm, sigma, deg in poses]
    assert found == [False, True, False, True]
    # each by its own sigma: 6 deg are covered by 1.3 deg, whatever the position is said to be
    assert not stress.unforeseen(Deviation(0.1, 6.0, 0.01, 1.3, 1.0))
    assert stress.unforeseen(Deviation(0.1, 6.0, 100.0, 1.1, 1.0))


def test_beyond_is_more_than_five_sigmas_however_little_that_is():
    poses = [(0.06, 0.01, 0.1), (0.04, 0.01, 0.1), (0.04, 0.01, 0.6)]  # mm, sigma, deg; 0.1 deg
    found = [stress.beyond(Deviation(mm, deg, sigma, 0.1, 1.0)) for mm, sigma, deg in poses]
    assert found == [True, False, True]
    assert stress.judged(rows_of([Deviation(0.06, 0.1, 0.01, 0.1, 1.0), MISSING]))["beyond"] == 1


def test_a_block_without_a_fault(monkeypatch):
    """From a file that states nothing its poses are less certain than from one that states to be
    exact.
    """
    monkeypatch.setattr(stress, "BLOCK", 2)
    monkeypatch.setattr(stress, "EVERY", {BEST: EVERY[BEST]})
    stated, silent = (
        pd.DataFrame(stress.trial("none", "coded", silent, 0)).set_index(["rig", "estimator"])
        for silent in (False, True)
    )
    assert list(stated.index) == [(rig, BEST) for rig in stress.RIGS for _ in range(2)]
    assert (stated["measured"] & silent["measured"]).all()
    assert not stated["wrong"].any()
    assert stated["mm"].between(0, 0.05, inclusive="neither").all()
    for rig in stress.RIGS:
        assert silent.loc[rig, "nees"].sum() < stated.loc[rig, "nees"].sum()


@pytest.mark.parametrize(
    ("block", "which", "count"), [(30, 3, 2), pytest.param(34, 6, 3, marks=pytest.mark.heavy)]
)
def test_a_bent_handle_s_markers_are_not_taken_for_others(block, which, count):
    """The true pose explains all markers, but lies further from them than a pose may; a pose turned
    by 120 deg lies near enough to those that it explains.
    """
    truths, taken = stress.instants("handle bent by 0.1 mm", "coded", block)
    one = taken[which]
    rig = one.rig.part(range(count))
    measured = measure(one.frames[:count], rig, load_handle("coded"), None, EVERY[BEST])
    assert not deviation(measured.pose, truths[which], load_handle("coded")).wrong


@pytest.mark.slow
def test_centroids_that_lead_away_are_no_pose():
    """CCD3's markers lie beside their windows: the last step was 43 sigmas long, and the pose 9 deg off."""
    _, taken = stress.instants("frames 5 ms apart", "coded", 0)
    one = taken[8]
    rig, parameters = one.rig.part(range(3)), EVERY["reprojection"]
    measured = measure(one.frames[:3], rig, load_handle("coded"), None, parameters)
    assert measured.pose.status == "lost"


# --- the shipped table


@pytest.mark.parametrize(
    ("name", "faults"), [("stress", FAULTS), ("stress_silent", stress.SILENT_FAULTS)]
)
def test_table_is_whole(name, faults):
    table = load_sweep(name)
    keys = ["fault", "handle", "rig", "estimator"]
    expected = list(product(faults, stress.HANDLES, stress.RIGS, EVERY))
    assert list(table[keys].itertuples(index=False, name=None)) == expected
    assert (table["unforeseen"] <= table[["wrong", "beyond"]].min(axis=1)).all()
    assert (table[["wrong", "beyond"]].max(axis=1) <= table["measured"]).all()
