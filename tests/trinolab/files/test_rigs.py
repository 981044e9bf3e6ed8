"""Rig files: round trips, what other programs write, and every way in which a file can be wrong."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from cases import cases, unescaped
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Camera, Rig, RigCovariance
from trinolab.datasets import data_path, load_rig
from trinolab.files.rigs import (
    covariance_path,
    covariance_text,
    read_camera,
    read_handle,
    read_rig,
    rig_text,
    write_rig,
)

HERE = Path(__file__).parent
WRONG = HERE / "wrong.txt"


def table(name="a", **changes):
    fields = {
        "name": name,
        "size": [640, 480],
        "matrix": [[800.0, 0.0, 300.0], [0.0, 700.0, 250.0], [0.0, 0.0, 1.0]],
        "distortions": [0.1, 0.0, 0.0, 0.0, 0.0],
        "rotation": [0.1, -0.2, 0.3],
        "translation": [1.0, 2.0, 3.0],
    }
    return {key: value for key, value in {**fields, **changes}.items() if value is not None}


def write(path, *tables):
    path.write_text(tomli_w.dumps({f"cam_{k}": t for k, t in enumerate(tables)}), encoding="utf-8")
    return path


def test_a_file_by_hand():
    left, right = read_rig(HERE / "examples" / "by_hand.toml").cameras
    # in the order of the file, which is the camera axis
    assert (left.name, right.name, left.size) == ("left", "a right one", (640, 480))
    # World to camera: a quarter turn about y carries world z to camera x.
    np.testing.assert_allclose(left.T_cam_world.apply([0, 0, 10]), [11, 2, 3], atol=1e-12)
    # four: k3 is 0
    np.testing.assert_array_equal(right.distortions, [0.1, 0.2, 0.3, 0.4, 0.0])


def test_round_trip_keeps_every_digit(tmp_path):
    rng = np.random.default_rng(0)
    matrix = [[2956.2067, 0, 627.993], [0, 2940.1, 515.2], [0, 0, 1]]
    cameras = []
    for k in range(4):
        T = RigidTransform.from_components(rng.normal(0, 500, 3), Rotation.random(rng=rng))
        cameras.append(Camera(f"c{k}", (1280, 1024), matrix, rng.normal(0, 0.1, 5), T))
    write_rig(Rig(tuple(cameras)), tmp_path / "rig.toml")
    for a, b in zip(cameras, read_rig(tmp_path / "rig.toml").cameras, strict=True):
        assert (a.name, a.size) == (b.name, b.size)
        np.testing.assert_array_equal(a.matrix, b.matrix)
        np.testing.assert_array_equal(a.distortions, b.distortions)
        # via a vector
        np.testing.assert_allclose(a.T_cam_world.as_matrix(), b.T_cam_world.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("name", ["paper_pair", "paper_trinocular", "raised_40deg"])
def test_shipped_rigs_can_be_read_by_path(name):
    assert read_rig(str(data_path("rigs", f"{name}.toml"))).names == load_rig(name).names


def changed(fields, row):
    """Fields of a table after a row of `wrong.txt`."""
    if row.startswith("- "):
        return {name: value for name, value in fields.items() if name != row[2:]}
    return {**fields, **tomllib.loads(unescaped(row))}


@pytest.mark.parametrize(("row", "field"), cases(WRONG, "camera"))
def test_a_wrong_camera_is_named_with_its_file_and_field(tmp_path, row, field):
    path = write(tmp_path / "rig.toml", table("fine"), changed(table(), row))
    with pytest.raises(ValueError, match=r"rig\.toml: \[cam_1\]: ") as caught:
        read_rig(path)
    message = str(caught.value)
    assert field in message.removeprefix(f"{path}: [cam_1]")
    assert message.count(str(path)) == 1


@pytest.mark.parametrize(("row", "question"), cases(WRONG, "units"))
def test_numbers_that_are_likely_of_another_unit_are_asked_about(tmp_path, row, question):
    second = changed(table("b", translation=[100.0, 2.0, 3.0]), row)
    path = write(tmp_path / "rig.toml", table("a"), second)
    if not question:
        assert read_rig(path).names == ("a", "b")
    else:
        with pytest.raises(ValueError, match=question):
            read_rig(path)


WHOLE = [
    (tomli_w.dumps({"one": table()}), "two or more, got 1"),
    (tomli_w.dumps({"one": table(), "two": table()}), "different names"),
    (tomli_w.dumps({"one": table(), "two": table("b")}), "different places, got a and b in one"),
    ("a = " + 5000 * "[", "lists within lists"),
    ("a = " + 5000 * "9", "no valid TOML"),
]


@pytest.mark.parametrize(("content", "message"), [*WHOLE, *cases(WRONG, "rig")])
def test_a_wrong_file_is_named(tmp_path, content, message):
    path = tmp_path / "rig.toml"
    path.write_bytes(unescaped(content).encode("latin-1"))
    with pytest.raises(ValueError, match=message) as caught:
        read_rig(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("name", ["none.toml", "."])
def test_files_that_cannot_be_read_are_named(tmp_path, name):
    with pytest.raises(ValueError, match=re.escape(f"{tmp_path / name}: cannot be read")):
        read_rig(tmp_path / name)


def known(names=("a", "b"), seed=0):
    """A covariance as a calibration gives it: the first camera's place is exact."""
    n = 15 * len(names)
    mixed = np.random.default_rng(seed).normal(size=(n, n)) * np.logspace(-6, 1, n)[:, None]
    mixed[9:15] = 0.0
    return RigCovariance(names, mixed @ mixed.T)


def two(covariance=None):
    cameras = load_rig("paper_pair").cameras
    named = (replace(camera, name=name) for camera, name in zip(cameras, "ab", strict=True))
    return Rig(tuple(named), covariance)


def tables(path):
    return tomllib.loads(path.read_text(encoding="utf-8"))


def test_the_covariance_beside_a_rig(tmp_path):
    rig = two(replace(known(), freedom=2.5))
    write_rig(rig, tmp_path / "rig.toml")
    assert {path.name for path in tmp_path.iterdir()} == {"rig.toml", "rig.covariance.toml"}
    again = read_rig(tmp_path / "rig.toml").covariance
    assert (again.names, again.freedom) == (("a", "b"), 2.5)
    np.testing.assert_array_equal(again.matrix, rig.covariance.matrix)
    # what other programs read has cameras alone
    assert set(tables(tmp_path / "rig.toml")) == {"a", "b"}
    said = tables(tmp_path / "rig.covariance.toml")
    assert said["parameters"][:5] == ["fx", "fy", "cx", "cy", "k1"]
    assert said["units"] == ["px"] * 4 + ["1"] * 5 + ["rad"] * 3 + ["mm"] * 3


def test_a_rational_lens_and_its_covariance(tmp_path):
    lens = np.array([0.9, 0.11, 1e-3, -2e-3, 0.003, 1.22, 0.32, 0.022])
    first, second = two().cameras
    covariance = RigCovariance(("a", "b"), np.diag(np.arange(1.0, 37)))
    write_rig(Rig((first, replace(second, distortions=lens)), covariance), tmp_path / "rig.toml")
    again = read_rig(tmp_path / "rig.toml")
    np.testing.assert_array_equal(again.cameras[1].distortions, lens)
    np.testing.assert_array_equal(again.cameras[0].distortions, [*first.distortions, 0, 0, 0])
    np.testing.assert_array_equal(again.covariance.matrix, covariance.matrix)
    said = tables(tmp_path / "rig.covariance.toml")
    assert said["parameters"][8:12] == ["k3", "k4", "k5", "k6"]
    # a covariance of five coefficients is that of another rig
    write_rig(two(known()), tmp_path / "other.toml")
    (tmp_path / "other.covariance.toml").replace(tmp_path / "rig.covariance.toml")
    with pytest.raises(ValueError, match=r"parameters: expected fx, .* k6, .*, got fx"):
        read_rig(tmp_path / "rig.toml")


def test_a_rig_without_a_covariance_takes_no_other_ones(tmp_path):
    write_rig(two(), tmp_path / "rig.toml")
    assert read_rig(tmp_path / "rig.toml").covariance is None
    write_rig(two(known()), tmp_path / "rig.toml")
    with pytest.raises(ValueError, match=r"rig\.covariance\.toml: belongs to the rig that"):
        write_rig(two(), tmp_path / "rig.toml")


def test_a_rig_that_is_known_exactly_says_so_in_its_own_file(tmp_path):
    path = tmp_path / "rig.toml"
    write_rig(two(RigCovariance.exact("ab")), path)
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]
    assert tables(path)["metadata"] == {"exact": True}
    assert read_rig(path).covariance.is_exact
    path.write_text(rig_text(two()) + '[metadata]\nexact = "very"\n', encoding="utf-8")
    with pytest.raises(ValueError, match=r"\[metadata\]: exact: expected true or false, got 'very"):
        read_rig(path)
    write_rig(two(known()), path)
    path.write_text(rig_text(two()) + "[metadata]\nexact = true\n", encoding="utf-8")
    with pytest.raises(ValueError, match="exact cameras have no covariance, but"):
        read_rig(path)


@pytest.mark.parametrize(
    ("metadata", "reprojection_px"),
    [
        ({"adjusted": False, "error": 0.31}, 0.31),  # as Anipose writes it
        ({"error": 0.0}, None),
        ({"error": float("nan")}, None),
        ({"error": "small"}, None),
        ({"error": True}, None),
        ({}, None),
    ],
)
def test_the_reprojection_error_of_a_calibration_is_read(tmp_path, metadata, reprojection_px):
    path = tmp_path / "rig.toml"
    path.write_text(rig_text(two()) + tomli_w.dumps({"metadata": metadata}), encoding="utf-8")
    rig = read_rig(path)
    assert rig.covariance is None
    assert rig.reprojection_px == reprojection_px
    write_rig(rig, path)
    assert read_rig(path).reprojection_px == reprojection_px


ASYMMETRIC = known().matrix + np.eye(30, k=1) * np.sqrt(np.diag(known().matrix))[:, None] * 1e-3
INDEFINITE = known().matrix - 2 * np.diag(np.arange(30) == 29) * known().matrix[29, 29]
NO_COVARIANCE = [
    ("finite", known().matrix * np.nan),
    ("not symmetric", ASYMMETRIC),
    ("negative variance", -known().matrix),
    ("without a variance", known().matrix + np.eye(30, k=10) + np.eye(30, k=-10)),
    ("negative", INDEFINITE),
]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        *cases(WRONG, "covariance"),
        *((f"matrix = {matrix.tolist()}", message) for message, matrix in NO_COVARIANCE),
    ],
)
def test_a_wrong_covariance_file_is_one_line(tmp_path, row, message):
    write_rig(two(known()), tmp_path / "rig.toml")
    beside = tmp_path / "rig.covariance.toml"
    fields = changed(tomllib.loads(covariance_text(known())), row)
    beside.write_text(tomli_w.dumps(fields), encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        read_rig(tmp_path / "rig.toml")
    assert str(error.value).startswith(str(beside))
    assert "\n" not in str(error.value)


def test_a_file_of_one_camera_has_one(tmp_path):
    one = write(tmp_path / "one.toml", table())
    camera = read_camera(one)
    assert (camera.name, camera.size) == ("a", (640, 480))
    two_of_them = write(tmp_path / "two.toml", table(), table("b"))
    with pytest.raises(ValueError, match=r"two\.toml: expected one camera, got 2"):
        read_camera(two_of_them)


def test_files_of_rig_and_handle_that_are_exchanged_are_named(tmp_path):
    rig = write(tmp_path / "rig.toml", table())
    with pytest.raises(ValueError, match="is a rig's file, expected a handle; likely the files"):
        read_handle(rig)
    with pytest.raises(ValueError, match="is a handle's file, expected cameras; likely the files"):
        read_rig(data_path("handles", "coded.toml"))
    covariance_path(rig).write_text(covariance_text(known()), encoding="utf-8")
    with pytest.raises(ValueError, match="is a rig's covariance, expected its cameras"):
        read_rig(covariance_path(rig))
