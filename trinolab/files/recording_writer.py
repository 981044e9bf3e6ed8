"""Write a recording folder: instant by instant into a folder beside it, which takes its name when
it is whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from ..camera import Rig
from ..handle import Handle
from .inputs import read_json
from .outputs import check_parent, resolved, table_text, write_whole
from .poses import write_poses
from .rigs import write_handle, write_rig

PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
# filters take time
STORED_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 0, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE]
MANIFEST = "made_from.json"
PARTIAL = ".partial"  # behind the name of a recording that is not finished


def partial_of(folder: str | Path) -> Path:
    """The folder that an unfinished recording is in.

    Raises
    ------
    ValueError
        If there is something at `folder` already, or nothing can be written beside it.
    """
    target = resolved(folder)
    check_parent(folder)
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise ValueError(f"{folder}: exists already; name another folder, or remove it")
    return target.with_name(target.name + PARTIAL)


def begin(
    folder: str | Path,
    rig: Rig | Sequence[str],
    handle: Handle | None = None,
    backgrounds: Mapping[str, np.ndarray] | None = None,
) -> Path:
    """Make the unfinished folder with all that is known before the first instant, and return it.

    Parameters
    ----------
    folder : path
    rig : Rig or sequence of str
        The cameras, or only their names where they are not calibrated: the folder then has no rig
        file.
    handle : Handle, optional
    backgrounds : mapping of str to ndarray, optional
        A camera's empty scene, uint8.

    Raises
    ------
    ValueError
        As `partial_of` and `check_names`, or if something cannot be written.
    """
    partial = partial_of(folder)
    check_names(_names(rig))
    for name in _names(rig):
        _make_folder(partial / "images" / name)
    if isinstance(rig, Rig):
        write_rig(rig, partial / "rig.toml")
    if handle is not None:
        write_handle(handle, partial / "handle.toml")
    if backgrounds is not None:
        _make_folder(partial / "background")
        for name, image in backgrounds.items():
            write_image(image, partial / "background" / f"{name}.png")
    return partial


def check_names(cameras: Iterable[str]) -> None:
    """Refuse, with a ValueError, a camera's name that cannot name its folder."""
    for name in cameras:
        if not name or name.startswith(".") or set(name) & set("/\\:\0"):
            raise ValueError(f"camera: expected a name that a folder can have, got {name!r}")


def check_cameras(cameras: Iterable[str], rig: Rig, absent: str) -> None:
    """Refuse, with a ValueError, other cameras than those of a rig; `absent` is the fault of a
    camera of the rig that is not among them.
    """
    given = list(cameras)
    names = ", ".join(rig.names)
    if missing := [name for name in rig.names if name not in given]:
        raise ValueError(f"{missing[0]}: {absent} ({names})")
    if unknown := [name for name in given if name not in rig.names]:
        raise ValueError(f"{unknown[0]}: a camera that the rig does not have ({names})")


def claim(partial: Path, manifest: Mapping[str, Any]) -> None:
    """Write into an unfinished folder what the recording is made from, so that it can be resumed.

    Raises
    ------
    ValueError
        If the folder was begun with something else, or cannot be written.
    """
    path = partial / MANIFEST
    if partial.is_dir() and any(partial.iterdir()):
        begun = read_manifest(path)
        if differing := [name for name in manifest if begun.get(name) != manifest[name]]:
            raise ValueError(
                f"{partial}: an unfinished recording with another {differing[0]}; remove it, or name another "
                "folder"
            )
        return
    write_whole(path, json.dumps(manifest, indent=1) + "\n")


def read_manifest(path: Path) -> dict[str, Any]:
    """The manifest of a recording: what it was made from; empty if the file cannot be read."""
    try:
        manifest = read_json(path)
    except ValueError:
        return {}
    return manifest if isinstance(manifest, dict) else {}


def image_paths(partial: Path, rig: Rig | Sequence[str], frame: int) -> list[Path]:
    """Paths of the images of an instant, one per camera."""
    return [partial / "images" / name / f"{frame:06d}.png" for name in _names(rig)]


def add(partial: Path, rig: Rig | Sequence[str], frame: int, images: Sequence[np.ndarray]) -> None:
    """Write the images of an instant, uint8, one per camera. Raises ValueError if one cannot be
    written.
    """
    for path, image in zip(image_paths(partial, rig, frame), images, strict=True):
        write_image(image, path)


def finish(folder: str | Path, times_s: Sequence[float], truth: pd.DataFrame | None = None) -> None:
    """Write times and truth, and give the folder its name.

    Raises
    ------
    ValueError
        If something cannot be written, or something is at `folder` by now.
    """
    partial = partial_of(folder)
    table = pd.DataFrame({"frame": np.arange(len(times_s)), "t_s": times_s})
    write_whole(partial / "timestamps.csv", table_text(table))
    if truth is not None:
        write_poses(truth, partial / "truth.csv")
    give_name(folder)


def give_name(folder: str | Path) -> None:
    """Give a recording that is whole its name. Raises ValueError as `finish` does."""
    partial = partial_of(folder)
    try:
        partial.rename(Path(folder).resolve())
    except OSError as error:
        raise ValueError(f"{folder}: cannot be written ({error.strerror})") from None


def write_image(image: np.ndarray, path: Path, fast: bool = False) -> None:
    """Write a grey image, uint8, as PNG, whole or not at all; `fast` needs a seventh of the time
    and twice the space.

    Raises
    ------
    ValueError
        If it cannot be written.
    """
    temporary = path.with_name(f".{path.name}")
    try:
        temporary.write_bytes(cv2.imencode(".png", image, STORED_PNG if fast else PNG)[1].tobytes())
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise ValueError(f"{path}: cannot be written ({error.strerror})") from None


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"{path}: cannot be written ({error.strerror})") from None


def _names(rig: Rig | Sequence[str]) -> tuple[str, ...]:
    return rig.names if isinstance(rig, Rig) else tuple(rig)
