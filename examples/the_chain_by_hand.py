"""The paper's chain from its own functions, stage by stage, for two cameras (Eq. 16-24).

    python examples/the_chain_by_hand.py

What `trinolab.measure` does more, is to tell which marker is which: here the truth says so.
"""

import numpy as np

import trinolab
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_table1

rig = trinolab.load_rig("paper_pair")
handle = trinolab.load_handle("paper")
truth = load_table1().set_poses[0]
frames = render_rig(rig, handle, truth, Bench(), np.random.default_rng(0))
left, right = rig.cameras

# Eq. 16: markers in each image
markers = [trinolab.find_markers(frame, len(handle.marker_centres)) for frame in frames]
# Eq. 17, 18: the same marker in both
matches = trinolab.match(left, right, *frames, markers[0].uv, markers[1].uv)
# Eq. 19-22: points
uv = np.stack([markers[k].uv[matches.index[:, k]] for k in range(2)])
points = trinolab.triangulate(rig, uv)
# which marker is which: the one whose true place is nearest, if it is near
places = truth.apply(handle.marker_centres)
distances = np.linalg.norm(points[:, None] - places, axis=2)
nearest = distances.argmin(axis=1)
near = distances.min(axis=1) < 1.0
# Eq. 23, 24: the pose
pose = trinolab.rigid_fit(handle.marker_centres[nearest[near]], points[near])

off_mm = np.linalg.norm(pose.translation - truth.translation)
print(f"{len(points)} matches, {near.sum()} of them right: {off_mm:.3f} mm off")
