"""Images that are read: as grey images, whatever they were. What cannot be read is a ValueError that names the file."""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import cv2
import numpy as np

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm")
log = logging.getLogger("trinolab")


@contextmanager
def unheard() -> Iterator[IO[bytes]]:
    """Whatever the process writes to the file of standard error meanwhile goes to the file that this gives."""
    with tempfile.TemporaryFile() as file:
        kept = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield file
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def is_image(path: Path) -> bool:
    """Whether a file is named like an image."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def read_grey(path: Path, size: tuple[int, int] | None, said: set[str]) -> np.ndarray:
    """Read an image file as a grey image, shape (height, width), grey levels 0 to 255.

    Parameters
    ----------
    path : Path
    size : (int, int) or None
        Width and height that it must have; None for any.
    said : set of str
        As in `as_grey`.

    Raises
    ------
    ValueError
        Names the file: unreadable, no image of 8 or 16 bit, or another size.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    if data.startswith(b"\x89PNG") and b"IEND" not in data[-12:]:
        raise ValueError(f"{path}: cannot be read as an image (its end is missing)")
    image, complaint = _decoded(data)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: cannot be read as an image of 8 or 16 bit")
    check_size(image, size, path)
    if complaint:
        _say(path, f"may be damaged ({complaint})", said)
    return as_grey(image, path, said)


def _decoded(data: bytes) -> tuple[np.ndarray | None, str]:
    """The image, None if there is none, and the first line of what its decoder has to say about it."""
    with unheard() as said:
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
        except cv2.error:  # more pixels than OpenCV takes
            image = None
        said.seek(0)
        return image, said.read(200).decode(errors="replace").partition("\n")[0]


def check_size(image: np.ndarray, size: tuple[int, int] | None, path: Path) -> None:
    """Raise a ValueError that names the file if the image has not the size (width, height) that the rig says."""
    if size is not None and image.shape[:2] != (size[1], size[0]):
        raise ValueError(f"{path}: {image.shape[1]} x {image.shape[0]} pixels, the rig says {size[0]} x {size[1]}")


def as_grey(image: np.ndarray, path: Path, said: set[str]) -> np.ndarray:
    """Convert colour to grey and 16 bit to 8-bit levels (with their fractions); the log says so, once for each folder.

    Parameters
    ----------
    image : ndarray of uint8 or uint16, shape (height, width) or (height, width, 3 or 4)
        Blue first.
    path : Path
        Of its file.
    said : set of str
        What the log has said before; it grows by what is said here.
    """
    if image.ndim == 3:
        _say(path, "colour converted to grey", said)
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2GRAY if image.shape[2] == 4 else cv2.COLOR_BGR2GRAY)
    if image.dtype == np.uint16:
        _say(path, "16 bit scaled to grey levels 0 to 255", said)
        image = (image / 257.0).astype(np.float32)
    return image


def _say(path: Path, what: str, said: set[str]) -> None:
    """Log once what is done to the images of a folder."""
    if (key := f"{path.parent}: {what}") not in said:
        said.add(key)
        log.info("%s: %s; said once a camera", path, what)
