"""Recordings rendered by the simulated bench: every frame of a scenario, with the truth, in a
recording folder.

The noise of a frame follows from the seed, the frame and the camera, so that an interrupted
rendering can be resumed. The two standard recordings are rendered at first use, and stored in the
user's cache.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import shutil
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from stat import S_ISREG
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from tqdm import tqdm

from ..camera import Camera, Rig
from ..checks import as_number, as_whole
from ..datasets import handle_of, load_handle, load_rig, rig_of
from ..files.fetch import cache_folder
from ..files.journal import locked
from ..files.outputs import write_whole
from ..files.poses import pose_table, poses_by_frame, read_poses
from ..files.recording_writer import (
    PARTIAL,
    add,
    begin,
    check_names,
    claim,
    finish,
    image_paths,
    partial_of,
)
from ..handle import Handle
from ..pose import LOST, Pose
from ..workers import serve_parent
from .scenario import Job, Shot, calm, empty, following, hard, seen_markers, slow, take

SCRIPTS = {"calm": calm, "hard": hard, "slow": slow}
SECONDS = 10.0  # of a standard recording
# behind the name of a standard recording: whoever renders it has this file; it is being removed
LOCK = ".lock"
REMOVED = ".removed"
WORKERS = 2  # processes, where the machine has as many
# The code that decides what a recording shows: with another one it is another recording. A test holds
# that these are all that `scenario` imports.
DRAWN_WITH = ("bench/*.py", "camera.py", "checks.py", "handle.py", "lens.py", "rigid.py")
_worker: dict[str, Any] = {}  # of a process of the pool: its job


def render(
    rig: Rig | str | Path,
    handle: Handle | str | Path,
    motion: str | Path,
    out: str | Path,
    seed: int = 0,
    seconds: float | None = None,
    fps: float = 30.0,
    progress: bool = True,
) -> pd.DataFrame:
    """Render a recording folder with its truth; interrupted and called again in the same way, it
    goes on.

    Parameters
    ----------
    rig, handle
        A `Rig` and a `Handle`, or files, or names of shipped ones, as ``raised_40deg`` and
        ``coded``.
    motion : str or path
        ``calm``, ``hard`` or ``slow``, the scenarios of `scenario`; or a CSV of poses, a hand holds the
        handle along them.
    out : path
        The folder to write. Until it is whole, all is in the folder ``<out>.partial`` beside it.
    seed : int
        Of motion and noise.
    seconds : float, optional
        Length; 10 for a script, and all poses of a file.
    fps : float
        Frames per second; a file's own times take precedence.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Returns
    -------
    pandas.DataFrame
        The truth that was written.

    Raises
    ------
    ValueError
        Names the file or the argument that is missing, unreadable or does not fit; the folder that
        exists already, cannot be written, was begun with other arguments, or that another process
        works on.
    """
    rig, handle = rig_of(rig), handle_of(handle)
    motion = str(motion)
    seed = as_whole(seed, "seed", 0, 2**63 - 1)
    if motion in SCRIPTS:
        job = scripted(motion, rig, handle, seed, SECONDS if seconds is None else seconds, fps)
    else:
        job = Job(rig, handle, *_followed(motion, rig, seconds, fps), seed)
    return write_recording(job, out, made_from(job, motion), progress)


def scripted(
    name: str, rig: Rig, handle: Handle, seed: int, seconds: float, fps: float = 30.0
) -> Job:
    """The job of a script. Raises ValueError for an unknown script, or a length without a frame."""
    if name not in SCRIPTS:
        raise ValueError(f"motion: expected {', '.join(SCRIPTS)} or a CSV of poses, got {name!r}")
    fps = as_number(fps, "fps", 0.0, 1e4, open_low=True)
    times = np.arange(round(as_number(seconds, "seconds", 0.0, 3600.0, open_low=True) * fps)) / fps
    if len(times) == 0:
        raise ValueError(
            f"seconds: expected one frame or more at {fps:g} frames per second, got {seconds!r}"
        )
    return Job(rig, handle, SCRIPTS[name](rig, times, seed), times, seed)


def made_from(job: Job, motion: str) -> dict[str, Any]:
    """Hashes of everything that decides the content of a recording: for the manifest, and for a
    cache's key.
    """
    parts = {
        "rig": [_camera_numbers(camera) for camera in job.rig.cameras],
        "handle": asdict(job.handle),
        "bench": asdict(job.bench),
        "times": list(job.times_s),
        "instants": [_shot_numbers(shot) for shot in job.shots],
        "code": _hash_of_code(DRAWN_WITH),
    }
    short = {
        name: hashlib.sha256(json.dumps(part).encode()).hexdigest()[:16]
        for name, part in parts.items()
    }
    return {"motion": Path(motion).name, "seed": job.seed, "frames": len(job.shots), **short}


@lru_cache
def _hash_of_code(patterns: tuple[str, ...]) -> str:
    """A hash of some of the package's files, as they are when a process asks first."""
    package = Path(__file__).resolve().parents[1]
    state = hashlib.sha256()
    for pattern in patterns:
        for path in sorted(package.glob(pattern)):
            state.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return state.hexdigest()


def write_recording(
    job: Job,
    out: str | Path,
    manifest: dict[str, Any],
    progress: bool = True,
    workers: int = WORKERS,
) -> pd.DataFrame:
    """Render what is not there yet, and give the folder its name; see `render`, also for the
    errors.
    """
    partial = partial_of(out)
    check_names(job.rig.names)
    try:
        partial.mkdir(exist_ok=True)
    except OSError as error:
        raise ValueError(f"{partial}: cannot be written ({error.strerror})") from None
    with locked(partial):
        claim(partial, manifest)
        begin(
            out,
            job.rig,
            job.handle,
            {camera.name: empty(job, k) for k, camera in enumerate(job.rig.cameras)},
        )
        seen = np.zeros((len(job.shots), len(job.rig.cameras)), int)
        with (
            tqdm(
                total=len(job.shots), unit="instant", disable=None if progress else True
            ) as progress_bar,
            closing(_all_frames(job, partial, min(workers, os.cpu_count() or 1))) as frames,
        ):
            for frame, counts in frames:
                seen[frame] = counts
                progress_bar.update()
        table = pd.DataFrame(seen, columns=list(job.rig.names)).rename_axis("frame").reset_index()
        write_whole(partial / "truth_markers.csv", table.to_csv(index=False))
        truth = truth_of(job, seen)
        finish(out, list(job.times_s), truth)
    return truth


def truth_of(job: Job, seen: np.ndarray) -> pd.DataFrame:
    """The true poses; `seen` is how many markers each camera truly sees, int (frames, cameras)."""
    poses = [
        LOST
        if shot.T_world_handle is None
        else Pose(
            "measured",
            shot.T_world_handle,
            np.zeros((6, 6)),
            0.0,
            int(row.max()),
            int((row > 0).sum()),
        )
        for shot, row in zip(job.shots, seen, strict=True)
    ]
    return pose_table(poses, list(job.times_s))


def _followed(
    path: str | Path, rig: Rig, seconds: float | None, fps: float
) -> tuple[list[Shot], np.ndarray]:
    """The instants of a file of poses, and their times."""
    if not Path(path).is_file():
        if Path(path).suffix or len(Path(path).parts) > 1:
            raise ValueError(f"motion: {path}: no such file")
        raise ValueError(f"motion: expected {', '.join(SCRIPTS)} or a CSV of poses, got {path!r}")
    table = read_poses(path).sort_values("frame")
    if not (poses := poses_by_frame(table)):
        raise ValueError(f"{path}: no pose in it")
    if not np.array_equal(table["frame"], np.arange(len(table))):
        missing = int(np.flatnonzero(table["frame"].to_numpy() != np.arange(len(table)))[0])
        raise ValueError(
            f"{path}: frame {missing} is missing; an instant without the handle has the status 'lost'"
        )
    times = _times_of(table, path, as_number(fps, "fps", 0.0, 1e4, open_low=True))
    if seconds is not None:
        times = times[times - times[0] < as_number(seconds, "seconds", 0.0, open_low=True)]
    return following(rig, [poses.get(k) for k in range(len(times))]), times


def _times_of(table: pd.DataFrame, path: str | Path, fps: float) -> np.ndarray:
    """The instants' own times, s; where there are none they follow from the frames per second."""
    if "t_s" not in table or table["t_s"].isna().all():
        return np.arange(len(table)) / fps
    times = table["t_s"].to_numpy(float)
    if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
        raise ValueError(f"{path}: column 't_s' expects increasing seconds")
    return times


def _camera_numbers(camera: Camera) -> list[Any]:
    T = camera.T_cam_world
    return [
        camera.name,
        camera.size,
        camera.matrix.tolist(),
        camera.distortions.tolist(),
        T.as_matrix().tolist(),
    ]


def _shot_numbers(shot: Shot) -> list[Any]:
    pose = None if shot.T_world_handle is None else shot.T_world_handle.as_matrix().tolist()
    arm = None if shot.arm is None else asdict(shot.arm)
    return [pose, arm, shot.gains, shot.velocity.tolist(), shot.turn_rate.tolist(), shot.shadows]


def _one_frame(job: Job, partial: Path, frame: int) -> tuple[int, list[int]]:
    """Write the images of an instant that are not there yet; return it with its truly seen
    markers.
    """
    if not all(path.is_file() for path in image_paths(partial, job.rig, frame)):
        add(partial, job.rig, frame, [take(job, frame, k) for k in range(len(job.rig.cameras))])
    return frame, seen_markers(job, frame)


def _all_frames(
    job: Job, partial: Path, workers: int
) -> Generator[tuple[int, list[int]], None, None]:
    """Every frame, in two processes where the system can copy this one, else here."""
    if workers < 2 or len(job.shots) < 8 or "fork" not in multiprocessing.get_all_start_methods():
        yield from (_one_frame(job, partial, frame) for frame in range(len(job.shots)))
        return
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # its threads would be missing in the copies
    pool = ProcessPoolExecutor(
        workers, multiprocessing.get_context("fork"), _start_worker, (job, partial)
    )
    try:
        yield from pool.map(_worker_frame, range(len(job.shots)))
    except BrokenProcessPool:
        raise OSError(
            "a process that renders was ended from outside; what it has rendered is kept"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)
        cv2.setNumThreads(threads)


def _start_worker(job: Job, partial: Path) -> None:
    """Keep the job, for a process that serves its parent alone."""
    serve_parent()
    _worker.update(job=job, partial=partial)


def _worker_frame(frame: int) -> tuple[int, list[int]]:
    return _one_frame(_worker["job"], _worker["partial"], frame)


def standard_recording(
    name: str,
    seed: int = 0,
    seconds: float = SECONDS,
    rig_name: str = "raised_40deg",
    handle_name: str = "coded",
    progress: bool = True,
) -> Path:
    """The folder of a standard recording, 30 frames per second; rendered, in a minute or two, if it
    is not there yet.

    A recording is identified by its name, seed, length, rig and handle, and by the code that
    renders it; if one of these changes, it is rendered anew. The first seconds of a longer one are
    the same.

    Parameters
    ----------
    name : {"calm", "hard"}
        See `scenario`.
    seed : int
        Of motion and noise.
    seconds : float
        Length.
    rig_name, handle_name : str
        Of the shipped rigs and handles.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Raises
    ------
    ValueError
        If a name is unknown, the seed or the length is out of range, or the cache cannot be
        written.
    """
    job = scripted(
        name,
        load_rig(rig_name),
        load_handle(handle_name),
        as_whole(seed, "seed", 0, 2**63 - 1),
        seconds,
    )
    manifest = made_from(job, name)
    return cached_folder(
        f"{name}-{rig_name}-{handle_name}-{seed}",
        manifest,
        lambda folder: write_recording(job, folder, manifest, progress),
    )


def cached_folder(name: str, manifest: dict[str, Any], make: Callable[[Path], object]) -> Path:
    """A folder of the user's cache, made if it is not there yet.

    Parameters
    ----------
    name : str
        It begins with this.
    manifest : dict
        Everything that determines its content; another manifest means another folder.
    make : callable
        Makes the folder it is given, whole or not at all. One process at a time does.

    Raises
    ------
    ValueError
        If the cache cannot be written.
    """
    key = hashlib.sha256(json.dumps(manifest).encode()).hexdigest()[:12]
    folder = recordings_folder() / f"{name}-{key}"
    if folder.is_dir():
        return folder
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"{folder.parent}: cannot be written ({error.strerror})") from None
    with locked(folder.with_name(f"{folder.name}{LOCK}"), wait=True):
        if not folder.is_dir():  # another process has not made it meanwhile
            make(folder)
    return folder


def recordings_folder() -> Path:
    """The folder of the user's cache that holds standard recordings; it may be removed at any time."""
    return cache_folder() / "recordings"


class CachedRecording(NamedTuple):
    """A standard recording in the user's cache, whole or not: its name, its size, bytes, and when it
    was last written, s since 1970.
    """

    name: str
    size: int
    written_s: float


def cached_recordings() -> list[CachedRecording]:
    """The standard recordings that are kept, the last written one first."""
    recordings = []
    for name, paths in _paths_by_name().items():
        about = [one for root in paths for path in [root, *root.rglob("*")] for one in _stat(path)]
        size = sum(one.st_size for one in about if S_ISREG(one.st_mode))
        recordings.append(
            CachedRecording(name, size, max((one.st_mtime for one in about), default=0.0))
        )
    return sorted(recordings, key=lambda one: -one.written_s)


def clear_recordings(chosen: Sequence[CachedRecording] | None = None) -> list[CachedRecording]:
    """Remove standard recordings, all by default; return those that are gone.

    One that a process renders at this moment stays. One whose removal is interrupted is not taken
    for a whole one.
    """
    gone = []
    for recording in cached_recordings() if chosen is None else chosen:
        with suppress(ValueError), locked(recordings_folder() / f"{recording.name}{LOCK}"):
            for path in _paths_by_name().get(recording.name, []):
                _remove(path)
            gone.append(recording)
    with suppress(OSError):  # it is not there, or something is left
        recordings_folder().rmdir()
    return gone


def _stat(path: Path) -> list[os.stat_result]:
    """The status of a file; empty if it is gone, as files are that another process renders."""
    try:
        return [path.stat()]
    except FileNotFoundError:
        return []


def _remove(path: Path) -> None:
    """Remove a file, or a folder, which loses its name first."""
    if not path.is_dir():
        path.unlink(missing_ok=True)
        return
    nameless = path.with_name(f"{path.stem}{REMOVED}")
    if path != nameless:
        shutil.rmtree(nameless, ignore_errors=True)  # of an interrupted removal
        path = path.rename(nameless)
    shutil.rmtree(path)


def _paths_by_name() -> dict[str, list[Path]]:
    """The paths of each standard recording: the folder, the unfinished one, the lock."""
    paths: dict[str, list[Path]] = {}
    for path in sorted(recordings_folder().glob("*")):
        name = path.stem if path.suffix in (PARTIAL, LOCK, REMOVED) else path.name
        paths.setdefault(name, []).append(path)
    return paths
