"""The shipped data: against a second transcription of the paper, and against the functions that
made them.
"""

import itertools
import re
from pathlib import Path
from string import ascii_lowercase

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trinolab.camera import T_between, T_world_oxyz
from trinolab.datasets import (
    data_path,
    load_calibration,
    load_handle,
    load_rig,
    load_table1,
    paper_rig,
)
from trinolab.rigid import nearest_rotation
from workbench.studies.scoreboard import Claim, load_claims

SECOND = Path(__file__).parent / "second_transcription"
RIGS = {"paper_pair": None, "paper_trinocular": 90.0, "raised_40deg": 40.0}
NUMBER = r"-?\d+(?:\.\d+)?"


def lines(name):
    return (SECOND / name).read_text(encoding="utf-8").splitlines()[1:]


def test_table1_equals_the_second_transcription():
    rows = [[float(text) for text in re.findall(NUMBER, line)] for line in lines("table1.txt")]
    assert [len(row) for row in rows] == [13] * 20
    second = np.array(rows)
    frame = load_table1().frame
    names = [
        f"{side}_{part}"
        for parts in (("x_mm", "y_mm", "z_mm"), ("alpha_deg", "beta_deg", "gamma_deg"))
        for side in ("measured", "set")
        for part in parts
    ]
    assert frame.index.tolist() == second[:, 0].tolist() == list(range(1, 21))
    np.testing.assert_array_equal(frame[names].to_numpy(), second[:, 1:])
    assert frame.loc[8, "set_y_mm"] == 48.4289


def test_calibration_equals_the_second_transcription():
    second, name = {}, ""
    for line in lines("calibration.txt"):
        if re.fullmatch(r"[A-Z]_\w+", line):
            name, second[line] = line, []
        else:
            second[name].append([float(text) for text in line.split()])
    for name, value in load_calibration()._asdict().items():
        np.testing.assert_array_equal(np.atleast_2d(value), second[name])


def test_claims_equal_the_second_transcription():
    second = {
        no: (float(value), unit)
        for no, value, unit in (line.split() for line in lines("claims.txt"))
    }
    first = {
        claim.no: (claim.paper, claim.unit)
        for claim in load_claims()
        if isinstance(claim.paper, float)
    }
    assert {no: first[no] for no in first if no.isdigit()} == second
    # a letter marks another form of the claim before it, whose number is the same
    assert all(first[no] == second[no.rstrip(ascii_lowercase)] for no in first)


def test_table1_poses_carry_the_printed_numbers():
    table = load_table1()
    np.testing.assert_array_equal(table.set_poses.translation[7], [37.27, 48.4289, 561.55])
    np.testing.assert_allclose(
        table.measured.rotation[3].as_euler("ZYX", degrees=True), [-32.1, 81.2, 92.6], atol=1e-9
    )  # deg; rounding


@pytest.mark.parametrize(("name", "elevation"), RIGS.items())
def test_rig_files_equal_what_the_calibration_gives(name, elevation):
    shipped, made = load_rig(name), paper_rig(elevation)
    assert shipped.names == made.names
    for a, b in zip(shipped.cameras, made.cameras, strict=True):
        assert a.size == b.size == (1280, 1024)
        np.testing.assert_array_equal(a.matrix, b.matrix)
        np.testing.assert_array_equal(a.distortions, np.zeros(5))
        # mm; rounding
        np.testing.assert_allclose(a.T_cam_world.as_matrix(), b.T_cam_world.as_matrix(), atol=1e-9)


def test_ccd2_is_where_eq25_puts_it():
    # X_l = R_rl X_r + T_rl: CCD2's centre is T_rl in CCD1's frame, its axis the third column of
    # R_rl.
    ccd1, ccd2 = load_rig("paper_pair").cameras
    np.testing.assert_array_equal(ccd1.T_cam_world.as_matrix(), np.eye(4))
    np.testing.assert_allclose(ccd2.centre, [98.7723, 0.8410, 9.1032], atol=1e-9)
    # the printed column, off by 3e-4
    np.testing.assert_allclose(ccd2.axis, [-0.1799, 0.0224, 0.9837], atol=4e-4)
    X_r = np.array([10.0, 20.0, 500.0])
    X_l = T_between(ccd1, ccd2).apply(X_r)
    R_rl, T_rl = load_calibration()[2:]
    # mm; 500 mm times what the printed matrix is off
    np.testing.assert_allclose(X_l, R_rl @ X_r + T_rl, atol=0.3)


def test_ccd3_is_where_the_design_puts_it():
    above, raised = (load_rig(name).cameras[2] for name in ("paper_trinocular", "raised_40deg"))
    np.testing.assert_allclose(above.centre, [0.0, -549.0, 549.0], atol=1e-9)
    np.testing.assert_allclose(
        above.T_world_cam.rotation.as_matrix().T, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12
    )
    np.testing.assert_allclose(raised.centre, [0.0, -352.9, 128.4], atol=0.06)  # mm; given to 0.1
    middle = np.array([[0.0, 0.0, 549.0]])
    for camera in (above, raised):
        np.testing.assert_allclose(camera.project(middle)[0], camera.principal_point, atol=1e-9)
        assert np.linalg.norm(camera.centre - middle[0]) == pytest.approx(549.0, abs=1e-9)


@pytest.mark.parametrize("name", RIGS)
def test_the_pairs_geometry(name):
    rig = load_rig(name)
    a, b = rig.cameras[:2]
    x, _, z = T_world_oxyz(rig).rotation.as_matrix().T
    assert np.linalg.norm(b.centre - a.centre) == pytest.approx(99.19, abs=0.005)
    angles = np.rad2deg(np.arccos([a.axis @ b.axis, a.axis @ x, -(b.axis @ x)]))
    np.testing.assert_allclose(angles, [10.45, 84.7, 84.9], atol=0.05)  # deg; given so
    assert a.axis @ z > 0.99
    assert b.axis @ z > 0.99


def test_all_of_table1_is_in_front_of_every_camera_and_in_its_image():
    points = load_table1().set_poses.translation
    for name in RIGS:
        for camera in load_rig(name).cameras:
            assert (camera.T_cam_world.apply(points)[:, 2] > 0).all()
            assert camera.sees(points).all()


def test_the_paper_handle_has_its_twelve_markers():
    handle = load_handle("paper")
    assert (handle.radius_mm, handle.length_mm, handle.top_mm, handle.marker_diameter_mm) == (
        5.0,
        200.0,
        25.0,
        3.0,
    )
    assert handle.columns_deg == (0.0, 60.0, 120.0, 180.0, 240.0, 300.0)
    assert handle.rows_mm == ((10.0, -10.0),) * 6
    assert handle.markers == "bright"
    assert len(handle.symmetries) == 12


def misfits(handle):
    """How far the markers of columns k, k + 1 stay from those of j, j + 1, least over the shift
    along the axis, mm.

    For every pair of neighbours and every motion that keeps the cylinder: turns about the axis, and
    half turns across it, each with the shift that fits best. Worked out on the unrolled surface,
    without the package's symmetries.
    """
    rows = [np.array(row) for row in handle.rows_mm]
    for k, j in itertools.product(range(6), repeat=2):
        here, there = (np.concatenate([rows[m], rows[(m + 1) % 6]]) for m in (k, j))
        if k != j:
            yield np.ptp(here - there) / 2  # the turn; upper marker on upper marker
        # a half turn swaps columns and rows
        flipped = np.concatenate([-rows[(k + 1) % 6][::-1], -rows[k][::-1]])
        yield np.ptp(flipped - there) / 2


def test_no_motion_carries_two_neighbouring_columns_of_the_coded_handle_onto_two_others():
    handle = load_handle("coded")
    assert len(handle.symmetries) == 1
    assert handle.rows_mm == ((10, -10), (10, -6), (10, -14), (10, -8), (10, -12), (10, -4))
    # mm; more than 1 is what identification needs
    assert min(misfits(handle)) == pytest.approx(2.0)
    assert min(misfits(load_handle("paper"))) == 0.0


@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan])
def test_nearest_rotation_refuses_what_is_none(value):
    with pytest.raises(ValueError, match="matrix"):
        nearest_rotation(value * np.eye(3))


def test_nearest_rotation_is_the_nearest():
    R_rl = load_calibration().R_rl
    best = nearest_rotation(R_rl)
    distance = np.linalg.norm(best.as_matrix() - R_rl)
    rng = np.random.default_rng(0)
    for size in (1e-5, 1e-4, 1e-3):
        for turn in Rotation.from_rotvec(rng.normal(0, size, (200, 3))):
            assert np.linalg.norm((turn * best).as_matrix() - R_rl) >= distance


@pytest.mark.parametrize("load", [load_rig, load_handle])
def test_unknown_names_list_those_that_exist(load):
    with pytest.raises(ValueError, match=r"name: expected one of .*paper.*, got 'no_such'"):
        load("no_such")


def test_missing_data_files_are_named():
    with pytest.raises(
        ValueError, match=r"rigs/no\.toml: no such data file; there are .*paper_pair\.toml"
    ):
        data_path("rigs", "no.toml")


def test_every_claim_has_a_criterion_before_a_result():
    claims = load_claims()
    numbers = [claim.no for claim in claims]
    assert [no for no in numbers if no.isdigit()] == [str(k) for k in range(1, 30)]
    assert len(set(numbers)) == len(numbers)
    for claim in claims:
        assert claim.criterion
        limits = [claim.match_within, claim.at_most, claim.at_least]
        undecidable = all(limit is None for limit in limits)
        assert undecidable == (claim.verdict == "cannot be tested"), claim.no
        assert claim.check is not None or undecidable, claim.no


def claim(**limits):
    return Claim("0", "a", "1", limits.pop("paper", 1.0), "", "c", "v", "r", **limits)


@pytest.mark.parametrize(
    ("row", "value", "verdict"),
    [
        (claim(match_within=0.1), 1.05, "match"),
        (claim(match_within=0.1), 1.2, "differs"),
        (claim(paper="yes", at_most=1.0), 0.9, "match"),
        (claim(paper="yes", at_least=1.0), 0.9, "differs"),
        (claim(paper="", at_most=1.0), 0.9, "met"),
        (claim(paper="", at_most=1.0), 1.1, "missed"),
    ],
)
def test_verdicts(row, value, verdict):
    assert row.computed_verdict(value) == verdict


def test_verdict_of_nan_is_refused():
    with pytest.raises(ValueError, match="value"):
        claim(match_within=0.1).computed_verdict(np.nan)
