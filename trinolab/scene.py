"""The simulated bench: what cameras would see of the handle, and of a hand that holds it, with the truth.

A frame is ``digitise(blurred(radiance(...)))``: the light that reaches each pixel's area, the lens's blur, then shot
and read noise and 8 bit. Motion blur is the mean of `radiance` over the poses of an exposure, before the blur.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from .arm import Arm, capsules, skin_grey
from .arm import true_visibility as true_visibility
from .bench import Bench as Bench
from .bench import background, blurred, digitise, lambert
from .camera import Camera, Rig
from .capsule import Capsules, capsule_region, cast_capsules, in_camera
from .checks import Array, as_array, as_number, as_transform
from .handle import Handle
from .motion import random_pose as random_pose
from .raycast import EMPTY, SIDE, Hits, body_region, cast, edge_pixels, sample_offsets

_CHUNK = 16_384  # rays cast at once: their arrays stay in the cache
_ARM = -4  # label of what an arm hides, beside those of raycast
_SKIN_SAMPLES = 4  # a side of the square of samples at an edge between skin and background: nothing is measured there


def render(camera: Camera, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench,
           rng: np.random.Generator, arm: Arm | None = None, gain: float = 1.0) -> np.ndarray:
    """Take a frame of the handle.

    Parameters
    ----------
    camera : Camera
    handle : Handle
    T_world_handle : RigidTransform or None
        The pose; None for the empty bench.
    bench : Bench
    rng : numpy.random.Generator
        For the noise.
    arm : Arm or None
        The hand and forearm that hold the handle.
    gain : float
        The light, as a factor on everything that the camera sees; the noise follows it.

    Returns
    -------
    ndarray of uint8, shape (height, width)

    Raises
    ------
    ValueError
        If the pose is not one rigid motion, `rng` no generator, or `gain` negative.
    """
    light = as_number(gain, "gain", 0.0) * blurred(radiance(camera, handle, T_world_handle, bench, arm), bench)
    return digitise(light, bench, rng)


def render_rig(rig: Rig, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench,
               rng: np.random.Generator, arm: Arm | None = None, gain: float = 1.0) -> list[np.ndarray]:
    """Take a frame with each camera of a rig, in its order; see `render`."""
    return [render(camera, handle, T_world_handle, bench, rng, arm, gain) for camera in rig.cameras]


def render_clip(view: Camera | Rig, handle: Handle, poses: RigidTransform | Sequence[RigidTransform | None],
                bench: Bench, rng: np.random.Generator, arm: Arm | Sequence[Arm | None] | None = None,
                lights: ArrayLike | None = None) -> Iterator[Any]:
    """Take the frames of a clip, one instant after the other: a frame of a camera, or the list of a rig's frames.

    Parameters
    ----------
    view : Camera or Rig
    handle : Handle
    poses : RigidTransform, or a sequence of RigidTransform and None
        n poses T_world_handle, None for the empty bench.
    bench : Bench
    rng : numpy.random.Generator
        For the noise.
    arm : Arm, or a sequence of n Arm and None, or None
        Who holds the handle, for all instants or for each.
    lights : array_like, shape (n,), or None
        The `gain` of each instant; None for 1.

    Raises
    ------
    ValueError
        At the call if `arm` or `lights` has another length than `poses`, or a light is negative; at the frame what
        `render` refuses.
    """
    take: Any = render_rig if isinstance(view, Rig) else render
    arms = [arm] * len(poses) if arm is None or isinstance(arm, Arm) else list(arm)
    if len(arms) != len(poses):
        raise ValueError(f"arm: expected one for each of {len(poses)} poses, got {len(arms)}")
    gains = np.ones(len(poses)) if lights is None else as_array(lights, "lights", (len(poses),))
    if (gains < 0).any():
        raise ValueError(f"lights: expected factors from 0, got {gains.min():g}")
    return (take(view, handle, poses[k], bench, rng, arms[k], float(gains[k])) for k in range(len(arms)))


def scaled(camera: Camera, factor: float) -> Camera:
    """The same camera with `factor` times as many pixels a side: 0.5 makes four pixels one.

    The corner of the image stays where it is, half a pixel outside the first centre: cx + 1/2 scales, not cx. Raises
    ValueError if the size does not come out in whole pixels.
    """
    factor = as_number(factor, "factor", 0.0, open_low=True)
    size = factor * np.array(camera.size)
    if (np.abs(size - np.round(size)) > 1e-9).any():
        raise ValueError(f"factor: expected whole pixels of {camera.size[0]} x {camera.size[1]}, got {factor:g}")
    matrix = np.diag([factor, factor, 1.0]) @ camera.matrix
    matrix[:2, 2] += (factor - 1) / 2
    width, height = np.round(size).astype(int)
    return Camera(camera.name, (int(width), int(height)), matrix, camera.distortions, camera.T_cam_world)


class _View(NamedTuple):
    """All that one frame shows: what may be seen where, bool (height, width), and what it is."""

    camera: Camera
    handle: Handle
    T_world_handle: RigidTransform
    bench: Bench
    arm: Arm | None
    solids: Capsules | None  # of the arm, camera frame
    body_mask: np.ndarray
    arm_mask: np.ndarray


def radiance(camera: Camera, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench,
             arm: Arm | None = None) -> Array:
    """The image before blur and noise: the mean grey of each pixel's area, shape (height, width).

    Pixels that an edge may cross have many samples (see `Bench`), all others one at the centre.
    """
    image = background(camera, bench).copy()
    if T_world_handle is None:
        return image
    view = _view(camera, handle, as_transform(T_world_handle, "T_world_handle"), bench, arm)
    labels = np.full(image.shape, EMPTY, np.int16)
    _sample(view, view.body_mask | view.arm_mask, image, labels, 1)
    counts = bench.supersampling, bench.marker_supersampling, _SKIN_SAMPLES
    for mask, count in zip(_edges(view, labels), counts, strict=True):
        image[mask] = background(camera, bench)[mask]
        _sample(view, mask, image, None, count)
    return image


def _view(camera: Camera, handle: Handle, T_world_handle: RigidTransform, bench: Bench, arm: Arm | None) -> _View:
    body = body_region(camera, handle, T_world_handle)
    if arm is None:
        return _View(camera, handle, T_world_handle, bench, None, None, body, np.zeros_like(body))
    solids = in_camera(camera, capsules(arm, handle, T_world_handle))
    return _View(camera, handle, T_world_handle, bench, arm, solids, body, capsule_region(camera, solids))


def _edges(view: _View, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels that an edge may cross: of the body, of a marker, and of skin before the background alone."""
    body, markers = edge_pixels(view.camera, view.handle, view.T_world_handle, labels)
    square = np.ones((3, 3), np.uint8)
    highest, lowest = cv2.dilate(labels, square), cv2.erode(labels, square)
    skin = body & (highest == EMPTY) & (lowest == _ARM)
    hidden = highest == _ARM  # an outline that runs behind the arm
    return body & ~skin & ~hidden, markers & ~skin & ~hidden, skin


def _sample(view: _View, mask: np.ndarray, image: Array, labels: np.ndarray | None, count: int) -> None:
    """Replace the pixels of `mask` by the mean of ``count ** 2`` samples; write what their centres see to `labels`."""
    offsets = sample_offsets(count)
    step = max(1, _CHUNK // len(offsets))
    rows, columns = np.nonzero(mask)
    body, arm = view.body_mask[rows, columns], view.arm_mask[rows, columns]
    for on_body, on_arm in ((True, False), (False, True), (True, True)):
        chosen = np.flatnonzero((body == on_body) & (arm == on_arm))
        for start in range(0, len(chosen), step):
            v, u = (index[chosen[start:start + step]] for index in (rows, columns))
            uv = (np.column_stack([u, v])[:, None] + offsets).reshape(-1, 2)
            grey, found = _look(view, uv, on_body, on_arm)
            grey = np.where(found == EMPTY, np.repeat(image[v, u], len(offsets)), grey)
            image[v, u] = grey.reshape(len(v), -1).mean(axis=1)
            if labels is not None:
                labels[v, u] = found


def _look(view: _View, uv: Array, on_body: bool, on_arm: bool) -> tuple[Array, np.ndarray]:
    """Grey of what the rays through pixels meet first, and its label, shapes (n,); NaN where they meet nothing."""
    grey, labels, depths = np.full(len(uv), np.nan), np.full(len(uv), EMPTY, np.int16), np.full(len(uv), np.inf)
    if on_body:
        hits = cast(view.camera, view.handle, view.T_world_handle, uv)
        grey, labels = _surface_grey(view.handle, view.T_world_handle, view.bench, hits), hits.labels
        depths = np.where(labels == EMPTY, np.inf, hits.depths)
    if on_arm and view.arm is not None and view.solids is not None:
        xy = view.camera.normalise(uv)
        skin = cast_capsules(view.solids, np.stack([xy[:, 0], xy[:, 1], np.ones(len(xy))]))
        nearer = skin.depths < depths
        points = np.column_stack([xy, np.ones(len(xy))])[nearer] * skin.depths[nearer, None]
        T_handle_cam = (view.camera.T_cam_world * view.T_world_handle).inv()
        normals = skin.normals[nearer] @ view.camera.T_cam_world.rotation.as_matrix()
        grey[nearer] = skin_grey(view.arm, T_handle_cam.apply(points)) * lambert(view.bench, normals @ view.bench.light)
        labels[nearer] = _ARM
    return grey, labels


def _surface_grey(handle: Handle, T_world_handle: RigidTransform, bench: Bench, hits: Hits) -> Array:
    """Grey of the surface at each hit, shape (n,); meaningless where a ray missed."""
    body, marker = (bench.body_grey, bench.marker_grey)[::1 if handle.markers == "bright" else -1]
    light = T_world_handle.rotation.inv().apply(bench.light)
    x, y, z = hits.points.T
    cap_cosine = np.where(y > (handle.top_mm + handle.bottom_mm) / 2, light[1], -light[1])
    on_side = (hits.labels == SIDE) | (hits.labels >= 0)
    cosine = np.where(on_side, (x * light[0] + z * light[2]) / handle.radius_mm, cap_cosine)
    return np.where(hits.labels >= 0, marker, body) * lambert(bench, cosine)
