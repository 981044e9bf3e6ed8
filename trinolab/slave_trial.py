"""The slave arm on trial: where a recorded track takes it (Sect. 2), and what it feels when led against a block."""

from __future__ import annotations

from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation

from . import posetracker
from .overlay import PageVideo
from .pose import motion_between, shifted
from .posetable import poses_by_frame, read_poses
from .robot import load_robot
from .session import Session
from .slave import Reading
from .standard import standard_recording
from .teleop import MappingParameters, Sample
from .teleoperating import VIDEO, recorded, teleoperate

REST_S = 1.5
FIRST = 30  # frame of the recording `calm` at which the hand has come
BLOCK_Y_MM, TOOL_RADIUS_MM, DEEP_MM = 160.0, 5.0, 3.0  # the block's side towards the arm's home, in the shipped model


def slave_at_rest() -> float | None:
    """How far the tool is from where the true handle's motion leads, at rest: the larger of mm and deg.

    The handle is tracked in the second second of `calm`, and its last pose given for `REST_S` more. None where the
    extra `slave` is missing.
    """
    if find_spec("mujoco") is None or find_spec("mink") is None:
        return None
    folder = standard_recording("calm", seconds=2.0, progress=False)
    session = Session(load_robot())
    start, samples = session.slave.read().tool, _tracked(folder)
    for sample in samples:
        moment = session.step(sample)
    truths = poses_by_frame(read_poses(folder / "truth.csv"))
    led = shifted(start, motion_between(truths[max(truths)], truths[FIRST]))  # at scale 1, axes alike
    off = motion_between(moment.reading.tool, led)
    return float(max(np.linalg.norm(off[:3]), np.rad2deg(np.linalg.norm(off[3:]))))


def pushed() -> tuple[Session, Reading]:
    """An arm whose tool a hand has led down and, away from the operator, `DEEP_MM` into the block; what it measures."""
    away = Rotation.from_euler("x", -90, degrees=True)  # the hand's right, down and away: the base's x, -z and y
    reach = (-850.0, 850.0), (-850.0, BLOCK_Y_MM - TOOL_RADIUS_MM + DEEP_MM), (30.0, 950.0)
    session = Session(load_robot(), MappingParameters(alignment=away, reach_mm=reach))
    for t in np.arange(90) / 30:
        hand = RigidTransform.from_translation([0, min(150 * t, 90), 560 + 150 * max(t - 0.6, 0)])
        reading = session.step(Sample(t, hand, "measured", True)).reading
    return session, reading


def filmed() -> tuple[pd.DataFrame, PageVideo]:
    """A stroke of the clutch while a second hand hides CCD3, from images to the arm: events, and the monitor's film.

    The images are those of the recording `hard` from 0.3 to 1.5 s.
    """
    source = recorded(standard_recording("hard", seconds=2.0, progress=False))
    with TemporaryDirectory() as folder:
        clutch, out = Path(folder, "clutch.csv"), Path(folder, "session")
        clutch.write_text("t_s,closed\n0.4,1\n0.75,0\n0.95,1\n", encoding="utf-8")
        part = source._replace(length=36, frames=islice(source.frames, 10, 46))
        done = teleoperate(part, out, clutch=clutch, progress=False)
        film = cv2.VideoCapture(str(out / VIDEO))
        still = film.read()[1]
        film.release()
        return done.events, PageVideo(out / VIDEO, "The operator's monitor: three cameras, the arm, the status.", still)


def _tracked(folder: Path) -> list[Sample]:
    """The tracked poses, the clutch closed, and the last one as long as the hand rests."""
    source = recorded(folder)
    state, samples = None, []
    for now in islice(source.frames, FIRST, source.length):
        state = state or posetracker.start(now.t_s - 1.0)
        state, tracked = posetracker.step(state, now.images, now.t_s, source.rig, source.handle)
        pose = tracked.measurement.pose
        samples.append(Sample(now.t_s, pose.T_world_handle, pose.status, True))
    last = samples[-1]
    return samples + [last._replace(t_s=last.t_s + k / 30) for k in range(1, round(30 * REST_S) + 1)]
