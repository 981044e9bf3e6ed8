"""Real recordings made by others: how they are found and fetched, and what this package makes of
them.
"""

import functools
import hashlib
import http.server
import re
import threading
from dataclasses import replace

import cv2
import numpy as np
import pooch
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration import target
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_real_sets, real_set
from trinolab.files import fetch
from trinolab.files.fetch import RealFile, RealSet, find, why_not
from trinolab.triangulation import triangulate
from workbench.studies import real_recordings

SETS = load_real_sets()


def needs(name):
    """Skip a test where a set is not on this machine, and say why."""
    return pytest.mark.skipif(real_set(name) is None, reason=f"no {name}: {why_not(SETS[name])}")


# --- finding


CONTENT = {"a.txt": b"first", "b.txt": b"second"}


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A set of two files, lying nowhere, and a cache and a TRINOLAB_DATA of its own."""
    monkeypatch.delenv("TRINOLAB_DATA", raising=False)
    monkeypatch.setattr(fetch, "cache_folder", lambda: tmp_path / "cache")
    files = tuple(
        RealFile(name, hashlib.sha256(data).hexdigest(), f"deep/{name}")
        for name, data in CONTENT.items()
    )
    return RealSet("small", "two words", "CC0-1.0", "nowhere", "", files, {})


def put(folder, content=CONTENT):
    folder.mkdir(parents=True)
    for name, data in content.items():
        (folder / name).write_bytes(data)
    return folder


@pytest.fixture
def served(tmp_path):
    """A folder and the address of a server for it, and the paths that were asked for."""
    asked = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            asked.append(self.path)

    put(tmp_path / "served" / "deep")
    handler = functools.partial(Handler, directory=str(tmp_path / "served"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield tmp_path / "served", f"http://127.0.0.1:{server.server_port}", asked
        server.shutdown()


def test_a_set_that_is_not_here_is_none_and_asks_no_network(small, tmp_path, monkeypatch):
    monkeypatch.setattr(pooch, "retrieve", lambda *_, **__: pytest.fail("asked the network"))
    small = replace(small, address="http://127.0.0.1:1")
    assert find(small) is None
    assert why_not(small) == "TRINOLAB_DATA is not set"
    monkeypatch.setenv("TRINOLAB_DATA", str(tmp_path))
    assert find(small) is None
    assert why_not(small) == "TRINOLAB_DATA has no small"
    folder = put(tmp_path / "small")
    assert find(small) == folder


@pytest.mark.parametrize(
    ("content", "variable", "words"),
    [
        ({**CONTENT, "b.txt": b"tampered"}, "data", r"small.b\.txt: SHA-256 is not"),
        ({"a.txt": b"first"}, "data", r"b\.txt: missing; small needs it"),
        (CONTENT, "none", "TRINOLAB_DATA: expected a folder, got "),
    ],
)
def test_a_folder_that_is_not_the_set_s_is_refused(
    small, tmp_path, monkeypatch, content, variable, words
):
    put(tmp_path / "data" / "small", content)
    monkeypatch.setenv("TRINOLAB_DATA", str(tmp_path / variable))
    with pytest.raises(ValueError, match=words):
        find(small)


def test_fetched_on_demand_once_and_with_its_licence(small, served, tmp_path, monkeypatch):
    _, address, asked = served
    small = replace(small, address=address)
    folder = find(small, fetch=True)
    assert folder == tmp_path / "cache" / "small"
    assert {name: (folder / name).read_bytes() for name in CONTENT} == CONTENT
    assert asked == ["/deep/a.txt", "/deep/b.txt"]
    assert find(small, fetch=True) == find(small) == folder
    assert len(asked) == 2


def test_what_came_is_checked(small, served):
    root, address, _ = served
    (root / "deep" / "b.txt").write_bytes(b"tampered")
    for source, words in (
        (address, r"b\.txt.* does not match the known hash"),
        (f"{address}/none", "cannot be fetched"),
        ("", "CC0-1.0.*origin"),
    ):
        with pytest.raises(ValueError, match=words):
            find(replace(small, address=source), fetch=True)
    assert find(small) is None


# --- the list


def test_the_list_is_complete():
    for real in SETS.values():
        assert all((real.what, real.licence, real.origin, real.files))
        assert all(re.fullmatch(r"[0-9a-f]{64}", file.sha256) for file in real.files)
        assert all("/" not in file.name and ".." not in file.path for file in real.files)
        assert not real.address or re.search(r"https://[\w./-]+/[0-9a-f]{40}(/|$)", real.address)
    assert SETS["trajectories"].address == ""  # its licence is not confirmed


# --- photographs


@pytest.fixture(scope="module")
def photographed():
    return real_recordings.photographed_calibration()


@needs("opencv_stereo")
def test_photographs_as_opencv_calibrates_them(photographed):
    photographs = real_recordings.load_opencv_stereo()
    board = [photographs.board.points.astype(np.float32).reshape(-1, 1, 3)] * 13
    sides = [
        [target.find_corners(image, photographs.board, 7).astype(np.float32) for image in side]
        for side in photographs[:2]
    ]
    mono = [cv2.calibrateCamera(board, side, (640, 480), None, None) for side in sides]
    np.testing.assert_allclose(
        [one[0] for one in mono], SETS["opencv_stereo"].reference["mono_rms_px_win7"], atol=5e-5
    )
    start = [np.array(part) for one in mono for part in one[1:3]]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 500, 1e-12)
    rms, *_, R, T, _, _ = cv2.stereoCalibrate(
        board, *sides, *start, (640, 480), flags=cv2.CALIB_USE_INTRINSIC_GUESS, criteria=stop
    )
    assert photographed.rms_px == pytest.approx(rms, abs=1e-6)
    T_right_left = photographed.cameras[1].T_cam_world
    # mm; sigma is 0.03 to 0.14
    np.testing.assert_allclose(T_right_left.translation, T.ravel(), rtol=0, atol=1e-3)
    np.testing.assert_allclose(T_right_left.rotation.as_matrix(), R, rtol=0, atol=1e-5)


# --- a rig of four cameras and an LED


@needs("pymvg_mcsc")
def test_leds_are_in_front_of_every_camera_and_where_it_sees_them():
    tracks = real_recordings.load_pymvg_mcsc()
    assert tracks.uv.shape == (4, 464, 2)
    points = triangulate(tracks.rig, tracks.uv)
    assert np.isfinite(points).all()
    for camera in tracks.rig.cameras:
        assert camera.T_cam_world.apply(points)[:, 2].min() > 100  # mm
    errors = real_recordings.led_errors_px()
    assert real_recordings.led_median_px() == np.nanmedian(errors) <= 0.30
    # the reference solves all cameras at once: 0.278; the mean of pairs can only be worse
    assert SETS["pymvg_mcsc"].reference["reprojection_median_px"] < np.nanmedian(errors)


@pytest.mark.parametrize("scale", [1.0, -1.0, 2.5])
def test_projection_matrices_have_no_scale(scale):
    K = np.array([[400.0, 3, 320], [0, 410, 240], [0, 0, 1]])
    R, t = Rotation.from_rotvec([0.3, -2.0, 0.4]), [1, 2, 3.0]
    found = real_recordings.decomposed(scale * K @ np.column_stack([R.as_matrix(), t]))
    np.testing.assert_allclose(found[0], K, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[1].as_matrix(), R.as_matrix(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[2], t, rtol=0, atol=1e-12)


# --- a board in four webcams


@needs("caliscope")
def test_webcams_and_their_board():
    tracks = real_recordings.load_caliscope()
    reference = SETS["caliscope"].reference
    assert tracks.rig.names == ("cam_0", "cam_1", "cam_2", "cam_3")
    # the pixel of the file's first row: instant 416, camera 1, corner 0
    np.testing.assert_array_equal(tracks.uv[1, 0], [710.9169311523438, 507.43072509765625])
    errors = real_recordings.board_errors_mm()
    fit = real_recordings.board_fit_mm()
    assert fit == np.median(np.nanmedian(errors, axis=1)) <= 0.75
    assert fit == pytest.approx(reference["board_fit_median_mm"], abs=0.005)


@needs("caliscope")
def test_cameras_that_face_each_other_spoil_the_plain_mean():
    plain, without = (
        np.median(np.nanmedian(real_recordings.board_errors_mm(min_angle_deg=deg), axis=1))
        for deg in (0.0, 30.0)
    )
    assert plain == pytest.approx(1.04, abs=0.005)
    assert without == pytest.approx(0.71, abs=0.005)


# --- steep pairs


def facing_rig():
    """Two cameras side by side, 100 mm apart, and one that looks at the first from 1,000 mm
    away.
    """
    K = np.array([[800.0, 0, 320], [0, 800, 240], [0, 0, 1]])
    poses = [
        RigidTransform.identity(),
        RigidTransform.from_translation([100.0, 0, 0]),
        RigidTransform.from_components([0, 0, 1000.0], Rotation.from_rotvec([0, np.pi, 0])),
    ]
    names = ("a", "b", "c")
    cameras = (
        Camera(n, (640, 480), K, np.zeros(5), T.inv()) for n, T in zip(names, poses, strict=True)
    )
    return Rig(tuple(cameras))


def test_steep_pairs():
    rig, points = facing_rig(), np.array([[5.0, -10, 480], [-20, 30, 520]])
    uv = np.stack([camera.project(points) for camera in rig.cameras])
    np.testing.assert_allclose(real_recordings.triangulate_steep(rig, uv, 5.0), points, atol=1e-9)
    np.testing.assert_array_equal(
        real_recordings.triangulate_steep(rig, uv, 0.0), triangulate(rig, uv)
    )
    # the steepest pair: 12 deg
    assert np.isnan(real_recordings.triangulate_steep(rig, uv, 80.0)).all()
    only = uv.copy()
    only[1] = np.nan  # the two that face each other: 177 and 172 deg
    assert np.isnan(real_recordings.triangulate_steep(rig, only, 9.0)).all()
    np.testing.assert_allclose(real_recordings.triangulate_steep(rig, only, 0.5), points, atol=1e-6)


# --- particles, and a trajectory


@needs("trackpy_particles")
def test_centroids_of_particles():
    errors = real_recordings.particle_errors_px()
    assert real_recordings.particle_median_px() == np.median(errors) <= 0.2
    assert (errors < 2).mean() > 0.95
