"""The simulated bench without a handle: its light, surfaces and camera electronics, and the empty
background.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from ..camera import Camera
from ..checks import Array, as_image, as_rng, as_unit, as_whole, check_numbers, frozen


@dataclass(frozen=True)
class Bench:
    """Light, surfaces and camera electronics of the simulated bench; the defaults are the standard
    scene.

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
        Share of the light that comes from `light` (Lambert's cosine law); the rest is the same from
        everywhere. Grey = nominal grey x (1 - shading + shading x max(0, cosine)).
    supersampling, marker_supersampling : int
        A pixel at an edge of the body, or of a marker, is the mean of that many by that many
        samples. The centroid of a disc seen at 70 deg errs by up to 0.016 px at 8 x 8 and 0.008 px
        at 16 x 16. More samples do not help: the rest is the effect of whole pixels on a disc that
        is five pixels across.
    blur_px : float
        Standard deviation of the lens's Gaussian blur, px.
    shot_variance : float
        Noise variance per grey level, grey levels.
    read_noise : float
        Standard deviation of the noise in the dark, grey levels.
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
        check_numbers(
            self, "background_grey", "body_grey", "marker_grey", "read_noise", low=0.0, high=255
        )
        check_numbers(self, "texture_contrast", "shading", low=0.0, high=1)
        check_numbers(self, "blur_px", "shot_variance", low=0.0, high=100)
        for name, low, high in (
            ("texture_seed", 0, 2**63),
            ("supersampling", 1, 64),
            ("marker_supersampling", 1, 64),
        ):
            object.__setattr__(self, name, as_whole(getattr(self, name), name, low, high))
        object.__setattr__(self, "light", tuple(float(c) for c in as_unit(self.light, "light")))


def lambert(bench: Bench, cosine: Array) -> Array:
    """Share of its nominal grey that a surface shows, whose normal makes an angle of this cosine
    with the light.
    """
    return 1 - bench.shading + bench.shading * np.maximum(cosine, 0)


def background(camera: Camera, bench: Bench) -> Array:
    """The empty bench before blur and noise, shape (height, width), read-only; the same whenever it
    is asked for.
    """
    seed = (bench.texture_seed, zlib.crc32(camera.name.encode()))
    return _texture(camera.size, seed, bench.background_grey, bench.texture_contrast)


def blurred(image: Array, bench: Bench) -> Array:
    """Blur an image with the lens's Gaussian, cut off beyond five standard deviations; shape
    (height, width).
    """
    grey: Array = np.array(as_image(image, "image"), float)
    side = 2 * int(np.ceil(5 * bench.blur_px)) + 1
    if side > 1:
        cv2.GaussianBlur(
            grey, (side, side), bench.blur_px, dst=grey, borderType=cv2.BORDER_REPLICATE
        )
    return grey


def digitise(image: Array, bench: Bench, rng: np.random.Generator) -> np.ndarray:
    """Add noise of variance ``shot_variance * grey + read_noise ** 2``, round and clip to uint8
    (height, width).
    """
    grey = np.maximum(as_image(image, "image"), 0.0)
    noise = as_rng(rng).standard_normal(grey.shape, dtype=np.float32)
    deviation = grey * bench.shot_variance
    deviation += bench.read_noise**2
    noise *= np.sqrt(deviation, out=deviation)
    grey += noise
    return np.clip(np.rint(grey, out=grey), 0, 255, out=grey).astype(np.uint8)


@lru_cache(maxsize=8)
def _texture(size: tuple[int, int], seed: tuple[int, int], grey: float, contrast: float) -> Array:
    """Smooth random blotches of three sizes with a given mean and contrast, never below 0; shape
    (height, width).
    """
    rng = np.random.default_rng(seed)
    image = np.zeros((size[1], size[0]))
    for blotch in (6, 24, 96):  # px
        coarse = rng.standard_normal((size[1] // blotch + 3, size[0] // blotch + 3))
        whole = cv2.resize(coarse, None, fx=blotch, fy=blotch, interpolation=cv2.INTER_CUBIC)
        image += whole[blotch : blotch + size[1], blotch : blotch + size[0]]
    image -= image.mean()
    return frozen(np.maximum(grey + grey * contrast * image / max(image.std(), 1e-12), 0))
