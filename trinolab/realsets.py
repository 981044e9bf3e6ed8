"""Reading the real recordings made by others: photographs, detected points and calibrations in our conventions.

Each reader returns None if its set is not on this machine (see `datasets.real_set`), mm and pixels with (0, 0) in the
centre of the first one. Nothing is unpickled. The readers raise ValueError as `datasets.real_set` does.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from scipy.linalg import rq
from scipy.spatial.transform import RigidTransform, Rotation

from .board import Board
from .camera import Camera, Rig
from .checks import Array, as_array, frozen, get, read_toml
from .datasets import real_set


class StereoPhotographs(NamedTuple):
    """Pairs of photographs of a board: images of uint8, shape (height, width), one a view in `left` and `right`."""

    left: tuple[np.ndarray, ...]
    right: tuple[np.ndarray, ...]
    board: Board


class Tracks(NamedTuple):
    """Points seen by a calibrated rig: pixels (cameras, n, 2), NaN where not seen, and points (m, 3) or None, mm."""

    rig: Rig
    uv: Array
    points: Array | None


class Particles(NamedTuple):
    """A grey image of dark particles, and the positions (n, 2), px, that another program finds in it."""

    image: np.ndarray
    uv: Array


class Trajectory(NamedTuple):
    """Times (n,), s, from 0, and poses, mm."""

    t_s: Array
    poses: RigidTransform


def load_opencv_stereo(fetch: bool = False) -> StereoPhotographs | None:
    """OpenCV's 13 pairs of photographs of a chessboard, 640 x 480; there is no pair 10."""
    folder = real_set("opencv_stereo", fetch)
    if folder is None:
        return None
    left, right = (tuple(_grey(path) for path in sorted(folder.glob(f"{side}??.jpg"))) for side in ("left", "right"))
    return StereoPhotographs(left, right, Board(9, 6, 25.0))


def load_pymvg_mcsc(fetch: bool = False) -> Tracks | None:
    """One LED at 464 instants in four cameras, as MultiCamSelfCal's output has it; no `points`.

    Three traps, undone here. The lens distortion belongs to the matrix of the ``.rad`` files and not to the linear
    camera. The linear cameras have skew, up to 4 px, which `Camera` has not: **the pixels are corrected for distortion
    and skew**, and the cameras have neither. Cameras and points of the files without ``Pmat`` are mirrored: a proper
    rotation puts every point behind its camera. The ``Pmat`` files are not; their unit is the metre.
    """
    folder = real_set("pymvg_mcsc", fetch)
    if folder is None:
        return None
    sizes = np.loadtxt(folder / "Res.dat", dtype=int)
    pixels = np.loadtxt(folder / "points.dat").reshape(len(sizes), 3, -1)[:, :2].transpose(0, 2, 1)
    cameras, corrected = zip(*(_mcsc_camera(folder, k, size, uv) for k, (size, uv)
                               in enumerate(zip(sizes.tolist(), pixels, strict=True), start=1)), strict=True)
    return Tracks(Rig(cameras), frozen(np.stack(corrected)), None)


def load_caliscope(fetch: bool = False) -> Tracks | None:
    """Corners of a board in four webcams: 48 instants of 12 corners, one after the other in `uv`.

    `points` are the 12 corners in the board's frame, z = 0. The cameras were not triggered together: their times within
    an instant differ by 8 ms in the middle, up to 46 ms.
    """
    folder = real_set("caliscope", fetch)
    if folder is None:
        return None
    tables = get(read_toml(folder / "camera_array.toml"), "cameras", "camera_array.toml")
    rig = Rig(tuple(_caliscope_camera(name, table) for name, table in tables.items()))
    frame = pd.read_csv(folder / "xy.csv")
    instants, instant = np.unique(frame["sync_index"], return_inverse=True)
    board = frame.groupby("keypoint_id")[["obj_loc_x", "obj_loc_y"]].first() * 1e3  # m
    uv = np.full((len(rig.cameras), len(instants), len(board), 2), np.nan)
    uv[frame["cam_id"], instant, frame["keypoint_id"]] = frame[["img_loc_x", "img_loc_y"]]
    corners = np.column_stack([board.to_numpy(), np.zeros(len(board))])
    return Tracks(rig, frozen(uv.reshape(len(uv), -1, 2)), frozen(corners))


def load_trackpy_particles(fetch: bool = False) -> Particles | None:
    """A microscope image of dark particles, and the 344 positions of trackpy's ``locate(255 - image, 9, ...)``."""
    folder = real_set("trackpy_particles", fetch)
    if folder is None:
        return None
    with np.load(folder / "reproducibility_v0.4.npz", allow_pickle=False) as stored:
        uv = as_array(stored["arr_3"], "arr_3", (None, 2))[:, ::-1]
    return Particles(_grey(folder / "T76S3F00001.png"), frozen(uv))


def load_trajectories(fetch: bool = False) -> Trajectory | None:
    """A handheld camera followed by motion capture for 30 s: times and poses. Never fetched: see `data/real.toml`."""
    folder = real_set("trajectories", fetch)
    if folder is None:
        return None
    rows = as_array(np.loadtxt(folder / "freiburg1_xyz-groundtruth.txt"), "freiburg1_xyz-groundtruth.txt", (None, 8))
    poses = RigidTransform.from_components(rows[:, 1:4] * 1e3, Rotation.from_quat(rows[:, 4:]))
    return Trajectory(frozen(rows[:, 0] - rows[0, 0]), poses)


def _grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ValueError(f"{path}: no image")
    return frozen(image)


def _mcsc_camera(folder: Path, number: int, size: list[int], uv: Array) -> tuple[Camera, Array]:
    """A camera without distortion and skew, and its pixels corrected for both."""
    name, identity = f"basler{number}", RigidTransform.identity()
    text = (folder / f"basename{number}.rad").read_text(encoding="utf-8")
    rad = {key: float(value) for key, value in re.findall(r"(\w+)\s*=\s*(\S+)", text)}
    matrix = np.array([[rad["K11"], 0, rad["K13"]], [0, rad["K22"], rad["K23"]], [0, 0, 1]])
    distortions = np.array([*(rad[f"kc{k}"] for k in range(1, 5)), 0.0])
    lens = Camera(name, (size[0], size[1]), matrix, distortions, identity)
    K, R, t = _decomposed(np.loadtxt(folder / f"camera{number}.Pmat.cal"))
    upright = K.copy()
    upright[0, 1] = 0.0  # the skew stays with the pixels' correction
    camera = Camera(name, lens.size, upright, np.zeros(5), RigidTransform.from_components(t * 1e3, R))
    ideal = lens.ideal_pixels(uv)
    xy = np.column_stack([ideal, np.ones(len(ideal))]) @ np.linalg.inv(K).T
    return camera, camera.to_pixels(xy[:, :2])


def _decomposed(P: Array) -> tuple[Array, Rotation, Array]:
    """K (with a diagonal that is positive), R and t of a projection matrix P ~ K [R | t]."""
    K, R = rq(P[:, :3])
    signs = np.diag(np.sign(np.diag(K)))
    K, R = K @ signs, signs @ R
    side = np.sign(np.linalg.det(R))
    return K / K[2, 2], Rotation.from_matrix(R * side), np.linalg.solve(K, P[:, 3]) * side


def _caliscope_camera(name: str, table: dict) -> Camera:
    T = RigidTransform.from_components(np.array(table["translation"]) * 1e3, Rotation.from_matrix(table["rotation"]))
    return Camera(name, table["size"], table["matrix"], table["distortions"], T)
