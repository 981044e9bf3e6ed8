"""Pose files: what is read, what is refused and how."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import cases, unescaped
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.files.poses import (
    pose_table,
    read_poses,
    transforms,
    truth_table,
    write_poses,
    write_tum,
)
from trinolab.pose import LOST, Pose

HERE = Path(__file__).parent
HEAD = "frame,x_mm,y_mm,z_mm,qw,qx,qy,qz,status\n"
QUARTER = RigidTransform.from_components(
    [1.0, -250.0, 549.0], Rotation.from_euler("Z", 90.0, degrees=True)
)
COVARIANCE = np.diag([1.0, 4.0, 4.0, 1e-4, 1e-4, 2e-4])
MEASURED = Pose("measured", QUARTER, COVARIANCE, 0.5, 6, 2)
AMBIGUOUS = Pose("ambiguous", QUARTER.inv(), COVARIANCE, 0.25, 4, 2)


def test_a_table_by_hand(tmp_path):
    """`examples/poses.csv` has the columns that book/notation.md lists. A sigma is the root of the sum
    of variances, 1 + 4 + 4 mm^2 and 4e-4 rad^2, and of the systematic part's, 16 and 4e-4.
    """
    poses = [
        replace(MEASURED, systematic=np.diag([4.0, 8.0, 4.0, 0.0, 4e-4, 0.0])),
        LOST,
        AMBIGUOUS,
    ]
    write_poses(pose_table(poses, [0.1, 0.2, 0.3]), tmp_path / "p.csv")
    assert (tmp_path / "p.csv").read_text() == (HERE / "examples" / "poses.csv").read_text()
    table = read_poses(tmp_path / "p.csv")
    assert table["status"].tolist() == ["measured", "lost", "ambiguous"]
    assert table.iloc[1, 2:15].isna().all()
    old = table.drop(columns=["systematic_mm", "systematic_deg"])
    write_poses(old, tmp_path / "old.csv")
    assert list(read_poses(tmp_path / "old.csv")) == list(old)


def test_table_may_lack_what_is_not_needed(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("qz,qw,qx,qy,x_mm,y_mm,z_mm,frame,remark\n0,1,0,0,1,2,3,7,x\n")
    assert read_poses(path)[["frame", "status"]].values.tolist() == [[7, "measured"]]
    path.write_text(HEAD + "0,,,,,,,,lost\n")
    assert list(read_poses(path)["status"]) == ["lost"]


# --- TUM


def test_tum_holds_the_measured_poses_by_hand(tmp_path):
    others = [LOST, replace(AMBIGUOUS, status="predicted"), AMBIGUOUS]
    poses = [MEASURED, *others, replace(MEASURED, T_world_handle=QUARTER.inv())]
    write_tum(pose_table(poses, [0.0, 0.1, 0.2, 0.3, 1753000000.4]), tmp_path / "p.tum")
    # sin 45 deg; the inverse carries (1, -250, 549) back to the origin: t = -R^T (1, -250, 549)
    h = 0.707106781
    line = f"0.000000000 0.001000000 -0.250000000 0.549000000 0.000000000 0.000000000 {h} {h}"
    assert (tmp_path / "p.tum").read_text().splitlines()[0] == line
    wanted = [
        [0.0, 0.001, -0.25, 0.549, 0, 0, h, h],
        [1753000000.4, 0.25, 0.001, -0.549, 0, 0, -h, h],
    ]
    # half a unit of the ninth digit, and a double's 2.4e-7 s in the time since 1970
    np.testing.assert_allclose(np.loadtxt(tmp_path / "p.tum"), wanted, rtol=0, atol=3e-7)


def test_tum_needs_times_only_of_what_it_writes(tmp_path):
    write_tum(pose_table([LOST, LOST]), tmp_path / "p.tum")
    assert (tmp_path / "p.tum").read_text() == ""
    table = pose_table([AMBIGUOUS, LOST, MEASURED])
    for without in (table, table.drop(columns="t_s")):
        with pytest.raises(ValueError, match="time of every measured row, got none for frame 2"):
            write_tum(without, tmp_path / "other.tum")
    assert not (tmp_path / "other.tum").exists()


@pytest.mark.parametrize(("text", "message"), cases(HERE / "wrong.txt", "poses"))
def test_bad_table_is_named(tmp_path, text, message):
    path = tmp_path / "p.csv"
    path.write_bytes(unescaped(text.replace("HEAD", HEAD)).encode("latin-1"))
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        read_poses(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unreadable_table_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"no\.csv: cannot be read \(No such file"):
        read_poses(tmp_path / "no.csv")
    with pytest.raises(ValueError, match=r"cannot be read \(Is a directory"):
        read_poses(tmp_path)


# --- any pose; files that are wrong in any way: test_fuzz


@settings(max_examples=40, deadline=None, derandomize=True)
@given(position=st.tuples(*[st.floats(-1e6, 1e6)] * 3), rotvec=st.tuples(*[st.floats(-4, 4)] * 3))
def test_any_pose_survives_the_file(position, rotvec, tmp_path_factory):
    T = RigidTransform.from_components([position], Rotation.from_rotvec([rotvec]))
    path = tmp_path_factory.mktemp("poses") / "p.csv"
    write_poses(truth_table(T), path)
    back = transforms(read_poses(path))
    assert np.allclose(back.translation, T.translation, rtol=1e-8, atol=1e-12)  # nine digits
    assert (back.rotation * T.rotation.inv()).magnitude().max() < 1e-8
