"""Pieces of a room as Mitsuba 3 sees them through a camera: the light that reaches windows of the
image.

Mitsuba's lens has square pixels and its axis in the middle of the image. A camera with the matrix K
sees of a scene what an ideal one, K0, sees of the scene moved by ``inv(K0) K``: all meshes come in
the camera's frame, and are moved so by less than one per cent. Straight lines stay straight, and
images are those of K, sharp or not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from trinolab.camera import Camera
from trinolab.checks import Array

from .room import Piece, Room, Texture, surround
from .shapes import Mesh

MISSING = "mitsuba: not installed; it comes with the extra second (pip install trinolab[second])"
# Mitsuba's camera frame has x to the left and y up.
_FLIP = np.diag([-1.0, -1.0, 1.0])


class Window(NamedTuple):
    """A part of the image: its first pixel, its size, and how many paths a pixel of it gets."""

    u: int
    v: int
    width: int
    height: int
    samples: int


@cache
def mitsuba() -> ModuleType:
    """The module, with the variant that needs nothing else. Raises ValueError if it is missing."""
    try:
        import mitsuba
    except ImportError:
        raise ValueError(MISSING) from None
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def traced(
    camera: Camera, pieces: Mapping[str, Piece], room: Room, windows: Iterable[Window], seed: int
) -> list[Array]:
    """The mean radiance of each pixel's area, traced along random paths.

    Parameters
    ----------
    camera : Camera
        Without lens distortion.
    pieces : mapping of str to Piece
        All that is in the room.
    room : Room
    windows : iterable of Window
        Inside the image.
    seed : int
        Of the paths; each window has its own.

    Returns
    -------
    list of ndarray, shape (height, width)
        For each window.

    Raises
    ------
    ValueError
        If Mitsuba is not installed, or the camera's lens distorts.
    """
    mi = mitsuba()
    if np.any(camera.distortions):
        raise ValueError(f"camera {camera.name}: expected no distortion, got {camera.distortions}")
    contents: dict[str, Any] = {name: _shape(name, piece, camera) for name, piece in pieces.items()}
    if room.surround > 0:
        contents["surround"] = _surround(camera, room)
    paths = {"type": "path", "max_depth": room.bounces + 1, "rr_depth": 100}
    scene = mi.load_dict({"type": "scene", "integrator": paths, **contents})
    seeds = np.random.SeedSequence(seed).generate_state(1000)
    images = []
    for window, own in zip(windows, seeds, strict=False):
        lens = mi.load_dict(_lens(camera, room, window))
        images.append(np.array(mi.render(scene, sensor=lens, seed=int(own)), float)[..., 0])
    return images


def _lens(camera: Camera, room: Room, window: Window) -> dict[str, Any]:
    width, height = camera.size
    lens = {
        "type": "perspective",
        "fov": float(2 * np.rad2deg(np.arctan(width / 2 / _ideal(camera)[0, 0]))),
        "fov_axis": "x",
        "near_clip": 1.0,
        "far_clip": 1e5,
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "crop_offset_x": window.u,
            "crop_offset_y": window.v,
            "crop_width": window.width,
            "crop_height": window.height,
            "rfilter": {"type": "box"},
            "pixel_format": "luminance",
            "component_format": "float32",
        },
        "sampler": {"type": "multijitter", "sample_count": window.samples},
    }
    if room.aperture_mm > 0:
        lens |= {
            "type": "thinlens",
            "aperture_radius": room.aperture_mm,
            "focus_distance": room.focus_mm,
        }
    return lens


def _ideal(camera: Camera) -> Array:
    """The matrix K0 of a camera of the same size, with square pixels and its axis in the middle."""
    (width, height), focal = camera.size, float(camera.focal.mean())
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def _shape(name: str, piece: Piece, camera: Camera) -> Any:
    mi = mitsuba()
    mesh = piece.mesh
    properties = mi.Properties()
    properties["mesh_bsdf"] = _material(piece.kind, piece.paint, piece.roughness)
    if piece.kind == "lamp":
        properties["mesh_emitter"] = mi.load_dict(
            {"type": "area", "radiance": _paint(piece.paint), "sampling_weight": _mean(piece.paint)}
        )
    shape = mi.Mesh(
        name,
        vertex_count=len(mesh.points),
        face_count=len(mesh.faces),
        has_vertex_normals=True,
        has_vertex_texcoords=True,
        props=properties,
    )
    points, normals = _seen(mesh, camera)
    buffers = mi.traverse(shape)
    buffers["vertex_positions"] = points.astype(np.float32).ravel()
    buffers["vertex_normals"] = normals.astype(np.float32).ravel()
    buffers["vertex_texcoords"] = mesh.uv.astype(np.float32).ravel()
    buffers["faces"] = mesh.faces.astype(np.uint32).ravel()
    buffers.update()
    return shape


def _seen(mesh: Mesh, camera: Camera) -> tuple[Array, Array]:
    """Points and normals in Mitsuba's camera frame, moved for the ideal camera."""
    M = _FLIP @ np.linalg.inv(_ideal(camera)) @ camera.matrix
    points = camera.T_cam_world.apply(mesh.points) @ M.T
    normals = camera.T_cam_world.rotation.apply(mesh.normals) @ np.linalg.inv(M)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


@lru_cache(maxsize=64)
def _material(kind: str, paint: float | Texture, roughness: float) -> Any:
    """What a surface does with light; prepared once, which takes a while."""
    if kind == "lamp":
        return mitsuba().load_dict({"type": "diffuse", "reflectance": 0.0})
    if kind == "metal":
        inner: dict[str, Any] = {"type": "roughconductor", "material": "Al", "alpha": roughness}
    elif kind == "varnished":
        inner = {"type": "roughplastic", "alpha": roughness, "diffuse_reflectance": _paint(paint)}
    else:
        inner = {"type": "diffuse", "reflectance": _paint(paint)}
    return mitsuba().load_dict({"type": "twosided", "inner": inner})


def _paint(paint: float | Texture) -> dict[str, Any]:
    if isinstance(paint, float):
        return {"type": "rgb", "value": paint}
    return {
        "type": "bitmap",
        "bitmap": mitsuba().Bitmap(np.array(paint.values)[..., None]),
        "raw": True,
        "filter_type": "bilinear",
        "wrap_mode": "repeat",
    }


def _mean(paint: float | Texture) -> float:
    return paint if isinstance(paint, float) else float(paint.values.mean())


def _surround(camera: Camera, room: Room) -> Any:
    mi = mitsuba()
    turn = np.eye(4)
    turn[:3, :3] = _FLIP @ camera.T_cam_world.rotation.as_matrix()
    image = np.repeat(surround(room).values[..., None], 3, axis=2)
    # It is dim and wide: most paths should ask the lamps.
    return mi.load_dict(
        {
            "type": "envmap",
            "bitmap": mi.Bitmap(image),
            "to_world": mi.ScalarTransform4f(turn),
            "sampling_weight": 0.1 * room.lamp,
        }
    )
