"""Rig files of other programs: read as the cameras that they say, or named."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from cases import cases, unescaped
from scipy.spatial.transform import Rotation

from trinolab.files.rigs import read_rig

K = np.array([[700.0, 0.0, 319.5], [0.0, 702.0, 239.5], [0.0, 0.0, 1.0]])
LENS = [-0.07, 0.01, 1e-4, -2e-4]
TURN = Rotation.from_rotvec([0.02, -0.35, 0.01])
SHIFT_MM = np.array([-100.0, 2.0, 5.0])

CAMERA = f"""size = [640, 480]
matrix = {K.tolist()}
distortions = {LENS}
"""
SECOND = f"rotation = {TURN.as_rotvec().tolist()}\ntranslation = {SHIFT_MM.tolist()}\n"
ANIPOSE = (
    f'[cam_0]\nname = "a"\n{CAMERA}rotation = [0, 0, 0]\ntranslation = [0, 0, 0]\n'
    f'[cam_1]\nname = "b"\n{CAMERA}{SECOND}'
)
ROWS = np.column_stack([TURN.as_matrix(), SHIFT_MM / 1e3]).tolist()
ONE = f"""  camera_model: pinhole
  distortion_coeffs: {LENS}
  distortion_model: radtan
  intrinsics: [700.0, 702.0, 319.5, 239.5]
  resolution: [640, 480]
  rostopic: /cam/image_raw
"""
CAMCHAIN = (
    f"cam0:\n  cam_overlaps: [1]\n{ONE}cam1:\n  T_cn_cnm1:\n"
    + "".join(f"  - {row}\n" for row in [*ROWS, [0.0, 0.0, 0.0, 1.0]])
    + ONE
)
CALISCOPE = (
    f"[cameras.0]\nport = 0\n{CAMERA}rotation = [0, 0, 0]\ntranslation = [0, 0, 0]\n"
    f"[cameras.1]\nport = 1\n{CAMERA}rotation = {TURN.as_matrix().tolist()}\n"
    f"translation = {(SHIFT_MM / 1e3).tolist()}\n"
)


def stored(path, names):
    """A stereo pair as `cv2.stereoCalibrate` gives it, with its rectification."""
    file = cv2.FileStorage(str(path), cv2.FileStorage_WRITE)
    for k in "12":
        file.write(f"{names[0]}{k}", K)
        file.write(f"{names[1]}{k}", np.array([[*LENS, 0.0]]))
        file.write(f"R{k}", np.eye(3))
        file.write(f"P{k}", np.eye(3, 4))
    file.write("R", TURN.as_matrix())
    file.write("T", SHIFT_MM[:, None])
    file.write("image_width", 640)
    file.write("image_height", 480)
    file.release()


READ = {
    "anipose.toml": ANIPOSE,
    "zeros.toml": ANIPOSE.replace(str(LENS), str([*LENS, *[0.0] * 10])),
    "tables.toml": f'title = "bench"\n{ANIPOSE}[capture]\nfps = 30\n[metadata.board]\nrows = 5\n',
    "utf16.toml": ANIPOSE.encode("utf-16"),
    "camera_array.toml": CALISCOPE,
    "camchain.yaml": CAMCHAIN,
    "chain.yml": f"%YAML 1.2\n---\n{CAMCHAIN}",
    "stereo.yml": ("M", "D"),
    "stereo.xml": ("cameraMatrix", "distCoeffs"),
    "stereo.json": ("K", "dist"),
}


@pytest.mark.parametrize("name", READ)
def test_the_cameras_are_those_of_the_file(name, tmp_path):
    path, content = tmp_path / name, READ[name]
    if isinstance(content, tuple):
        stored(path, content)
    else:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    for k, camera in enumerate(read_rig(path).cameras):
        assert camera.size == (640, 480)
        np.testing.assert_array_equal(camera.matrix, K)
        np.testing.assert_array_equal(camera.distortions, [*LENS, 0.0])
        T = camera.T_cam_world
        np.testing.assert_allclose(T.translation, k * SHIFT_MM, atol=1e-9)
        np.testing.assert_allclose(T.rotation.as_rotvec(), k * TURN.as_rotvec(), atol=1e-12)


DEEP = {
    "deep.yml": "%YAML:1.0\n---\na: opencv-matrix\nb: " + "- " * 9000,
    "deep.xml": "<opencv_storage>opencv-matrix" + "<a>" * 9000,
    "long.json": "{" + " " * 70000,
    "fisheye.yaml": CAMCHAIN.replace("radtan", "equidistant"),
    "short.yaml": CAMCHAIN.replace("T_cn_cnm1", "T_cam_imu"),
}
NAMED = cases(Path(__file__).with_name("wrong.txt"), "foreign")


@pytest.mark.parametrize(("file", "message"), NAMED)
def test_what_is_not_read_is_named_in_a_line(file, message, tmp_path):
    name, _, content = file.partition(":")
    path = tmp_path / name
    path.write_bytes(DEEP.get(name, unescaped(content.strip())).encode("latin-1"))
    with pytest.raises(ValueError, match=message) as caught:
        read_rig(path)
    assert re.fullmatch(rf"{re.escape(str(path))}: [^\n]+", str(caught.value))
