"""Rows of poses for the tests of the data sheet, off their truth by what is known."""

from functools import cache

import numpy as np

from satellites.accept import pointer, static
from satellites.accept.setup import Setup, sobol_poses
from satellites.accept.tracks import FPS, row_of
from trinolab.datasets import load_handle, load_rig
from trinolab.pose import LOST, Pose
from trinolab.rigid import shifted

RIGS = ("paper_pair", "paper_trinocular", "raised_40deg")
COVARIANCE = np.diag([0.01**2] * 3 + [0.001**2] * 3)


@cache
def setup(rig="raised_40deg", handle="coded", poses=64):
    return Setup(load_rig(rig), load_handle(handle), poses)


def rows_of(poses, off=None, lost=(), times=None, covariance=COVARIANCE):
    """Rows of measured poses that are off their truth by (n, 6), but for those that are lost."""
    off = np.zeros((len(poses), 6)) if off is None else off
    times = np.arange(len(poses)) / FPS if times is None else times
    measured = [
        LOST if k in lost else Pose("measured", shifted(T, off[k]), covariance, 0.1, 6, 3)
        for k, T in enumerate(poses)
    ]
    return [row_of(float(t), pose, 0.01) for t, pose in zip(times, measured, strict=True)]


def static_rows(one, off, lost=()):
    poses = sobol_poses(one.field, one.poses, one.seed).poses
    rows = rows_of(poses, off, lost)
    return [rows[k : k + static.TOGETHER] for k in range(0, len(rows), static.TOGETHER)]


def pointer_rows(one, off=None):
    rows = rows_of(pointer.touches(one).poses, off)
    return [rows[k : k + pointer.TOGETHER] for k in range(0, len(rows), pointer.TOGETHER)]
