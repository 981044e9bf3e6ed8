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

HERE = Path(__file__).parent
ANIPOSE, CALISCOPE, CAMCHAIN = (
    (HERE / "examples" / name).read_text()
    for name in ("anipose.toml", "camera_array.toml", "camchain.yaml")
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
    "zeros.toml": ANIPOSE.replace("-0.0002]", "-0.0002" + 10 * ", 0.0" + "]"),
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
NAMED = cases(HERE / "wrong.txt", "foreign")


@pytest.mark.parametrize(("file", "message"), NAMED)
def test_what_is_not_read_is_named_in_a_line(file, message, tmp_path):
    name, _, content = file.partition(":")
    path = tmp_path / name
    path.write_bytes(DEEP.get(name, unescaped(content.strip())).encode("latin-1"))
    with pytest.raises(ValueError, match=message) as caught:
        read_rig(path)
    assert re.fullmatch(rf"{re.escape(str(path))}: [^\n]+", str(caught.value))
