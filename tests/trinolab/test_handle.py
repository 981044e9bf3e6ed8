"""The handle: where its markers are, also beside their columns and rows, its symmetries for any
layout, and what a handle file may not say.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import tomli_w
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig
from trinolab.files.rigs import read_handle, write_handle
from trinolab.handle import Handle, slants
from trinolab.measurement import measure
from trinolab.methods import ESTIMATORS
from trinolab.parameters import Parameters
from trinolab.rigid import motion_between

RIG, PAPER, CODED = load_rig("raised_40deg"), load_handle("paper"), load_handle("coded")
POSE = RigidTransform.from_components(
    [10.0, 5.0, 560.0], Rotation.from_euler("ZYX", [170.0, 15.0, 40.0], degrees=True)
)
FIELDS = {
    "name": "h",
    "radius_mm": 5.0,
    "length_mm": 200.0,
    "top_mm": 25.0,
    "marker_diameter_mm": 3.0,
    "columns_deg": [0.0, 90.0],
    "rows_mm": [[10.0, -10.0], [10.0, -10.0]],
    "markers": "bright",
}


def handle(**changes):
    return Handle(**{**FIELDS, **changes})


def test_markers_by_hand():
    # Column 0 at 0 deg looks along z, column 1 at 90 deg along x; y is the axis; numbered column by
    # column.
    h = handle(rows_mm=[[10.0, -10.0], [7.0]])
    np.testing.assert_allclose(h.marker_centres, [[0, 10, 5], [0, -10, 5], [5, 7, 0]], atol=1e-12)
    np.testing.assert_allclose(h.marker_normals, [[0, 0, 1], [0, 0, 1], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(h.marker_angles, [0, 0, np.pi / 2], atol=1e-15)
    np.testing.assert_array_equal(h.marker_radii, [5, 5, 5])
    assert h.bottom_mm == -175.0
    for array in (h.marker_centres, h.marker_normals, h.marker_angles):
        assert not array.flags.writeable


def test_slants_by_hand():
    # Seen from far along z: marker 0 face on, the one at 90 deg on edge, moved and turned with the
    # handle; and from nearby, 5 mm up and 5 mm in front of marker 0.
    h, turned = handle(rows_mm=[[0.0], [0.0]]), Rotation.from_rotvec([0.0, np.deg2rad(30.0), 0.0])
    T = RigidTransform.from_components([10.0, 20.0, 30.0], turned)
    far = np.rad2deg(slants(h, T, np.array([10.0, 20.0, 30.0 + 1e9])))
    np.testing.assert_allclose(far, [30.0, 120.0], atol=1e-5)
    near = slants(h, RigidTransform.identity(), np.array([0.0, 5.0, 10.0]))
    assert np.rad2deg(near[0]) == pytest.approx(45.0)


def brute_force_symmetries(h):
    """All turns and half turns on a grid of degrees, with the shift that keeps the middle, that keep
    the marker set.
    """
    centres, found = h.marker_centres, 0
    middle = (centres[:, 1].max() + centres[:, 1].min()) / 2
    for flip, angle in itertools.product((False, True), range(360)):
        turn = Rotation.from_rotvec([0.0, np.deg2rad(angle), 0.0])
        if flip:
            turn = turn * Rotation.from_rotvec([np.pi, 0.0, 0.0])
        moved = (centres - [0, middle, 0]) @ turn.as_matrix().T + [0, middle, 0]
        found += bool((np.linalg.norm(moved[:, None] - centres, axis=2).min(axis=1) < 1e-6).all())
    return found


SIX = list(range(0, 360, 60))
LAYOUTS = {
    "the paper's": (PAPER, 12),
    "coded": (CODED, 1),
    "one column": (handle(columns_deg=[37.0], rows_mm=[[10.0, 0.0, -10.0]]), 2),
    "one column, uneven": (handle(columns_deg=[37.0], rows_mm=[[10.0, 3.0, -10.0]]), 1),
    "a row of five": (handle(columns_deg=list(range(0, 360, 72)), rows_mm=[[4.0]] * 5), 10),
    "rows beside the origin": (handle(columns_deg=SIX, rows_mm=[[12.0, 2.0]] * 6), 12),
    "alternating rows": (handle(columns_deg=SIX, rows_mm=[[10.0], [-10.0]] * 3), 6),
    "five columns of six": (handle(columns_deg=SIX[:5], rows_mm=[[10.0, -10.0]] * 5), 2),
    "uneven columns": (handle(columns_deg=[0.0, 50.0, 170.0], rows_mm=[[10.0, 0.0]] * 3), 1),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_symmetries(name):
    h, count = LAYOUTS[name]
    symmetries = h.symmetries
    assert len(symmetries) == count == brute_force_symmetries(h)
    np.testing.assert_array_equal(symmetries[0].as_matrix(), np.eye(4))
    sorted_centres = sorted(map(tuple, h.marker_centres.round(6) + 0.0))
    for T in symmetries:
        assert sorted(map(tuple, T.apply(h.marker_centres).round(6) + 0.0)) == sorted_centres
        np.testing.assert_allclose(np.abs(T.rotation.as_matrix()[1]), [0, 1, 0], atol=1e-12)
    for a, b in itertools.combinations(symmetries, 2):
        assert np.abs(a.as_matrix() - b.as_matrix()).max() > 0.4


# --- markers beside their places


def moved(handle, offsets):
    return replace(handle, offsets_mm=tuple(map(tuple, offsets.tolist())))


def beside(sigma_mm, handle=CODED):
    """A handle whose markers lie beside their places, in all directions."""
    return moved(handle, np.random.default_rng(0).normal(0.0, sigma_mm, (12, 3)))


def test_an_offset_by_hand():
    # marker 0 is at (0, 10, 5) and looks along z: 0.3 aside, 0.1 along the axis, 0.4 outwards
    offsets = np.zeros((12, 3))
    offsets[0] = [0.3, 0.1, 0.4]
    handle = moved(CODED, offsets)
    radius = np.hypot(0.3, 5.4)
    np.testing.assert_allclose(handle.marker_centres[0], [0.3, 10.1, 5.4], atol=1e-12)
    assert handle.marker_radii[0] == pytest.approx(radius)
    assert handle.marker_angles[0] == pytest.approx(np.arctan2(0.3, 5.4))
    np.testing.assert_allclose(handle.marker_normals[0], [0.3 / radius, 0, 5.4 / radius])
    # the others are where they were; their angles are computed in another way
    np.testing.assert_array_equal(handle.marker_centres[1:], CODED.marker_centres[1:])
    np.testing.assert_allclose(handle.marker_angles[1:], CODED.marker_angles[1:], atol=1e-14)
    np.testing.assert_allclose(handle.marker_radii[1:], 5.0, atol=1e-14)


def test_offsets_leave_angles_near_the_columns_and_the_layout_its_symmetries():
    # also where the arc tangent jumps, at 180 deg
    handle = beside(0.1)
    assert 0 < np.abs(handle.marker_angles - handle.stated_angles).max() < 0.1
    assert len(beside(0.05, PAPER).symmetries) == 12


@pytest.fixture(scope="module")
def frames():
    """Images of a handle whose markers lie 0.15 mm beside their places, in each direction."""
    return render_rig(RIG, beside(0.15), POSE, Bench(), np.random.default_rng(0))


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_every_estimator_knows_them(frames, estimator):
    off = []
    for handle in (beside(0.15), CODED):
        pose = measure(frames, RIG, handle, POSE, Parameters(estimator=estimator)).pose
        away = [10.0, 0, 0, np.pi, 0, 0]
        if pose.T_world_handle is not None:
            away = motion_between(pose.T_world_handle, POSE)
        off.append([np.linalg.norm(away[:3]), np.rad2deg(np.linalg.norm(away[3:]))])
    # mm, deg; the paper's centroids are biased
    most = [0.4, 2.5] if estimator.startswith("paper") else [0.03, 0.3]
    assert (np.array(off[0]) < most).all()
    assert off[0][1] < off[1][1] / 1.5


# --- files


WRITTEN = [
    *(h for h, _ in LAYOUTS.values() if len(h.columns_deg) > 1),  # a line of markers is not read
    handle(markers="dark"),
    handle(placement_sigma_mm=0.0),
    replace(beside(0.05), placement_sigma_mm=0.05),
]


@pytest.mark.parametrize("h", WRITTEN)
def test_round_trip(tmp_path, h):
    path = tmp_path / "h.toml"
    write_handle(h, path)
    assert read_handle(path) == h
    assert ("offsets_mm" in path.read_text()) == bool(h.offsets_mm)
    plain = {name: value for name, value in FIELDS.items() if name != "markers"}
    path.write_text(tomli_w.dumps(plain), encoding="utf-8")
    assert (read_handle(path).markers, read_handle(path).placement_sigma_mm) == ("bright", None)


REFUSED = [
    *((name, {name: None}) for name in FIELDS if name != "markers"),
    ("name", {"name": ""}),
    ("radius_mm", {"radius_mm": 0.0}),
    ("radius_mm", {"radius_mm": 1.1e6}),
    ("placement_sigma_mm", {"placement_sigma_mm": -0.1}),
    ("marker_diameter_mm", {"marker_diameter_mm": -3.0}),
    ("columns_deg", {"columns_deg": [], "rows_mm": []}),
    ("columns_deg", {"columns_deg": [0.0, 5.5e240]}),
    ("rows_mm", {"rows_mm": [[10.0]]}),
    ("rows_mm", {"rows_mm": [[10.0], []]}),
    ("a marker leaves the body", {"rows_mm": [[10.0], [24.0]]}),
    ("a marker leaves the body", {"rows_mm": [[10.0], [-174.0]]}),
    ("markers 0 and 1 overlap, 2 mm", {"rows_mm": [[10.0, 8.0], [10.0]]}),
    ("overlap", {"columns_deg": [0.0, 359.0]}),
    ("rows_mm: expected markers", {"columns_deg": [0.0], "rows_mm": [[10.0, 0.0, -10.0]]}),
    ("rows_mm: expected markers", {"rows_mm": [[10.0], [-10.0]]}),
    ("rows_mm: expected markers", {"columns_deg": [0.0, 0.01], "rows_mm": [[10.0, 0.0], [-10.0]]}),
    ("markers", {"markers": "grey"}),
    ("colour", {"colour": "red"}),
    ("offsets_mm: expected shape (4, 3), got (1, 3)", {"offsets_mm": [[0.0, 0.0, 0.0]]}),
    ("offsets_mm: the largest", {"offsets_mm": [[1.6, 0.0, 0.0]] * 4}),
    (
        "overlap",
        {
            "rows_mm": [[10.0, 6.5], [10.0, -10.0]],
            "offsets_mm": [[0, -0.3, 0], [0, 0.3, 0], [0, 0, 0], [0, 0, 0]],
        },
    ),
]


@pytest.mark.parametrize(("field", "changes"), REFUSED)
def test_a_wrong_file_is_named_with_its_field(tmp_path, field, changes):
    path = tmp_path / "h.toml"
    wrong = {key: value for key, value in {**FIELDS, **changes}.items() if value is not None}
    path.write_text(tomli_w.dumps(wrong), encoding="utf-8")
    with pytest.raises(ValueError, match=r"h\.toml: ") as caught:
        read_handle(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert field in str(caught.value).removeprefix(f"{path}: ")
