"""Poses and their truth from files: errors, flips and losses counted by hand."""

import logging
import shutil

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import data_path, load_handle
from trinolab.evaluation import as_lines, evaluate
from trinolab.files.poses import pose_table, read_poses, truth_table, write_poses
from trinolab.pose import LOST

HANDLE, CODED = data_path("handles", "paper.toml"), data_path("handles", "coded.toml")


def truths(n=4):
    """n poses along x, with turns that have nothing to do with one another."""
    turns = Rotation.from_euler(
        "ZYX", [[10.0 * k, 20.0, -30.0 * k] for k in range(n)], degrees=True
    )
    return RigidTransform.from_components([[10.0 * k, 0.0, 600.0] for k in range(n)], turns)


def turn_deg(axis, angle):
    return RigidTransform.from_rotation(Rotation.from_euler(axis, angle, degrees=True))


def compared(tmp_path, estimates, statuses, frames=None, handle=HANDLE, truth=None):
    """Evaluate estimates against `truths`, through files."""
    table = truth_table(estimates).assign(status=statuses)
    write_poses(table if frames is None else table.assign(frame=frames), tmp_path / "p.csv")
    write_poses(truth_table(truths()) if truth is None else truth, tmp_path / "truth.csv")
    return evaluate(tmp_path / "p.csv", tmp_path / "truth.csv", handle)


def test_errors_by_hand(tmp_path):
    T = truths()
    off = (
        RigidTransform.from_translation(
            [[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]
        )
        * T
    )
    wrong = [off[0], turn_deg("Z", 2.0) * off[1], off[2], off[3] * turn_deg("X", -4.0)]
    result = compared(tmp_path, RigidTransform.concatenate(wrong), "measured")
    # Rz(2 deg) from the left moves pose 1 as well: 10 mm from the axis by 2 sin(1 deg) of that
    chord = 20.0 * np.sin(np.deg2rad(1.0))
    e = result.errors
    assert (result.instants, result.measured, result.ambiguous, result.predicted, result.lost) == (
        4,
        4,
        0,
        0,
        0,
    )
    assert e.n == 4
    # tolerances: nine digits in the files
    assert e.E_t_mm == pytest.approx((5.0 + chord + 1.0 + 0.0) / 4, abs=1e-6)
    assert e.position_max_mm == pytest.approx(5.0, abs=1e-6)
    assert e.E_alpha_deg == pytest.approx(2.0 / 4, abs=1e-6)
    assert e.E_beta_deg == pytest.approx(0.0, abs=1e-6)
    assert e.E_gamma_deg == pytest.approx(4.0 / 4, abs=1e-6)
    assert e.geodesic_mean_deg == pytest.approx((2.0 + 4.0) / 4, abs=1e-6)
    assert e.geodesic_max_deg == pytest.approx(4.0, abs=1e-6)


def test_near_gimbal_lock_it_says_that_angles_err_by_more_than_the_rotation(tmp_path):
    """At a beta of 80 deg a turn of 0.1 deg about X moves alpha by 0.1 tan(80 deg) = 0.57 deg."""
    angles = [[0.0, 20.0, 0.0], [0.0, 59.0, 0.0], [0.0, -61.0, 0.0], [0.0, 80.0, 0.0]]
    turns = Rotation.from_euler("ZYX", angles, degrees=True)
    T = RigidTransform.from_components([[10.0 * k, 0.0, 600.0] for k in range(4)], turns)
    turned = RigidTransform.from_components(T.translation, turn_deg("X", 0.1).rotation * turns)
    result = compared(tmp_path, turned, "measured", handle=CODED, truth=truth_table(T))
    assert result.errors.geodesic_max_deg == pytest.approx(0.1, abs=1e-6)
    assert result.errors.E_gamma_deg > 0.1
    assert (result.steep, result.steepest_deg) == (2, pytest.approx(80.0, abs=1e-6))
    (line,) = (line for line in as_lines(result) if "gimbal" in line)
    assert line.startswith("near gimbal lock: |beta| > 60 deg in 2 of 4, up to 80.0 deg")


def test_far_from_gimbal_lock_nothing_is_said_of_it(tmp_path):
    result = compared(tmp_path, truths(), "measured")
    assert (result.steep, result.steepest_deg) == (0, pytest.approx(20.0, abs=1e-6))
    assert not any("gimbal" in line for line in as_lines(result))


@pytest.mark.parametrize("k", range(1, 12))
def test_a_track_may_be_turned_by_one_symmetry(tmp_path, k):
    result = compared(tmp_path, truths() * load_handle("paper").symmetries[k], "measured")
    assert result.errors.geodesic_max_deg < 1e-6
    assert result.errors.position_max_mm < 1e-6


def test_a_flip_inside_a_track_is_an_error(tmp_path):
    T, S = truths(), load_handle("paper").symmetries
    sixty = next(s for s in S if np.isclose(np.rad2deg(s.rotation.magnitude()), 60.0))
    flipped = RigidTransform.concatenate(
        [T[0] * S[2], T[1] * S[2], T[2] * S[2] * sixty, T[3] * S[2]]
    )
    result = compared(tmp_path, flipped, "measured")
    assert result.errors.geodesic_max_deg == pytest.approx(60.0, abs=1e-6)
    assert result.errors.geodesic_mean_deg == pytest.approx(15.0, abs=1e-6)


def test_ambiguous_rows_are_compared_one_by_one(tmp_path):
    T, S = truths(), load_handle("paper").symmetries
    each = RigidTransform.concatenate([T[k] * S[3 * k] for k in range(4)])
    assert compared(tmp_path, each, "ambiguous").errors.geodesic_max_deg < 1e-6
    assert compared(tmp_path, each, "measured").errors.geodesic_max_deg > 30.0
    mixed = RigidTransform.concatenate([T[0] * S[5], T[1] * S[7], T[2] * S[5], T[3] * S[1]])
    result = compared(tmp_path, mixed, ["measured", "ambiguous", "measured", "ambiguous"])
    assert (result.measured, result.ambiguous) == (2, 2)
    assert result.errors.geodesic_max_deg < 1e-6


def test_a_handle_without_symmetry_forgives_nothing(tmp_path):
    turned = truths() * load_handle("paper").symmetries[1]
    assert compared(tmp_path, turned, "ambiguous", handle=CODED).errors.geodesic_mean_deg > 30.0


def test_rows_are_counted_and_joined_on_frame(tmp_path):
    T = truths()
    # frame 3 is missing, 9 is nowhere in the truth, and the order of the rows means nothing
    estimates = RigidTransform.concatenate(
        [T[2], T[0], RigidTransform.from_translation([0, 0, 7.0]) * T[1], T[3]]
    )
    result = compared(
        tmp_path, estimates, ["measured", "ambiguous", "predicted", "measured"], frames=[2, 0, 1, 9]
    )
    assert (result.instants, result.measured, result.ambiguous, result.predicted, result.lost) == (
        4,
        1,
        1,
        1,
        1,
    )
    assert result.errors.n == 2
    assert result.errors.position_max_mm < 1e-6


def test_instants_without_a_truth_do_not_count(tmp_path):
    truth = truth_table(truths())
    truth.loc[1, "status"] = "lost"
    truth.loc[1, ["x_mm", "qw"]] = np.nan
    result = compared(tmp_path, truths(), "measured", truth=truth)
    assert (result.instants, result.measured, result.lost) == (3, 3, 0)


def test_nothing_but_lost_rows_has_no_errors(tmp_path):
    write_poses(pose_table([LOST] * 4), tmp_path / "p.csv")
    write_poses(truth_table(truths()), tmp_path / "truth.csv")
    result = evaluate(tmp_path / "p.csv", tmp_path / "truth.csv", HANDLE)
    assert (result.lost, result.errors) == (4, None)


def test_no_frame_in_common_is_an_error(tmp_path):
    with pytest.raises(ValueError, match=r"p\.csv, .*truth\.csv: no frame in common"):
        compared(tmp_path, truths(), "measured", frames=[4, 5, 6, 7])


def test_a_flip_inside_a_track_is_counted_and_far_off(tmp_path):
    T, S = truths(6), load_handle("paper").symmetries
    # one whole track in equivalent 2, but for row 3; a flip there and one back
    estimates = RigidTransform.concatenate([T[k] * (S[5] if k == 3 else S[2]) for k in range(6)])
    result = compared(tmp_path, estimates, "measured", truth=truth_table(T))
    assert (result.track.flips, result.track.far_off) == (2, 1)
    # rows in any order, and an ambiguous row in between, change nothing: only measured rows are the
    # track
    statuses = ["measured", "ambiguous", "measured", "measured", "measured", "measured"]
    mixed = compared(
        tmp_path, estimates[::-1], statuses, frames=[5, 4, 3, 2, 1, 0], truth=truth_table(T)
    )
    assert (mixed.track.flips, mixed.track.far_off) == (2, 1)
    alone = compared(
        tmp_path,
        estimates,
        ["measured"] * 3 + ["ambiguous"] + ["measured"] * 2,
        truth=truth_table(T),
    )
    assert (alone.track.flips, alone.track.far_off, alone.track.waits) == (0, 0, (1,))


def test_losses_count_what_can_be_seen(tmp_path):
    T = truths(8)
    statuses = [
        "lost",
        "measured",
        "predicted",
        "lost",
        "measured",
        "measured",
        "ambiguous",
        "lost",
    ]
    plain = compared(tmp_path, T, statuses, truth=truth_table(T))
    assert (plain.track.waits, plain.track.unended) == ((2,), 2)
    assert (plain.visible, plain.visible_measured) == (0, 0)
    seen = truth_table(T).assign(markers=[4, 4, 3, 5, 4, 2, 0, 6])
    known = compared(tmp_path, T, statuses, truth=seen.sample(frac=1, random_state=0))
    assert (known.track.waits, known.track.unended) == ((1,), 1)
    assert (known.visible, known.visible_measured) == (5, 2)


def test_two_cameras_that_see_three_each_are_enough(tmp_path):
    """The rule needs each camera's count, which stand in a file beside the truth: two rows more are
    visible.
    """
    T = truths(8)
    statuses = [
        "lost",
        "measured",
        "predicted",
        "lost",
        "measured",
        "measured",
        "ambiguous",
        "lost",
    ]
    seen = truth_table(T).assign(markers=[4, 4, 3, 5, 4, 2, 3, 6])
    counts = pd.DataFrame(
        {
            "frame": range(8),
            "a": [4, 4, 3, 0, 4, 2, 3, 1],
            "b": [0, 0, 3, 5, 2, 2, 2, 6],
            "c": [0, 0, 0, 0, 0, 2, 3, 0],
        }
    )
    counts.sample(frac=1, random_state=0).to_csv(tmp_path / "truth_markers.csv", index=False)
    known = compared(tmp_path, T, statuses, truth=seen)
    assert (known.visible, known.visible_measured) == (7, 2)
    counts.assign(b="many").to_csv(tmp_path / "truth_markers.csv", index=False)
    with pytest.raises(ValueError, match=r"truth_markers\.csv: expected numbers"):
        compared(tmp_path, T, statuses, truth=seen)


# --- tables instead of files, and a handle by its name


def test_tables_files_and_names_give_the_same(tmp_path):
    T = truths()
    found = truth_table(RigidTransform.from_translation([0.3, 0.0, 0.4]) * T)
    write_poses(found, tmp_path / "p.csv")
    write_poses(truth_table(T), tmp_path / "truth.csv")
    by_file = evaluate(tmp_path / "p.csv", str(tmp_path / "truth.csv"), HANDLE)
    assert by_file.errors.E_t_mm == pytest.approx(0.5, abs=1e-6)
    for poses, truth, handle in (
        (found, truth_table(T), load_handle("paper")),
        (read_poses(tmp_path / "p.csv"), pd.read_csv(tmp_path / "truth.csv"), "paper"),
        (found, tmp_path / "truth.csv", HANDLE),
    ):
        result = evaluate(poses, truth, handle)
        assert result.measured == by_file.measured == 4
        assert result.errors.E_t_mm == pytest.approx(by_file.errors.E_t_mm, abs=1e-6)
        assert result.track == by_file.track


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (lambda t: {"poses": t.drop(columns="qw")}, "^poses: column 'qw' is missing$"),
        (lambda t: {"truth": t.assign(x_mm=np.nan)}, "^truth: frame 0: no pose"),
        (lambda t: {"poses": t.assign(frame=t["frame"] + 50)}, "^poses, truth: no frame in common"),
        (lambda t: {"poses": t.to_numpy()}, "^poses: expected a file or a table.*got ndarray$"),
        (lambda _: {"truth": None}, "^truth: expected a file or a table of poses, got NoneType$"),
        (lambda _: {"handle": "papers"}, "^papers: no such file, and no shipped handle"),
    ],
)
def test_a_table_that_is_none_of_poses_is_refused_by_its_argument(changed, said):
    table = truth_table(truths())
    given = {"poses": table, "truth": table, "handle": "paper"}
    with pytest.raises(ValueError, match=said):
        evaluate(**{**given, **changed(table)})


def hints(caplog):
    return [one.getMessage() for one in caplog.records if one.levelno == logging.WARNING]


def test_another_handle_beside_the_truth_is_named(tmp_path, caplog):
    shutil.copy(CODED, tmp_path / "handle.toml")
    compared(tmp_path, truths(), "measured", handle=HANDLE)
    assert hints(caplog) == [
        f"{HANDLE}: the errors count up to the 12 symmetries of paper, but {tmp_path / 'handle.toml'}, beside "
        f"the truth, is coded with 1: likely --handle {tmp_path / 'handle.toml'} is meant"
    ]
    caplog.clear()
    compared(tmp_path, truths(), "measured", handle=tmp_path / "handle.toml")
    assert hints(caplog) == []


def test_a_shipped_handle_whose_symmetry_explains_the_poses_is_named(tmp_path, caplog):
    turned = truths() * load_handle("paper").symmetries[2]
    compared(tmp_path, turned, "measured", handle=CODED)
    (said,) = hints(caplog)
    assert "under the symmetries of the shipped handle paper the poses fit the truth far" in said
    assert said.endswith("likely --handle paper is meant")
    caplog.clear()
    # no symmetry explains an error of 20 deg
    compared(tmp_path, truths() * turn_deg("X", 20.0), "measured", handle=CODED)
    assert hints(caplog) == []


def test_poses_that_need_no_symmetry_are_likely_of_another_handle(tmp_path, caplog):
    compared(tmp_path, truths(), "measured", handle=HANDLE)
    (said,) = hints(caplog)
    assert "no pose needs the 12 symmetries of paper, the errors are the same without" in said
    caplog.clear()
    compared(tmp_path, truths(), ["measured"] * 3 + ["ambiguous"], handle=HANDLE)
    compared(tmp_path, truths() * load_handle("paper").symmetries[1], "measured", handle=HANDLE)
    # the handle beside the truth says that it is the one
    shutil.copy(HANDLE, tmp_path / "handle.toml")
    compared(tmp_path, truths(), "measured", handle=HANDLE)
    assert hints(caplog) == []
