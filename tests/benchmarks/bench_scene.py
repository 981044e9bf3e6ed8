"""Milliseconds a frame of the simulated bench, 1280 x 1024 on one core: ``python
tests/benchmarks/bench_scene.py``.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is loaded

import resource
import time

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance, render
from trinolab.camera import Camera
from trinolab.handle import Handle

LIMIT_MS = 400.0
MATRIX = [[2956.2, 0, 628], [0, 2940.1, 515], [0, 0, 1]]
LENSES = {"no distortion": [0.0] * 5, "distorted": [-0.25, 0.12, 0.001, -0.0008, 0.02]}
PAPER = Handle("paper", 5, 200, 25, 3, (0, 60, 120, 180, 240, 300), ((10, -10),) * 6)


def milliseconds(function, *arguments) -> float:
    """CPU time of a call, which another program on the machine does not lengthen."""
    start = time.process_time()
    function(*arguments)
    return 1e3 * (time.process_time() - start)


def stage_times(
    camera: Camera, poses: list[RigidTransform], bench: Bench, rng: np.random.Generator
) -> dict:
    image = radiance(camera, PAPER, poses[0], bench)  # makes the background once
    return {
        "radiance": [milliseconds(radiance, camera, PAPER, T, bench) for T in poses],
        "blur": [milliseconds(blurred, image, bench) for _ in poses],
        "noise": [milliseconds(digitise, image, bench, rng) for _ in poses],
        "render": [milliseconds(render, camera, PAPER, T, bench, rng) for T in poses],
    }


def main(frames: int = 30) -> int:
    cv2.setNumThreads(1)
    bench, rng = Bench(), np.random.default_rng(1)
    poses = [random_pose(rng) for _ in range(frames)]
    slowest = 0.0
    print(f"{'ms a frame':26}{'median':>8}{'most':>8}")
    for lens, distortions in LENSES.items():
        camera = Camera("ccd1", (1280, 1024), MATRIX, distortions, RigidTransform.identity())
        times = stage_times(camera, poses, bench, rng)
        for stage, values in times.items():
            label = f"{stage}, {lens}"
            print(f"{label:26}{np.median(values):8.0f}{np.max(values):8.0f}")
        slowest = max(slowest, float(np.median(times["render"])))
    print(
        f"largest resident memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB"
    )
    print(f"limit {LIMIT_MS:.0f} ms: {'kept' if slowest <= LIMIT_MS else 'BROKEN'}")
    return int(slowest > LIMIT_MS)


if __name__ == "__main__":
    raise SystemExit(main())
