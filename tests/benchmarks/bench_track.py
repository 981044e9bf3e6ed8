"""Instants a second of the tracker on one core, from frames in memory, beside a plain OpenCV chain
in the same run.

A hand holds the handle and moves at a person's pace; two and three cameras of 1280 x 1024, before a
textured and a flat background. The floor is the time to read all pixels once. Beside it the paper's
chain (Eq. 5-24) with two and three cameras, which needs no more than 33 ms at 30 frames a second:
median, 99 % and worst instant. Then `bench_instants`: how the times of all instants of the standard
motions spread. With --long the memory over 10,000 instants instead:

    python tests/benchmarks/bench_track.py [--instants 10000] [--long]
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is loaded

import argparse
import resource
import time
from dataclasses import replace

import bench_instants
import cv2
import numpy as np
from bench_measure import HANDLE, RIG, clocked, opencv_chain
from scipy.spatial.transform import RigidTransform

from trinolab import tracker
from trinolab.bench.hand import Arm
from trinolab.bench.motion import human_motion
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_clip, render_rig
from trinolab.camera import Rig
from trinolab.following import look, posetracker
from trinolab.following.parameters import FollowParameters
from trinolab.metrics import pose_errors
from workbench.studies.instant_times import blob_detector

WANTED = {"paper": 200.0, "patches": 125.0}  # instants a second, three cameras
CHAIN_MS = 15.0  # an instant of the paper's chain, three cameras
FRAME_MS = 1e3 / 30
FPS, COUNT = 30.0, 60
CHAIN = {"_step_camera": "background and window", "measure": "the rest"}
STAGES = {"expect": "predict", "follow": "markers and pose"}


def tracked(
    frames: list[list[np.ndarray]], rig: Rig, estimator: str
) -> tuple[list, list[float], dict[str, float]]:
    """Poses, CPU time of each instant (s), and of the stages (ms, mean)."""
    p, state, poses, seconds = (
        FollowParameters(estimator=estimator),
        posetracker.start(-1 / FPS),
        [],
        [],
    )
    with clocked(posetracker, STAGES) as spent, clocked(look, {"look": "markers"}) as within:
        for k, images in enumerate(frames):
            begin = time.process_time()
            state, one = posetracker.step(state, images, k / FPS, rig, HANDLE, p)
            seconds.append(time.process_time() - begin)
            poses.append(one.measurement.pose)
    return poses, seconds, {stage: ms / len(frames) for stage, ms in {**spent, **within}.items()}


def line(name: str, poses: list, truths: list, seconds: list[float], stages: str = "") -> float:
    """Print how fast and how good; return the instants a second."""
    held = [(T, truths[k]) for k, T in enumerate(poses) if T is not None]
    e = pose_errors(*(RigidTransform.concatenate(list(part)) for part in zip(*held, strict=True)))
    rate = 1 / float(np.median(seconds))
    print(
        f"  {name:24s}{rate:8.0f} a second {1e3 * np.mean(seconds):8.2f} ms mean  E_t {e.E_t_mm:.4f} mm "
        f"{e.geodesic_mean_deg:.3f} deg  lost {len(poses) - len(held)}  {stages}",
        flush=True,
    )
    return rate


def floor(frames: list[list[np.ndarray]]) -> float:
    """Instants a second, if all pixels were but read."""
    begin = time.process_time()
    for images in frames:
        for image in images:
            cv2.sumElems(image)
    return len(frames) / (time.process_time() - begin)


def paper_chain(rig: Rig, frames: list, truths: list, bench: Bench) -> float:
    """Print what the paper's chain takes: background, window, markers, matches, points, pose; return
    the median instant, ms.

    Beside it SimpleBlobDetector on the same images, right after each instant, so that whatever else
    the machine does slows both.
    """
    empty = render_rig(rig, HANDLE, None, bench, np.random.default_rng(1))
    detector = blob_detector(rig, HANDLE)
    state, poses, seconds, alone = tracker.start(empty, rig, -1 / FPS), [], [], []
    with clocked(tracker, CHAIN) as spent:
        for k, images in enumerate(frames):
            begin = time.process_time()
            state, one = tracker.step(state, images, k / FPS, rig, HANDLE)
            measured = time.process_time()
            for image in images:
                detector.detect(image)
            seconds.append(measured - begin)
            alone.append(time.process_time() - measured)
            poses.append(one.pose.T_world_handle)
    stages = ", ".join(f"{stage} {ms / len(frames):.2f}" for stage, ms in spent.items())
    cameras = len(rig.cameras)
    line(f"the paper's chain, {cameras}", poses, truths, seconds, f"ms: {stages}")
    median, late, worst = 1e3 * np.quantile(seconds, [0.5, 0.99, 1.0])
    print(
        f"    {cameras} cameras: median {median:.1f} ms, 99 % {late:.1f}, worst {worst:.1f} of "
        f"{FRAME_MS:.1f}: {'in' if worst <= FRAME_MS else 'NOT IN'} real time to the last instant; "
        f"by SimpleBlobDetector alone ({1e3 * np.median(alone):.1f} ms) "
        f"{np.median(seconds) / np.median(alone):.2f}"
    )
    return float(median)


def rates() -> int:
    """Print instants a second, stage by stage; return whether less than wanted."""
    cv2.setNumThreads(1)
    truths, broken = list(human_motion(np.random.default_rng(3), np.arange(COUNT) / FPS)), []
    for cameras, background, contrast in (
        (3, "textured", 0.15),
        (2, "textured", 0.15),
        (3, "flat", 0.0),
    ):
        rig = replace(RIG, cameras=RIG.cameras[:cameras])
        bench = replace(Bench(), texture_contrast=contrast)
        frames = list(render_clip(rig, HANDLE, truths, bench, np.random.default_rng(0), Arm()))
        print(
            f"{cameras} cameras, {background} background; reading the pixels once: {floor(frames):.0f} a second"
        )
        by_estimator = {}
        for estimator, wanted in WANTED.items():
            tracked(frames[:5], rig, estimator)  # what is made once
            poses, seconds, spent = tracked(frames, rig, estimator)
            stages = ", ".join(f"{stage} {ms:.2f}" for stage, ms in spent.items())
            by_estimator[estimator] = line(
                estimator, [p.T_world_handle for p in poses], truths, seconds, f"ms: {stages}"
            )
            if cameras == 3 and by_estimator[estimator] < wanted:
                broken.append(
                    f"{estimator}, {background}: {by_estimator[estimator]:.0f} of {wanted:.0f}"
                )
        if cameras == 3:
            plain = [opencv_chain(images, T) for images, T in zip(frames, truths, strict=True)]
            rate = line(
                "OpenCV, markers told",
                [T for T, _ in plain],
                truths,
                [ms["total"] / 1e3 for _, ms in plain],
            )
            print(
                "    ours by this one: "
                + ", ".join(f"{name} {ours / rate:.1f}" for name, ours in by_estimator.items())
            )
            alone = float(np.median([ms["markers"] for _, ms in plain]))
            print(
                f"    SimpleBlobDetector alone {alone:.2f} ms; times of ours by this one: "
                + ", ".join(
                    f"{name} {1e3 / ours / alone:.2f}" for name, ours in by_estimator.items()
                )
            )
        chain_ms = paper_chain(rig, frames, truths, bench)
        if cameras == 3 and chain_ms > CHAIN_MS:
            broken.append(f"the paper's chain, {background}: {chain_ms:.1f} of {CHAIN_MS:.0f} ms")
    print(
        f"wanted of three cameras: {WANTED} a second, the paper's chain at most {CHAIN_MS:.0f} ms: "
        f"{'BROKEN: ' + '; '.join(broken) if broken else 'kept'}"
    )
    return int(bool(broken))


def memory(count: int = 10_000) -> int:
    """Print the memory over many instants; it must not grow."""
    frames = list(
        render_clip(
            RIG,
            HANDLE,
            human_motion(np.random.default_rng(3), np.arange(30) / FPS),
            Bench(),
            np.random.default_rng(0),
            Arm(),
        )
    )
    state, order, sizes = posetracker.start(-1.0), [*range(30), *range(28, 0, -1)], []
    for k in range(count):
        images = frames[order[k % len(order)]]
        state, _ = posetracker.step(state, images, k / FPS, RIG, HANDLE, FollowParameters())
        if (k + 1) % (count // 10) == 0:
            sizes.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
            print(f"{k + 1:6d} instants: {sizes[-1]:.0f} MiB at most", flush=True)
    return int(sizes[-1] > 1.02 * sizes[1])


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--instants", type=int, default=800, help="of the standard motions")
    parser.add_argument("--long", action="store_true", help="the memory over 10,000 instants")
    arguments = parser.parse_args()
    if arguments.long:
        return memory()
    is_slow = rates()
    bench_instants.report(arguments.instants, os.cpu_count() or 1)
    return is_slow


if __name__ == "__main__":
    raise SystemExit(main())
