"""Frames of one instant that several tests measure, rendered once a session."""

from functools import cache

import numpy as np

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig, load_table1

POSE = load_table1().set_poses[4]


@cache
def frames(rig, handle):
    """Of a shipped rig and a shipped handle, by their names, at the fifth pose of Table 1."""
    images = render_rig(load_rig(rig), load_handle(handle), POSE, Bench(), np.random.default_rng(0))
    return tuple(images)
