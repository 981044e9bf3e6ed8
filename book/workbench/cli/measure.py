"""What ``trinolab measure`` does: from images of several cameras to a file of poses."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from trinolab.files.outputs import check_targets
from trinolab.files.poses import contradictions, pose_table, poses_by_frame, read_poses, write_poses
from trinolab.files.recording import list_instants, read_instants
from trinolab.files.rigs import read_handle, read_rig
from trinolab.following.losses import lost_lines
from trinolab.measurement import measure
from trinolab.methods import estimator_of
from trinolab.parameters import Parameters
from trinolab.uncertainty.systematic import is_uncertain

__all__ = ["measure_folder"]

log = logging.getLogger("trinolab")


def measure_folder(
    rig: str | Path,
    handle: str | Path,
    images: str | Path,
    out: str | Path,
    method: str = "paper_checked",
    prior: str | Path | None = None,
    progress: bool = True,
) -> pd.DataFrame:
    """Measure every instant of a folder of images on its own, and write the poses.

    Parameters
    ----------
    rig, handle : path
        Rig and handle file.
    images : path
        Holds a folder a camera, named as in the rig, the same file names in each; what is in
        others is left out. The frames are the numbers in the names, see `recording.frames_named`.
        Colour and 16-bit images are converted. The log says what was left out or converted.
    out : path
        CSV of poses to write; it appears when all instants are done.
    method : {"paper", "paper_checked", "weighted", "reprojection", "patches", "outline", "best"}
        The estimator, see `estimators.estimate`; `best` is ``patches``.
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
    the_rig = read_rig(rig)
    the_handle = read_handle(handle)
    instants = list_instants(images, the_rig)
    frames = [instant.frame for instant in instants]
    expected = {} if prior is None else _expected(prior, frames)
    check_targets([out], [rig, handle, *([prior] if prior else [])])
    with (
        logging_redirect_tqdm(),
        tqdm(instants, unit="instant", disable=None if progress else True) as progress_bar,
    ):
        poses = [
            measure(images, the_rig, the_handle, expected.get(instant.frame), parameters).pose
            for instant, images in zip(progress_bar, read_instants(instants, the_rig), strict=True)
        ]
    table = pose_table(poses, frames=frames)
    write_poses(table, out)
    for line in [] if is_uncertain(the_rig, the_handle) else contradictions(table, rig):
        log.info(line)

    def images_of(numbers: list[int]) -> Iterator[Sequence[np.ndarray]]:
        return read_instants([instants[k] for k in numbers], the_rig)

    for line in lost_lines(table, the_rig, the_handle, images_of):
        log.info(line)
    return table


def _expected(path: str | Path, frames: Sequence[int]) -> dict[int, RigidTransform]:
    """The poses of a prior by their frame."""
    table = read_poses(path)
    if not table["frame"].isin(frames).any():
        raise ValueError(
            f"{path}: no frame in common with the images, which are frames {min(frames)} to "
            f"{max(frames)}"
        )
    return poses_by_frame(table)
