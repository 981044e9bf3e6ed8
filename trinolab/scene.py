"""The simulated bench: what cameras would see of the handle, with the truth.

A frame is ``digitise(blurred(radiance(...)))``: the light that reaches each pixel's area, the lens's blur, then shot
and read noise and 8 bit. Motion blur is the mean of `radiance` over the poses of an exposure, before the blur.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from .camera import Camera, Rig
from .checks import Array, as_array, as_image, as_number, as_transform, as_unit, frozen
from .handle import Handle, slants
from .raycast import EMPTY, SIDE, Hits, body_region, cast, edge_pixels, marker_outline, sample_offsets, shown_share

_CHUNK = 16_384  # rays cast at once: their arrays stay in the cache


@dataclass(frozen=True)
class Bench:
    """Light, surfaces and camera electronics of the simulated bench; the defaults are the standard scene.

    Attributes
    ----------
    background_grey : float
        Mean of the background, grey levels (0 to 255, like all greys).
    texture_contrast : float
        Standard deviation of the background's texture as a share of its mean.
    texture_seed : int
        Of the texture; it differs from camera to camera, and stays the same from frame to frame.
    body_grey, marker_grey : float
        Of a surface that faces the light. On a handle with dark markers the two change places.
    light : tuple of 3 floats
        Direction towards the light, world frame.
    shading : float
        Share of the light that comes from `light` (Lambert's cosine law); the rest is the same from everywhere.
        Grey = nominal grey x (1 - shading + shading x max(0, cosine)).
    supersampling, marker_supersampling : int
        A pixel at an edge of the body, or of a marker, is the mean of that many by that many samples. A disc seen at
        70 deg has its centroid off by up to 0.016 px at 8 x 8 and 0.008 px at 16 x 16. More do not help: the rest is
        what whole pixels do to a disc five of them across.
    blur_px : float
        Standard deviation of the lens's Gaussian blur, px.
    shot_variance : float
        Noise variance a grey level, grey levels.
    read_noise : float
        Standard deviation of the noise in the dark, grey levels.

    Raises
    ------
    ValueError
        Names the field: no number, out of range, or no direction.
    """

    background_grey: float = 45.0
    texture_contrast: float = 0.15
    texture_seed: int = 0
    body_grey: float = 90.0
    marker_grey: float = 220.0
    light: tuple[float, float, float] = (-0.2, -0.3, -1.0)
    shading: float = 0.3
    supersampling: int = 8
    marker_supersampling: int = 16
    blur_px: float = 0.7
    shot_variance: float = 0.05
    read_noise: float = 1.5

    def __post_init__(self) -> None:
        for name, high in (("background_grey", 255), ("texture_contrast", 1), ("body_grey", 255), ("marker_grey", 255),
                           ("shading", 1), ("blur_px", 100), ("shot_variance", 100), ("read_noise", 255)):
            object.__setattr__(self, name, as_number(getattr(self, name), name, 0.0, high))
        for name, low, high in (("texture_seed", 0, 2**63), ("supersampling", 1, 64), ("marker_supersampling", 1, 64)):
            if as_number(getattr(self, name), name, low, high) % 1:
                raise ValueError(f"{name}: expected a whole number, got {getattr(self, name)!r}")
            object.__setattr__(self, name, int(getattr(self, name)))
        object.__setattr__(self, "light", tuple(float(c) for c in as_unit(self.light, "light")))


def render(camera: Camera, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench,
           rng: np.random.Generator) -> np.ndarray:
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

    Returns
    -------
    ndarray of uint8, shape (height, width)

    Raises
    ------
    ValueError
        If the pose is not one rigid motion, or `rng` no generator.
    """
    return digitise(blurred(radiance(camera, handle, T_world_handle, bench), bench), bench, rng)


def render_rig(rig: Rig, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench,
               rng: np.random.Generator) -> list[np.ndarray]:
    """Take a frame with each camera of a rig, in its order; see `render`."""
    return [render(camera, handle, T_world_handle, bench, rng) for camera in rig.cameras]


def radiance(camera: Camera, handle: Handle, T_world_handle: RigidTransform | None, bench: Bench) -> Array:
    """The image before blur and noise: the mean grey of each pixel's area, shape (height, width).

    Pixels that an edge may cross have many samples (see `Bench`), all others one at the centre.
    """
    image = background(camera, bench).copy()
    if T_world_handle is None:
        return image
    region = body_region(camera, handle, as_transform(T_world_handle, "T_world_handle"))
    labels = np.full(image.shape, EMPTY, np.int16)
    _sample(camera, handle, T_world_handle, bench, region, image, labels, 1)
    edges = edge_pixels(camera, handle, T_world_handle, labels)
    for mask, count in zip(edges, (bench.supersampling, bench.marker_supersampling), strict=True):
        image[mask] = background(camera, bench)[mask]
        _sample(camera, handle, T_world_handle, bench, mask, image, None, count)
    return image


def background(camera: Camera, bench: Bench) -> Array:
    """The empty bench before blur and noise, shape (height, width), read-only; the same whenever it is asked for."""
    seed = (bench.texture_seed, zlib.crc32(camera.name.encode()))
    return _texture(camera.size, seed, bench.background_grey, bench.texture_contrast)


def blurred(image: Array, bench: Bench) -> Array:
    """Blur an image with the lens's Gaussian, cut off beyond five standard deviations; shape (height, width).

    Raises ValueError if `image` is no grey image.
    """
    grey: Array = np.array(as_image(image, "image"), float)
    side = 2 * int(np.ceil(5 * bench.blur_px)) + 1
    if side > 1:
        cv2.GaussianBlur(grey, (side, side), bench.blur_px, dst=grey, borderType=cv2.BORDER_REPLICATE)
    return grey


def digitise(image: Array, bench: Bench, rng: np.random.Generator) -> np.ndarray:
    """Add noise of variance ``shot_variance * grey + read_noise ** 2``, round and clip to uint8 (height, width).

    Raises ValueError if `image` is no grey image, or `rng` no generator.
    """
    image = np.maximum(as_image(image, "image"), 0)
    noise = _as_rng(rng).standard_normal(image.shape, dtype=np.float32)
    noise *= np.sqrt(bench.shot_variance * image + bench.read_noise**2)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def true_visibility(camera: Camera, handle: Handle, T_world_handle: RigidTransform) -> np.ndarray:
    """Which markers a camera truly sees, bool (markers,).

    Truly seen: slant at most 62 deg, at least 80 % of the marker not hidden by the body, and all of it at least 10 px
    inside the image. Raises ValueError if `T_world_handle` is not one rigid motion.
    """
    as_transform(T_world_handle, "T_world_handle")
    steep = slants(handle, T_world_handle, camera.centre) > np.deg2rad(62)
    viewpoint = T_world_handle.inv().apply(camera.centre)
    shown = np.array([shown_share(handle, k, viewpoint) for k in range(len(steep))])
    inside = [camera.sees(T_world_handle.apply(marker_outline(handle, k)), 10).all() for k in range(len(steep))]
    return ~steep & (shown >= 0.8) & np.array(inside)


def random_pose(rng: np.random.Generator, x_mm: tuple[float, float] = (-90, 90), y_mm: tuple[float, float] = (-60, 60),
                z_mm: tuple[float, float] = (520, 620), tilt_deg: tuple[float, float] = (60, 120)) -> RigidTransform:
    """Draw a pose T_world_handle of the standard scene.

    Parameters
    ----------
    rng : numpy.random.Generator
    x_mm, y_mm, z_mm : (float, float)
        Range of the handle's origin in the world frame.
    tilt_deg : (float, float)
        Range of the angle between the handle's axis and the world's z axis (the line of sight of a first camera whose
        frame is the world). The axis is uniform over that band of the sphere, the turn about it uniform.

    Raises
    ------
    ValueError
        If `rng` is no generator, or a range is not two numbers.
    """
    ranges = as_array((x_mm, y_mm, z_mm), "x_mm, y_mm, z_mm", (3, 2))
    position = _as_rng(rng).uniform(ranges.min(axis=1), ranges.max(axis=1))
    polar = np.arccos(rng.uniform(*np.sort(np.cos(np.deg2rad(as_array(tilt_deg, "tilt_deg", (2,)))))))
    azimuth, turn = rng.uniform(0, 2 * np.pi, 2)
    # the handle's y axis is laid on the world's z, tipped to the polar angle, and turned to the azimuth
    rotation = Rotation.from_euler("ZYX", [azimuth, polar, np.pi / 2]) * Rotation.from_rotvec([0.0, turn, 0.0])
    return RigidTransform.from_components(position, rotation)


def _sample(camera: Camera, handle: Handle, T_world_handle: RigidTransform, bench: Bench, mask: np.ndarray,
            image: Array, labels: np.ndarray | None, count: int) -> None:
    """Replace the pixels of `mask` by the mean of ``count ** 2`` samples; write what their centres see to `labels`."""
    offsets = sample_offsets(count)
    rows, columns = np.nonzero(mask)
    for start in range(0, len(rows), max(1, _CHUNK // len(offsets))):
        v, u = (index[start:start + max(1, _CHUNK // len(offsets))] for index in (rows, columns))
        uv = (np.column_stack([u, v])[:, None] + offsets).reshape(-1, 2)
        hits = cast(camera, handle, T_world_handle, uv)
        behind = np.repeat(image[v, u], len(offsets))
        grey = np.where(hits.labels == EMPTY, behind, _surface_grey(handle, T_world_handle, bench, hits))
        image[v, u] = grey.reshape(len(v), -1).mean(axis=1)
        if labels is not None:
            labels[v, u] = hits.labels


def _surface_grey(handle: Handle, T_world_handle: RigidTransform, bench: Bench, hits: Hits) -> Array:
    """Grey of the surface at each hit, shape (n,); meaningless where a ray missed."""
    body, marker = (bench.body_grey, bench.marker_grey)[::1 if handle.markers == "bright" else -1]
    light = T_world_handle.rotation.inv().apply(bench.light)
    x, y, z = hits.points.T
    cap_cosine = np.where(y > (handle.top_mm + handle.bottom_mm) / 2, light[1], -light[1])
    on_side = (hits.labels == SIDE) | (hits.labels >= 0)
    cosine = np.where(on_side, (x * light[0] + z * light[2]) / handle.radius_mm, cap_cosine)
    shade = 1 - bench.shading + bench.shading * np.maximum(cosine, 0)
    return np.where(hits.labels >= 0, marker, body) * shade


@lru_cache(maxsize=8)
def _texture(size: tuple[int, int], seed: tuple[int, int], grey: float, contrast: float) -> Array:
    """Smooth random blotches of three sizes with a given mean and contrast, never below 0; shape (height, width)."""
    rng = np.random.default_rng(seed)
    image = np.zeros((size[1], size[0]))
    for blotch in (6, 24, 96):  # px
        coarse = rng.standard_normal((size[1] // blotch + 3, size[0] // blotch + 3))
        whole = cv2.resize(coarse, None, fx=blotch, fy=blotch, interpolation=cv2.INTER_CUBIC)
        image += whole[blotch:blotch + size[1], blotch:blotch + size[0]]
    image -= image.mean()
    return frozen(np.maximum(grey + grey * contrast * image / max(image.std(), 1e-12), 0))


def _as_rng(rng: np.random.Generator) -> np.random.Generator:
    if not isinstance(rng, np.random.Generator):
        raise ValueError(f"rng: expected a numpy.random.Generator, got {type(rng).__name__}")
    return rng
