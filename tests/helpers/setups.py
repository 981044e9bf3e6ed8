"""Recordings of a printed rod before three webcams in small images: good ones, and ones with a fault."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from webcams import BENCH, WEBCAMS, webcam_rig

from satellites.classkit.wrap import wrapped
from trinolab.bench.layer import cropped
from trinolab.bench.scenario import Job, Shot, take
from trinolab.datasets import load_handle
from trinolab.files import recording_writer

FPS = 60.0
ROD = wrapped(load_handle("coded"), 20.0, 6.0)
SMALL = wrapped(load_handle("coded"), 20.0, 3.0)
SPEED_MM_S, REACH_MM = 250.0, 25.0


def small_rig(baseline_mm=200.0, cameras=3):
    """The study's webcams, of which the middle of the images is kept."""
    rig = webcam_rig(WEBCAMS[0], baseline_mm)
    return replace(
        rig.part(range(cameras)),
        cameras=tuple(cropped(camera, (120, 90), (400, 300)) for camera in rig.cameras[:cameras]),
    )


def pose_at(t_s, speed=SPEED_MM_S, rig=None):
    """The rod on its way around the place that the cameras look at."""
    baseline = np.linalg.norm((rig or small_rig()).cameras[1].centre)
    phase = speed / REACH_MM * t_s
    way = [np.sin(phase), 0.7 * np.cos(phase), 0.6 * np.sin(0.8 * phase)]
    turn = [170 + 6 * np.sin(phase), 15.0, 40 + 8 * np.cos(phase)]
    return RigidTransform.from_components(
        np.array([0.0, 0.0, np.hypot(500.0, baseline / 2)]) + REACH_MM * np.array(way),
        Rotation.from_euler("ZYX", turn, degrees=True),
    )


def shot_at(t_s, exposure_s, speed, rig):
    """The rod as a shutter that is open so long sees it on its way."""
    before, T, after = (pose_at(t_s + dt, speed, rig) for dt in (-5e-4, 0.0, 5e-4))
    share = exposure_s / 0.010 / 1e-3  # `take` smears over 10 ms
    velocity = share * (after.translation - before.translation)
    turn = share * (after.rotation * before.rotation.inv()).as_rotvec()
    return Shot(T, None, (1.0,) * len(rig.cameras), velocity, turn, False)


@cache
def clip(count=16, exposure_s=0.002, handle=ROD, baseline_mm=200.0, cameras=3, speed=SPEED_MM_S):
    """The frames (instants, cameras) of the moving rod."""
    rig = small_rig(baseline_mm, cameras)
    times = np.arange(count) / FPS
    shots = [shot_at(t, exposure_s, speed, rig) for t in times]
    job = Job(rig, handle, shots, times, 0, BENCH)
    return [[take(job, frame, c) for c in range(cameras)] for frame in range(count)]


def each(frames, change):
    """Every image changed by a function of greys, and made 8 bit again."""
    return [
        [np.clip(np.rint(change(image.astype(float))), 0, 255).astype(np.uint8) for image in images]
        for images in frames
    ]


def record(folder, frames, rig=None, handle=ROD, times=None):
    """A recording folder of frames; without a rig if `rig` is False, without a handle if that is
    None.
    """
    cameras = small_rig() if rig is None else rig
    known = cameras if rig is not False else small_rig().names
    partial = recording_writer.begin(folder, known, handle)
    for k, images in enumerate(frames):
        recording_writer.add(partial, known, k, images)
    recording_writer.finish(folder, list(np.arange(len(frames)) / FPS if times is None else times))
    return folder
