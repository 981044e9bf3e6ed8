"""What ``trinolab measure`` does: from a recording, or a folder of images, to a file of poses."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import repeat
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from trinolab.camera import Rig
from trinolab.default_covariance import assumed
from trinolab.files.outputs import check_targets
from trinolab.files.poses import (
    POSE_COLUMNS,
    contradictions,
    pose_row,
    poses_by_frame,
    read_poses,
    write_poses,
)
from trinolab.files.recording import (
    Frames,
    instants,
    list_instants,
    open_folder,
    read_instants,
    some_instants,
)
from trinolab.files.rigs import read_handle, read_rig
from trinolab.following.losses import lost_lines
from trinolab.handle import Handle
from trinolab.measurement import measure
from trinolab.methods import DEFAULT, estimator_of
from trinolab.parameters import Parameters
from trinolab.sensitivity import is_uncertain

log = logging.getLogger("trinolab")


def measure_folder(
    rig: str | Path,
    handle: str | Path,
    images: str | Path,
    out: str | Path,
    method: str = DEFAULT,
    prior: str | Path | None = None,
    progress: bool = True,
    check: bool = False,
) -> pd.DataFrame:
    """Measure every instant of a folder of images on its own, and write the poses.

    Parameters
    ----------
    rig, handle : path
        Rig and handle file.
    images : path
        Holds a folder per camera, named as in the rig, the same file names in each; what is in
        others is left out. The frames are the numbers in the names, see `recording.frames_named`.
        Colour and 16-bit images are converted. The log says what was left out or converted.
    out : path
        CSV of poses to write; it appears when all instants are done.
    method : {"paper", "reprojection", "patches", "best"}
        The estimator, see `estimators.estimate`; `best` is ``patches``.
    prior : path, optional
        CSV of poses that are expected, joined on `frame`: they choose among poses that look alike.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.
    check : bool
        Whether the poses of ``paper`` are checked against the pixels, see `Parameters`.

    Returns
    -------
    pandas.DataFrame
        The table that was written.

    Raises
    ------
    ValueError
        Names the file that is missing, unreadable or does not fit.
    """
    the_rig = read_rig(rig)
    the_handle = read_handle(handle)
    listed = list_instants(images, the_rig)
    frames = [instant.frame for instant in listed]
    expected = {} if prior is None else _expected(prior, frames)
    check_targets([out], [rig, handle, *([prior] if prior else [])])
    table = _measured(
        map(Frames, frames, repeat(np.nan), read_instants(listed, the_rig)),
        len(listed),
        (the_rig, the_handle),
        expected,
        Parameters(estimator=estimator_of(method), check=check),
        progress,
    )
    _conclude(
        table,
        out,
        (the_rig, the_handle),
        (rig, handle),
        lambda rows: read_instants([listed[k] for k in rows], the_rig),
    )
    return table


def measure_recording(
    folder: str | Path,
    out: str | Path,
    rig: str | Path | None = None,
    handle: str | Path | None = None,
    method: str = DEFAULT,
    prior: str | Path | None = None,
    progress: bool = True,
    check: bool = False,
) -> pd.DataFrame:
    """Measure every instant of a recording folder on its own, and write the poses with their times.

    Parameters
    ----------
    folder : path
        See `files.recording`.
    out : path
        CSV of poses to write; it appears when all instants are done.
    rig, handle : path, optional
        Other files than the folder's; a rig may have some of the cameras.
    method, prior, progress, check
        As for `measure_folder`, also the errors.
    """
    recording, the_handle = open_folder(folder, rig, handle)
    # of a video the header says how many frames it has, which need not be so
    expected = {} if prior is None else _expected(prior, range(max(recording.length, 1)))
    names = rig or Path(folder, "rig.toml"), handle or Path(folder, "handle.toml")
    check_targets([out], [*names, recording.times_from, *([prior] if prior else [])])
    of = (recording.rig, the_handle)
    parameters = Parameters(estimator=estimator_of(method), check=check)
    table = _measured(instants(recording), recording.length, of, expected, parameters, progress)
    frames = table["frame"]

    def images_of(rows: list[int]) -> Iterator[Sequence[np.ndarray]]:
        return (now.images for now in some_instants(recording, frames.iloc[rows].tolist()))

    _conclude(table, out, of, names, images_of)
    return table


def _measured(
    taken: Iterable[Frames],
    count: int,
    of: tuple[Rig, Handle],
    expected: Mapping[int, RigidTransform],
    parameters: Parameters,
    progress: bool,
) -> pd.DataFrame:
    """The table of the poses of all instants."""
    with (
        logging_redirect_tqdm(),
        tqdm(taken, total=count, unit="instant", disable=None if progress else True) as bar,
    ):
        rows = [
            pose_row(
                now.frame,
                now.t_s,
                measure(now.images, *of, expected.get(now.frame), parameters).pose,
            )
            for now in bar
        ]
    return pd.DataFrame(rows, columns=list(POSE_COLUMNS))


def _conclude(
    table: pd.DataFrame,
    out: str | Path,
    of: tuple[Rig, Handle],
    names: tuple[str | Path, str | Path],
    images_of: Callable[[list[int]], Iterator[Sequence[np.ndarray]]],
) -> None:
    """Write the poses, and say what was assumed, what the cameras contradict each other in, and why
    most instants have no pose.
    """
    write_poses(table, out)
    lines = contradictions(table, names[0]) if not is_uncertain(*of) else assumed(*of, *names)
    for line in [*lines, *lost_lines(table, *of, images_of)]:
        log.info(line)


def _expected(path: str | Path, frames: Sequence[int]) -> dict[int, RigidTransform]:
    """The poses of a prior by their frame."""
    table = read_poses(path)
    if not table["frame"].isin(frames).any():
        raise ValueError(
            f"{path}: no frame in common with the images, which are frames {min(frames)} to "
            f"{max(frames)}"
        )
    return poses_by_frame(table)
