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

# the columns that book/notation.md lists, typed once more
LISTED = """
    frame t_s x_mm y_mm z_mm qw qx qy qz alpha_deg beta_deg gamma_deg sigma_mm sigma_deg
    residual_px markers cameras status systematic_mm systematic_deg
"""
COLUMNS = LISTED.split()
HEAD = "frame,x_mm,y_mm,z_mm,qw,qx,qy,qz,status\n"


T = RigidTransform.from_components(
    [1.0, 2.0, 3.0], Rotation.from_euler("ZYX", [10.0, 20.0, 30.0], degrees=True)
)


def some_poses():
    covariance = np.diag([1.0, 4.0, 4.0, 1e-4, 1e-4, 2e-4])
    return [
        Pose("measured", T, covariance, 0.5, 6, 2),
        LOST,
        Pose("ambiguous", T.inv(), covariance, 0.25, 4, 2),
    ]


def test_columns_are_those_of_the_design(tmp_path):
    write_poses(pose_table(some_poses()), tmp_path / "p.csv")
    assert (tmp_path / "p.csv").read_text().splitlines()[0].split(",") == COLUMNS


def test_a_row_holds_the_pose():
    row = pose_table(some_poses(), [0.1, 0.2, 0.3]).iloc[0]
    assert (row.frame, row.t_s, row.x_mm, row.y_mm, row.z_mm) == (0, 0.1, 1.0, 2.0, 3.0)
    assert np.allclose([row.alpha_deg, row.beta_deg, row.gamma_deg], [10, 20, 30], atol=1e-9)
    assert row.sigma_mm == pytest.approx(3.0)  # sqrt(1 + 4 + 4)
    assert row.sigma_deg == pytest.approx(np.rad2deg(0.02))  # sqrt(4e-4) rad
    assert (row.residual_px, row.markers, row.cameras, row.status) == (0.5, 6, 2, "measured")
    assert (row.systematic_mm, row.systematic_deg) == (0.0, 0.0)


def test_sigma_is_the_whole_and_systematic_a_part_of_it(tmp_path):
    pose = replace(some_poses()[0], systematic=np.diag([4.0, 8.0, 4.0, 0.0, 4e-4, 0.0]))
    write_poses(pose_table([pose]), tmp_path / "p.csv")
    row = read_poses(tmp_path / "p.csv").iloc[0]
    assert row.sigma_mm == pytest.approx(5.0)  # sqrt(1 + 4 + 4 + 4 + 8 + 4)
    assert row.systematic_mm == pytest.approx(4.0)
    assert row.sigma_deg == pytest.approx(np.rad2deg(np.sqrt(8e-4)))
    assert row.systematic_deg == pytest.approx(np.rad2deg(0.02))


def test_files_without_the_systematic_part_are_read(tmp_path):
    old = pose_table(some_poses()).drop(columns=["systematic_mm", "systematic_deg"])
    write_poses(old, tmp_path / "p.csv")
    assert tuple(read_poses(tmp_path / "p.csv").columns) == tuple(COLUMNS[:-2])


def test_quaternion_is_the_rotation_by_hand():
    quarter = RigidTransform.from_rotation(
        Rotation.from_euler("ZYX", [90.0, 0.0, 0.0], degrees=True)
    )
    row = truth_table(RigidTransform.concatenate([quarter])).iloc[0]
    assert np.allclose(
        [row.qw, row.qx, row.qy, row.qz], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-15
    )


def test_lost_row_is_empty(tmp_path):
    write_poses(pose_table(some_poses()), tmp_path / "p.csv")
    lines = (tmp_path / "p.csv").read_text().splitlines()
    assert lines[2] == "1" + "," * 15 + "0,0,lost,,"
    row = read_poses(tmp_path / "p.csv").iloc[1]
    assert row.status == "lost"
    assert row[list(COLUMNS[1:15])].isna().all()
    (tmp_path / "p.csv").write_text(HEAD + "0,,,,,,,,lost\n")
    assert list(read_poses(tmp_path / "p.csv")["status"]) == ["lost"]


def test_table_may_lack_what_is_not_needed(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text("qz,qw,qx,qy,x_mm,y_mm,z_mm,frame,remark\n0,1,0,0,1,2,3,7,x\n")
    table = read_poses(path)
    assert list(table["status"]) == ["measured"]
    assert list(table["frame"]) == [7]


# --- TUM


def test_tum_holds_the_measured_poses_by_hand(tmp_path):
    quarter = RigidTransform.from_components(
        [1.0, -250.0, 549.0], Rotation.from_euler("Z", 90.0, degrees=True)
    )
    poses = [
        Pose("measured", quarter, np.eye(6), 0.5, 6, 2),
        LOST,
        replace(some_poses()[2], status="predicted"),
        some_poses()[2],
        replace(some_poses()[0], T_world_handle=quarter.inv()),
    ]
    write_tum(pose_table(poses, [0.0, 0.1, 0.2, 0.3, 1753000000.4]), tmp_path / "p.tum")
    # sin 45 deg; the inverse carries (1, -250, 549) back to the origin: t = -R^T (1, -250, 549)
    h = 0.707106781
    assert (tmp_path / "p.tum").read_text().splitlines()[
        0
    ] == f"0.000000000 0.001000000 -0.250000000 0.549000000 0.000000000 0.000000000 {h} {h}"
    wanted = [
        [0.0, 0.001, -0.25, 0.549, 0, 0, h, h],
        [1753000000.4, 0.25, 0.001, -0.549, 0, 0, -h, h],
    ]
    # half a unit of the ninth digit, and a double's 2.4e-7 s in the time since 1970
    np.testing.assert_allclose(np.loadtxt(tmp_path / "p.tum"), wanted, rtol=0, atol=3e-7)


def test_tum_needs_times_only_of_what_it_writes(tmp_path):
    write_tum(pose_table([LOST, LOST]), tmp_path / "p.tum")
    assert (tmp_path / "p.tum").read_text() == ""
    for table in (
        pose_table(some_poses()[::-1]),
        pose_table(some_poses()[::-1]).drop(columns="t_s"),
    ):
        with pytest.raises(
            ValueError, match="t_s: expected the time of every measured row, got none for frame 2"
        ):
            write_tum(table, tmp_path / "other.tum")
    assert not (tmp_path / "other.tum").exists()


@pytest.mark.parametrize(("text", "message"), cases(Path(__file__).with_name("wrong.txt"), "poses"))
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
