"""Instants made to mislead the identification, and what may be reported of each."""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.hand import true_visibility
from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench
from trinolab.bench.rays import body_region
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig

# how many blobs like markers an image gets, from and below
BLOBS = {
    "glints": (3, 21),
    "handle and glints": (3, 21),
    "half hidden, glints": (1, 8),
    "500 blobs": (500, 501),
}
OTHERS = "noise,half hidden,two handles,camera turned,no markers,one camera left"
KINDS = (*OTHERS.split(","), *BLOBS)
TYPICAL_MM = 570.0  # distance at which a blob is as large as a marker
WRONG_MM, WRONG_DEG = 2.0, 5.0


class Instant(NamedTuple):
    """Frames, one a camera, and the poses of which one may be reported (up to the handle's
    symmetry).
    """

    kind: str
    frames: list[np.ndarray]
    truths: list[RigidTransform]


def hostile(rng, rig, handle, kind):
    """Draw an instant of one of `KINDS`."""
    T = seen_pose(rng, rig, handle)
    there, bench, cameras = T, Bench(), rig
    if kind == "noise":
        return Instant(kind, [_noise(rng, camera.size) for camera in rig.cameras], [])
    if kind == "two handles":
        return _two(rng, rig, handle, T)
    if kind == "no markers":
        bench = Bench(marker_grey=90.0)
    elif kind == "camera turned":
        cameras = _one_turned(rng, rig)
    elif kind == "glints":
        there = None
    frames = render_rig(cameras, handle, there, bench, rng)
    if kind.startswith("half hidden"):
        frames = [
            _half_hidden(rng, frame, camera, T) if rng.random() < 0.7 else frame
            for frame, camera in zip(frames, rig.cameras, strict=True)
        ]
    if kind == "one camera left":
        left = rng.integers(len(frames))
        frames = [frame if c == left else _covered(rng, frame) for c, frame in enumerate(frames)]
    if kind in BLOBS:
        frames = [
            _blobs(rng, frame, handle, camera, rng.integers(*BLOBS[kind]))
            for frame, camera in zip(frames, rig.cameras, strict=True)
        ]
    return Instant(kind, frames, [] if kind in ("glints", "no markers") else [T])


def is_wrong(pose, instant, handle):
    """Whether a pose is called measured and is off by more than 2 mm or 5 deg from all that may be
    reported.
    """
    if pose.status != "measured":
        return False
    return not any(
        _near(pose.T_world_handle, T * S) for T in instant.truths for S in handle.symmetries
    )


def seen_pose(rng, rig, handle):
    """A random pose of the standard scene at which each of two cameras truly sees four markers."""
    while True:
        T = random_pose(rng)
        if sorted(true_visibility(camera, handle, T).sum() for camera in rig.cameras)[-2] >= 4:
            return T


def _near(estimate, truth):
    turn = np.rad2deg((estimate.inv() * truth).rotation.magnitude())
    return (
        np.linalg.norm(estimate.translation - truth.translation) <= WRONG_MM and turn <= WRONG_DEG
    )


def _noise(rng, size):
    """White noise, or smooth blotches of about a marker's size."""
    image = rng.normal(0, 1, size[::-1]).astype(np.float32)
    if rng.random() < 0.7:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(2, 8))
    return np.clip(110 + rng.uniform(20, 60) * image / image.std(), 0, 255).astype(np.uint8)


def _blobs(rng, frame, handle, camera, count, scale=16):
    typical = handle.marker_diameter_mm * camera.focal[0] / TYPICAL_MM
    shape = np.zeros(frame.shape, np.uint8)
    for _ in range(count):
        centre = rng.uniform(0, camera.size) * scale
        axes = typical / 2 * rng.uniform(0.7, 1.3) * np.array([1, rng.uniform(0.4, 1)]) * scale
        place = centre.astype(int).tolist(), axes.astype(int).tolist(), rng.uniform(0, 180)
        cv2.ellipse(shape, *place, 0, 360, 255, -1, cv2.LINE_AA, 4)
    share = cv2.GaussianBlur(shape, (0, 0), 0.7) / 255
    grey = rng.uniform(180, 255) if handle.markers == "bright" else rng.uniform(0, 30)
    return np.clip(frame * (1 - share) + grey * share, 0, 255).astype(np.uint8)


def _half_hidden(rng, frame, camera, T):
    """Cover what lies on one side of a line that passes near the markers."""
    place = camera.project(T.translation[None])[0] + rng.normal(0, 30, 2)
    angle = rng.uniform(0, 2 * np.pi)
    along = 400 * np.array([np.cos(angle), np.sin(angle)])
    away = 400 * np.array([-np.sin(angle), np.cos(angle)])
    corners = place + [along, -along, away - along, away + along]
    shape = cv2.fillConvexPoly(
        np.zeros(frame.shape, np.uint8), (16 * corners).astype(int), 255, cv2.LINE_AA, 4
    )
    share = cv2.GaussianBlur(shape, (0, 0), 1.0) / 255
    return (frame * (1 - share) + rng.uniform(30, 140) * share).astype(np.uint8)


def _covered(rng, frame):
    return np.clip(rng.normal(60, 2, frame.shape), 0, 255).astype(np.uint8)


def _two(rng, rig, handle, T):
    """A second handle before the first one."""
    other = seen_pose(rng, rig, handle)
    back, front = (render_rig(rig, handle, pose, Bench(), rng) for pose in (T, other))
    frames = [
        np.where(body_region(camera, handle, other), nearer, farther)
        for camera, nearer, farther in zip(rig.cameras, front, back, strict=True)
    ]
    return Instant("two handles", frames, [T, other])


def _one_turned(rng, rig, angle_deg=2.0):
    """The rig as it stands after one camera was turned about its centre."""
    cameras, k, axis = list(rig.cameras), rng.integers(len(rig.cameras)), rng.normal(size=3)
    turn = Rotation.from_rotvec(np.deg2rad(angle_deg) * axis / np.linalg.norm(axis))
    cameras[k] = replace(
        cameras[k], T_cam_world=RigidTransform.from_rotation(turn) * cameras[k].T_cam_world
    )
    return Rig(tuple(cameras))
