"""The command ``trinolab track``: a recording to a file of poses."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from ..camera import Rig
from ..checks import Array
from ..datasets import handle_file, handle_of, rig_file, rig_of
from ..default_covariance import assumed
from ..files.journal import sole_writer
from ..files.outputs import check_targets, write_together
from ..files.poses import (
    POSE_COLUMNS,
    contradictions,
    pose_row,
    poses_by_frame,
    poses_text,
    read_poses,
    tum_text,
)
from ..files.recording import (
    Frames,
    Recording,
    instants,
    open_folder,
    open_recording,
    some_instants,
)
from ..handle import Handle
from ..identity import labelled_pixels
from ..methods import DEFAULT, estimator_of
from ..pose import fit_pose
from ..sensitivity import is_uncertain
from . import drift, posetracker
from .clocks import late_lines, widened
from .losses import lost_lines
from .parameters import FollowParameters
from .served import idle_lines
from .sync import Offsets, estimate_offsets

log = logging.getLogger("trinolab")

MOST_INSTANTS = 3000  # kept for the cameras' offsets in time, and for their drift

Watch = Callable[[Recording, Frames, posetracker.Tracked], object]


def track_files(
    rig: Rig | str | Path,
    handle: Handle | str | Path,
    sources: Mapping[str, str | Path],
    out: str | Path,
    start: str | Path | None = None,
    fps: float | None = None,
    timestamps: str | Path | None = None,
    method: str = DEFAULT,
    progress: bool = True,
    watch: Watch | None = None,
) -> pd.DataFrame:
    """Follow the handle through videos or image folders, and write its poses.

    Parameters
    ----------
    rig, handle
        A `Rig` and a `Handle`, or files, or names of shipped ones, as ``raised_40deg`` and
        ``coded``.
    sources : mapping of str to path
        For each camera's name its video, or its folder of images (in the order of their names).
    out : path
        CSV of poses to write; TUM beside it, with the suffix ``.tum``. Both appear whole or not at
        all.
    start : path, optional
        CSV of poses known at some frames: at the first one for a handle that looks alike from
        several sides.
    fps : float, optional
        Frames per second, where there are no timestamps; without it the videos' own rate, or else
        30.
    timestamps : path, optional
        CSV with the columns ``frame`` and ``t_s``.
    method : str
        The estimator, see `methods.METHODS`; ``best`` is that of all commands and of
        ``trinolab.measure``.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.
    watch : callable, optional
        Called with the recording, each instant's frames and their `posetracker.Tracked`.

    Returns
    -------
    pandas.DataFrame
        The table that was written.

    Raises
    ------
    ValueError
        Names the file that is missing, unreadable or does not fit, or that another process writes.
    """
    the_rig, the_handle = rig_of(rig), handle_of(handle)
    rig_name = "rig" if isinstance(rig, Rig) else rig_file(rig)
    handle_name = "handle" if isinstance(handle, Handle) else handle_file(handle)
    recording = open_recording(sources, the_rig, fps, timestamps)
    parameters = FollowParameters(estimator=estimator_of(method))
    known = known_poses(start, recording)
    files = [path for path in (rig_name, handle_name) if isinstance(path, Path)]
    files += [Path(path) for path in (start, timestamps) if path is not None]
    tum = Path(out).with_suffix(".tum")
    check_targets([out, tum], files)
    with sole_writer(out):
        table, offsets = follow(recording, the_handle, parameters, known, progress, watch)
        if offsets is not None:
            table = widened(table, offsets, the_rig)
        write_together({out: poses_text(table), tum: tum_text(table)})
    lines = assumed(the_rig, the_handle, rig_name, handle_name)
    if not is_uncertain(the_rig, the_handle):
        lines = contradictions(table, rig_name)
    for line in lines:
        log.info(line)

    def images_of(numbers: list[int]) -> Iterator[Sequence[np.ndarray]]:
        frames = table["frame"].iloc[numbers].tolist()
        return (now.images for now in some_instants(recording, frames))

    for line in lost_lines(table, the_rig, the_handle, images_of):
        log.info(line)
    return table


def track_folder(
    folder: str | Path,
    out: str | Path,
    rig: Rig | str | Path | None = None,
    handle: Handle | str | Path | None = None,
    timestamps: str | Path | None = None,
    **options: Any,
) -> pd.DataFrame:
    """Follow the handle through a recording folder, see `recording`.

    Parameters
    ----------
    folder : path
    out : path
        As for `track_files`, which also has the other options and the errors.
    rig, handle : optional
        Instead of the folder's own, as for `track_files`; a rig may have some of the cameras.
    timestamps : path, optional
        Another file than the folder's.
    """
    if "overlay" in options:
        raise ValueError("overlay: give watch, as workbench.films.overlay.filmed(PATH) yields it")
    rig, handle, sources, times = parts_of_folder(folder, rig, handle, timestamps)
    return track_files(rig, handle, sources, out, timestamps=times, **options)


def parts_of_folder(
    folder: str | Path,
    rig: Rig | str | Path | None,
    handle: Handle | str | Path | None,
    timestamps: str | Path | None,
) -> tuple[Rig | Path, Handle | Path, dict[str, Path], str | Path | None]:
    """Rig, handle, footage by camera and timestamps of a recording folder, or what is given instead
    of its own. Raises ValueError as `files.recording.open_folder`.
    """
    if not isinstance(folder, (str, Path)):
        raise ValueError(f"folder: expected a recording folder, got {type(folder).__name__}")
    rig = rig if rig is None or isinstance(rig, Rig) else rig_file(rig)
    handle = handle if handle is None or isinstance(handle, Handle) else handle_file(handle)
    recording, _ = open_folder(folder, rig, handle)
    if timestamps is None and recording.times_s is not None:
        timestamps = recording.times_from
    return (
        Path(folder, "rig.toml") if rig is None else rig,
        Path(folder, "handle.toml") if handle is None else handle,
        {name: one.path for name, one in zip(recording.rig.names, recording.footage, strict=True)},
        timestamps,
    )


def follow(
    recording: Recording,
    handle: Handle,
    parameters: FollowParameters,
    known: Mapping[int, RigidTransform],
    progress: bool,
    watch: Watch | None = None,
) -> tuple[pd.DataFrame, Offsets | None]:
    """The poses of all instants as a table with the columns of `POSE_COLUMNS`, and how far the clocks
    lie apart. Poses that are `known` have the numbers of their frames.
    """
    rig = recording.rig
    rows: list[tuple] = []
    measured: dict[int, list[bool]] = {}
    times_s: list[float] = []
    pixels: list[Array] = []
    drift_monitor = DriftMonitor(rig, handle, parameters)
    steps = posetracker.track_instants(instants(recording), rig, handle, parameters, known)
    with (
        logging_redirect_tqdm(),
        tqdm(total=recording.length, unit="instant", disable=None if progress else True) as bar,
    ):
        for now, tracked in steps:
            pose = tracked.measurement.pose
            rows.append(pose_row(now.frame, now.t_s, pose))
            uv = _identified(tracked, len(handle.marker_centres))
            if len(times_s) < MOST_INSTANTS:
                times_s.append(now.t_s)
                pixels.append(uv)
            drift_monitor.add(now.frame, now.t_s, uv, pose.T_world_handle)
            if watch is not None:
                watch(recording, now, tracked)
            if pose.status == "measured":
                measured[now.frame] = [bool((row >= 0).any()) for row in tracked.measurement.labels]
            share = len(measured) / (now.frame + 1)
            bar.set_postfix_str(f"tracked {100 * share:.0f} %", refresh=False)
            bar.update()
        offsets = None
        if len(times_s) > 1:
            offsets = estimate_offsets(np.array(times_s), np.stack(pixels, axis=1), rig)
        late = late_lines(offsets, rig) if offsets else []
        idle = idle_lines(list(measured), list(measured.values()), rig)
        for line in [*late, *drift_monitor.drift(), *idle]:
            log.info(line)
    return pd.DataFrame(rows, columns=list(POSE_COLUMNS)), offsets


def _identified(tracked: posetracker.Tracked, markers: int) -> Array:
    """The pixels (cameras, markers, 2) of the identified markers, also where a pose was refused."""
    labels = tracked.measurement.labels if tracked.labels is None else tracked.labels
    pixels = tuple(markers.uv for markers in tracked.measurement.markers)
    return labelled_pixels(labels, pixels, markers)


class DriftMonitor:
    """The instants of a track in which a drift of the rig would show: of long ones every second,
    every fourth, ...
    """

    def __init__(self, rig: Rig, handle: Handle, parameters: FollowParameters) -> None:
        self.rig = rig
        self.handle = handle
        self.parameters = parameters
        self.every = 1
        self.instants: list[tuple[int, float, RigidTransform, Array]] = []

    def add(self, frame: int, t_s: float, uv: Array, T: RigidTransform | None) -> None:
        """Add an instant with the pixels (cameras, markers, 2) of its identified markers, and its
        pose; where that was refused, the pose that the markers give.
        """
        if frame % self.every:
            return
        if T is None:
            T = fit_pose(uv, self.rig, self.handle).T_world_handle
        if T is None:
            return
        self.instants.append((frame, t_s, T, uv))
        if len(self.instants) > MOST_INSTANTS:
            self.every *= 2
            self.instants = [one for one in self.instants if one[0] % self.every == 0]

    def drift(self) -> list[str]:
        """A line if a camera has turned, else none."""
        if not self.instants:
            return []
        frames, times, poses, uv = zip(*self.instants, strict=True)
        batch = RigidTransform.concatenate(list(poses))
        p = self.parameters.identity
        series = drift.image_offsets(self.rig, self.handle, batch, np.stack(uv), p)
        drifted = drift.find_drift(series, self.rig)
        if drifted is None:
            return []
        names = " or ".join(self.rig.names[c] for c in drifted.cameras)
        return [
            f"{names}: turned by {drifted.turned_deg:.3f} deg ({drifted.shift_px:.1f} px, as far as that "
            f"shows) at {times[drifted.instant]:.2f} s (frame {frames[drifted.instant]}); from there on "
            "the rig file does not hold"
        ]


def known_poses(path: str | Path | None, recording: Recording) -> dict[int, RigidTransform]:
    """The poses of a start file by their frames."""
    if path is None:
        return {}
    if not (known := poses_by_frame(read_poses(path))):
        raise ValueError(f"{path}: no row holds a pose")
    # of a video nobody knows how long it is
    if recording.footage[0].names and min(known) >= recording.length:
        raise ValueError(
            f"{path}: no frame in common with the recording, which has {recording.length}"
        )
    return known
