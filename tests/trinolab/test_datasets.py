"""The shipped data: against a second transcription of the paper, and against the functions that
made them.
"""

import re
from pathlib import Path
from string import ascii_lowercase

import numpy as np
import pytest

from trinolab import datasets
from trinolab.camera import T_between
from trinolab.datasets import load_calibration, load_handle, load_rig, load_table1, paper_rig
from trinolab.rigid import nearest_rotation
from workbench.studies.scoreboard import load_claims

SECOND = Path(__file__).parent / "second_transcription"
RIGS = {"paper_pair": None, "paper_trinocular": 90.0, "raised_40deg": 40.0}
NUMBER = r"-?\d+(?:\.\d+)?"


def lines(name):
    return (SECOND / name).read_text(encoding="utf-8").splitlines()[1:]


def test_table1_equals_the_second_transcription():
    second = np.array(
        [[float(x) for x in re.findall(NUMBER, line)] for line in lines("table1.txt")]
    )
    table = load_table1()
    names = [
        f"{side}_{part}"
        for parts in (("x_mm", "y_mm", "z_mm"), ("alpha_deg", "beta_deg", "gamma_deg"))
        for side in ("measured", "set")
        for part in parts
    ]
    assert table.frame.index.tolist() == second[:, 0].tolist() == list(range(1, 21))
    np.testing.assert_array_equal(table.frame[names].to_numpy(), second[:, 1:])
    np.testing.assert_array_equal(table.set_poses.translation[7], [37.27, 48.4289, 561.55])
    angles = table.measured.rotation[3].as_euler("ZYX", degrees=True)
    np.testing.assert_allclose(angles, [-32.1, 81.2, 92.6], atol=1e-9)  # deg; rounding


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
    rows = [line.split() for line in lines("claims.txt")]
    second = {no: (float(value), unit) for no, value, unit in rows}
    first = {c.no: (c.paper, c.unit) for c in load_claims() if isinstance(c.paper, float)}
    assert {no: first[no] for no in first if no.isdigit()} == second
    # a letter marks another form of the claim before it, whose number is the same
    assert all(first[no] == second[no.rstrip(ascii_lowercase)] for no in first)


@pytest.mark.parametrize(("name", "elevation"), RIGS.items())
def test_rig_files_equal_what_the_calibration_gives(name, elevation):
    shipped, made = load_rig(name), paper_rig(elevation)
    points = load_table1().set_poses.translation
    assert shipped.names == made.names
    for a, b in zip(shipped.cameras, made.cameras, strict=True):
        assert a.size == b.size == (1280, 1024)
        np.testing.assert_array_equal(a.matrix, b.matrix)
        np.testing.assert_array_equal(a.distortions, np.zeros(5))
        # mm; rounding
        np.testing.assert_allclose(a.T_cam_world.as_matrix(), b.T_cam_world.as_matrix(), atol=1e-9)
        assert a.sees(points).all()


def test_ccd2_is_where_eq25_puts_it():
    # X_l = R_rl X_r + T_rl: CCD2's centre is T_rl in CCD1's frame, its axis the third column of
    # R_rl.
    ccd1, ccd2 = load_rig("paper_pair").cameras
    np.testing.assert_array_equal(ccd1.T_cam_world.as_matrix(), np.eye(4))
    np.testing.assert_allclose(ccd2.centre, [98.7723, 0.8410, 9.1032], atol=1e-9)
    # the printed column, off by 3e-4
    np.testing.assert_allclose(ccd2.axis, [-0.1799, 0.0224, 0.9837], atol=4e-4)
    X_r = np.array([10.0, 20.0, 500.0])
    R_rl, T_rl = load_calibration()[2:]
    # mm; 500 mm times what the printed matrix is off
    np.testing.assert_allclose(T_between(ccd1, ccd2).apply(X_r), R_rl @ X_r + T_rl, atol=0.3)


def test_the_shipped_handles():
    paper, coded = load_handle("paper"), load_handle("coded")
    for handle, symmetries in ((paper, 12), (coded, 1)):
        sizes = (handle.radius_mm, handle.length_mm, handle.top_mm, handle.marker_diameter_mm)
        assert sizes == (5.0, 200.0, 25.0, 3.0)
        assert handle.columns_deg == (0.0, 60.0, 120.0, 180.0, 240.0, 300.0)
        assert handle.markers == "bright"
        assert len(handle.symmetries) == symmetries
    assert paper.rows_mm == ((10.0, -10.0),) * 6
    assert coded.rows_mm == ((10, -10), (10, -6), (10, -14), (10, -8), (10, -12), (10, -4))


def test_rigs_and_handles_are_meant_by_name_file_or_value(tmp_path):
    path = datasets.data_path("rigs", "paper_pair.toml")
    assert datasets.rig_file("paper_pair") == datasets.rig_file(path) == path
    assert datasets.rig_of(path).names == datasets.rig_of("paper_pair").names
    for what in ("no/rig", "rig.toml", tmp_path):
        assert datasets.rig_file(what) == Path(what)
    rig, handle = load_rig("paper_pair"), load_handle("coded")
    assert datasets.rig_of(rig) is rig
    assert datasets.handle_of(handle) is handle
    assert datasets.handle_of("coded") == handle


REFUSED = [
    (load_rig, "no_such", r"name: expected one of .*paper_pair.*, got 'no_such'"),
    (nearest_rotation, -np.eye(3), "matrix: expected a positive determinant"),
    (datasets.real_set, "no_such", "name: expected one of .*, got 'no_such'"),
    (paper_rig, 181.0, "elevation_deg"),
    (datasets.rig_of, "raised_40", r"^raised_40: no such file, .* shipped rig \(paper_pair, .*\)$"),
    (datasets.rig_of, "coded", "it is a shipped handle: likely rig and handle are exchanged"),
    (datasets.rig_of, None, "^rig: expected a file or the name of a shipped one .*, got None$"),
    (datasets.rig_of, load_handle("coded"), "rig: .*, got a Handle$"),
    (datasets.handle_of, "paper_pair", "it is a shipped rig: likely"),
]


@pytest.mark.parametrize(("call", "given", "words"), REFUSED)
def test_what_is_not_shipped_is_named(call, given, words):
    with pytest.raises(ValueError, match=words):
        call(given)
