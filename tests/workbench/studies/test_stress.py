"""The stress table: sums and bounds worked out by hand, a small trial, and the shipped table."""

from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import load_handle, load_rig, load_sweep, load_table1
from trinolab.measurement import measure
from trinolab.methods import BEST
from trinolab.pose import LOST, Pose
from workbench.intervals import highest_share
from workbench.studies import stress
from workbench.studies.__main__ import main
from workbench.studies.broken import FAULTS, covariance_of_such
from workbench.studies.replication import CHECKED, EVERY, Deviation, deviation
from workbench.sweep import runs

HELD = [Deviation(0.3, 1.0, 0.1, 1.0, 10.0), Deviation(2.5, 2.0, 0.5, 1.0, 30.0)]
MISSING = Deviation(*[np.nan] * 5)
DIGITS = 1e-5  # of the shipped table


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


def test_wrong_is_beyond_two_millimetres_or_five_degrees():
    pairs = [(1.9, 4.9), (2.1, 0.0), (0.0, 5.1)]
    assert [Deviation(mm, deg, 1.0, 1.0, 1.0).wrong for mm, deg in pairs] == [False, True, True]


def test_blocks_add_up_to_a_row():
    """Of three instants two were measured, one of them wrongly: means 1.4 mm and 1.5 deg."""
    first, second = (stress.sums(part) for part in ([HELD[0], MISSING], [HELD[1]]))
    blocks = pd.DataFrame(
        [{f"r/e/{name}": value for name, value in part.items()} for part in (first, second)]
    )
    row = stress.judged(blocks, "r/e")
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
    assert stress.sums([Deviation(0.06, 0.1, 0.01, 0.1, 1.0), MISSING])["beyond"] == 1


def test_blocks_that_an_estimator_has_not_measured_do_not_count():
    blocks = pd.DataFrame([{f"r/e/{k}": v for k, v in stress.sums(HELD).items()}, {}])
    assert stress.judged(blocks, "r/e")["n"] == 2


def test_a_fault_is_both_handles_together():
    """Two of four poses at 1 mm and 3 sigmas, and one of six at 4 mm and 6 sigmas."""
    common = {"fault": "rain", "rig": "r", "estimator": "e", "unforeseen": 1, "beyond": 2}
    numbers = [
        {"n": 4, "measured": 2, "wrong": 0, "mean_mm": 1.0, "error_by_sigma_mm": 3.0, "nees": 3.0},
        {"n": 6, "measured": 1, "wrong": 1, "mean_mm": 4.0, "error_by_sigma_mm": 6.0, "nees": 9.0},
    ]
    angles = {"mean_deg": np.nan, "error_by_sigma_deg": np.nan}
    table = pd.DataFrame([{**common, **row, **angles} for row in numbers])
    (row,) = stress.by_fault(table, "r", "e").to_dict("records")
    assert (row["n"], row["measured"], row["wrong"], row["unforeseen"]) == (10, 0.3, 1, 2)
    assert row["beyond"] == 4
    assert row["NEES"] == pytest.approx(5.0)
    assert row["mm"] == pytest.approx(2.0)
    assert row["by sigma, mm"] == pytest.approx(np.sqrt((9 + 9 + 36) / 3))
    assert row["wrong, at most"] == pytest.approx(0.394, abs=1e-3)


def test_windows_hold_the_markers_and_stay_inside_the_images():
    rig, handle = load_rig("raised_40deg"), load_handle("coded")
    for T in load_table1().set_poses:
        for whole, window in zip(rig.cameras, stress.watched(rig, T).cameras, strict=True):
            assert window.size == (stress.WINDOW_PX, stress.WINDOW_PX)
            corner = whole.principal_point - window.principal_point
            assert (corner >= 0).all()
            assert (corner + window.size <= whole.size).all()
            centres = T.apply(handle.marker_centres)
            np.testing.assert_allclose(window.project(centres) + corner, whole.project(centres))
            # markers near the edge of an image are as far from that of its window
            inside = whole.sees(centres, 20.0)
            assert window.sees(centres[inside], 20.0).all()


def test_the_first_cameras_are_known_as_well_as_all_are():
    whole = load_rig("raised_40deg")
    known = covariance_of_such(whole, 0.3, 0.02)
    pair = replace(whole, covariance=known).part(range(2))
    expected = covariance_of_such(load_rig("paper_pair"), 0.3, 0.02)
    assert pair.covariance.names == expected.names
    np.testing.assert_array_equal(pair.covariance.matrix, expected.matrix)
    assert whole.part(range(2)).covariance.is_exact


def test_nothing_measured_has_no_mean():
    row = stress.judged(
        pd.DataFrame([{f"r/e/{k}": v for k, v in stress.sums([MISSING] * 4).items()}]), "r/e"
    )
    assert row["measured"] == 0
    assert np.isnan([row["mean_mm"], row["error_by_sigma_deg"]]).all()


def test_bound_of_a_share():
    """None of n: (1 - p) ** n = 0.05, about 3 / n; one of ten: 39.4 %, from a table of the binomial."""
    assert highest_share(0, 1000) == pytest.approx(3 / 1000, rel=0.01)
    assert highest_share(1, 10) == pytest.approx(0.394, abs=1e-3)
    assert highest_share(5, 5) == 1.0


def test_a_block_without_a_fault(monkeypatch):
    monkeypatch.setattr(stress, "BLOCK", 1)
    monkeypatch.setattr(stress, "EVERY", {name: EVERY[name] for name in ("patches",)})
    found = stress.trial("none", "coded", 0)
    files = product((stress.STATED, stress.SILENT), stress.RIGS, (*stress.SUMS, "nees_0"))
    assert set(found) == {f"{file}/{rig}/patches/{name}" for file, rig, name in files}
    assert found["stated/paper_pair/patches/measured"] == found["stated/paper_pair/patches/n"] == 1
    assert found["stated/raised_40deg/patches/wrong"] == 0
    assert 0 < found["stated/raised_40deg/patches/largest_mm"] < 0.05
    assert found == stress.trial("none", "coded", 0)
    assert found != stress.trial("none", "coded", 1)


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


def test_later_rounds_are_those_of_two_estimators(monkeypatch):
    monkeypatch.setattr(stress, "BLOCK", 1)
    found = stress.trial("gamma 0.6", "paper", stress.FIRST_ROUNDS)
    assert {name.split("/")[2] for name in found} == set(stress.OFTEN)


@pytest.mark.slow
def test_a_silent_file_is_one_that_states_nothing(monkeypatch):
    """Its poses are less certain than those of the same images and rigs that state to be exact."""
    monkeypatch.setattr(stress, "BLOCK", 2)
    monkeypatch.setattr(stress, "EVERY", {BEST: EVERY[BEST]})
    found = stress.trial("none", "coded", 0)
    assert found["silent/paper_pair/patches/measured"] == 2
    for rig in stress.RIGS:
        assert found[f"silent/{rig}/patches/nees"] < found[f"stated/{rig}/patches/nees"]


# --- the command


def quick(fault, handle, block):
    DONE.append((fault, handle, block))
    sums = dict(zip(stress.SUMS, [10.0, 8.0, 0.0, 0.0, 0.0, 40.0, *[1.0] * 8], strict=True))
    sums |= {f"nees_{k}": 5.0 for k in range(8)}
    names = EVERY if block < stress.FIRST_ROUNDS else stress.OFTEN
    files = (stress.STATED, stress.SILENT)[: 1 + (fault in stress.SILENT_FAULTS)]
    cells = product(files, stress.RIGS, names, sums.items())
    return {f"{file}/{rig}/{one}/{name}": value for file, rig, one, (name, value) in cells}


DONE = []
CHOSEN = "none", "calibration 0.1 px, 0.005 deg"


def test_more_rounds_add_to_those_that_are_kept(monkeypatch, tmp_path):
    monkeypatch.setattr(stress, "trial", quick)
    monkeypatch.setattr(runs, "figure", lambda found: b"")  # what it shows is tested with sweeps
    monkeypatch.setattr(stress, "FAULTS", {name: FAULTS[name] for name in CHOSEN})
    monkeypatch.setattr(stress, "HANDLES", ("coded",))
    command = ["stress", "--out", str(tmp_path), "--kept", str(tmp_path / "kept"), "--workers", "1"]
    monkeypatch.setattr(stress, "FIRST_ROUNDS", 1)
    assert main([*command, "--instants", "10"]) == 0
    first = pd.read_csv(tmp_path / "stress.csv")
    assert set(first["n"]) == {10}
    assert [(name, "coded", 0) for name in CHOSEN] == DONE
    DONE.clear()
    assert main([*command, "--instants", "20"]) == 0
    assert [(name, "coded", 1) for name in CHOSEN] == DONE
    second = pd.read_csv(tmp_path / "stress.csv")
    assert list(second.columns) == list(first.columns)
    counts = second.groupby("estimator")["n"].unique().explode().to_dict()
    assert counts == {name: 20 if name in stress.OFTEN else 10 for name in EVERY}
    assert set(second["fault"]) == set(CHOSEN)
    assert set(second["nees"]) == {5.0}
    assert set(pd.read_csv(tmp_path / "stress_silent.csv")["fault"]) == {"none"}


# --- the shipped table


@pytest.mark.parametrize(
    ("name", "faults"), [("stress", FAULTS), ("stress_silent", stress.SILENT_FAULTS)]
)
def test_table_is_whole(name, faults):
    table = load_sweep(name)
    keys = ["fault", "handle", "rig", "estimator"]
    expected = list(product(faults, stress.HANDLES, stress.RIGS, EVERY))
    assert list(table[keys].itertuples(index=False, name=None)) == expected
    often = table["estimator"].isin(stress.OFTEN)
    assert (table["n"][~often] == stress.FIRST_ROUNDS * stress.BLOCK).all()
    assert table["n"][often].nunique() == 1
    assert (table["wrong"] <= table["measured"]).all()
    assert (table["unforeseen"] <= table[["wrong", "beyond"]].min(axis=1)).all()
    assert (table["beyond"] <= table["measured"]).all()
    assert (table["seed"] == stress.SEED).all()
    assert not (table["nees_95"] > table["nees_99"] * (1 + DIGITS)).any()
    for unit in ("mm", "deg"):
        ends = table[[f"error_by_sigma_low_{unit}", f"error_by_sigma_high_{unit}"]].to_numpy().T
        many = table["measured"] > 10
        assert (ends[0] <= table[f"error_by_sigma_{unit}"] * (1 + DIGITS))[many].all()
        assert (table[f"error_by_sigma_{unit}"] <= ends[1] * (1 + DIGITS))[many].all()


def test_poses_that_are_false_and_beyond_what_they_say_are_late_frames():
    """More than 2 mm or 5 deg off, and by more than five of its own sigmas: two of the paper's poses
    from cameras that look 5 ms apart. What is late shifts an image along its epipolar lines as
    well, which a pair cannot contradict, and it outvotes a third camera.
    """
    both = pd.concat([load_sweep("stress"), load_sweep("stress_silent")])
    false = both[both["unforeseen"] > 0]
    assert set(false["fault"]) == {"frames 5 ms apart"}
    assert set(false["estimator"]) == {CHECKED}
    assert false["unforeseen"].sum() == 2


def test_hardly_a_pose_is_beyond_five_of_its_sigmas():
    """However little it is off: a normal error is in 1 of 100,000, three axes together; where the
    images are broken it is in 1 of 200.
    """
    both = pd.concat([load_sweep("stress"), load_sweep("stress_silent")])
    for estimator in EVERY:
        rows = both[both["estimator"] == estimator]
        assert rows["beyond"].sum() <= rows["measured"].sum() / 200
        whole = rows[rows["fault"].isin(["none", "half contrast", "noise x 3", "JPEG 60"])]
        assert whole["beyond"].sum() == 0


def test_without_a_fault_the_best_estimator_is_honest_and_never_wrong():
    table = load_sweep("stress")
    table = table[(table["fault"] == "none") & (table["estimator"] == BEST)]
    assert (table["measured"] == table["n"]).all()
    assert (table["wrong"] == 0).all()
    ratios = table[["error_by_sigma_mm", "error_by_sigma_deg"]].to_numpy()
    assert ((ratios > 0.8) & (ratios < 1.3)).all()


def made_again(fault, handle, estimators):
    """Rows of estimators that measure the first rounds alone, of both tables."""
    blocks = pd.DataFrame([stress.trial(fault, handle, k) for k in range(stress.FIRST_ROUNDS)])
    tables = {stress.STATED: load_sweep("stress"), stress.SILENT: load_sweep("stress_silent")}
    keys = ["fault", "handle", "rig", "estimator"]
    for file, rig, estimator in product(tables, stress.RIGS, estimators):
        if file == stress.SILENT and fault not in stress.SILENT_FAULTS:
            continue
        stored = tables[file].set_index(keys).loc[(fault, handle, rig, estimator)]
        for name, value in stress.judged(blocks, f"{file}/{rig}/{estimator}").items():
            assert stored[name] == pytest.approx(value, rel=DIGITS, nan_ok=True), name


@pytest.mark.heavy
def test_two_rows_are_made_again(monkeypatch):
    monkeypatch.setattr(stress, "EVERY", {"paper": EVERY["paper"]})
    made_again("half contrast", "coded", ["paper"])


@pytest.mark.heavy
@pytest.mark.parametrize("handle", stress.HANDLES)
@pytest.mark.parametrize("fault", FAULTS)
def test_all_estimators_of_a_fault_are_made_again(fault, handle):
    made_again(fault, handle, [name for name in EVERY if name not in stress.OFTEN])


def test_an_unknown_fault_is_refused():
    with pytest.raises(ValueError, match=r"fault: expected one of none, lens blur 2 px, .*'rain'"):
        stress.trial("rain", "coded", 0)


def test_a_block_that_fails_is_said_and_no_table_is_written(monkeypatch, tmp_path, capsys):
    def failing(fault, handle, block):
        if fault == "JPEG 60":
            raise ValueError("handle: bent")
        return quick(fault, handle, block)

    monkeypatch.setattr(f"{__name__}.DONE", [])
    monkeypatch.setattr(stress, "trial", failing)
    monkeypatch.setattr(runs, "figure", lambda found: b"")
    monkeypatch.setattr(stress, "FAULTS", {name: FAULTS[name] for name in ("none", "JPEG 60")})
    command = ["stress", "--out", str(tmp_path), "--kept", str(tmp_path / "kept"), "--workers", "1"]
    assert main([*command, "--instants", "10"]) == 2
    *_, line = capsys.readouterr().err.splitlines()
    assert line.endswith("stress: 2 of 4 runs failed; the first: ValueError: handle: bent")
    assert not (tmp_path / "stress.csv").exists()
