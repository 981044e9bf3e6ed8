"""Recordings and poses as files: instants from image folders, pose tables as CSV.

A pose table has one row an instant and the columns of `POSE_COLUMNS`; the pose is T_world_handle. Files appear whole or
not at all.
"""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation

from .camera import Rig
from .metrics import euler_deg
from .pose import Pose

POSE_COLUMNS = ("frame", "t_s", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz", "alpha_deg", "beta_deg", "gamma_deg",
                "sigma_mm", "sigma_deg", "residual_px", "markers", "cameras", "status")
STATUSES = ("measured", "ambiguous", "predicted", "lost")
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm")

log = logging.getLogger("trinolab")


class Instant(NamedTuple):
    """The images of one instant: `paths` in the order of the rig's cameras; `frame` counts from 0."""

    frame: int
    paths: tuple[Path, ...]


def list_instants(folder: str | Path, rig: Rig) -> list[Instant]:
    """The instants of a folder that holds a folder of images for each camera, the same file names in each.

    Raises
    ------
    ValueError
        If a camera's folder is missing or holds no image, a name is missing in one of them, or there are images of a
        camera that the rig does not have.
    """
    root = Path(folder)
    if not root.is_dir():
        raise ValueError(f"{root}: no such folder")
    names = {camera: _image_names(root / camera, rig) for camera in rig.names}
    for other in sorted(path for path in root.iterdir() if path.is_dir() and path.name not in rig.names):
        if any(_is_image(path) for path in other.iterdir()):
            raise ValueError(f"{other}: images of a camera that the rig does not have ({', '.join(rig.names)})")
    every = sorted(set().union(*names.values()))
    for camera, present in names.items():
        if missing := [name for name in every if name not in present]:
            raise ValueError(f"{root / camera / missing[0]}: missing, another camera has this image")
    return [Instant(k, tuple(root / camera / name for camera in rig.names)) for k, name in enumerate(every)]


def read_instant(instant: Instant, rig: Rig, said: set[str] | None = None) -> list[np.ndarray]:
    """Read the images of an instant as grey images, shape (height, width), grey levels 0 to 255.

    Colour images are converted to grey and 16-bit images to 8-bit levels (with their fractions); the log says so.

    Parameters
    ----------
    instant : Instant
    rig : Rig
    said : set of str, optional
        What the log has said before, and need not say for each of a thousand images; it grows by what is said here.

    Raises
    ------
    ValueError
        Names the file that cannot be read as an image or has another size than its camera.
    """
    said = set() if said is None else said
    return [_read_grey(path, camera.size, said) for path, camera in zip(instant.paths, rig.cameras, strict=True)]


def pose_table(poses: Sequence[Pose], t_s: Sequence[float] | None = None) -> pd.DataFrame:
    """Poses as a table with the columns of `POSE_COLUMNS`; a lost pose has empty numbers, `t_s` is empty if unknown."""
    times = [np.nan] * len(poses) if t_s is None else t_s
    rows = [_row(k, t, pose) for k, (t, pose) in enumerate(zip(times, poses, strict=True))]
    return pd.DataFrame(rows, columns=list(POSE_COLUMNS))


def truth_table(poses: RigidTransform) -> pd.DataFrame:
    """Known poses, a batch of length n, as a pose table without uncertainty."""
    exact = [Pose("measured", T, np.zeros((6, 6)), 0.0, 0, 0) for T in poses]
    return pose_table(exact)


def transforms(table: pd.DataFrame) -> RigidTransform:
    """The poses of a table's rows as a batch of length n; every row must hold a pose."""
    quaternions = table[["qx", "qy", "qz", "qw"]].to_numpy(dtype=float)
    positions = table[["x_mm", "y_mm", "z_mm"]].to_numpy(dtype=float)
    return RigidTransform.from_components(positions, Rotation.from_quat(quaternions))


def write_poses(table: pd.DataFrame, path: str | Path) -> None:
    """Write a pose table as CSV, whole or not at all.

    Raises
    ------
    ValueError
        If the file cannot be written.
    """
    write_whole(path, table.to_csv(index=False, float_format="%.9g"))


def read_poses(path: str | Path) -> pd.DataFrame:
    """Read a pose table; only `frame`, the position and the quaternion are required, `status` is "measured" if absent.

    Raises
    ------
    ValueError
        Names the file and the column: unreadable, missing, no number, frames that are not whole, negative or repeated,
        an unknown status, a pose that is incomplete or whose quaternion has not length 1.
    """
    try:
        table = pd.read_csv(path, low_memory=False)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"{path}: no valid CSV ({str(error).splitlines()[0]})") from None
    if not isinstance(table.index, pd.RangeIndex):
        raise ValueError(f"{path}: no valid CSV (rows have more fields than the first line)")
    for column in ("frame", *POSE_COLUMNS[2:9]):
        if column not in table:
            raise ValueError(f"{path}: column '{column}' is missing")
    for column in POSE_COLUMNS[:-1]:
        if column in table and not (pd.api.types.is_numeric_dtype(table[column]) or table[column].isna().all()):
            raise ValueError(f"{path}: column '{column}' holds something that is no number")
    table = table.assign(status=table.get("status", "measured"))
    _check_poses(table, path)
    return table.astype({"frame": int})


def check_target(path: str | Path) -> None:
    """Refuse, with a ValueError, a place where `write_whole` could not write: asked before a long computation."""
    target, folder = Path(path), Path(path).resolve().parent
    if not folder.is_dir():
        raise ValueError(f"{path}: no such folder to write into")
    if target.exists() and not target.is_file():
        raise ValueError(f"{path}: cannot be written (a folder or a device is there)")
    if not os.access(folder, os.W_OK):
        raise ValueError(f"{path}: cannot be written (no permission in its folder)")


def write_whole(path: str | Path, text: str) -> None:
    """Write a text file through a temporary one beside it, so that it is never seen half written.

    Raises
    ------
    ValueError
        If the file cannot be written.
    """
    check_target(path)
    target = Path(path).resolve()
    try:
        with tempfile.NamedTemporaryFile("w", dir=target.parent, prefix=f".{target.name}.", delete=False,
                                         encoding="utf-8") as file:
            temporary = Path(file.name)
            try:
                file.write(text)
                file.close()
                temporary.chmod(0o644)
                os.replace(temporary, target)
            finally:
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise ValueError(f"{path}: cannot be written ({error.strerror})") from None


def _image_names(folder: Path, rig: Rig) -> set[str]:
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder; each camera of the rig needs one ({', '.join(rig.names)})")
    names = {path.name for path in folder.iterdir() if _is_image(path)}
    if not names:
        raise ValueError(f"{folder}: no image in it ({', '.join(IMAGE_SUFFIXES)})")
    return names


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in IMAGE_SUFFIXES


def _read_grey(path: Path, size: tuple[int, int], said: set[str]) -> np.ndarray:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    if data.startswith(b"\x89PNG") and b"IEND" not in data[-12:]:  # libpng would complain by itself
        raise ValueError(f"{path}: cannot be read as an image (its end is missing)")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: cannot be read as an image of 8 or 16 bit")
    if image.shape[:2] != (size[1], size[0]):
        raise ValueError(f"{path}: {image.shape[1]} x {image.shape[0]} pixels, the rig says {size[0]} x {size[1]}")
    if image.ndim == 3:
        _say(path, "colour converted to grey", said)
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2GRAY if image.shape[2] == 4 else cv2.COLOR_BGR2GRAY)
    if image.dtype == np.uint16:
        _say(path, "16 bit scaled to grey levels 0 to 255", said)
        image = (image / 257.0).astype(np.float32)
    return image


def _say(path: Path, what: str, said: set[str]) -> None:
    """Log once what is done to the images of a folder."""
    if (key := f"{path.parent}: {what}") not in said:
        said.add(key)
        log.info("%s: %s; said once a camera", path, what)


def _row(frame: int, t_s: float, pose: Pose) -> tuple:
    if pose.T_world_handle is None:
        return (frame, t_s, *[np.nan] * 13, pose.markers, pose.cameras, pose.status)
    T = pose.T_world_handle
    quaternion = T.rotation.as_quat(canonical=True, scalar_first=True)
    return (frame, t_s, *T.translation, *quaternion, *np.ravel(euler_deg(T)), pose.sigma_mm, pose.sigma_deg,
            pose.residual_px, pose.markers, pose.cameras, pose.status)


def _check_poses(table: pd.DataFrame, path: str | Path) -> None:
    frame = table["frame"].to_numpy(dtype=float)
    if not np.isfinite(frame).all() or (frame != np.round(frame)).any() or (frame < 0).any() or (frame > 2**53).any():
        raise ValueError(f"{path}: column 'frame' expects whole numbers from 0")
    if len(np.unique(frame)) < len(frame):
        raise ValueError(f"{path}: column 'frame' has a number twice")
    if len(wrong := table["status"][~table["status"].isin(STATUSES)]):
        raise ValueError(f"{path}: status '{wrong.iloc[0]}' is none of {', '.join(STATUSES)}")
    held = table[table["status"] != "lost"]
    pose = held[list(POSE_COLUMNS[2:9])].to_numpy(dtype=float)
    length = np.linalg.norm(pose[:, 3:], axis=1)
    wrong_rows = ~np.isfinite(pose).all(axis=1) | ~(np.abs(length - 1) < 1e-3)
    if wrong_rows.any():
        raise ValueError(f"{path}: frame {int(held['frame'].iloc[int(wrong_rows.argmax())])}: no pose "
                         "(numbers missing, or a quaternion that has not length 1)")
