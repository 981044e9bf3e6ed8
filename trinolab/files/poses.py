"""Tables of poses, and their files: CSV, one row per instant (columns: `POSE_COLUMNS`); the pose is
T_world_handle.

`sigma_mm` and `sigma_deg` are the whole uncertainty; `systematic_mm` and `systematic_deg` are the part
that all instants share, caused by errors of the rig and the marker layout. TUM files, which other
programs read, are written as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation

from ..metrics import euler_deg
from ..pose import Pose
from .inputs import read_csv
from .outputs import table_text, write_whole
from .rigs import covariance_path

POSE_COLUMNS = (
    "frame",
    "t_s",
    "x_mm",
    "y_mm",
    "z_mm",
    "qw",
    "qx",
    "qy",
    "qz",
    "alpha_deg",
    "beta_deg",
    "gamma_deg",
    "sigma_mm",
    "sigma_deg",
    "residual_px",
    "markers",
    "cameras",
    "status",
    "systematic_mm",
    "systematic_deg",
)

# share of the poses whose images contradict each other, and their number, that noise does not make
OFTEN, SEVERAL = 0.1, 2
FARTHEST_MM = 1e9  # of a position that a file may hold: a thousand km
STATUSES = ("measured", "ambiguous", "predicted", "lost")


def pose_table(
    poses: Sequence[Pose],
    t_s: Sequence[float] | None = None,
    frames: Sequence[int] | None = None,
) -> pd.DataFrame:
    """Poses as a table with the columns of `POSE_COLUMNS`; a lost pose has empty numbers, `t_s` is
    empty if unknown, `frames` count from 0.
    """
    times = [np.nan] * len(poses) if t_s is None else t_s
    numbers = range(len(poses)) if frames is None else frames
    rows = [pose_row(k, t, pose) for k, t, pose in zip(numbers, times, poses, strict=True)]
    return pd.DataFrame(rows, columns=list(POSE_COLUMNS))


def truth_table(poses: RigidTransform) -> pd.DataFrame:
    """Known poses, a batch of length n, as a pose table without uncertainty."""
    exact = [Pose("measured", T, np.zeros((6, 6)), 0.0, 0, 0) for T in poses]
    return pose_table(exact)


def contradictions(table: pd.DataFrame, rig: str | Path) -> list[str]:
    """A line if the images contradict each other in more poses of a table than noise explains; for a
    rig and a handle that are stated to be exact, so that nothing else is systematic.
    """
    with_pose = table[table["status"].isin(["measured", "ambiguous"])]
    # a misfit by chance adds less than the noise; equal parts of a sigma count, to rounding
    least = with_pose["sigma_mm"] / np.sqrt(2) * (1 - 1e-9)
    systematic = with_pose["systematic_mm"]
    count = int(((systematic > 0) & (systematic >= least)).sum())
    if count <= max(OFTEN * len(with_pose), SEVERAL):
        return []
    return [
        f"{rig}: the cameras contradict each other in {count} of {len(with_pose)} poses, which counts "
        f"in sigma as far as it shows; they are stated to be exact, {covariance_path(rig).name} "
        "would say how well they are known"
    ]


def transforms(table: pd.DataFrame) -> RigidTransform:
    """The poses of a table's rows as a batch of length n; every row must hold a pose."""
    quaternions = table[["qx", "qy", "qz", "qw"]].to_numpy(dtype=float)
    positions = table[["x_mm", "y_mm", "z_mm"]].to_numpy(dtype=float)
    return RigidTransform.from_components(positions, Rotation.from_quat(quaternions))


def poses_by_frame(table: pd.DataFrame) -> dict[int, RigidTransform]:
    """The poses of those rows that hold one."""
    with_pose = table[table["status"] != "lost"]
    return (
        dict(zip(with_pose["frame"], transforms(with_pose), strict=True)) if len(with_pose) else {}
    )


def write_poses(table: pd.DataFrame, path: str | Path) -> None:
    """Write a pose table as CSV, whole or not at all.

    Raises
    ------
    ValueError
        If the file cannot be written.
    """
    write_whole(path, poses_text(table))


def poses_text(table: pd.DataFrame) -> str:
    """The text of a pose table's CSV file."""
    return table_text(table)


def write_tum(table: pd.DataFrame, path: str | Path) -> None:
    """Write the track as a TUM file: a line ``t tx ty tz qx qy qz qw`` per pose, in s and m, for tools
    such as evo.

    Only `measured` rows are written: an ambiguous pose is one of several, and a predicted one was
    not seen. A table without any gives an empty file.

    Parameters
    ----------
    table : pandas.DataFrame
        Of `pose_table` or `read_poses`; each of its measured rows has a time `t_s`.
    path : path
        The file appears whole or not at all.

    Raises
    ------
    ValueError
        If a measured row has no time, or the file cannot be written.
    """
    write_whole(path, tum_text(table))


def tum_text(table: pd.DataFrame) -> str:
    """The text of a pose table's TUM file; ValueError if a measured row has no time."""
    measured = table[table["status"] == "measured"]
    times = (
        measured["t_s"].to_numpy(dtype=float)
        if "t_s" in measured
        else np.full(len(measured), np.nan)
    )
    if not np.isfinite(times).all():
        raise ValueError(
            f"t_s: expected the time of every measured row, got none for frame "
            f"{int(measured['frame'].iloc[int(np.isfinite(times).argmin())])}"
        )
    numbers = measured[["x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"]].to_numpy(dtype=float) / (
        [1e3] * 3 + [1.0] * 4
    )
    rows = np.column_stack([times, numbers])
    return "".join(" ".join(f"{value:.9f}" for value in row) + "\n" for row in rows)


def read_poses(path: str | Path) -> pd.DataFrame:
    """Read a pose table; only `frame`, the position and the quaternion are required, `status` is
    "measured" if absent.

    Raises
    ------
    ValueError
        Names the file and the column: unreadable, missing, no number, frames that are not whole,
        negative or repeated, an unknown status, a pose that is incomplete or whose quaternion has
        not length 1.
    """
    table = read_csv(path)
    if "frame" not in table and len(" ".join(map(str, table.columns)).split()) == 8:
        raise ValueError(
            f"{path}: is a TUM file by its eight columns: its poses have times and no frames, by which "
            "poses are joined; give the CSV that track has written beside it, or a table with the columns "
            f"{', '.join(('frame', *POSE_COLUMNS[1:9]))}"
        )
    return as_poses(table, path)


def as_poses(table: pd.DataFrame, path: str | Path) -> pd.DataFrame:
    """A pose table with the columns of `read_poses`, checked; the errors name it by `path`."""
    for column in ("frame", *POSE_COLUMNS[2:9]):
        if column not in table:
            raise ValueError(f"{path}: column '{column}' is missing")
    for column in (name for name in POSE_COLUMNS if name != "status"):
        if column in table and not (
            pd.api.types.is_numeric_dtype(table[column]) or table[column].isna().all()
        ):
            raise ValueError(f"{path}: column '{column}' holds something that is no number")
    table = table.assign(status=table.get("status", "measured"))
    _check_poses(table, path)
    return table.astype({"frame": int})


def pose_row(frame: int, t_s: float, pose: Pose) -> tuple:
    """One row, in the order of `POSE_COLUMNS`."""
    if pose.T_world_handle is None:
        nothing = [np.nan] * 13
        return (frame, t_s, *nothing, pose.markers, pose.cameras, pose.status, np.nan, np.nan)
    T = pose.T_world_handle
    quaternion = T.rotation.as_quat(canonical=True, scalar_first=True)
    return (
        frame,
        t_s,
        *T.translation,
        *quaternion,
        *np.ravel(euler_deg(T)),
        pose.sigma_mm,
        pose.sigma_deg,
        pose.residual_px,
        pose.markers,
        pose.cameras,
        pose.status,
        pose.systematic_mm,
        pose.systematic_deg,
    )


def _check_poses(table: pd.DataFrame, path: str | Path) -> None:
    frame = table["frame"].to_numpy(dtype=float)
    if (
        not np.isfinite(frame).all()
        or (frame != np.round(frame)).any()
        or (frame < 0).any()
        or (frame > 2**53).any()
    ):
        raise ValueError(f"{path}: column 'frame' expects whole numbers from 0")
    if len(np.unique(frame)) < len(frame):
        raise ValueError(f"{path}: column 'frame' has a number twice")
    if len(wrong := table["status"][~table["status"].isin(STATUSES)]):
        raise ValueError(f"{path}: status {str(wrong.iloc[0])!r} is none of {', '.join(STATUSES)}")
    with_pose = table[table["status"] != "lost"]
    pose = with_pose[list(POSE_COLUMNS[2:9])].to_numpy(dtype=float)
    with np.errstate(over="ignore"):  # an overflow shows in the length
        length = np.linalg.norm(pose[:, 3:], axis=1)
    wrong_rows = ~(np.abs(pose) <= FARTHEST_MM).all(axis=1) | ~(np.abs(length - 1) < 1e-3)
    if wrong_rows.any():
        raise ValueError(
            f"{path}: frame {int(with_pose['frame'].iloc[int(wrong_rows.argmax())])}: no pose "
            f"(numbers missing or beyond {FARTHEST_MM:g}, or a quaternion that has not length 1)"
        )
