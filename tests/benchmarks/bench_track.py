"""Milliseconds an instant of the tracker takes, from frames in memory, beside a plain OpenCV chain in the
same run.

A hand holds the handle and moves at a person's pace; two and three cameras of 1280 x 1024, before a
textured and a flat background. Beside it the paper's chain (Eq. 5-24), and SimpleBlobDetector right
after each of its instants. How the times of all instants of the standard motions spread is in the table
`instant_times`:

    python tests/benchmarks/bench_track.py
"""

import clock
import numpy as np
from bench_measure import HANDLE, RIG, errors, opencv_chain

from trinolab import tracker
from trinolab.bench.hand import Arm
from trinolab.bench.motion import human_motion
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_clip, render_rig
from trinolab.following import posetracker
from trinolab.following.parameters import FollowParameters
from workbench.studies.instant_times import blob_detector

LIMITS_MS = {"paper": 5.0, "patches": 8.0}  # three cameras
CHAIN_MS = 15.0  # an instant of the paper's chain, three cameras
FPS, COUNT = 30.0, 60


def follow(rig, frames, truths, estimator, limit):
    p, state, found = FollowParameters(estimator=estimator), posetracker.start(-1 / FPS), []
    with clock.clocked(posetracker, "expect", "follow") as spent:
        for k, images in enumerate(frames):
            (state, one), ms = clock.timed(posetracker.step, state, images, k / FPS, rig, HANDLE, p)
            found.append((one.measurement.pose.T_world_handle, ms))
    poses, times = zip(*found, strict=True)
    stages = ", ".join(f"{stage} {ms / len(frames):.2f}" for stage, ms in spent.items())
    clock.line(
        f"follower, {estimator}", times, "ms", limit, f"{errors(poses, truths)}; mean of {stages}"
    )


def paper_chain(rig, frames, truths, bench, limit):
    """Background, window, markers, matches, points, pose."""
    empty = render_rig(rig, HANDLE, None, bench, np.random.default_rng(1))
    detector = blob_detector(rig, HANDLE)
    state, found = tracker.start(empty, rig, -1 / FPS), []
    for k, images in enumerate(frames):
        (state, one), ms = clock.timed(tracker.step, state, images, k / FPS, rig, HANDLE)
        alone_ms = clock.timed(lambda images=images: [detector.detect(image) for image in images])[
            1
        ]
        found.append((one.pose.T_world_handle, ms, alone_ms))
    poses, times, alone = zip(*found, strict=True)
    clock.line("SimpleBlobDetector", alone)
    clock.line("the paper's chain", times, "ms", limit, errors(poses, truths))


def main() -> int:
    truths = list(human_motion(np.random.default_rng(3), np.arange(COUNT) / FPS))
    for cameras, contrast in ((3, 0.15), (2, 0.15), (3, 0.0)):
        print(f"{cameras} cameras, {'textured' if contrast else 'flat'} background")
        rig = RIG.part(range(cameras))
        bench = Bench(texture_contrast=contrast)
        frames = list(render_clip(rig, HANDLE, truths, bench, np.random.default_rng(0), Arm()))
        if cameras == 3:
            plain = [opencv_chain(images, T) for images, T in zip(frames, truths, strict=True)]
            poses, times = zip(*plain, strict=True)
            clock.line("OpenCV, markers told", times, more=errors(poses, truths))
        for estimator, limit in LIMITS_MS.items():
            follow(rig, frames[:5], truths[:5], estimator, None)  # what is made once
            follow(rig, frames, truths, estimator, limit if cameras == 3 else None)
        paper_chain(rig, frames, truths, bench, CHAIN_MS if cameras == 3 else None)
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
