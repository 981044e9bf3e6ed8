"""Milliseconds a frame of the simulated bench, 1280 x 1024: ``python
tests/benchmarks/bench_scene.py``.
"""

import clock
import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance, render
from trinolab.camera import Camera
from trinolab.datasets import load_handle

LIMIT_MS, FRAMES = 400.0, 30
MATRIX = [[2956.2, 0, 628], [0, 2940.1, 515], [0, 0, 1]]
LENSES = {"no distortion": [0.0] * 5, "distorted": [-0.25, 0.12, 0.001, -0.0008, 0.02]}


def main() -> int:
    bench, rng, handle = Bench(), np.random.default_rng(1), load_handle("paper")
    poses = [random_pose(rng) for _ in range(FRAMES)]
    for lens, distortions in LENSES.items():
        camera = Camera("ccd1", (1280, 1024), MATRIX, distortions, RigidTransform.identity())
        image = radiance(camera, handle, poses[0], bench)  # makes the background once
        stages = {
            "radiance": [clock.timed(radiance, camera, handle, T, bench)[1] for T in poses],
            "blur": [clock.timed(blurred, image, bench)[1] for _ in poses],
            "noise": [clock.timed(digitise, image, bench, rng)[1] for _ in poses],
        }
        for stage, times in stages.items():
            clock.line(f"{stage}, {lens}", times)
        whole = [clock.timed(render, camera, handle, T, bench, rng)[1] for T in poses]
        clock.line(f"render, {lens}", whole, limit=LIMIT_MS)
    return clock.exit_code()


if __name__ == "__main__":
    raise SystemExit(main())
