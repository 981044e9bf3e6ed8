"""Rendered views of a chessboard in two cameras, and their files: what `trinolab calibrate` is
tested with.
"""

from functools import cache

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.board import board_positions, render_board
from trinolab.bench.optics import Bench
from trinolab.calibration.target import Board
from trinolab.camera import Camera, Rig

SIZE = (480, 360)
LENS = np.array([-0.12, 0.05, 5e-4, -4e-4, 0.0])
CALIBRATE = (
    "calibrate --images a=a b=b --board chessboard --columns 7 --rows 6 --square 15 "
    "--distortions 5 --out rig.toml"
)


def motion(translation, rotvec=(0, 0, 0)):
    return RigidTransform.from_components(
        translation, Rotation.from_rotvec(np.array(rotvec, float))
    )


def make_rig(lens=LENS, cameras=2):
    """Cameras 110 mm apart; the world is the first one's frame."""
    K = np.array([[620.0, 0, 246], [0, 615, 174], [0, 0, 1]])
    second = motion([110, 4, 12], [0.02, -0.22, 0.03])
    third = motion([-90, 14, 22], [0.05, 0.2, -0.03])
    every = (
        Camera("a", SIZE, K, lens, RigidTransform.identity()),
        Camera("b", SIZE, K + [[8, 0, -9], [0, 11, 8], [0, 0, 0]], 0.8 * lens, second.inv()),
        Camera("c", SIZE, K, 0.5 * lens, third.inv()),
    )
    return Rig(every[:cameras])


def corners(rig, poses, target, noise_px=0.0, seed=0):
    """Where cameras see a target, px, shape (cameras, views, n, 2)."""
    points = np.concatenate([T.apply(np.array(target.points)) for T in poses])
    uv = np.array([camera.project(points) for camera in rig.cameras])
    uv = uv.reshape(len(rig.cameras), len(poses), -1, 2)
    return uv + np.random.default_rng(seed).normal(0, noise_px, uv.shape)


def positions(count, seed=2):
    board = Board(7, 6, 15.0)
    return board_positions(
        make_rig(), board, count, np.random.default_rng(seed), 480.0, margin_px=4.0
    )


@cache
def board_frames(count):
    """Rendered positions of the chessboard in the two cameras, with distortion."""
    rng, bench = np.random.default_rng(0), Bench(supersampling=4)
    return [
        [render_board(camera, Board(7, 6, 15.0), T, bench, rng) for T in positions(count)]
        for camera in make_rig().cameras
    ]


def write_views(folder, frames):
    """Frames (cameras, views) as folders a, b with the same file names."""
    for name, side in zip("abc", frames, strict=False):
        (folder / name).mkdir(parents=True)
        for k, frame in enumerate(side):
            cv2.imwrite(str(folder / name / f"{k:02d}.png"), frame)
