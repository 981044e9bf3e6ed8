"""Poses and their truth from files: errors, flips and losses counted by hand."""

import logging
import re
import shutil

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import data_path, load_handle
from trinolab.evaluation import as_lines, evaluate
from trinolab.files.poses import pose_table, truth_table, write_poses
from trinolab.metrics import pose_from_euler_deg
from trinolab.pose import LOST

HANDLE, CODED = data_path("handles", "paper.toml"), data_path("handles", "coded.toml")
SYMMETRIES = load_handle("paper").symmetries


def truths(n=4):
    """n poses along x, with turns that have nothing to do with one another."""
    angles = [[10.0 * k, 20.0, -30.0 * k] for k in range(n)]
    return pose_from_euler_deg([[10.0 * k, 0.0, 600.0] for k in range(n)], angles)


def turn_deg(axis, angle):
    return RigidTransform.from_rotation(Rotation.from_euler(axis, angle, degrees=True))


def compared(tmp_path, estimates, statuses, frames=None, handle=HANDLE, truth=None):
    """Evaluate estimates against `truths`, through files."""
    table = truth_table(estimates).assign(status=statuses)
    write_poses(table if frames is None else table.assign(frame=frames), tmp_path / "p.csv")
    write_poses(truth_table(truths()) if truth is None else truth, tmp_path / "truth.csv")
    return evaluate(tmp_path / "p.csv", tmp_path / "truth.csv", handle)


def counts(result):
    return tuple(
        getattr(result, name) for name in ("instants", "measured", "ambiguous", "predicted", "lost")
    )


def chosen(T, choice):
    """Poses with one of the paper's handle's symmetries each."""
    return T * RigidTransform.concatenate([SYMMETRIES[k] for k in choice])


def test_errors_by_hand(tmp_path):
    T = truths()
    off = RigidTransform.from_translation([[3.0, 4.0, 0.0], [0] * 3, [0, 0, -1.0], [0] * 3]) * T
    wrong = [off[0], turn_deg("Z", 2.0) * off[1], off[2], off[3] * turn_deg("X", -4.0)]
    result = compared(tmp_path, RigidTransform.concatenate(wrong), "measured")
    # Rz(2 deg) from the left moves pose 1 as well: 10 mm from the axis by 2 sin(1 deg) of that
    chord = 20.0 * np.sin(np.deg2rad(1.0))
    e = result.errors
    assert counts(result) == (4, 4, 0, 0, 0)
    assert e.n == 4
    found = (e.E_t_mm, e.E_alpha_deg, e.E_beta_deg, e.E_gamma_deg, e.geodesic_max_deg)
    # tolerances: nine digits in the files
    assert found == pytest.approx(((5.0 + chord + 1.0) / 4, 0.5, 0.0, 1.0, 4.0), abs=1e-6)
    assert (result.steep, result.steepest_deg) == (0, pytest.approx(20.0, abs=1e-6))
    assert not any("gimbal" in line for line in as_lines(result))


def test_near_gimbal_lock_it_says_that_angles_err_by_more_than_the_rotation(tmp_path):
    """At a beta of 80 deg a turn of 0.1 deg about X moves alpha by 0.1 tan(80 deg) = 0.57 deg."""
    angles = [[0.0, 20.0, 0.0], [0.0, 59.0, 0.0], [0.0, -61.0, 0.0], [0.0, 80.0, 0.0]]
    T = pose_from_euler_deg([[10.0 * k, 0.0, 600.0] for k in range(4)], angles)
    turned = RigidTransform.from_components(T.translation, turn_deg("X", 0.1).rotation * T.rotation)
    result = compared(tmp_path, turned, "measured", handle=CODED, truth=truth_table(T))
    assert result.errors.geodesic_max_deg == pytest.approx(0.1, abs=1e-6)
    assert result.errors.E_gamma_deg > 0.1
    assert (result.steep, result.steepest_deg) == (2, pytest.approx(80.0, abs=1e-6))
    (line,) = (line for line in as_lines(result) if "gimbal" in line)
    assert line.startswith("near gimbal lock: |beta| > 60 deg in 2 of 4, up to 80.0 deg")


SIXTY = next(
    k for k, S in enumerate(SYMMETRIES) if np.isclose(np.rad2deg(S.rotation.magnitude()), 60.0)
)


TRACKS = [
    *(([k] * 4, "measured", 0) for k in (1, 5, 11)),  # a track may be turned by one
    ([0, 0, SIXTY, 0], "measured", 60),  # a flip inside is an error
    ([0, 3, 6, 9], "ambiguous", 0),  # and these are compared one by one
    ([5, 7, 5, 1], ["measured", "ambiguous", "measured", "ambiguous"], 0),
]


@pytest.mark.parametrize(("choice", "statuses", "worst_deg"), TRACKS)
def test_measured_rows_are_one_track_and_ambiguous_ones_each_by_itself(
    tmp_path, choice, statuses, worst_deg
):
    result = compared(tmp_path, chosen(truths(), choice), statuses)
    assert result.errors.geodesic_max_deg == pytest.approx(worst_deg, abs=1e-6)
    assert result.errors.position_max_mm < 1e-6
    if max(choice) == SIXTY:
        return
    other = compared(tmp_path, chosen(truths(), choice), statuses, handle=CODED)
    assert other.errors.geodesic_mean_deg > 30.0  # a handle without symmetry forgives nothing


def test_rows_are_counted_and_joined_on_frame(tmp_path):
    T = truths()
    # frame 3 is missing, 9 is nowhere in the truth, and the order of the rows means nothing
    estimates = RigidTransform.concatenate(
        [T[2], T[0], RigidTransform.from_translation([0, 0, 7.0]) * T[1], T[3]]
    )
    statuses = ["measured", "ambiguous", "predicted", "measured"]
    result = compared(tmp_path, estimates, statuses, frames=[2, 0, 1, 9])
    assert counts(result) == (4, 1, 1, 1, 1)
    assert result.errors.n == 2
    assert result.errors.position_max_mm < 1e-6
    # instants without a truth do not count
    truth = truth_table(T)
    truth.loc[1, "status"] = "lost"
    truth.loc[1, ["x_mm", "qw"]] = np.nan
    assert counts(compared(tmp_path, T, "measured", truth=truth)) == (3, 3, 0, 0, 0)


def test_nothing_but_lost_rows_has_no_errors():
    result = evaluate(pose_table([LOST] * 4), truth_table(truths()), "paper")
    assert (result.lost, result.errors) == (4, None)
    assert as_lines(result)[-1] == "no pose to compare"


def test_a_flip_inside_a_track_is_counted_and_far_off(tmp_path):
    T = truths(6)
    # one whole track in equivalent 2, but for row 3; a flip there and one back
    estimates, truth = chosen(T, [2, 2, 2, 5, 2, 2]), truth_table(T)
    result = compared(tmp_path, estimates, "measured", truth=truth)
    assert (result.track.flips, result.track.far_off) == (2, 1)
    # rows in any order, and an ambiguous row in between, change nothing: only measured rows are the
    # track
    mixed = compared(
        tmp_path,
        estimates[::-1],
        ["measured", "ambiguous", *["measured"] * 4],
        range(6)[::-1],
        truth=truth,
    )
    assert (mixed.track.flips, mixed.track.far_off) == (2, 1)
    statuses = ["measured"] * 3 + ["ambiguous"] + ["measured"] * 2
    alone = compared(tmp_path, estimates, statuses, truth=truth)
    assert (alone.track.flips, alone.track.far_off, alone.track.waits) == (0, 0, (1,))


def test_losses_count_what_can_be_seen(tmp_path):
    """Four markers in one camera, or three in two: the counts stand in a file beside the truth."""
    T = truths(8)
    known = {"l": "lost", "m": "measured", "p": "predicted", "a": "ambiguous"}
    statuses = [known[letter] for letter in "lmplmmal"]
    plain = compared(tmp_path, T, statuses, truth=truth_table(T))
    assert (plain.track.waits, plain.track.unended) == ((2,), 2)
    assert (plain.visible, plain.visible_measured) == (0, 0)
    seen = truth_table(T).assign(markers=[4, 4, 3, 5, 4, 2, 3, 6])
    mixed = seen.sample(frac=1, random_state=0)
    known = compared(tmp_path, T, statuses, truth=mixed)
    assert (known.track.waits, known.track.unended) == ((1,), 1)
    assert (known.visible, known.visible_measured) == (5, 2)
    text = " ".join(" ".join(as_lines(known)).split())
    for words in (
        "measured 3 37.5 %",
        "visible 5 40.0 % measured",
        "losses 2 back after 1 instants",
    ):
        assert words in text
    each = pd.DataFrame({"frame": range(8), "a": [4, 4, 3, 0, 4, 2, 3, 1], "b": 0, "c": 0})
    each["b"], each.loc[6, "c"] = [0, 0, 3, 5, 2, 2, 2, 6], 3
    each.sample(frac=1, random_state=0).to_csv(tmp_path / "truth_markers.csv", index=False)
    known = compared(tmp_path, T, statuses, truth=mixed)
    assert (known.visible, known.visible_measured) == (7, 2)
    each.assign(b="many").to_csv(tmp_path / "truth_markers.csv", index=False)
    with pytest.raises(ValueError, match=r"truth_markers\.csv: expected numbers"):
        compared(tmp_path, T, statuses, truth=mixed)


TABLE = truth_table(truths())


REFUSED = [
    ({"poses": TABLE.drop(columns="qw")}, "^poses: column 'qw' is missing$"),
    ({"truth": TABLE.assign(x_mm=np.nan)}, "^truth: frame 0: no pose"),
    ({"poses": TABLE.assign(frame=TABLE["frame"] + 50)}, "^poses, truth: no frame in common"),
    ({"poses": TABLE.to_numpy()}, "^poses: expected a file or a table.*got ndarray$"),
    ({"truth": None}, "^truth: expected a file or a table of poses, got NoneType$"),
    ({"handle": "papers"}, "^papers: no such file, and no shipped handle"),
]


@pytest.mark.parametrize(("changed", "said"), REFUSED)
def test_a_table_that_is_none_of_poses_is_refused_by_its_argument(changed, said):
    with pytest.raises(ValueError, match=said):
        evaluate(**{"poses": TABLE, "truth": TABLE, "handle": "paper", **changed})


ALL, SOME, FEW = "measured", ["measured"] * 3 + ["ambiguous"], ["measured"] * 2 + ["lost"] * 2


HANDLES = [
    (SYMMETRIES[0], ALL, HANDLE, CODED, "is coded with 1: likely --handle .* is meant"),
    (SYMMETRIES[0], ALL, CODED, CODED, None),
    (SYMMETRIES[2], ALL, CODED, None, "likely --handle paper is meant"),
    (SYMMETRIES[2] * turn_deg("X", 20.0), ALL, CODED, None, "likely --handle paper is meant"),
    (turn_deg("X", 20.0), ALL, CODED, None, None),  # no symmetry explains that
    (SYMMETRIES[0], ALL, HANDLE, None, "no pose needs the 12 symmetries of paper, the errors are"),
    (SYMMETRIES[0], SOME, HANDLE, None, None),
    (SYMMETRIES[1], ALL, HANDLE, None, None),
    (SYMMETRIES[0], ALL, HANDLE, HANDLE, None),
    (SYMMETRIES[2], FEW, CODED, None, None),
]


@pytest.mark.parametrize(("turn", "statuses", "handle", "beside", "said"), HANDLES)
def test_another_handle_than_the_likely_one_is_named(
    tmp_path, caplog, turn, statuses, handle, beside, said
):
    if beside is not None:  # the file beside the truth says which handle it is
        shutil.copy(beside, tmp_path / "handle.toml")
    compared(tmp_path, truths() * turn, statuses, handle=handle)
    lines = [one.getMessage() for one in caplog.records if one.levelno == logging.WARNING]
    assert len(lines) == (said is not None)
    assert all(re.search(said, line) for line in lines)
