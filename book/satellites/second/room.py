"""The room and what stands in it: lamps, surfaces and lens as numbers, textures drawn by a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.checks import as_whole, check_numbers, frozen
from trinolab.handle import Handle

from .shapes import Mesh, band, capsule, disc, marker_texture, moved, panel, tube

# Middles and half sides of the lamps, world frame, mm: they stand behind and beside the cameras.
_LAMPS = (
    ((-350.0, -480.0, -60.0), (-110.0, 80.0, 0.0), (0.0, 60.0, -70.0)),
    ((430.0, 110.0, 60.0), (-60.0, 0.0, -70.0), (0.0, 90.0, 0.0)),
)
_WALL_Z_MM, _TABLE_Y_MM = 1000.0, 300.0
# A glove that holds the body, handle frame: starts, ends and radii of its capsules, mm.
_GLOVE = (
    ((-13.0, -52.0, 6.0), (12.0, -54.0, 8.0), 9.0),
    ((-13.0, -69.0, 6.0), (12.0, -71.0, 8.0), 9.0),
    ((-13.0, -86.0, 6.0), (12.0, -88.0, 8.0), 9.0),
    ((-13.0, -102.0, 6.0), (12.0, -104.0, 8.0), 8.0),
    ((0.0, -60.0, -20.0), (0.0, -98.0, -20.0), 15.0),
    ((0.0, -98.0, -24.0), (40.0, -260.0, -60.0), 24.0),
)


@dataclass(frozen=True)
class Room:
    """The path-traced room; the defaults are those of the stored recipe.

    Attributes
    ----------
    seed : int
        Of all textures.
    aperture_mm : float
        Radius of the lens's opening; 0 is a pinhole.
    focus_mm : float
        Distance along the axis that the lens shows sharp.
    marker_reflectance, body_reflectance : float
        Of the paint; on a handle with dark markers the two change places.
    roughness : float
        Of the varnish over the paint (Beckmann's alpha): 0.3 is satin, 0.1 is glossy.
    lamp, second_lamp, surround : float
        Mean radiance of the two textured lamps, and of all that is around the room.
    bounces : int
        Surfaces on the longest way from a lamp to the camera; 1 leaves out interreflection.
    samples, near_samples, far_samples : int
        Paths a pixel on and beside a marker, between the markers, and along the rest of the handle.
    grey_per_radiance : float
        Grey levels; 0 to 255.
    electrons_per_grey : float
        Electrons that a pixel collects for a grey level: the fewer, the more shot noise.
    read_electrons : float
        Standard deviation of the electrons that reading adds.
    """

    seed: int = 7
    aperture_mm: float = 1.5
    focus_mm: float = 560.0
    marker_reflectance: float = 0.75
    body_reflectance: float = 0.16
    roughness: float = 0.25
    lamp: float = 130.0
    second_lamp: float = 70.0
    surround: float = 0.5
    bounces: int = 2
    samples: int = 196
    near_samples: int = 9
    far_samples: int = 2
    grey_per_radiance: float = 100.0
    electrons_per_grey: float = 20.0
    read_electrons: float = 25.0

    def __post_init__(self) -> None:
        check_numbers(self, "aperture_mm", "lamp", "second_lamp", "surround", low=0.0)
        check_numbers(self, "read_electrons", low=0.0)
        check_numbers(
            self, "focus_mm", "electrons_per_grey", "grey_per_radiance", low=0.0, open_low=True
        )
        check_numbers(self, "marker_reflectance", "body_reflectance", low=0.0, high=1.0)
        check_numbers(self, "roughness", low=0.01, high=1.0)
        for name in ("bounces", "samples", "near_samples", "far_samples"):
            object.__setattr__(self, name, as_whole(getattr(self, name), name, 1, 4096))
        object.__setattr__(self, "seed", as_whole(self.seed, "seed", 0, 2**63))


@dataclass(frozen=True, eq=False)
class Texture:
    """Values over a surface, float32 (height, width), whose row 0 lies at v = 0. Each is itself
    alone: it may be a key.
    """

    values: np.ndarray

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(np.asarray(self.values, np.float32)))


class Piece(NamedTuple):
    """A surface of the room.

    Attributes
    ----------
    mesh : Mesh
        World frame, mm.
    kind : str
        ``matt``, ``varnished``, ``metal`` or ``lamp``.
    paint : float or Texture
        Reflectance; of a lamp its radiance, of metal nothing.
    roughness : float
        Of varnish and metal (Beckmann's alpha).
    """

    mesh: Mesh
    kind: str
    paint: float | Texture
    roughness: float = 0.0


@lru_cache(maxsize=4)
def empty_room(room: Room) -> Mapping[str, Piece]:
    """Lamps, wall, table, a white card beside the handle and a block of brushed metal, by name."""
    wall = panel((0, 0, _WALL_Z_MM), (900.0, 0, 0), (0, 700.0, 0))
    table = panel((0, _TABLE_Y_MM, 500.0), (900.0, 0, 0), (0, 0, 500.0))
    card = panel((-240.0, 40.0, 560.0), (0, 0, 120.0), (0, -150.0, 0))
    block = panel((130.0, _TABLE_Y_MM - 40.0, 620.0), (35.0, 0, 0), (0, 0, -45.0))
    pieces = {
        "wall": Piece(wall, "matt", _blotches(room.seed, (300, 400), 0.32, 0.1)),
        "table": Piece(table, "matt", _blotches(room.seed + 1, (300, 500), 0.28, 0.1)),
        "card": Piece(card, "matt", 0.7),
        "block": Piece(block, "metal", 0.0, 0.35),
    }
    for k, (place, radiance) in enumerate(zip(_LAMPS, (room.lamp, room.second_lamp), strict=True)):
        pieces[f"lamp{k}"] = Piece(panel(*place), "lamp", _window(room.seed + 2 + k, radiance))
    return MappingProxyType(pieces)


def handle_pieces(handle: Handle, T_world_handle: RigidTransform, room: Room) -> dict[str, Piece]:
    """The handle: its band of markers, the body below and above it, both caps."""
    radius, (low, high) = handle.radius_mm, band(handle)
    plain, painted = _paints(handle, room)
    meshes = {
        "band": tube(radius, low, high),
        "below": tube(radius, handle.bottom_mm, low),
        "above": tube(radius, high, handle.top_mm),
        "bottom": disc(radius, handle.bottom_mm, up=False),
        "top": disc(radius, handle.top_mm, up=True),
    }
    return {
        name: Piece(
            moved(mesh, T_world_handle),
            "varnished",
            painted if name == "band" else plain,
            room.roughness,
        )
        for name, mesh in meshes.items()
    }


@lru_cache(maxsize=8)
def _paints(handle: Handle, room: Room) -> tuple[float, Texture]:
    """Reflectance of the body, and of the band of markers."""
    body, marker = room.body_reflectance, room.marker_reflectance
    if handle.markers == "dark":
        body, marker = marker, body
    return body, Texture(body + (marker - body) * marker_texture(handle))


def glove(T_world_handle: RigidTransform) -> dict[str, Piece]:
    """A gloved hand with its forearm, which holds the body below the markers."""
    return {
        f"glove{k}": Piece(moved(capsule(*one), T_world_handle), "matt", 0.2)
        for k, one in enumerate(_GLOVE)
    }


@lru_cache(maxsize=4)
def surround(room: Room) -> Texture:
    """Radiance that comes from around the room, by latitude and longitude."""
    return _blotches(room.seed + 9, (32, 64), room.surround, 0.4 * room.surround)


def _blotches(seed: int, shape: tuple[int, int], mean: float, spread: float) -> Texture:
    """Random spots of many sizes, one spread about the mean and never below a tenth of it."""
    noise = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    total = np.zeros(shape, np.float32)
    for size in (1.0, 3.0, 9.0):
        spots = cv2.GaussianBlur(noise, (0, 0), size)
        total += spots / spots.std()
    return Texture(np.maximum(mean + spread * total / total.std(), 0.1 * mean))


def _window(seed: int, mean: float) -> Texture:
    """A lamp like a window: four panes with dark bars between, and a sky that is not even."""
    sky = _blotches(seed, (64, 96), 1.0, 0.25).values.copy()
    sky[:, 46:50] = 0.05
    sky[30:34] = 0.05
    return Texture(mean * sky / sky.mean())
