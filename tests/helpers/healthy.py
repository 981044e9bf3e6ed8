"""A folder with all that the commands read, in small images, and the command lines that take it:
nothing is wrong.
"""

import shlex
from dataclasses import replace

import cv2
import numpy as np
from boards import CALIBRATE, board_frames, write_views
from makenotebook import glued, make_notebook
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig, scaled
from trinolab.datasets import load_handle, load_rig
from trinolab.files import recording_writer
from trinolab.files.poses import truth_table, write_poses
from trinolab.files.rigs import write_handle, write_rig
from trinolab.rigid import shifted
from workbench import cli

RIG, CODED = (
    replace(
        load_rig("paper_pair"),
        cameras=tuple(scaled(camera, 0.25) for camera in load_rig("paper_pair").cameras),
    ),
    load_handle("coded"),
)
FIRST = RigidTransform.from_components(
    [0.0, 5.0, 560.0], Rotation.from_euler("ZYX", [170.0, 15.0, 40.0], degrees=True)
)
FPS = 25.0
TRACK = "track rec --out poses.csv"
VIDEOS = (
    "track --rig rig.toml --handle handle.toml --video ccd1=ccd1.mkv ccd2=ccd2.mkv --out poses.csv"
)
MEASURE = "measure --rig rig.toml --handle handle.toml --images rec/images --out poses.csv"
EVALUATE = "evaluate found.csv truth.csv --handle handle.toml"
RENDER = "render --rig rig.toml --handle handle.toml --motion hard --seed 3 --out out --seconds 0.1"
FOLLOW = "render --rig rig.toml --handle handle.toml --motion path.csv --out out"
CAPTURE = "capture --camera ccd1=ccd1.mkv ccd2=ccd2.mkv --rig rig.toml --fps 200 --out new"
SWEEP = "sweep n.ipynb -p a=0,1 --workers 1 --out new"
BOARDS = CALIBRATE.replace("rig.toml", "new.toml")


def true_path(count):
    """The handle's poses at `count` instants."""
    return RigidTransform.concatenate(
        [
            shifted(FIRST, np.array([90.0, -60, 40, 0.2, 0.3, -0.2]) * np.sin(k / FPS))
            for k in range(count)
        ]
    )


def make_healthy(root, count):
    """A rig, a handle, a recording of `count` instants, the same as videos, poses, views of a
    board.
    """
    poses, rng = true_path(count), np.random.default_rng(0)
    partial = recording_writer.begin(root / "rec", RIG, CODED)
    instants = [render_rig(RIG, CODED, T, Bench(), rng) for T in poses]
    for k, images in enumerate(instants):
        recording_writer.add(partial, RIG, k, images)
    recording_writer.finish(root / "rec", np.arange(count) / FPS, truth_table(poses))
    for name, frames in zip(RIG.names, zip(*instants, strict=True), strict=True):
        write_video(root / f"{name}.mkv", frames)
    write_rig(RIG, root / "rig.toml")
    write_handle(CODED, root / "handle.toml")
    for name in ("truth", "found", "path"):
        write_poses(truth_table(poses[:3]), root / f"{name}.csv")
    write_views(root, board_frames(5))
    parameters = "a = 0\nb = 0.5\nname = 'paper'"
    make_notebook(root / "n.ipynb", "pass", glued(y="a + b"), parameters=parameters)


def write_video(path, frames, codec="FFV1", fps=FPS):
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*codec), fps, frames[0].shape[::-1], isColor=False
    )
    for frame in frames:
        writer.write(frame)
    writer.release()


def contents(folder):
    return {path: path.is_file() and path.read_bytes() for path in sorted(folder.rglob("*"))}


def run(line):
    """The exit code of a command line; argparse leaves by an exception."""
    try:
        return cli.main(shlex.split(line))
    except SystemExit as left:
        return left.code
