"""One instant: images of three cameras, the handle's pose, and how far it is from the truth.

    python examples/one_instant.py

The images come from the simulated bench, so that the truth is known and no file is needed.
"""

import numpy as np

import trinolab
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_table1

rig = trinolab.load_rig("raised_40deg")
handle = trinolab.load_handle("coded")
truth = load_table1().set_poses[4]
frames = render_rig(rig, handle, truth, Bench(), np.random.default_rng(0))

pose = trinolab.measure(frames, rig, handle).pose

off_mm = np.linalg.norm(pose.T_world_handle.translation - truth.translation)
print(f"{pose.status}: {off_mm:.3f} mm off, {pose.markers} markers in {pose.cameras} cameras")
