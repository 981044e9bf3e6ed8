"""The handle: where its markers are, its symmetries for any layout, and what a handle file may not
say.
"""

import itertools

import numpy as np
import pytest
import tomli_w
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle
from trinolab.files.rigs import read_handle, write_handle
from trinolab.handle import Handle, slants


def fields(**changes):
    given = {
        "name": "h",
        "radius_mm": 5.0,
        "length_mm": 200.0,
        "top_mm": 25.0,
        "marker_diameter_mm": 3.0,
        "columns_deg": [0.0, 90.0],
        "rows_mm": [[10.0, -10.0], [10.0, -10.0]],
        "markers": "bright",
    }
    return {key: value for key, value in {**given, **changes}.items() if value is not None}


def handle(**changes):
    return Handle(**fields(**changes))


def test_markers_by_hand():
    # Column 0 at 0 deg looks along z, column 1 at 90 deg along x; y is the axis; numbered column by
    # column.
    h = handle(rows_mm=[[10.0, -10.0], [7.0]])
    np.testing.assert_allclose(h.marker_centres, [[0, 10, 5], [0, -10, 5], [5, 7, 0]], atol=1e-12)
    np.testing.assert_allclose(h.marker_normals, [[0, 0, 1], [0, 0, 1], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(h.marker_angles, [0, 0, np.pi / 2], atol=1e-15)
    assert h.bottom_mm == -175.0


def test_slants_by_hand():
    # Seen from far along z: marker 0 face on, the one at 90 deg on edge, moved and turned with the
    # handle.
    h = handle(rows_mm=[[0.0], [0.0]])
    ahead = slants(h, RigidTransform.identity(), np.array([0.0, 0.0, 1e9]))
    np.testing.assert_allclose(ahead, [0, np.pi / 2], atol=1e-7)
    T = RigidTransform.from_components(
        [10.0, 20.0, 30.0], Rotation.from_rotvec([0.0, np.deg2rad(30.0), 0.0])
    )
    far = np.array([10.0, 20.0, 30.0 + 1e9])
    np.testing.assert_allclose(np.rad2deg(slants(h, T, far)), [30.0, 120.0], atol=1e-5)
    near = slants(h, RigidTransform.identity(), np.array([0.0, 5.0, 10.0]))
    assert np.rad2deg(near[0]) == pytest.approx(45.0)  # 5 mm up, 5 mm in front of the marker


def brute_force_symmetries(h, step_deg=1):
    """All turns and half turns on a grid of angles, with the shift that keeps the middle, that keep
    the marker set.
    """
    centres, found = h.marker_centres, 0
    middle = (centres[:, 1].max() + centres[:, 1].min()) / 2
    for flip, angle in itertools.product((False, True), np.arange(0, 360, step_deg)):
        turn = Rotation.from_rotvec([0.0, np.deg2rad(angle), 0.0])
        if flip:
            turn = turn * Rotation.from_rotvec([np.pi, 0.0, 0.0])
        moved = (centres - [0, middle, 0]) @ turn.as_matrix().T + [0, middle, 0]
        found += bool((np.linalg.norm(moved[:, None] - centres, axis=2).min(axis=1) < 1e-6).all())
    return found


SIX = list(range(0, 360, 60))
LAYOUTS = {
    "the paper's": (load_handle("paper"), 12),
    "coded": (load_handle("coded"), 1),
    "one column of three rows": (handle(columns_deg=[37.0], rows_mm=[[10.0, 0.0, -10.0]]), 2),
    "one column of uneven rows": (handle(columns_deg=[37.0], rows_mm=[[10.0, 3.0, -10.0]]), 1),
    "a single row of five": (handle(columns_deg=list(range(0, 360, 72)), rows_mm=[[4.0]] * 5), 10),
    "dark": (handle(columns_deg=SIX, rows_mm=[[10.0, -10.0]] * 6, markers="dark"), 12),
    "rows that are not about the origin": (handle(columns_deg=SIX, rows_mm=[[12.0, 2.0]] * 6), 12),
    "alternating rows": (handle(columns_deg=SIX, rows_mm=[[10.0], [-10.0]] * 3), 6),
    "one marker": (handle(columns_deg=[10.0], rows_mm=[[1.0]]), 2),
    "five columns of six": (handle(columns_deg=SIX[:5], rows_mm=[[10.0, -10.0]] * 5), 2),
    "uneven columns": (handle(columns_deg=[0.0, 50.0, 170.0], rows_mm=[[10.0, 0.0]] * 3), 1),
    "columns of different lengths": (
        handle(columns_deg=[0.0, 180.0], rows_mm=[[10.0, 0.0, -10.0], [0.0]]),
        2,
    ),
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
        np.testing.assert_allclose(
            T.rotation.as_matrix()[1], [0, np.sign(T.rotation.as_matrix()[1, 1]), 0], atol=1e-12
        )


def test_symmetries_are_a_group():
    symmetries = load_handle("paper").symmetries
    for a, b in itertools.product(symmetries, repeat=2):
        product = (a * b).as_matrix()
        assert min(np.abs(product - c.as_matrix()).max() for c in symmetries) < 1e-9
    differences = [
        np.abs(a.as_matrix() - b.as_matrix()).max()
        for a, b in itertools.combinations(symmetries, 2)
    ]
    assert min(differences) > 0.4


def test_round_trip(tmp_path):
    # a line of markers is not read
    for h in (h for h, _ in LAYOUTS.values() if len(h.columns_deg) > 1):
        write_handle(h, tmp_path / "h.toml")
        assert read_handle(tmp_path / "h.toml") == h


def test_markers_are_bright_unless_said(tmp_path):
    path = tmp_path / "h.toml"
    path.write_text(tomli_w.dumps(fields(markers=None)), encoding="utf-8")
    assert read_handle(path).markers == "bright"


def test_how_well_the_markers_are_placed(tmp_path):
    path = tmp_path / "h.toml"
    path.write_text(tomli_w.dumps(fields()), encoding="utf-8")
    assert read_handle(path).placement_sigma_mm is None
    for sigma_mm in (None, 0.0, 0.05):
        write_handle(handle(placement_sigma_mm=sigma_mm), path)
        assert read_handle(path) == handle(placement_sigma_mm=sigma_mm)


NAN = float("nan")
WRONG = {
    **{
        f"no {name}": (name, fields(**{name: None}))
        for name in (
            "name",
            "radius_mm",
            "length_mm",
            "top_mm",
            "marker_diameter_mm",
            "columns_deg",
            "rows_mm",
        )
    },
    "text as radius": ("radius_mm", fields(radius_mm="five")),
    "no thickness": ("radius_mm", fields(radius_mm=0.0)),
    "NaN as length": ("length_mm", fields(length_mm=NAN)),
    "true as length": ("length_mm", fields(length_mm=True)),
    "a negative placement": ("placement_sigma_mm", fields(placement_sigma_mm=-0.1)),
    "text as placement": ("placement_sigma_mm", fields(placement_sigma_mm="good")),
    "a negative marker": ("marker_diameter_mm", fields(marker_diameter_mm=-3.0)),
    "infinite top": ("top_mm", fields(top_mm=float("inf"))),
    "no columns": ("columns_deg", fields(columns_deg=[], rows_mm=[])),
    "text in the columns": ("columns_deg", fields(columns_deg=[0.0, "ninety"])),
    "NaN in the columns": ("columns_deg", fields(columns_deg=[0.0, NAN])),
    "fewer rows than columns": ("rows_mm", fields(rows_mm=[[10.0]])),
    "rows that are no list": ("rows_mm", fields(rows_mm=10.0)),
    "a row that is no list": ("rows_mm", fields(rows_mm=[[10.0], 10.0])),
    "an empty row": ("rows_mm", fields(rows_mm=[[10.0], []])),
    "NaN in the rows": ("rows_mm", fields(rows_mm=[[10.0], [NAN]])),
    "a marker over the top": ("rows_mm", fields(rows_mm=[[10.0], [24.0]])),
    "a marker below the bottom": ("rows_mm", fields(rows_mm=[[10.0], [-174.0]])),
    "markers that overlap": ("overlap", fields(rows_mm=[[10.0, 8.0], [10.0]])),
    "columns that overlap": ("overlap", fields(columns_deg=[0.0, 359.0])),
    "one column": (
        "rows_mm: expected markers",
        fields(columns_deg=[0.0], rows_mm=[[10.0, 0.0, -10.0]]),
    ),
    "two markers": ("rows_mm: expected markers", fields(rows_mm=[[10.0], [-10.0]])),
    "one marker": (
        "rows_mm: expected markers",
        fields(columns_deg=[0.0], rows_mm=[[10.0]]),
    ),
    "columns that nearly coincide": (
        "rows_mm: expected markers",
        fields(columns_deg=[0.0, 0.01], rows_mm=[[10.0, 0.0], [-10.0]]),
    ),
    "a radius of a light year": ("radius_mm", fields(radius_mm=1e19)),
    "a column that overflows": ("columns_deg", fields(columns_deg=[0.0, 5.5e240])),
    "grey markers": ("markers", fields(markers="grey")),
    "a field too many": ("colour", fields(colour="red")),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_named_with_its_field(tmp_path, case):
    field, wrong = WRONG[case]
    path = tmp_path / "h.toml"
    path.write_text(tomli_w.dumps(wrong), encoding="utf-8")
    with pytest.raises(ValueError, match=r"h\.toml: ") as caught:
        read_handle(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert field in str(caught.value).removeprefix(f"{path}: ")


def test_a_name_must_be_text():
    with pytest.raises(ValueError, match="name"):
        handle(name=3)


def test_no_file_and_no_toml(tmp_path):
    with pytest.raises(ValueError, match="cannot be read"):
        read_handle(tmp_path / "none.toml")
    (tmp_path / "h.toml").write_text("radius_mm = = 5", encoding="utf-8")
    with pytest.raises(ValueError, match="no valid TOML"):
        read_handle(tmp_path / "h.toml")


def test_a_handle_cannot_be_changed():
    h = handle()
    for array in (h.marker_centres, h.marker_normals, h.marker_angles):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0
