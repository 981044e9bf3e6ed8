"""Rendered views of a chessboard in two cameras, and their files: what `trinolab calibrate` is
tested with.
"""

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


def make_rig(lens=LENS):
    """Two cameras 110 mm apart; the world is the first one's frame."""
    K = np.array([[620.0, 0, 246], [0, 615, 174], [0, 0, 1]])
    T = RigidTransform.from_components([110, 4, 12], Rotation.from_rotvec([0.02, -0.22, 0.03]))
    return Rig(
        (
            Camera("a", SIZE, K, lens, RigidTransform.identity()),
            Camera("b", SIZE, K + [[8, 0, -9], [0, 11, 8], [0, 0, 0]], 0.8 * lens, T.inv()),
        )
    )


def positions(count, seed=2):
    board = Board(7, 6, 15.0)
    return board_positions(
        make_rig(), board, count, np.random.default_rng(seed), 480.0, margin_px=4.0
    )


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
