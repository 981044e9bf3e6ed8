"""What `trinolab teleop` does: a recording, or the simulated bench, to poses, joints, events and a
video.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm
from tqdm.contrib.logging import logging_redirect_tqdm

from trinolab.bench.rendering import scripted
from trinolab.bench.scenario import take
from trinolab.camera import Camera, Rig
from trinolab.checks import Array, as_whole
from trinolab.datasets import data_path
from trinolab.files.inputs import read_csv
from trinolab.files.journal import locked
from trinolab.files.outputs import table_text, write_together
from trinolab.files.poses import pose_table, poses_text
from trinolab.files.recording import Frames, instants, open_folder
from trinolab.files.rigs import read_camera, read_handle, read_rig
from trinolab.following import posetracker
from trinolab.following.parameters import FollowParameters
from trinolab.handle import Handle
from trinolab.methods import DEFAULT, estimator_of
from trinolab.pose import Pose
from trinolab.slave.arm import joint_values, load_robot
from trinolab.slave.mapping import MappingParameters, Sample, alignment

from ..films.video import Film
from .monitor import SIZE, Readings, blue_first, monitor_picture
from .session import Log, Moment, Session

log = logging.getLogger("trinolab")

VIDEO = "monitor.webm"
POSES = "poses.csv"
JOINTS = "joints.csv"
EVENTS = "events.csv"
MEASURED = ("measured", "ambiguous")


class Script(NamedTuple):
    """From which times on, s, the clutch is closed or open, and the scale that holds from the next
    closing of the clutch on; shape (n,) each.
    """

    times_s: Array
    closed: Array
    scales: Array


class Source(NamedTuple):
    """Where instants come from: cameras, handle, how many, how many a second, and the instants."""

    rig: Rig
    handle: Handle
    length: int
    rate: float
    frames: Iterator[Frames]


class Done(NamedTuple):
    """What a session has given: the poses' table, the joints' trajectory, and the events."""

    poses: pd.DataFrame
    joints: pd.DataFrame
    events: pd.DataFrame


def recorded(
    folder: str | Path, rig: str | Path | None = None, handle: str | Path | None = None
) -> Source:
    """The instants of a recording folder, see `recording.open_folder`, also for the arguments."""
    recording, the_handle = open_folder(folder, rig, handle)
    return Source(recording.rig, the_handle, recording.length, recording.rate, instants(recording))


def simulated(rig: str | Path, handle: str | Path, seconds: float = 10.0, seed: int = 0) -> Source:
    """The instants of the script ``calm``, taken by the simulated bench as they are asked for."""
    seed = as_whole(seed, "seed", 0, 2**63 - 1)
    job = scripted("calm", read_rig(rig), read_handle(handle), seed, seconds)
    frames = (
        Frames(k, float(t), [take(job, k, c) for c in range(len(job.rig.cameras))])
        for k, t in enumerate(job.times_s)
    )
    return Source(job.rig, job.handle, len(job.times_s), 30.0, frames)


def teleoperate(
    source: Source,
    out: str | Path,
    robot: str | Path = "ur5",
    scale: float = 1.0,
    turn_scale: float = 1.0,
    clutch: str | Path | None = None,
    view: str | Path | None = None,
    method: str = DEFAULT,
    start: Mapping[str, float] | None = None,
    video: bool = True,
    size: tuple[int, int] = SIZE,
    progress: bool = True,
) -> Done:
    """Follow the handle, move the arm, and write what happened; Ctrl-C ends the session, and it is
    written.

    Parameters
    ----------
    source : Source
        See `recorded` and `simulated`.
    out : path
        A folder that is not there yet, or empty: for ``poses.csv``, ``joints.csv`` (a row per tick),
        ``events.csv``, and ``monitor.webm`` (VP8).
    robot : str or path
        See `arm.load_robot`.
    scale, turn_scale : float
        Tool : handle, of distances and of angles.
    clutch : path, optional
        CSV with the columns ``t_s`` and ``closed`` (0 or 1), which holds from its time on; open
        before the first one. A third column, ``scale``, has the scale that holds from the next
        closing of the clutch on, in place of the argument. Without a file the clutch is closed
        while the handle is measured, as by an operator who opens it at every loss.
    view : path, optional
        A rig file with the surveillance camera, in mm in the robot's base frame; a shipped one
        without it.
    method : str
        The estimator, see `methods.METHODS`.
    start : mapping, optional
        Joint positions by name, rad, those that are not named as at home.
    video : bool
        Whether the monitor is drawn.
    size : (int, int)
        Width and height of the video, px, see `monitor.monitor_picture`.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Raises
    ------
    ValueError
        Names the argument or the file that cannot be used; before anything is computed, but for a
        damaged image, or a simulation that diverges: then what is there is written, too. Another
        process writes into the folder.
    """
    root = _new_folder(out)
    camera = read_camera(data_path("robots", "ur5_view.toml") if view is None else view)
    switch = _script(clutch, scale)
    parameters = FollowParameters(estimator=estimator_of(method))
    arm = load_robot(robot)
    session = Session(
        arm,
        MappingParameters(scale, turn_scale, alignment(camera)),
        q=joint_values(arm, start or {}, "start"),
    )
    notes = Log(session.robot.joints)
    poses = list[tuple[float, Pose]]()
    root.mkdir(exist_ok=True)
    with locked(root):
        _new_folder(out)  # another process may have been here meanwhile
        try:
            with (
                _Monitor(root, source, session, camera, size) if video else nullcontext() as monitor
            ):
                try:
                    for now, tracked, moment, closed in _moments(
                        source, session, parameters, switch, progress
                    ):
                        poses.append((now.t_s, tracked.measurement.pose))
                        notes.add(moment, closed, session.mapping.scale)
                        if monitor is not None:
                            monitor.add(now, tracked, moment, closed)
                except KeyboardInterrupt:
                    log.warning(
                        "stopped at %d of %d instants; what is done is written",
                        len(poses),
                        source.length,
                    )
        finally:
            done = Done(
                pose_table([pose for _, pose in poses], [t for t, _ in poses]),
                notes.trajectory(),
                notes.event_table(),
            )
            write_together(
                {
                    root / POSES: poses_text(done.poses),
                    root / JOINTS: table_text(done.joints),
                    root / EVENTS: table_text(done.events),
                }
            )
    return done


class _Monitor:
    """The monitor's film, a picture an instant; a context manager."""

    def __init__(
        self,
        root: Path,
        source: Source,
        session: Session,
        camera: Camera,
        size: tuple[int, int],
    ) -> None:
        from .view import SlaveView  # loads PyVista

        self._view = SlaveView(session.robot.model, camera)
        self._film = Film(root / VIDEO, source.rate)
        self._cameras = source.rig.cameras
        self._data = session.slave.data
        self._session = session
        self._size = size

    def __enter__(self) -> _Monitor:
        self._film.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._view.close()
        self._film.__exit__(*error)

    def add(self, now: Frames, tracked: posetracker.Tracked, moment: Moment, closed: bool) -> None:
        from .view import ForceArrow

        force, state = moment.reading.force, moment.state
        picture = self._view.render(
            self._data, ForceArrow(moment.reading.tool.translation, force, mm_per_n=2.0)
        )
        readings = Readings(
            now.t_s,
            tracked.measurement.pose.status,
            closed,
            state.held or None,
            moment.limits,
            float(np.linalg.norm(force)),
            100.0,
            self._session.mapping.scale,
        )
        self._film.add(
            blue_first(
                monitor_picture(now.images, tracked, self._cameras, picture, readings, self._size)
            )
        )


def _moments(
    source: Source,
    session: Session,
    parameters: FollowParameters,
    switch: Script | None,
    progress: bool,
) -> Iterator[tuple[Frames, posetracker.Tracked, Moment, bool]]:
    """Each instant with its track, the session's moment, and whether the clutch is closed."""
    coupled = False
    steps = posetracker.track_instants(source.frames, source.rig, source.handle, parameters)
    with (
        logging_redirect_tqdm(),
        tqdm(total=source.length, unit="instant", disable=None if progress else True) as bar,
    ):
        for now, tracked in steps:
            pose = tracked.measurement.pose
            closed = pose.status in MEASURED
            if switch is not None:
                closed, scale = _at(switch, now.t_s)
                if closed and not coupled:
                    session.mapping = replace(session.mapping, scale=scale)
            coupled = closed
            yield (
                now,
                tracked,
                session.step(Sample(now.t_s, pose.T_world_handle, pose.status, closed)),
                closed,
            )
            bar.update()


def _new_folder(out: str | Path) -> Path:
    root = Path(out)
    if root.exists() and not (root.is_dir() and not any(root.iterdir())):
        raise ValueError(f"{out}: exists already; name another folder, or remove it")
    if not root.parent.is_dir():
        raise ValueError(f"{out}: no such folder to write into")
    return root


def _script(path: str | Path | None, scale: float) -> Script | None:
    """What the operator does with clutch and scale; None without a file."""
    if path is None:
        return None
    table = read_csv(path)
    if missing := [name for name in ("t_s", "closed") if name not in table]:
        raise ValueError(f"{path}: no column '{missing[0]}'")
    if "scale" not in table:
        table = table.assign(scale=scale)
    times, closed, scales = (
        pd.to_numeric(table[name], errors="coerce").to_numpy(float)
        for name in ("t_s", "closed", "scale")
    )
    if not (
        np.isfinite(times).all() and np.isin(closed, (0, 1)).all() and (np.diff(times) > 0).all()
    ):
        raise ValueError(f"{path}: expected times that increase, each with closed 0 or 1")
    if not (np.isfinite(scales).all() and (scales > 0).all()):
        raise ValueError(f"{path}: column 'scale' expects numbers above 0")
    return Script(times, closed, scales)


def _at(script: Script, t_s: float) -> tuple[bool, float]:
    """Whether the clutch is closed at a time, and the scale of the script by then."""
    k = int(np.searchsorted(script.times_s, t_s + 1e-9, side="right")) - 1
    return k >= 0 and bool(script.closed[k]), float(script.scales[max(k, 0)])
