"""Frames of the path-traced room: the light of every pixel, and the grey that a sensor makes of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.camera import Camera
from trinolab.checks import Array, as_rng, frozen
from trinolab.handle import Handle, on_cylinder, slants

from .pathtracing import Window, traced
from .room import Room, empty_room, glove, handle_pieces
from .shapes import band

_COARSE = 4  # side of the empty room's pixels in the camera's own
_PLATE_SAMPLES = 100
_BESIDE_PX = 5  # around a marker, and around the body
_NEAR_PX = 14  # around the band of markers
_PART_MM = 25.0  # of the body's length in one window


def take(
    camera: Camera,
    handle: Handle,
    poses: Sequence[RigidTransform],
    room: Room,
    rng: np.random.Generator,
    gain: float = 1.0,
    held: bool = False,
) -> np.ndarray:
    """Take a frame of the handle.

    Parameters
    ----------
    camera : Camera
        Without lens distortion.
    handle : Handle
    poses : sequence of RigidTransform
        T_world_handle at moments of the exposure, evenly spaced: one for a handle at rest.
    room : Room
    rng : numpy.random.Generator
        For the paths and the sensor.
    gain : float
        The light, as a factor.
    held : bool
        Whether a gloved hand holds the handle.

    Returns
    -------
    ndarray of uint8, shape (height, width)

    Raises
    ------
    ValueError
        If Mitsuba is not installed, or the camera's lens distorts.
    """
    return exposed(gain * light(camera, handle, poses, room, rng, held), room, rng)


def light(
    camera: Camera,
    handle: Handle,
    poses: Sequence[RigidTransform],
    room: Room,
    rng: np.random.Generator,
    held: bool = False,
) -> Array:
    """The radiance of each pixel, shape (height, width); see `take`.

    Only windows around the handle are traced, markers along more paths than the rest. The room
    behind is that of `plate`.
    """
    image = plate(camera, room).copy()
    windows = list(_windows(camera, handle, poses, room, held))
    total = [np.zeros((window.height, window.width)) for window in windows]
    for T in poses:
        pieces = {
            **empty_room(room),
            **handle_pieces(handle, T, room),
            **(glove(T) if held else {}),
        }
        seed = int(as_rng(rng).integers(2**32))
        for part, samples in zip(total, traced(camera, pieces, room, windows, seed), strict=True):
            part += samples / len(poses)
    for window, part in zip(windows, total, strict=True):
        rows, columns = (
            slice(window.v, window.v + window.height),
            slice(window.u, window.u + window.width),
        )
        image[rows, columns] = part
    return image


@lru_cache(maxsize=8)
def plate(camera: Camera, room: Room) -> Array:
    """The radiance of the empty room, shape (height, width), read-only.

    It is out of focus, so that it is traced with a sixteenth of the pixels, and single bright paths
    are taken out.
    """
    (width, height), share = camera.size, 1 / _COARSE
    matrix = np.diag([share, share, 1.0]) @ camera.matrix
    matrix[:2, 2] += (share - 1) / 2
    coarse = replace(camera, size=(width // _COARSE, height // _COARSE), matrix=matrix)
    whole = Window(0, 0, *coarse.size, _PLATE_SAMPLES)
    (image,) = traced(coarse, empty_room(room), room, [whole], room.seed)
    calm = cv2.medianBlur(image.astype(np.float32), 5)
    return frozen(cv2.resize(calm, (width, height), interpolation=cv2.INTER_CUBIC).astype(float))


def exposed(radiance: Array, room: Room, rng: np.random.Generator) -> np.ndarray:
    """What a sensor makes of the radiance, uint8 (height, width): electrons by Poisson's law, and
    those of reading.
    """
    electrons = room.electrons_per_grey * room.grey_per_radiance * np.maximum(radiance, 0.0)
    counted = as_rng(rng).poisson(electrons) + room.read_electrons * rng.standard_normal(
        electrons.shape
    )
    return np.clip(np.rint(counted / room.electrons_per_grey), 0, 255).astype(np.uint8)


def _windows(
    camera: Camera, handle: Handle, poses: Sequence[RigidTransform], room: Room, held: bool
) -> Iterator[Window]:
    """Where the handle may be seen; a later window lies over an earlier one."""
    count = len(poses)
    far, near, fine = (
        -(-samples // count) for samples in (room.far_samples, room.near_samples, room.samples)
    )
    if held:
        points = np.concatenate([piece.mesh.points for T in poses for piece in glove(T).values()])
        yield from _around(camera, points, _BESIDE_PX, far)
    ends = np.linspace(
        handle.bottom_mm, handle.top_mm, 1 + int(np.ceil(handle.length_mm / _PART_MM))
    )
    for low, high in pairwise(ends):
        yield from _around(camera, _moving(poses, _rims(handle, low, high)), _BESIDE_PX, far)
    yield from _around(camera, _moving(poses, _rims(handle, *band(handle))), _NEAR_PX, near)
    half = handle.marker_diameter_mm / 2
    turned = [slants(handle, T, camera.centre) for T in poses]
    for k in np.flatnonzero(np.min(turned, axis=0) < np.pi / 2):
        around = handle.marker_angles[k] + half / handle.radius_mm * np.array([-1, 1, 0, 0])
        along = handle.marker_centres[k, 1] + half * np.array([0, 0, -1, 1])
        rim = on_cylinder(handle.radius_mm, around, along)
        yield from _around(camera, _moving(poses, rim), _BESIDE_PX, fine)


def _rims(handle: Handle, low: float, high: float) -> Array:
    """Points round the body at two axial coordinates, handle frame, (n, 3)."""
    theta = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    return np.concatenate([on_cylinder(handle.radius_mm, theta, axial) for axial in (low, high)])


def _moving(poses: Sequence[RigidTransform], points: Array) -> Array:
    return np.concatenate([T.apply(points) for T in poses])


def _around(camera: Camera, points: Array, margin: int, samples: int) -> Iterator[Window]:
    """The window that holds the images of points, with a margin; none where it lies outside."""
    uv = camera.project(points)
    uv = uv[np.isfinite(uv).all(axis=1)]
    if not len(uv):
        return
    low = np.clip(np.floor(uv.min(axis=0)).astype(int) - margin, 0, camera.size)
    high = np.clip(np.ceil(uv.max(axis=0)).astype(int) + margin + 1, 0, camera.size)
    width, height = (int(side) for side in high - low)
    if width > 0 and height > 0:
        yield Window(int(low[0]), int(low[1]), width, height, samples)
