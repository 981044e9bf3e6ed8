"""The simulated bench broken, one thing at a time: frames with a fault of which the measurement knows
nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import NamedTuple

import cv2
import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.layer import cropped, foreground, over
from trinolab.bench.optics import Bench, background, blurred, digitise
from trinolab.bench.rays import SIDE, OvalHandle, body_corners, cast
from trinolab.bench.scene import radiance, render, render_rig
from trinolab.camera import CAMERA_PARAMETERS, Camera, Rig, RigCovariance
from trinolab.checks import Array
from trinolab.handle import Handle
from trinolab.rigid import cross_matrices

# A hand's, in the median (`motion.human_motion`): what moves while the shutter rolls or waits.
SPEED_MM_S, TURN_DEG_S = 330.0, 15.5
READOUT_S, APART_S = 0.010, 0.005
# Half as many samples a side as elsewhere: thousands of instants are drawn, and what the samples
# leave, 0.016 px of a marker that is seen at 70 deg, is little beside a fault.
BENCH = Bench(supersampling=4, marker_supersampling=8)
_SENSOR_ROWS = 1024  # that a shutter rolls over in `READOUT_S`
_BAND = 16  # rows that a rolling shutter takes at one time: a motion of 0.3 px
_GLOSS, _SHARPNESS = 400.0, 300.0  # grey levels, and the power of its cosine


class Instant(NamedTuple):
    """What is before the cameras."""

    rig: Rig
    handle: Handle
    T_world_handle: RigidTransform


class Taken(NamedTuple):
    """The frames of an instant, and the rig that the measurement believes in."""

    frames: list[np.ndarray]
    rig: Rig


Fault = Callable[[Instant, np.random.Generator], Taken]


def _by_bench(bench: Bench) -> Fault:
    """Frames of another bench."""

    def take(now: Instant, rng: np.random.Generator) -> Taken:
        return Taken(render_rig(*now, bench, rng), now.rig)

    return take


def _developed(change: Callable[[np.ndarray], np.ndarray]) -> Fault:
    """Frames that are changed after the sensor."""

    def take(now: Instant, rng: np.random.Generator) -> Taken:
        return Taken([change(frame) for frame in render_rig(*now, BENCH, rng)], now.rig)

    return take


def _made(change: Callable[[Handle, np.random.Generator], Handle]) -> Fault:
    """Frames of a handle that is not what its file says."""

    def take(now: Instant, rng: np.random.Generator) -> Taken:
        made = now._replace(handle=change(now.handle, rng))
        return Taken(render_rig(*made, BENCH, rng), now.rig)

    return take


def _believed(sigma_px: float, sigma_deg: float, stated: bool = False) -> Fault:
    """Right frames, and a rig file whose principal points and directions are off; `stated` if it
    says by how much, as a calibration does, else it says nothing.
    """

    def take(now: Instant, rng: np.random.Generator) -> Taken:
        frames = render_rig(*now, BENCH, rng)
        return Taken(frames, believed(now.rig, sigma_px, sigma_deg, stated, rng))

    return take


def believed(
    rig: Rig, sigma_px: float, sigma_deg: float, stated: bool, rng: np.random.Generator
) -> Rig:
    """What a rig file says of a rig, off as by `miscalibrated`; `stated` if it says by how much."""
    off = miscalibrated(rig, sigma_px, sigma_deg, rng)
    known = covariance_of_such(off, sigma_px, sigma_deg) if stated else None
    return replace(off, covariance=known)


def miscalibrated(rig: Rig, sigma_px: float, sigma_deg: float, rng: np.random.Generator) -> Rig:
    """A rig whose principal points (px) and directions (deg) are off by this an axis, and which does
    not say so.
    """
    cameras = []
    for camera in rig.cameras:
        matrix = camera.matrix.copy()
        matrix[:2, 2] += sigma_px * rng.standard_normal(2)
        turn = Rotation.from_rotvec(np.deg2rad(sigma_deg) * rng.standard_normal(3))
        T_cam_world = RigidTransform.from_rotation(turn) * camera.T_cam_world
        cameras.append(replace(camera, matrix=matrix, T_cam_world=T_cam_world))
    return Rig(tuple(cameras))


def covariance_of_such(rig: Rig, sigma_px: float, sigma_deg: float) -> RigCovariance:
    """The covariance of what `miscalibrated` changes."""
    blocks = []
    for camera in rig.cameras:
        # a turn about the camera's centre takes the world's origin along
        by_turn = np.concatenate([np.eye(3), -cross_matrices(camera.T_cam_world.translation)])
        block = np.zeros((len(CAMERA_PARAMETERS), len(CAMERA_PARAMETERS)))
        block[2:4, 2:4] = sigma_px**2 * np.eye(2)
        block[-6:, -6:] = np.deg2rad(sigma_deg) ** 2 * by_turn @ by_turn.T
        blocks.append(block)
    return RigCovariance(rig.names, block_diag(*blocks))


def gamma(frame: np.ndarray, exponent: float = 0.6) -> np.ndarray:
    """Grey levels through a camera's gamma curve, uint8."""
    curve = 255 * (np.arange(256) / 255) ** exponent
    return np.rint(curve).astype(np.uint8)[frame]


def jpeg(frame: np.ndarray, quality: int = 60) -> np.ndarray:
    """A frame that was kept as JPEG."""
    _, coded = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE))


def oval(handle: Handle, rng: np.random.Generator) -> Handle:
    """Markers that are 0.3 mm longer than wide, along the axis or around the body."""
    sign = rng.choice([-1, 1])
    d = handle.marker_diameter_mm
    same = {field.name: getattr(handle, field.name) for field in fields(handle)}
    return OvalHandle(
        **{**same, "marker_diameter_mm": d - 0.15 * sign}, marker_length_mm=d + 0.15 * sign
    )


def displaced(handle: Handle, rng: np.random.Generator, by_mm: float = 0.05) -> Handle:
    """Each marker beside its place, in a direction of its own on the surface."""
    way = rng.uniform(0, 2 * np.pi, len(handle.marker_centres))
    around = np.rad2deg(handle.marker_angles + by_mm / handle.radius_mm * np.cos(way))
    along = handle.marker_centres[:, 1] + by_mm * np.sin(way)
    columns = tuple(float(angle) for angle in around)
    return replace(handle, columns_deg=columns, rows_mm=tuple((float(s),) for s in along))


def bent(now: Instant, rng: np.random.Generator, by_mm: float = 0.1) -> Taken:
    """A body with a kink at its origin: the upper row lies `by_mm` beside its place."""
    handle = now.handle
    upper = tuple(tuple(s for s in row if s > 0) for row in handle.rows_mm)
    lower = tuple(tuple(s for s in row if s <= 0) for row in handle.rows_mm)
    high = replace(handle, rows_mm=upper, length_mm=handle.top_mm)
    low = replace(handle, rows_mm=lower, length_mm=-handle.bottom_mm, top_mm=0.0)
    way = rng.uniform(0, 2 * np.pi)
    angle = by_mm / float(np.mean([s for row in upper for s in row]))
    kink = Rotation.from_rotvec(angle * np.array([np.cos(way), 0.0, np.sin(way)]))
    T_high = now.T_world_handle * RigidTransform.from_rotation(kink)
    frames = []
    for camera in now.rig.cameras:
        light = radiance(camera, low, now.T_world_handle, BENCH)
        light = over(foreground(camera, high, T_high, BENCH), light)
        frames.append(digitise(blurred(light, BENCH), BENCH, rng))
    return Taken(frames, now.rig)


def glossy(now: Instant, rng: np.random.Generator) -> Taken:
    """A varnished handle under a long lamp: a stripe along it is far brighter than white."""
    frames = []
    for camera in now.rig.cameras:
        light = radiance(camera, now.handle, now.T_world_handle, BENCH)
        light += highlight(camera, now.handle, now.T_world_handle)
        frames.append(digitise(blurred(light, BENCH), BENCH, rng))
    return Taken(frames, now.rig)


def highlight(camera: Camera, handle: Handle, T_world_handle: RigidTransform) -> Array:
    """What the varnish of the handle's side mirrors, grey levels, shape (height, width).

    It is Blinn's cosine between the normal and the half of the directions to camera and light
    (Blinn 1977, DOI 10.1145/965141.563893), of what of them lies across the axis.
    """
    image = np.zeros(camera.size[::-1])
    corners = camera.project(T_world_handle.apply(body_corners(handle)))
    low = np.clip(np.floor(corners.min(axis=0)).astype(int), 0, camera.size)
    high = np.clip(np.ceil(corners.max(axis=0)).astype(int) + 1, 0, camera.size)
    v, u = np.mgrid[low[1] : high[1], low[0] : high[0]]
    hits = cast(camera, handle, T_world_handle, np.column_stack([u.ravel(), v.ravel()]))
    seen = np.flatnonzero((hits.labels == SIDE) | (hits.labels >= 0))
    points = hits.points[seen][:, [0, 2]]
    T_handle_world = T_world_handle.inv()
    towards = T_handle_world.apply(camera.centre)[[0, 2]] - points
    lamp = T_handle_world.rotation.apply(BENCH.light)[[0, 2]]
    half = towards / np.linalg.norm(towards, axis=1, keepdims=True) + lamp / np.linalg.norm(lamp)
    cosine = (points * half).sum(axis=1) / handle.radius_mm / np.linalg.norm(half, axis=1)
    image[v.ravel()[seen], u.ravel()[seen]] = _GLOSS * np.maximum(cosine, 0) ** _SHARPNESS
    return image


class Motion(NamedTuple):
    """A steady motion: of the handle's origin, mm/s, and about it, rad/s, world frame, (3,) each."""

    velocity: Array
    turn_rate: Array


def hand_motion(rng: np.random.Generator) -> Motion:
    """A hand's speed, in a random direction."""
    velocity, turn = (
        direction / np.linalg.norm(direction) for direction in rng.standard_normal((2, 3))
    )
    return Motion(SPEED_MM_S * velocity, np.deg2rad(TURN_DEG_S) * turn)


def later(T_world_handle: RigidTransform, motion: Motion, t_s: float) -> RigidTransform:
    """Where a moving handle is after a time."""
    return RigidTransform.from_components(
        T_world_handle.translation + t_s * motion.velocity,
        Rotation.from_rotvec(t_s * motion.turn_rate) * T_world_handle.rotation,
    )


def apart(now: Instant, rng: np.random.Generator) -> Taken:
    """CCD2 takes its frame 5 ms after CCD1, any other camera midway, where the truth is."""
    motion = hand_motion(rng)
    times = [-APART_S / 2, APART_S / 2, *[0.0] * (len(now.rig.cameras) - 2)]
    frames = [
        render(camera, now.handle, later(now.T_world_handle, motion, t), BENCH, rng)
        for camera, t in zip(now.rig.cameras, times, strict=True)
    ]
    return Taken(frames, now.rig)


def rolling(now: Instant, rng: np.random.Generator) -> Taken:
    """A shutter that rolls down the sensor in 10 ms; the truth is at the time of the principal
    point's row.
    """
    motion = hand_motion(rng)
    frames = []
    for camera in now.rig.cameras:
        light = rolled(camera, now.handle, now.T_world_handle, motion)
        frames.append(digitise(blurred(light, BENCH), BENCH, rng))
    return Taken(frames, now.rig)


def rolled(camera: Camera, handle: Handle, T_world_handle: RigidTransform, motion: Motion) -> Array:
    """The image before blur and noise, row by row at its own time, shape (height, width).

    Rows are counted from the principal point's, so that a window of an image has its rows' times.
    """
    width, height = camera.size
    image = np.array(background(camera, BENCH))
    for first in range(0, height, _BAND):
        t = READOUT_S * (first + (_BAND - 1) / 2 - camera.matrix[1, 2]) / _SENSOR_ROWS
        T = later(T_world_handle, motion, t)
        # two rows more on each side, so that edges are found
        part = cropped(camera, (0, first - 2), (width, _BAND + 4))
        layer = foreground(part, handle, T, BENCH)
        if layer.light.size:
            rows = slice(first, first + _BAND)
            behind = np.zeros((_BAND + 4, width))
            behind[2:-2] = image[rows]
            image[rows] = over(layer, behind)[2:-2]
    return image


FAULTS: Mapping[str, Fault] = {
    "none": _by_bench(BENCH),
    "lens blur 2 px": _by_bench(replace(BENCH, blur_px=2.0)),
    "half contrast": _by_bench(
        replace(
            BENCH, background_grey=67.5, texture_contrast=0.05, body_grey=90.0, marker_grey=155.0
        )
    ),
    "gamma 0.6": _developed(gamma),
    "noise x 3": _by_bench(replace(BENCH, shot_variance=0.45, read_noise=4.5)),
    "JPEG 60": _developed(jpeg),
    "rolling shutter 10 ms": rolling,
    "saturated highlights": glossy,
    "oval markers, 0.3 mm": _made(oval),
    "markers off by 0.05 mm": _made(displaced),
    "handle bent by 0.1 mm": bent,
    "calibration 0.1 px, 0.005 deg": _believed(0.1, 0.005),
    "calibration 0.3 px, 0.02 deg": _believed(0.3, 0.02),
    "frames 5 ms apart": apart,
    "calibration 0.1 px, 0.005 deg, stated": _believed(0.1, 0.005, stated=True),
    "calibration 0.3 px, 0.02 deg, stated": _believed(0.3, 0.02, stated=True),
}
