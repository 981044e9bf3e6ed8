"""What a command does, from files to files; notebooks call the same functions."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from .camera import Rig
from .checks import as_number
from .datasets import load_table1
from .handle import Handle, read_handle
from .metrics import PoseErrors, nearest_equivalent, pose_errors
from .outputs import check_targets
from .parameters import BEST, ESTIMATORS, Parameters
from .posetable import pose_table, poses_by_frame, read_poses, write_poses
from .recording import list_instants, read_instant
from .rigfile import read_rig
from .scene import Bench, render_rig
from .tracker import Measurement, measure

METHODS = {name: name for name in ESTIMATORS} | {"best": BEST}
"""What `--method` may name, and the estimator that it stands for."""


def measure_folder(rig: str | Path, handle: str | Path, images: str | Path, out: str | Path, method: str = "paper",
                   prior: str | Path | None = None, progress: bool = True) -> pd.DataFrame:
    """Measure every instant of a folder of images on its own, and write the poses.

    Parameters
    ----------
    rig, handle : path
        Rig and handle file.
    images : path
        Holds a folder a camera, named as in the rig, the same file names in each. Colour and 16-bit images are
        converted, and the log says so.
    out : path
        CSV of poses to write; it appears when all instants are done.
    method : {"paper", "weighted", "reprojection", "patches", "outline", "best"}
        The estimator, see `estimation.estimate`; `best` is ``patches``.
    prior : path, optional
        CSV of poses that are expected, joined on `frame`: they choose among poses that look alike.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Returns
    -------
    pandas.DataFrame
        The table that was written.

    Raises
    ------
    ValueError
        Names the file that is missing, unreadable or does not fit.
    """
    parameters = Parameters(estimator=estimator_of(method))
    the_rig, the_handle = read_rig(rig), read_handle(handle)
    instants = list_instants(images, the_rig)
    expected = {} if prior is None else _expected(prior, len(instants))
    check_targets([out], [rig, handle, *([prior] if prior else [])])
    said: set[str] = set()  # of conversions, by `read_instant`
    with logging_redirect_tqdm(), tqdm(instants, unit="instant", disable=None if progress else True) as shown:
        poses = [measure(read_instant(i, the_rig, said), the_rig, the_handle, expected.get(i.frame), parameters).pose
                 for i in shown]
    table = pose_table(poses)
    write_poses(table, out)
    return table


def replicate(poses: Iterable[RigidTransform], rig: Rig, handle: Handle, seed: int = 0, bench: Bench | None = None,
              parameters: Parameters | None = None, progress: bool = False) -> list[Measurement]:
    """Render each pose with the simulated bench and measure it, without a prior.

    Parameters
    ----------
    poses : iterable of RigidTransform
        T_world_handle of each instant.
    rig : Rig
    handle : Handle
    seed : int
        Of the noise.
    bench : Bench, optional
    parameters : Parameters, optional
    progress : bool
        Show a progress bar on standard error.
    """
    rng = np.random.default_rng(int(as_number(seed, "seed", low=0)))
    bench = bench or Bench()
    return [measure(render_rig(rig, handle, T, bench, rng), rig, handle, parameters=parameters)
            for T in tqdm(list(poses), unit="instant", disable=not progress)]


def replicate_table1(rig: Rig, handle: Handle, seed: int = 0, rows: slice = slice(None), bench: Bench | None = None,
                     parameters: Parameters | None = None) -> PoseErrors:
    """The errors of the whole chain on rendered frames of Table 1's poses, up to the handle's symmetry (Eq. 26-27).

    Parameters
    ----------
    rows : slice
        Of Table 1; all twenty by default. The other parameters are those of `replicate`.

    Raises
    ------
    ValueError
        If not one of the poses was measured.
    """
    truths = load_table1().set_poses[rows]
    measurements = replicate(truths, rig, handle, seed, bench, parameters)
    return replication_errors(measurements, truths, handle)


def replication_errors(measurements: list[Measurement], truths: RigidTransform, handle: Handle) -> PoseErrors:
    """Errors of measurements against their truths, each by its nearest equivalent; lost ones are left out of `n`."""
    held = [k for k, m in enumerate(measurements) if m.pose.T_world_handle is not None]
    if not held:
        raise ValueError(f"measurements: all {len(measurements)} are lost")
    estimates = RigidTransform.concatenate([measurements[k].pose.T_world_handle for k in held])
    return pose_errors(nearest_equivalent(estimates, truths[held], handle.symmetries), truths[held])


def estimator_of(method: str) -> str:
    """The estimator that `--method` names. Raises ValueError for another word."""
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    return METHODS[method]


def _expected(path: str | Path, instants: int) -> dict[int, RigidTransform]:
    """The poses of a prior by their frame."""
    table = read_poses(path)
    if not (table["frame"] < instants).any():
        raise ValueError(f"{path}: no frame in common with the images, which are frames 0 to {instants - 1}")
    return poses_by_frame(table)
