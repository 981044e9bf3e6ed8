"""Files of other programs that a calibration reads: lenses, and a target's points as one long table
with the columns `COLUMNS`, the form to which caliscope's ``xy.csv`` and Anipose's ``detections.pickle``
are brought (Sect. 6.2).

A pickle can run any program. The reader here accepts lists, numbers and arrays of numbers, and nothing
else.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from ..camera import Camera, as_distortions
from ..checks import Array, as_whole, frozen
from ..files import limits
from ..files.inputs import get, read_csv, read_toml
from .target import Target
from .views import TargetViews

COLUMNS = ("camera", "view", "point", "u", "v")
# what caliscope calls these, now and in older versions
CALISCOPE = {
    "cam_id": "camera",
    "port": "camera",
    "sync_index": "view",
    "keypoint_id": "point",
    "point_id": "point",
    "img_loc_x": "u",
    "img_loc_y": "v",
}
TIMES = (("frame_time", "s"), ("frame", "frames"))  # columns that a table may have, and their units
PLACES = ("obj_loc_x", "obj_loc_y")
UNITS_MM = {"m": 1000.0, "cm": 10.0, "mm": 1.0}  # in which a table may have its places
SAME = 0.01  # share by which a length of a table may differ from the stated one
MOST_BYTES = 512 * limits.MIB
MOST_CAMERAS = 100
LARGEST_NUMBER = 1e12
# files beside a table that have the sizes of the images
CALISCOPE_CAMERAS, ANIPOSE_CAMERAS = "camera_array.toml", "calibration.toml"


def read_corners(
    path: str | Path,
    target: Target,
    most: int = 50,
    size: Sequence[int] | None = None,
    late: Mapping[str, int] | None = None,
) -> TargetViews:
    """Read a target's points from a table of another program.

    Parameters
    ----------
    path : path
        ``.csv`` with the columns `COLUMNS`, all of them numbers, or as caliscope writes it, whose
        `obj_loc_x`, `obj_loc_y` have to agree with the target; or ``.pickle`` as Anipose writes it. In
        all pixel (0, 0) is the middle of the first one.
    target : Target
        The target of the points.
    most : int
        The largest number of views; of more, some are passed over, evenly.
    size : (int, int), optional
        Width and height of the images of all cameras. Without it ``camera_array.toml``
        (caliscope) or ``calibration.toml`` (Anipose) beside the table states it.
    late : mapping of str to int, optional
        By how many frames a camera began later than the first one.

    Raises
    ------
    ValueError
        Names the file: unreadable, of another form, with points that the target does not have or in
        other places, without a size of the images, or with fewer than two cameras.
    """
    most = as_whole(most, "views", low=3)
    path = Path(path)
    if path.suffix.lower() == ".csv":
        table = _caliscope(path, target)
        beside = path.with_name(CALISCOPE_CAMERAS)
    elif path.suffix.lower() in (".pickle", ".pkl"):
        table = _anipose(path, target)
        beside = path.with_name(ANIPOSE_CAMERAS)
    else:
        raise ValueError(
            f"{path}: expected a table of caliscope (.csv) or of Anipose (.pickle) by its ending"
        )
    cameras, c = np.unique(table["camera"], return_inverse=True)
    if not 2 <= len(cameras) <= MOST_CAMERAS:
        raise ValueError(
            f"{path}: expected points of two or more cameras, at most {MOST_CAMERAS}, got {len(cameras)}"
        )
    sizes = _sizes(beside, [f"cam_{k}" for k in cameras], size)
    if late:
        frame = table["frame"] + np.array([late.get(name, 0) for name in sizes])[c]
        table = table.assign(frame=frame, view=frame.astype(int))
    every = np.unique(table["view"])
    views = every[:: -(-len(every) // most)]
    taken = np.isin(table["view"], views)
    v = np.searchsorted(views, table["view"][taken])
    uv = np.full((len(cameras), len(views), len(target.points), 2), np.nan)
    uv[c[taken], v, table["point"][taken]] = table[["u", "v"]][taken]
    times, unit = _times(table, views)
    nothing = frozen(np.zeros(uv.shape[:2], bool))
    return TargetViews(
        tuple(sizes),
        tuple(sizes.values()),
        tuple(map(str, views)),
        frozen(uv),
        frozen(~nothing),
        len(every) - len(views),
        nothing,
        nothing,
        times=times,
        time_unit=unit,
    )


def _times(table: pd.DataFrame, views: np.ndarray) -> tuple[Array | None, str]:
    """Times of the views, each the mean of its images', and their unit: by the first column of `TIMES`
    that rises; None if there is none.
    """
    for column, unit in TIMES:
        if column in table and pd.api.types.is_numeric_dtype(table[column]):
            times = table.groupby("view")[column].mean().reindex(views).to_numpy(float)
            if np.isfinite(times).all() and (np.diff(times) > 0).all():
                return frozen(times), unit
    return None, "frames"


# --- caliscope


def _caliscope(path: Path, target: Target) -> pd.DataFrame:
    table = read_csv(path).rename(columns=CALISCOPE)
    for column in COLUMNS:
        if column not in table:
            names = [name for name, ours in CALISCOPE.items() if ours == column]
            raise ValueError(
                f"{path}: column '{names[0]}' is missing (expected caliscope's table of points, or the "
                f"columns {', '.join(COLUMNS)})"
            )
    numbers = table[list(COLUMNS)]
    if not all(map(pd.api.types.is_numeric_dtype, numbers.dtypes)):
        raise ValueError(
            f"{path}: expected numbers in the columns of cameras, views, points and pixels"
        )
    table = table[numbers.notna().all(axis=1)]
    if table.empty:
        raise ValueError(f"{path}: has no point")
    if np.abs(table[list(COLUMNS)].to_numpy(float)).max() > LARGEST_NUMBER:
        raise ValueError(f"{path}: expected numbers up to {LARGEST_NUMBER:g}")
    table = table.astype({"camera": int, "view": int, "point": int})
    points = table["point"]
    if not (points.min() >= 0 and points.max() < len(target.points)):
        raise ValueError(
            f"{path}: has points {points.min()} to {points.max()}, the target ({target}) has "
            f"{len(target.points)} from 0: likely other columns or rows"
        )
    if set(PLACES) <= set(table):
        _check_places(table.dropna(subset=PLACES), target, path)
    return table.assign(frame=table["view"])


def _check_places(table: pd.DataFrame, target: Target, path: Path) -> None:
    """Refuse a table whose points lie elsewhere on the target, or on one of another size."""
    first = table.drop_duplicates("point")
    there = first[list(PLACES)].to_numpy(float)
    ours = np.asarray(target.points)[first["point"], :2]
    there, ours = there - there.mean(axis=0), ours - ours.mean(axis=0)
    if len(first) < 2 or not there.any():
        return
    scale = float((there * ours).sum() / (ours**2).sum())
    if np.abs(there - scale * ours).max() > SAME * np.abs(there).max():
        raise ValueError(
            f"{path}: its points lie otherwise than those of the target ({target}): likely other columns "
            "or rows"
        )
    if not any(abs(scale * unit - 1) < SAME for unit in UNITS_MM.values()):
        step = scale * target.square_mm
        squares = ", ".join(f"{step * mm:g} mm if in {unit}" for unit, mm in UNITS_MM.items())
        raise ValueError(
            f"{path}: its squares have {step:g} ({squares}), the stated target {target.square_mm:g} mm"
        )


# --- Anipose


class _Numbers(pickle._Unpickler):
    """Reads lists, dictionaries, numbers and NumPy's arrays of them; anything else is refused.

    It is based on Python's own unpickler, because the one in C reserves the memory that a file of a few
    bytes announces.
    """

    # an announced length is set aside before it is read
    dispatch: ClassVar = {
        code: read
        for code, read in pickle._Unpickler.dispatch.items()
        if code != pickle.BYTEARRAY8[0]
    }

    def find_class(self, module: str, name: str) -> Any:
        if module == "numpy" and name == "dtype":
            return lambda *form: np.dtype(*form)
        if module == "numpy" and name == "ndarray":
            return lambda *_: None
        if module in ("numpy.core.multiarray", "numpy._core.multiarray"):
            if name == "_reconstruct":
                # its contents come with its state, which NumPy compares with its shape
                return lambda *_: np.empty(0)
            if name == "scalar":
                return lambda form, data: np.frombuffer(data, form)[0]
        raise pickle.UnpicklingError(f"{module}.{name} is no number")


def _anipose(path: Path, target: Target) -> pd.DataFrame:
    try:
        data = limits.read_bytes(path, MOST_BYTES)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    try:
        loaded = _Numbers(io.BytesIO(data)).load()
        rows = [
            (c, _label(row["framenum"]), np.asarray(row["filled"], float).reshape(-1, 2))
            for c, of in enumerate(loaded)
            for row in of
        ]
    except Exception as error:  # a damaged pickle may raise anything
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        raise ValueError(f"{path}: is not what Anipose writes ({what})") from None
    if not rows or not all(map(len, loaded)):
        raise ValueError(f"{path}: has no point of one of its cameras")
    cameras, labels, pixels = zip(*rows, strict=True)
    n = len(target.points)
    if wrong := [len(uv) for uv in pixels if len(uv) != n]:
        raise ValueError(
            f"{path}: has {wrong[0]} points a view, the target ({target}) has {n}: likely other columns "
            "or rows"
        )
    u, v = np.concatenate(pixels).T
    table = pd.DataFrame(
        {
            "camera": np.repeat(cameras, n),
            "view": np.repeat(labels, n),
            "point": np.tile(np.arange(n), len(rows)),
            "u": u,
            "v": v,
        }
    )
    videos, frames = zip(*(label.rpartition("/")[::2] for label in labels), strict=True)
    if len(set(videos)) > 1:  # frames of several videos have no common clock
        return table
    return table.assign(frame=np.repeat(np.array(frames, float), n))


def _label(frame: Any) -> str:
    """A view's name: the number of the frame, behind that of the video if there are several."""
    numbers = np.atleast_1d(np.asarray(frame)).tolist()
    return "/".join(f"{int(number):06d}" for number in numbers)


# --- the sizes of images


def _sizes(
    beside: Path, cameras: Sequence[str], size: Sequence[int] | None
) -> dict[str, tuple[int, int]]:
    """The size of each camera's images by its name, in the order of the table; Anipose's file contains
    the names as well.
    """
    if size is not None:
        width, height = (as_whole(side, "size", 1, 100_000) for side in size)
        return dict.fromkeys(cameras, (width, height))
    if not beside.exists():
        raise ValueError(
            f"--size: expected width and height of the images, which no {beside.name} beside the table says"
        )
    try:
        tables = _numbered(read_toml(beside))
        of = [tables[camera] for camera in cameras]
        names = cameras if beside.name == CALISCOPE_CAMERAS else [table["name"] for table in of]
        sizes = [(int(table["size"][0]), int(table["size"][1])) for table in of]
    except (KeyError, TypeError, IndexError, AttributeError, OverflowError) as error:
        raise ValueError(f"{beside}: has no size of camera {error}; --size says it") from None
    return dict(zip(names, sizes, strict=True))


def _numbered(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The tables of a file's cameras, those of caliscope by ``cam_`` and their number."""
    cameras = tables.get("cameras")
    if not isinstance(cameras, dict):
        return dict(tables)
    return {f"cam_{key}": table for key, table in cameras.items()}


# --- lenses


def read_lenses(path: str | Path, cameras: Sequence[str]) -> list[Camera]:
    """The lenses of cameras, by their names, from a rig file or from caliscope's ``camera_array.toml``;
    where they stand is not read.

    Raises
    ------
    ValueError
        Names the file and the camera: unreadable, missing, a field that is missing or wrong.
    """
    tables = read_toml(path)
    named = _numbered(tables)
    if "cameras" not in tables:
        named = {of["name"]: of for of in named.values() if isinstance(of, dict) and "name" in of}
    if missing := [name for name in cameras if name not in named]:
        raise ValueError(
            f"{path}: has no camera {missing[0]}, which is to be calibrated ({', '.join(named)})"
        )
    return [_lens(named[name], name, f"{path}: camera {name}") for name in cameras]


def _lens(table: Mapping[str, Any], name: str, where: str) -> Camera:
    fields = [get(table, key, where) for key in ("size", "matrix", "distortions")]
    try:
        size, matrix, distortions = fields
        padded = [*distortions, *[0.0] * (5 - len(distortions))]
        lens = as_distortions(np.array(padded, float))
        return Camera(name, size, matrix, lens, RigidTransform.identity())
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from None
