"""What `trinolab track` does: a recording in, a pose file out, row by row, so that an interruption
loses nothing.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from ..camera import Rig
from ..checks import Array
from ..datasets import handle_file, handle_of, rig_file, rig_of
from ..default_covariance import assumed
from ..files import limits
from ..files.kept import KeptLines
from ..files.outputs import check_targets, write_together
from ..files.poses import (
    POSE_COLUMNS,
    STATUSES,
    contradictions,
    pose_row,
    poses_by_frame,
    poses_text,
    read_poses,
    tum_text,
)
from ..files.recording import (
    Recording,
    instants,
    open_recording,
    parts_of_folder,
    some_instants,
)
from ..files.rigs import covariance_text, handle_text, rig_text
from ..files.video import Film
from ..handle import Handle
from ..identity import labelled_pixels
from ..methods import DEFAULT, estimator_of
from ..pose import Pose, fit_pose
from ..sensitivity import is_uncertain
from . import drift, posetracker
from .clocks import late_lines, widened
from .losses import lost_lines
from .overlay import picture
from .parameters import FollowParameters
from .posetracker import TrackState
from .statefile import state_of, text_of
from .sync import Offsets, estimate_offsets

log = logging.getLogger("trinolab")

PARTIAL = ".partial"  # behind the name of a pose file that is not finished
STATE = ".state"  # and behind that, of the tracker's state
STATE_EVERY = 25  # frames that are tracked again at most when a track goes on
MOST_INSTANTS = 3000  # kept for the cameras' offsets in time, and for their drift


class Job(NamedTuple):
    """What is tracked: a recording, its handle, how, and known poses by their frames."""

    recording: Recording
    handle: Handle
    parameters: FollowParameters
    known: Mapping[int, RigidTransform]


def track_files(
    rig: Rig | str | Path,
    handle: Handle | str | Path,
    sources: Mapping[str, str | Path],
    out: str | Path,
    start: str | Path | None = None,
    overlay: str | Path | None = None,
    fps: float = 30.0,
    timestamps: str | Path | None = None,
    method: str = DEFAULT,
    progress: bool = True,
) -> pd.DataFrame:
    """Follow the handle through videos or image folders, and write its poses.

    Rows are kept in a file beside `out` as they come. The same call goes on where an interrupted
    one has stopped.

    Parameters
    ----------
    rig, handle
        A `Rig` and a `Handle`, or files, or names of shipped ones, as ``raised_40deg`` and
        ``coded``.
    sources : mapping of str to path
        For each camera's name its video, or its folder of images (in the order of their names).
    out : path
        CSV of poses to write; TUM beside it, with the suffix ``.tum``.
    start : path, optional
        CSV of poses known at some frames: at the first one for a handle that looks alike from
        several sides.
    overlay : path, optional
        A .webm video (VP8) of what was found, from the frame with which this call began.
    fps : float
        Frames a second, where there are no timestamps.
    timestamps : path, optional
        CSV with the columns ``frame`` and ``t_s``.
    method : str
        The estimator, see `methods.METHODS`; ``best`` is that of all commands and of
        ``trinolab.measure``.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Returns
    -------
    pandas.DataFrame
        The table that was written.

    Raises
    ------
    ValueError
        Names the file that is missing, unreadable or does not fit, or whose rows another process
        tracks. Rows that are finished are kept.
    KeyboardInterrupt
        Says how many rows are kept.
    """
    the_rig, the_handle = rig_of(rig), handle_of(handle)
    values = [what for what in (rig, handle) if isinstance(what, Rig | Handle)]
    rig = "rig" if isinstance(rig, Rig) else rig_file(rig)
    handle = "handle" if isinstance(handle, Handle) else handle_file(handle)
    recording = open_recording(sources, the_rig, fps, timestamps)
    parameters = FollowParameters(estimator=estimator_of(method))
    job = Job(recording, the_handle, parameters, known_poses(start, recording))
    files = [path for path in (rig, handle) if isinstance(path, Path)]
    files += [Path(path) for path in (start, timestamps) if path is not None]
    tum = Path(out).with_suffix(".tum")
    film = None if overlay is None else Film(overlay, recording.rate)
    check_targets([out, tum, *([overlay] if overlay else [])], files)
    options = (start is None, timestamps is None, fps, method)
    made_from = fingerprint(files, sources, *options, *map(content_of, values))
    with Rows(Path(f"{out}{PARTIAL}"), made_from) as rows:
        try:
            with film or nullcontext():
                offsets = track_on(job, rows, film, progress)
            table = rows.table()
            if offsets is not None:
                table = widened(table, offsets, the_rig)
            write_together({out: poses_text(table), tum: tum_text(table)})
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                _kept(rows) and f"{_kept(rows)}; the same command goes on"
            ) from None
        except (ValueError, OSError) as error:
            raise ValueError(f"{error}; {_kept(rows)}".removesuffix("; ")) from None
        rows.remove()
    lines = assumed(the_rig, job.handle, rig, handle)
    if not is_uncertain(the_rig, job.handle):
        lines = contradictions(table, rig)
    for line in lines:
        log.info(line)

    def images_of(numbers: list[int]) -> Iterator[Sequence[np.ndarray]]:
        frames = table["frame"].iloc[numbers].tolist()
        return (now.images for now in some_instants(recording, frames))

    for line in lost_lines(table, the_rig, job.handle, images_of):
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
        In the place of the folder's own, as for `track_files`; a rig may have some of the cameras.
    timestamps : path, optional
        Another file than the folder's.
    """
    if not isinstance(folder, (str, Path)):
        raise ValueError(f"folder: expected a recording folder, got {type(folder).__name__}")
    rig = rig if rig is None or isinstance(rig, Rig) else rig_file(rig)
    handle = handle if handle is None or isinstance(handle, Handle) else handle_file(handle)
    parts = parts_of_folder(folder, rig, handle, timestamps)
    return track_files(
        Path(folder, "rig.toml") if rig is None else rig,
        Path(folder, "handle.toml") if handle is None else handle,
        parts.sources,
        out,
        timestamps=parts.timestamps,
        **options,
    )


class Rows(KeptLines):
    """The finished rows of a track, as lines of a CSV file; its first line names the track by its
    `fingerprint`. Beside it is a file with the tracker's state after the last frame that is a multiple of
    `STATE_EVERY`.
    """

    def __init__(self, path: Path, made_from: str) -> None:
        self._made_from = made_from
        self._state_path = path.with_name(f"{path.name}{STATE}")
        self._hidden = path.with_name(f".{path.name}{STATE}")  # while it is written
        super().__init__(path, f"# trinolab track {made_from}\n{','.join(POSE_COLUMNS)}\n", _is_row)

    def add(self, frame: int, t_s: float, pose: Pose) -> None:
        """One more row, see `add_line`."""
        cells = (
            f"{cell:.9g}" if isinstance(cell, float) else str(cell)
            for cell in pose_row(frame, t_s, pose)
        )
        self.add_line(",".join("" if cell == "nan" else cell for cell in cells))

    def table(self) -> pd.DataFrame:
        """The rows so far."""
        return pd.read_csv(io.StringIO("\n".join([",".join(POSE_COLUMNS), *self.lines()])))

    def keep_state(self, frame: int, state: TrackState, rig: Rig) -> TrackState:
        """Keep the tracker's state after every so many frames, in the place of the one before, and
        return the state to go on with. Raises ValueError if it cannot be written.
        """
        if (frame + 1) % STATE_EVERY:
            return state
        text = text_of(state, rig)
        try:
            self._hidden.write_text(f"{self._made_from} {frame}\n{text}\n", encoding="utf-8")
            self._hidden.replace(self._state_path)
        except OSError as error:
            self._hidden.unlink(missing_ok=True)
            raise ValueError(f"{self._state_path}: cannot be written ({error.strerror})") from None
        return state_of(text, rig)

    def kept_state(self, rig: Rig) -> tuple[int, TrackState | None]:
        """The first frame that the tracker has to see again, and its state before: that which was
        kept last, of a frame that has its row. Without one it is the very first frame.
        """
        try:
            content = limits.read_bytes(self._state_path, limits.TREE_BYTES).decode()
            head, text, _ = content.split("\n")
            made_from, number = head.split(" ")
            frame = int(number)
            if made_from == self._made_from and 0 <= frame < len(self.lines()):
                return frame + 1, state_of(text, rig)
        except (OSError, ValueError):  # there is none, or it was cut off
            pass
        return 0, None

    def remove(self) -> None:
        """Remove the rows and the state, and close the file."""
        for path in (self._state_path, self._hidden):
            path.unlink(missing_ok=True)
        super().remove()


def fingerprint(
    files: Sequence[str | Path], sources: Mapping[str, str | Path], *options: Any
) -> str:
    """What tells one track from another: the contents of its files, its footage as it lies there,
    its options.
    """
    contents = [hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in files]
    where = {name: [str(Path(path).resolve()), stamp(Path(path))] for name, path in sources.items()}
    return hashlib.sha256(
        json.dumps([contents, where, [str(o) for o in options]]).encode()
    ).hexdigest()[:16]


def content_of(value: Rig | Handle) -> str:
    """What tells one rig or handle from another."""
    if isinstance(value, Handle):
        return handle_text(value)
    known = value.covariance
    return rig_text(value) + ("" if known is None else covariance_text(known))


def stamp(path: Path) -> list[tuple[str, int, int]]:
    """Names, sizes and times of a video, or of a folder's images."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return [(file.name, (about := file.stat()).st_size, about.st_mtime_ns) for file in files]


def _is_row(frame: int, line: str) -> bool:
    """Whether a line is the row of a frame."""
    row = dict(zip(POSE_COLUMNS, line.split(","), strict=False))
    status = row.pop("status", "")
    try:
        numbers = [float(cell) for cell in row.values() if cell]
    except ValueError:
        return False
    return (
        line.count(",") == len(POSE_COLUMNS) - 1
        and status in STATUSES
        and bool(numbers)
        and row["frame"] == str(frame)
    )


def _kept(rows: Rows) -> str:
    """What is there of a track that has stopped; of no row there is no file."""
    if count := len(rows.lines()):
        return f"{count} rows are kept in {rows.path}"
    rows.remove()
    return ""


def track_on(job: Job, rows: Rows, film: Film | None, progress: bool) -> Offsets | None:
    """Track from the first frame that has no row; the frames since the last state that was kept are
    tracked again, so that the next ones come out as if nothing had stopped it. The result is how far
    the clocks lay apart in what was tracked.
    """
    done = rows.table()
    rig = job.recording.rig
    first, state = rows.kept_state(rig)
    measured = int((done["status"] == "measured").sum())
    seen = Seen([], [])
    watched = Watched(job.recording.rig, job.handle, job.parameters)
    steps = posetracker.track_instants(
        instants(job.recording, first),
        rig,
        job.handle,
        job.parameters,
        job.known,
        state,
        lambda frame, after: rows.keep_state(frame, after, rig),
    )
    with (
        logging_redirect_tqdm(),
        tqdm(
            total=job.recording.length,
            initial=len(done),
            unit="instant",
            disable=None if progress else True,
        ) as bar,
    ):
        for now, tracked in steps:
            if now.frame < len(done):
                continue  # its row is there
            rows.add(now.frame, now.t_s, tracked.measurement.pose)
            seen.add(now.t_s, tracked, len(job.handle.marker_centres))
            watched.add(now.frame, now.t_s, tracked)
            if film is not None:
                film.add(picture(now.images, tracked, job.recording.rig, now.frame, now.t_s))
            measured += tracked.measurement.pose.status == "measured"
            bar.set_postfix_str(f"tracked {100 * measured / (now.frame + 1):.0f} %", refresh=False)
            bar.update()
        offsets = seen.offsets(rig)
        late = late_lines(offsets, rig) if offsets else []
        for line in [*late, *watched.drift()]:
            log.info(line)
    return offsets


def _identified(tracked: posetracker.Tracked, markers: int) -> Array:
    """The pixels (cameras, markers, 2) of the identified markers, also where a pose was refused."""
    labels = tracked.measurement.labels if tracked.labels is None else tracked.labels
    pixels = tuple(found.uv for found in tracked.measurement.found)
    return labelled_pixels(labels, pixels, markers)


class Seen(NamedTuple):
    """Identified markers of the instants so far: times, s, and pixels (cameras, markers, 2)."""

    times_s: list[float]
    uv: list[Array]

    def add(self, t_s: float, tracked: posetracker.Tracked, markers: int) -> None:
        """One more instant, as long as they are few enough to be kept."""
        if len(self.times_s) < MOST_INSTANTS:
            self.times_s.append(t_s)
            self.uv.append(_identified(tracked, markers))

    def offsets(self, rig: Rig) -> Offsets | None:
        """How far the clocks lie apart; None for less than two instants."""
        if len(self.times_s) < 2:
            return None
        return estimate_offsets(np.array(self.times_s), np.stack(self.uv, axis=1), rig)


class Watched:
    """The instants of a track in which a drift of the rig would show: of long ones every second,
    every fourth, ...
    """

    def __init__(self, rig: Rig, handle: Handle, parameters: FollowParameters) -> None:
        self.rig = rig
        self.handle = handle
        self.parameters = parameters
        self.every = 1
        self.instants: list[tuple[int, float, RigidTransform, Array]] = []

    def add(self, frame: int, t_s: float, tracked: posetracker.Tracked) -> None:
        """One more instant, if its markers were identified: also where a pose was refused."""
        if frame % self.every:
            return
        uv = _identified(tracked, len(self.handle.marker_centres))
        pose = tracked.measurement.pose
        if pose.T_world_handle is None:
            pose = fit_pose(uv, self.rig, self.handle)
        if pose.T_world_handle is None:
            return
        T = pose.T_world_handle
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
