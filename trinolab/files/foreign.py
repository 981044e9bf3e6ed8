"""Rig files of other programs, turned into the tables of a rig file: Kalibr's camchain, a stereo pair
in OpenCV's file storage, caliscope's arrays of cameras. Other files are refused with their program's
name and the way out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from . import limits

# of YAML, XML and JSON: they are parsed slowly, and those that are read are short
MOST_BYTES = 1 << 16
METRE_MM = 1e3
WAY_OUT = (
    "make its cameras with trinolab.Camera.from_opencv, and write them with trinolab.write_rig"
)

# whose files they are: by the ending or the first bytes, or by what stands in them
BY_NAME = {
    "cameras.txt": "COLMAP",
    "cameras.bin": "COLMAP",
    ".npz": "NumPy (.npz)",
    ".npy": "NumPy (.npy)",
    ".mat": "MATLAB (.mat)",
    ".pickle": "Python (pickle)",
    ".ini": "ROS (INI)",
}
BY_FIRST = {b"PK\x03\x04": "NumPy (.npz)", b"MATLAB": "MATLAB (.mat)", b"# Camera list": "COLMAP"}
BY_WORD = {
    b"camera_model_params": "Isaac (JSON)",
    b"<chunk": "Metashape (XML)",
    b"<camera serial": "Qualisys (XML)",
    b"camera_pose_matrix": "MC-Calib",
}
SIZES = ("image_width", "image_height", "image_size", "imageSize", "size")
FORMS = {b"<": "XML", b"{": "JSON", b"%": "YAML"}


def foreign_tables(path: str | Path) -> dict[str, Any] | None:
    """The tables of a rig file that another program has written; None for a file that may be TOML.

    Raises
    ------
    ValueError
        Names the program of a file that is not read, or the file's fault.
    """
    file = Path(path)
    content = _first_bytes(file)
    form = "YAML" if file.suffix.lower() in (".yaml", ".yml") else FORMS.get(content.lstrip()[:1])
    named = BY_NAME.get(file.name.lower()) or BY_NAME.get(file.suffix.lower())
    first = [whose for begin, whose in BY_FIRST.items() if content.startswith(begin)]
    if named or first:
        raise ValueError(f"is a file of {named or first[0]}, which is not read; {WAY_OUT}")
    if form is None:
        return None
    if len(content) > MOST_BYTES:
        raise ValueError(f"is {form} of more than {MOST_BYTES} bytes, which is not read; {WAY_OUT}")
    if whose := [whose for word, whose in BY_WORD.items() if word in content]:
        raise ValueError(f"is a file of {whose[0]}, which is not read; {WAY_OUT}")
    if re.search(rb"opencv-matrix", content):
        return _stereo(_stored(content, form))
    tables = _yaml(content) if form == "YAML" else {}
    if any(isinstance(one, dict) and "intrinsics" in one for one in tables.values()):
        return _camchain(tables)
    if tables.keys() & {"camera_matrix", "K", "k"}:
        raise ValueError(
            "is ROS's camera_info: the lens of one camera, and a rig has two or more, each with its "
            "rotation and translation from the world, which this file lacks; give each of them with its "
            "image_width, image_height, matrix and distortions to trinolab.Camera.from_opencv, and "
            "all to trinolab.write_rig"
        )
    raise ValueError(f"is another program's {form}, which is not read; {WAY_OUT}")


def caliscope_tables(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The tables of caliscope's array of cameras, which counts in metres and has no names."""
    return {
        key: {
            "name": f"cam_{key}",
            **table,
            "rotation": _rotvec(table["rotation"]),
            "translation": (METRE_MM * _numbers(table["translation"], (3,))).tolist(),
        }
        for key, table in tables.items()
        if isinstance(table, dict) and {"rotation", "translation"} <= set(table)
    }


def _first_bytes(path: Path) -> bytes:
    """The first bytes of a file, by which its kind is known; empty if it cannot be read."""
    try:
        with limits.open_regular(path) as file:
            return file.read(MOST_BYTES + 1)
    except OSError:
        return b""


def _yaml(content: bytes) -> dict[str, Any]:
    import yaml  # only for another program's file

    if b"&" in content:
        raise ValueError("is YAML with anchors, which is not read")

    class Loader(yaml.SafeLoader):
        """Takes OpenCV's matrices for tables."""

    Loader.add_constructor(
        "tag:yaml.org,2002:opencv-matrix", lambda loader, node: loader.construct_mapping(node, True)
    )
    try:
        tables = yaml.load(re.sub(rb"\A%[^\n]*", b"", content), Loader)
    except (yaml.YAMLError, ValueError, RecursionError):
        raise ValueError("is no valid YAML") from None
    return tables if isinstance(tables, dict) else {}


def _camchain(chain: Mapping[str, Any]) -> dict[str, Any]:
    """Kalibr's chain of cameras, each with its pose relative to the one before, in metres."""
    T_cam_world = np.eye(4)
    tables: dict[str, Any] = {}
    for name, one in chain.items():
        if not isinstance(one, dict) or "intrinsics" not in one:
            continue
        models = one.get("camera_model"), one.get("distortion_model")
        if models[0] != "pinhole" or models[1] not in ("radtan", "none"):
            raise ValueError(
                f"[{name}]: expected a pinhole camera with the lens radtan, got {models[0]} with {models[1]}"
            )
        if tables:
            T_cam_world = (
                _numbers(one.get("T_cn_cnm1"), (4, 4), f"[{name}]: T_cn_cnm1") @ T_cam_world
            )
        f_u, f_v, c_u, c_v = _numbers(one["intrinsics"], (4,), f"[{name}]: intrinsics").tolist()
        tables[name] = {
            "name": str(name),
            "size": one.get("resolution"),
            "matrix": [[f_u, 0.0, c_u], [0.0, f_v, c_v], [0.0, 0.0, 1.0]],
            "distortions": one.get("distortion_coeffs", []),
            "rotation": _rotvec(T_cam_world[:3, :3]),
            "translation": (METRE_MM * T_cam_world[:3, 3]).tolist(),
        }
    return tables


def _stored(content: bytes, form: str) -> dict[str, Any]:
    """The numbers, matrices and lists of a file of OpenCV's storage. It is read without OpenCV, which
    aborts on some damaged files.
    """
    try:
        if form == "XML":
            root = ElementTree.fromstring(content)
            nodes = {one.tag: {of.tag: of.text for of in one} or one.text for one in root}
        else:
            nodes = json.loads(content) if form == "JSON" else _yaml(content)
        return {name: _value(node) for name, node in nodes.items()}
    except (AttributeError, KeyError, TypeError, ValueError, SyntaxError, RecursionError):
        raise ValueError("is no valid file of OpenCV's storage") from None


def _value(node: Any) -> Any:
    if isinstance(node, dict):
        if "data" not in node:
            return None
        return np.reshape(_value(node["data"]), (int(node["rows"]), int(node["cols"])))
    numbers = node.split() if isinstance(node, str) else node
    try:
        return np.array(numbers, float)
    except (TypeError, ValueError):
        return None  # a text


def _stereo(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Two cameras, as `cv2.stereoCalibrate` gives them: matrices and distortions by pairs of names that
    end with 1 and 2, R and T from the first to the second, and the size of the images.
    """
    matrices = {name: m for name, m in stored.items() if isinstance(m, np.ndarray)}
    pairs = [
        (matrices[name], matrices[f"{name[:-1]}2"])
        for name in matrices
        if name.endswith("1") and f"{name[:-1]}2" in matrices
    ]
    # rotations, which are named in the same way, have no focal length; projections have four columns
    Ks = [pair for pair in pairs if pair[0].shape == (3, 3) and pair[0][0, 0] > 1]
    lenses = [pair for pair in pairs if min(pair[0].shape) == 1 and pair[0].size > 3]
    sides = np.ravel([stored[name] for name in SIZES if stored.get(name) is not None])
    R, T = (stored.get(name) for name in ("R", "T"))
    if not Ks or R is None or T is None or len(sides) != 2:
        raise ValueError(
            "is OpenCV's file storage, of which pairs of cameras are read that have matrices and "
            f"distortions (M1, D1, M2, D2), R, T, image_width and image_height; {WAY_OUT}"
        )
    nothing = (np.zeros(5), np.zeros(5))
    places = ([0.0] * 3, [0.0] * 3), (_rotvec(R), np.ravel(T).tolist())
    return {
        name: {
            "name": name,
            "size": sides.astype(int).tolist(),
            "matrix": K.tolist(),
            "distortions": np.ravel(lens).tolist(),
            "rotation": place[0],
            "translation": place[1],
        }
        for name, K, lens, place in zip(
            ("left", "right"), Ks[0], (lenses or [nothing])[0], places, strict=True
        )
    }


def _numbers(values: Any, shape: tuple[int, ...], what: str = "translation") -> np.ndarray:
    try:
        numbers = np.array(values, float)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError(f"{what}: expected {' x '.join(map(str, shape))} finite numbers")
    return numbers


def _rotvec(rotation: Any) -> list[float]:
    """A Rodrigues vector of a rotation, which may be a matrix."""
    turned = np.array(rotation, float) if np.shape(rotation) == (3, 3) else None
    if turned is None:
        return rotation
    if not np.allclose(turned @ turned.T, np.eye(3), atol=1e-4) or np.linalg.det(turned) < 0:
        raise ValueError("rotation: expected a rotation matrix")
    return Rotation.from_matrix(turned).as_rotvec().tolist()
