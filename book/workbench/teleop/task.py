"""A task for the whole loop, from images to the arm: fifteen seconds of a hand, its clutch and its
scale.

The tool approaches a block and presses against its side; the clutch is opened, the hand brought
back, the clutch closed anew; a camera is covered; the light goes out, the pose is lost, and the
tool holds until the clutch is closed anew; the scale is changed from 3 to 1/2; the tool touches the
middle of the block's top. The hand does not see where the arm is. Its way is planned once, and all
that the arm does follows from the images.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.bench.motion import motion_at
from trinolab.bench.rendering import PARTIAL, cached_folder, made_from, write_recording
from trinolab.bench.scenario import Job, following
from trinolab.camera import Camera, Rig
from trinolab.checks import Array, as_whole
from trinolab.datasets import data_path, load_handle, load_rig
from trinolab.files.rigs import read_camera
from trinolab.methods import DEFAULT
from trinolab.slave.arm import forward, load_robot
from trinolab.slave.mapping import alignment

from ..provenance import code_hash
from .monitor import SMALLEST
from .operators import least_jerk
from .teleoperate import Done, recorded, teleoperate

RATE_HZ = 15.0  # of the cameras: half of the usual, which halves the time to render them
COARSE, FINE = 3.0, 0.5  # scales
SIDE_MM = (-500.0, 160.0, 45.0)  # of the block in the shipped model: a point of the side, base
TARGET_MM = (-500.0, 200.0, 60.0)  # the middle of its top
PRESSED_MM = 2.0  # so far beyond the side, or the top, the hand leads the tool
RADIUS_MM = 5.0  # of the tool
COVERED_S = (7.6, 8.6, 1)  # the second camera is covered
DARK_S = (9.4, 10.1)  # no camera sees anything
_START_MM = (25.0, 5.0, 540.0)  # of the hand
_TREMBLES_MM, _TURNS_DEG, _TREMOR_MM_S, _TURN_DEG_S = 0.15, 3.0, 3.0, 3.0


class Leg(NamedTuple):
    """A part of the way: until when, s; the scale while the clutch is closed, None while it is
    open; where the tool shall go (base, mm), or the hand (world, mm) where the tool is to rest.
    """

    until_s: float
    scale: float | None
    tool: tuple[float, float, float] | None = None
    hand: tuple[float, float, float] | None = None


_FRONT_Y = SIDE_MM[1] - RADIUS_MM
LEGS = (
    Leg(0.8, None),
    Leg(3.0, COARSE, tool=(SIDE_MM[0], _FRONT_Y - 15, SIDE_MM[2])),  # the approach
    Leg(3.6, COARSE, tool=(SIDE_MM[0], _FRONT_Y + PRESSED_MM, SIDE_MM[2])),  # the contact
    Leg(4.4, COARSE),
    Leg(5.3, COARSE, tool=(SIDE_MM[0], _FRONT_Y - 30, 100.0)),
    Leg(5.8, COARSE),
    Leg(6.9, None, hand=(0.0, 0.0, 560.0)),  # the clutch is open: the hand comes back
    Leg(7.2, None),
    Leg(8.2, COARSE, tool=(-430.0, 150.0, 130.0)),  # a camera is covered
    Leg(9.0, COARSE, tool=(-480.0, 190.0, 90.0)),
    Leg(9.5, COARSE),  # the light goes out
    Leg(10.6, COARSE, hand=(20.0, -10.0, 560.0)),  # the hand goes on; the tool holds
    Leg(10.8, COARSE),
    Leg(11.1, None),
    Leg(11.8, COARSE, tool=(TARGET_MM[0], TARGET_MM[1], TARGET_MM[2] + 12)),  # clutch closed anew
    Leg(12.3, COARSE),
    Leg(12.6, None),
    Leg(14.2, FINE, tool=(TARGET_MM[0], TARGET_MM[1], TARGET_MM[2] - PRESSED_MM)),
    Leg(15.0, FINE),
)


def script() -> str:
    """When the clutch is closed, and at which scale, as a table for `teleoperate` (CSV)."""
    rows = ["t_s,closed,scale"]
    begin = 0.0
    before: float | None = None
    for leg in LEGS:
        if leg.scale != before:
            rows.append(f"{begin:g},{int(leg.scale is not None)},{leg.scale or before or COARSE:g}")
        begin = leg.until_s
        before = leg.scale
    return "\n".join([*rows, ""])


def hand(seed: int = 0) -> tuple[Array, RigidTransform]:
    """Times, s, shape (n,), and the hand's n poses T_world_handle: the legs, and a seeded tremor."""
    times = np.arange(round(RATE_HZ * LEGS[-1].until_s)) / RATE_HZ
    robot = load_robot()
    to_base = alignment(read_camera(data_path("robots", "ur5_view.toml")))
    tool = forward(robot, robot.home).translation
    place = np.array(_START_MM)
    positions = np.empty((len(times), 3))
    begin = 0.0
    for leg in LEGS:
        goal = place
        if leg.tool is not None and leg.scale is not None:
            goal = place + to_base.inv().apply(np.array(leg.tool) - tool) / leg.scale
            tool = np.array(leg.tool)
        elif leg.hand is not None:
            goal = np.array(leg.hand)
        now = (times >= begin - 1e-9) & (times < leg.until_s - 1e-9)
        share = (times[now] - begin) / (leg.until_s - begin)
        positions[now] = place + least_jerk(share)[:, None] * (goal - place)
        begin = leg.until_s
        place = goal
    trembling = motion_at(
        np.random.default_rng([seed, 2]),
        times,
        speed_mm_s=_TREMOR_MM_S,
        turn_deg_s=_TURN_DEG_S,
        x_mm=(-_TREMBLES_MM, _TREMBLES_MM),
        y_mm=(-_TREMBLES_MM, _TREMBLES_MM),
        z_mm=(-_TREMBLES_MM, _TREMBLES_MM),
        tilt_deg=(90 - _TURNS_DEG, 90 + _TURNS_DEG),
    )
    return times, RigidTransform.from_components(
        positions + trembling.translation, trembling.rotation
    )


def rig() -> Rig:
    """The rig `raised_40deg`, two by two pixels read out as one: a quarter of the pixels to render."""
    whole = load_rig("raised_40deg")
    return replace(whole, cameras=tuple(_binned(camera) for camera in whole.cameras))


def job(seed: int = 0) -> Job:
    """The images to be made: the hand holds the handle along its way, cameras and light are as the
    script has them.
    """
    the_rig = rig()
    times, poses = hand(as_whole(seed, "seed", 0, 2**63 - 1))
    shots = []
    for t, shot in zip(times, following(the_rig, list(poses)), strict=True):
        lights = np.ones(len(the_rig.cameras))
        if COVERED_S[0] <= t < COVERED_S[1]:
            lights[COVERED_S[2]] = 0.0
        if DARK_S[0] <= t < DARK_S[1]:
            lights[:] = 0.0
        shots.append(shot._replace(gains=tuple(lights.tolist())))
    return Job(the_rig, load_handle("coded"), shots, times, seed)


def recording(seed: int = 0, progress: bool = True) -> Path:
    """The recording folder of the task; rendered, in a minute, if it is not in the user's
    cache yet.
    """
    to_do = job(seed)
    manifest = made_from(to_do, "task")
    return cached_folder(
        f"task-{seed}", manifest, lambda folder: write_recording(to_do, folder, manifest, progress)
    )


def perform(
    out: str | Path,
    seed: int = 0,
    method: str = DEFAULT,
    video: bool = True,
    progress: bool = True,
) -> Done:
    """The task from its images to the arm, see `teleoperate`, also for the errors.

    Parameters
    ----------
    out : path
        A folder that is not there yet, or empty.
    seed : int
        Of the hand's tremor and of the images' noise.
    method, video, progress
        As for `teleoperate`.
    """
    with TemporaryDirectory() as folder:
        clutch = Path(folder, "clutch.csv")
        clutch.write_text(script(), encoding="utf-8")
        return teleoperate(
            recorded(recording(seed, progress)),
            out,
            scale=COARSE,
            clutch=clutch,
            method=method,
            video=video,
            size=SMALLEST,
            progress=progress,
        )


def performed(seed: int = 0) -> Path:
    """The folder that `perform` makes by the paper's method, with its film; made, in half a minute,
    if it is not in the user's cache yet.
    """
    images = recording(seed, progress=False)
    manifest = {"images": images.name, "code": code_hash(__name__)}

    def make(folder: Path) -> None:
        partial = folder.with_name(f"{folder.name}{PARTIAL}")
        if partial.is_dir():  # of a process that was stopped
            for path in partial.iterdir():
                path.unlink()
        perform(partial, seed, "paper", progress=False)
        partial.rename(folder)

    return cached_folder(f"session-{seed}", manifest, make)


def _binned(camera: Camera) -> Camera:
    """A camera whose pixels are two by two of another's; the middle of the first is between four."""
    matrix = camera.matrix.copy()
    matrix[:2] = matrix[:2] / 2
    matrix[:2, 2] = (camera.matrix[:2, 2] + 0.5) / 2 - 0.5
    width, height = camera.size
    return Camera(
        camera.name, (width // 2, height // 2), matrix, camera.distortions, camera.T_cam_world
    )
