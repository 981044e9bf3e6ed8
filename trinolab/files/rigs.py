"""Rig and handle files (TOML). Rigs have the layout that Anipose, FreeMoCap and Pose2Sim read, with a
table per camera.

The covariance of the cameras is in a separate file, ``rig.covariance.toml`` beside ``rig.toml``, so
that other programs can still read the rig. Cameras that are known exactly, such as those of simulated
images, have ``exact = true`` in the table ``metadata`` instead. A rig that states neither is taken for
a calibration of usual quality.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import Camera, Rig, RigCovariance, as_distortions
from ..checks import Array, as_array, as_number
from ..handle import Handle
from . import limits
from .foreign import caliscope_tables, foreign_tables
from .inputs import get, read_toml
from .outputs import write_together, write_whole

NEAREST_MM = 1e-6  # of two cameras
# of the two cameras that are farthest apart: beyond, it is likely another unit
NEAR_MM, FAR_MM = 10.0, 1e5
SHORTEST = 0.1  # focal length, as a share of the image's longer side
OFF_CENTRE = 0.1  # principal point from the image's middle, as a share of that side
COVARIANCE_FORMAT = "trinolab rig covariance 1"


def read_rig(path: str | Path) -> Rig:
    """Read a rig file (TOML, the layout that Anipose, FreeMoCap and Pose2Sim read), or one of another
    program that `foreign` turns into it.

    Tables without fields of a camera are ignored. A camera has `name`, `size`, `matrix`, `distortions`
    (4, 5 or 8, further ones only if they are zero), `rotation` (Rodrigues vector) and `translation`
    (mm), both world to camera. A covariance file beside it (`covariance_path`) is read as well. Of
    ``metadata`` two fields are read: ``exact = true`` for cameras that are known exactly, and
    ``error``, the reprojection error of the calibration, px, as Anipose writes it.

    Raises
    ------
    ValueError
        Names the file and the field: unreadable, missing, of another shape, not finite, a fisheye
        camera, two cameras in one place, exact ones with a covariance; what `Camera`, `Rig` and
        `read_covariance` refuse.
    """
    beside = covariance_path(path)
    with _named(path):
        tables = foreign_tables(path)
        tables = read_toml(path) if tables is None else tables
        metadata = tables.get("metadata", {})
        rig = Rig(tuple(_cameras(tables, path)), reprojection_px=_reprojection_px(metadata))
        _check_places(rig)
        _check_distances(rig)
        exact = isinstance(metadata, dict) and metadata.get("exact", False)
        if exact not in (True, False):
            raise ValueError(f"[metadata]: exact: expected true or false, got {exact!r}")
        if exact and beside.exists():
            raise ValueError(f"[metadata]: exact cameras have no covariance, but {beside} is there")
    if exact:
        return replace(rig, covariance=RigCovariance.exact(rig.names))
    return replace(rig, covariance=read_covariance(beside, rig)) if beside.exists() else rig


def _reprojection_px(metadata: Any) -> float | None:
    """The reprojection error in a calibration's metadata, if it is a valid one."""
    error = metadata.get("error") if isinstance(metadata, dict) else None
    if isinstance(error, bool) or not isinstance(error, int | float):
        return None
    return float(error) if np.isfinite(error) and error > 0 else None


def covariance_path(rig: str | Path) -> Path:
    """The place of the covariance file that belongs to a rig file: ``rig.covariance.toml`` beside
    ``rig.toml``.
    """
    return Path(rig).with_suffix(".covariance.toml")


def read_covariance(path: str | Path, rig: Rig) -> RigCovariance:
    """Read the covariance file of a rig (TOML).

    It has `format` (``trinolab rig covariance 1``), `cameras` (their names in the order of the
    rig), `parameters` and `units` of a camera (those of `camera.Rig.parameters`), and `matrix`,
    as `camera.RigCovariance` explains it; `freedom` only where that is finite.

    Raises
    ------
    ValueError
        Names the file and the field: unreadable, missing, of another format, of other cameras,
        parameters or units; what `RigCovariance` refuses.
    """
    with _named(path):
        table = read_toml(path, limits.COVARIANCE_BYTES)
        names, units = (list(part) for part in zip(*rig.parameters, strict=True))
        expected = {
            "format": COVARIANCE_FORMAT,
            "cameras": list(rig.names),
            "parameters": names,
            "units": units,
        }
        for key, value in expected.items():
            if (value_in_file := get(table, key, str(path))) != value:
                raise ValueError(f"{key}: expected {_text(value)}, got {_text(value_in_file)}")
        matrix = get(table, "matrix", str(path))
        freedom = as_number(table["freedom"], "freedom") if "freedom" in table else np.inf
        return RigCovariance(rig.names, matrix, freedom)


def _text(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else repr(value)


def read_camera(path: str | Path) -> Camera:
    """Read a file of the same layout with one camera, in a world frame of its own. The errors are those
    of `read_rig`.
    """
    with _named(path):
        cameras = _cameras(read_toml(path), path)
        if len(cameras) != 1:
            raise ValueError(f"expected one camera, got {len(cameras)}")
    return cameras[0]


@contextmanager
def _named(path: str | Path) -> Iterator[None]:
    """Prefix an error with the file's name, if it does not begin with it."""
    try:
        yield
    except ValueError as error:
        raise ValueError(
            str(error) if str(error).startswith(str(path)) else f"{path}: {error}"
        ) from None


def _cameras(tables: dict[str, Any], path: str | Path) -> list[Camera]:
    if {"radius_mm", "columns_deg"} & set(tables):
        raise ValueError(
            f"{path}: is a handle's file, expected cameras; likely the files of rig and handle are "
            "exchanged"
        )
    if tables.get("format") == COVARIANCE_FORMAT:
        raise ValueError(
            f"{path}: is a rig's covariance, expected its cameras, which are beside it"
        )
    if isinstance(arrays := tables.get("cameras"), dict):
        tables = caliscope_tables(arrays)
    cameras = {key: table for key, table in tables.items() if _is_camera(table)}
    limits.check_count(len(cameras or tables), limits.CAMERAS, "cameras")
    return [
        _camera_from(table, f"{path}: [{key if key.isprintable() else repr(key)}]")
        for key, table in cameras.items()
    ]


def _is_camera(table: Any) -> bool:
    return isinstance(table, dict) and bool({"matrix", "rotation", "translation"} & set(table))


def write_rig(rig: Rig, path: str | Path) -> None:
    """Write a rig file that `read_rig` reads back, and its covariance beside it if it has one that
    is not zero; whole or not at all.

    Raises
    ------
    ValueError
        If they cannot be written, or a rig without a covariance would take another rig's.
    """
    beside = covariance_path(path)
    if rig.covariance is not None and not rig.covariance.is_exact:
        write_together({path: rig_text(rig), beside: covariance_text(rig.covariance)})
        return
    if beside.exists():
        raise ValueError(f"{beside}: belongs to the rig that {path} was; remove it first")
    write_whole(path, rig_text(rig))


def rig_text(rig: Rig) -> str:
    """The text of a rig file."""
    tables: dict[str, Any] = {camera.name: _table_of(camera) for camera in rig.cameras}
    metadata: dict[str, Any] = {}
    if rig.covariance is not None and rig.covariance.is_exact:
        metadata["exact"] = True
    if rig.reprojection_px is not None:
        metadata["error"] = rig.reprojection_px
    if metadata:
        tables["metadata"] = metadata
    return tomli_w.dumps(tables)


def covariance_text(covariance: RigCovariance) -> str:
    """The text of a rig's covariance file."""
    names, units = (list(part) for part in zip(*covariance.parameters, strict=True))
    table: dict[str, Any] = {
        "format": COVARIANCE_FORMAT,
        "cameras": list(covariance.names),
        "parameters": names,
        "units": units,
        "matrix": covariance.matrix.tolist(),
    }
    if np.isfinite(covariance.freedom):
        table["freedom"] = covariance.freedom
    return tomli_w.dumps(table)


def _check_places(rig: Rig) -> None:
    """Refuse two cameras in one place: they determine no depth, and usually one of them is a copy."""
    for left, right in ((rig.cameras[i], rig.cameras[j]) for i, j in rig.pairs):
        if np.linalg.norm(left.centre - right.centre) < NEAREST_MM:
            raise ValueError(
                f"rotation, translation: expected cameras in different places, got {left.name} and "
                f"{right.name} in one"
            )


def _check_distances(rig: Rig) -> None:
    """Log a question about places that are probably not in mm."""
    widest = max(
        float(np.linalg.norm(rig.cameras[i].centre - rig.cameras[j].centre)) for i, j in rig.pairs
    )
    if not NEAR_MM <= widest <= FAR_MM:
        raise ValueError(
            f"translation: the cameras are at most {widest:.3g} mm apart; is it in "
            f"{'metres' if widest < NEAR_MM else 'micrometres'}? Expected mm"
        )


def _check_units(camera: Camera, rotvec: Array) -> None:
    """Refuse, with a question, a camera's numbers that are probably in another unit."""
    turn = float(np.linalg.norm(rotvec))
    if turn > 2 * np.pi:
        raise ValueError(
            f"rotation: {turn:.4g} rad is beyond a turn; is it in degrees? Expected rad"
        )
    size, K = np.array(camera.size, float), np.asarray(camera.matrix)
    focal, centre, longer = K[[0, 1], [0, 1]], K[:2, 2], size.max()
    if focal.min() < SHORTEST * longer:
        raise ValueError(
            f"matrix: a focal length of {focal.min():.4g} px for an image of {camera.size[0]} x "
            f"{camera.size[1]}; is it in mm, or a share of the image? Expected pixels"
        )
    off, off_turned = np.linalg.norm(centre - size / 2), np.linalg.norm(centre - size[::-1] / 2)
    if off > OFF_CENTRE * longer and off_turned < off / 4:
        raise ValueError(
            f"size: the principal point ({centre[0]:.5g}, {centre[1]:.5g}) is the middle of an image of "
            f"{camera.size[1]} x {camera.size[0]}; are width and height exchanged?"
        )


def _camera_from(table: dict[str, Any], where: str) -> Camera:
    if isinstance(table, dict) and table.get("fisheye", False):
        raise ValueError(f"{where}: fisheye lenses are not supported")
    fields = {
        key: get(table, key, where) for key in ("name", "size", "matrix", "rotation", "translation")
    }
    try:
        lens = as_distortions(as_array(table.get("distortions", ()), "distortions", (None,)))
        rotvec = np.array(as_array(fields["rotation"], "rotation", (3,)))  # SciPy wants it writable
        as_number(np.abs(rotvec).max(), "rotation: the largest", high=1e6)
        rotation = Rotation.from_rotvec(rotvec)
        T_cam_world = RigidTransform.from_components(
            as_array(fields["translation"], "translation", (3,)), rotation
        )
        camera = Camera(fields["name"], fields["size"], fields["matrix"], lens, T_cam_world)
        limits.check_pixels("size", *camera.size)
        _check_units(camera, rotvec)
        return camera
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def _table_of(camera: Camera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "size": list(camera.size),
        "matrix": camera.matrix.tolist(),
        "distortions": camera.distortions.tolist(),
        "rotation": camera.T_cam_world.rotation.as_rotvec().tolist(),
        "translation": camera.T_cam_world.translation.tolist(),
    }


def read_handle(path: str | Path) -> Handle:
    """Read a handle file (TOML).

    Raises
    ------
    ValueError
        Names the file and the field: unreadable, missing, unknown, refused by `Handle`, or markers
        on one line.
    """
    table = read_toml(path)
    if any(isinstance(part, dict) and "matrix" in part for part in table.values()):
        raise ValueError(
            f"{path}: is a rig's file, expected a handle; likely the files of rig and handle are "
            "exchanged"
        )
    names = tuple(Handle.__dataclass_fields__)
    if unknown := sorted(set(table) - set(names)):
        raise ValueError(f"{path}: {unknown[0]!r} is not a field of a handle ({', '.join(names)})")
    optional = ("markers", "placement_sigma_mm", "offsets_mm")
    fields = {
        name: get(table, name, str(path)) for name in names if name in table or name not in optional
    }
    try:
        limits.check_count(
            _places_in(fields["columns_deg"], fields["rows_mm"]), limits.MARKERS, "markers"
        )
        return _spread_out(Handle(**fields))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _places_in(columns: Any, rows: Any) -> int:
    """The number of columns, or of markers per column, in a handle file; 0 if it has no lists."""
    lists = [row for row in rows if isinstance(row, list)] if isinstance(rows, list) else []
    return max(len(columns) if isinstance(columns, list) else 0, sum(map(len, lists)))


def write_handle(handle: Handle, path: str | Path) -> None:
    """Write a handle file that `read_handle` reads back, whole or not at all; ValueError if it
    cannot be written.
    """
    write_whole(path, handle_text(handle))


def handle_text(handle: Handle) -> str:
    """The text of a handle file."""
    table: dict[str, Any] = {name: getattr(handle, name) for name in Handle.__dataclass_fields__}
    if not handle.offsets_mm:
        del table["offsets_mm"]
    if handle.placement_sigma_mm is None:
        del table["placement_sigma_mm"]
    return tomli_w.dumps(table)


def _spread_out(handle: Handle) -> Handle:
    """The handle. Refuses markers on one line, since a turn about it changes no image."""
    spread = np.linalg.svd(
        handle.marker_centres - handle.marker_centres.mean(axis=0), compute_uv=False
    )
    if len(spread) < 2 or spread[1] < 1e-3 * handle.marker_diameter_mm:
        raise ValueError(
            "columns_deg, rows_mm: expected markers that fix a pose, got all of them on one line"
        )
    return handle
