"""Recordings as files: instants from image folders."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from .camera import Rig
from .greyimage import IMAGE_SUFFIXES, is_image, read_grey


class Instant(NamedTuple):
    """The images of one instant: `paths` in the order of the rig's cameras; `frame` counts from 0."""

    frame: int
    paths: tuple[Path, ...]


def list_instants(folder: str | Path, rig: Rig) -> list[Instant]:
    """The instants of a folder that holds a folder of images for each camera, the same file names in each.

    Raises
    ------
    ValueError
        If a camera's folder is missing or holds no image, a name is missing in one of them, or there are images of a
        camera that the rig does not have.
    """
    root = Path(folder)
    if not root.is_dir():
        raise ValueError(f"{root}: no such folder")
    names = {camera: _image_names(root / camera, rig) for camera in rig.names}
    for other in sorted(path for path in root.iterdir() if path.is_dir() and path.name not in rig.names):
        if any(is_image(path) for path in other.iterdir()):
            raise ValueError(f"{other}: images of a camera that the rig does not have ({', '.join(rig.names)})")
    every = sorted(set().union(*names.values()))
    for camera, present in names.items():
        if missing := [name for name in every if name not in present]:
            raise ValueError(f"{root / camera / missing[0]}: missing, another camera has this image")
    return [Instant(k, tuple(root / camera / name for camera in rig.names)) for k, name in enumerate(every)]


def read_instant(instant: Instant, rig: Rig, said: set[str] | None = None) -> list[np.ndarray]:
    """Read the images of an instant as grey images, shape (height, width), grey levels 0 to 255.

    Colour images are converted to grey and 16-bit images to 8-bit levels (with their fractions); the log says so.

    Parameters
    ----------
    instant : Instant
    rig : Rig
    said : set of str, optional
        What the log has said before, and need not say for each of a thousand images; it grows by what is said here.

    Raises
    ------
    ValueError
        Names the file that cannot be read as an image or has another size than its camera.
    """
    said = set() if said is None else said
    return [read_grey(path, camera.size, said) for path, camera in zip(instant.paths, rig.cameras, strict=True)]


def _image_names(folder: Path, rig: Rig) -> set[str]:
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such folder; each camera of the rig needs one ({', '.join(rig.names)})")
    names = {path.name for path in folder.iterdir() if is_image(path)}
    if not names:
        raise ValueError(f"{folder}: no image in it ({', '.join(IMAGE_SUFFIXES)})")
    return names
