"""Images read as grey images, whatever they were. A file that cannot be read raises a ValueError
that names it.
"""

from __future__ import annotations

import logging
import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple

import cv2
import numpy as np

from . import limits

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm")
BITS = (10, 12, 14, 16)  # that a camera may have, whose images are files of 16 bit
BITS_GIVEN = "TRINOLAB_BITS"  # in the environment, which processes that are begun have as well
LOOKED_AT = 8  # images of a folder, evenly among them, whose brightest value shows the bits
NO_IMAGE = "cannot be read as an image of 8 or 16 bit"
COMPLAINTS = 1 << 16  # bytes of what a decoder writes that are looked at
# how the lines begin that the decoders write, which OpenCV's own on its settings do not
DECODERS = re.compile(
    rb"libpng|\[ *(?:WARN|ERROR).*(?:grfmt_|loadsave|bitstrm|exif)|.*(?:JPEG|JFIF|TIFF|SOS|progression)"
)
log = logging.getLogger("trinolab")


@contextmanager
def unheard() -> Iterator[IO[bytes]]:
    """Redirect standard error, below Python, to the file that this yields."""
    with tempfile.TemporaryFile() as file:
        stderr_copy = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield file
        finally:
            os.dup2(stderr_copy, 2)
            os.close(stderr_copy)


@contextmanager
def camera_bits(bits: int) -> Iterator[None]:
    """Read 16-bit files as images of so many bits while the block runs."""
    if not 8 <= bits <= 16:
        raise ValueError(f"bits: expected 8 to 16, got {bits}")
    before = os.environ.get(BITS_GIVEN)
    os.environ[BITS_GIVEN] = str(bits)
    try:
        yield
    finally:
        os.environ.pop(BITS_GIVEN)
        if before is not None:
            os.environ[BITS_GIVEN] = before


def is_image(path: Path) -> bool:
    """Whether a file is named like an image; a hidden one is unfinished, or no image."""
    return not path.name.startswith(".") and path.suffix.lower() in IMAGE_SUFFIXES


class Grey(NamedTuple):
    """A grey image, shape (height, width), grey levels 0 to 255, and remarks on its conversion for
    the log.
    """

    image: np.ndarray
    remarks: tuple[str, ...]


def read_grey(path: Path, size: tuple[int, int] | None = None) -> np.ndarray:
    """One image file as a grey image; see `read_greys`."""
    return next(read_greys([path], size))


def read_greys(
    paths: Iterable[Path], size: tuple[int, int] | None = None, logged: set[str] | None = None
) -> Iterator[np.ndarray]:
    """Read a camera's image files one after the other as grey images, shape (height, width), grey
    levels 0 to 255.

    Colour images are converted to grey and 16-bit images to 8-bit levels (with their fractions);
    the log says so. All files of 16 bit in a folder have one scale: the fewest of `BITS` that hold
    some of them, or what `camera_bits` says.

    Parameters
    ----------
    paths : iterable of Path
    size : (int, int), optional
        Width and height that they must have.
    logged : set of str, optional
        Remarks that the log already contains; cameras that are read together share one set.

    Raises
    ------
    ValueError
        Names the file: unreadable, no image of 8 or 16 bit, another size, brighter than its bits
        allow, or more pixels than `limits.PIXELS`; the last before it is decoded.
    """
    bits: dict[Path, int] = {}
    return logged_once(((path, _read(path, size, bits)) for path in paths), logged)


def logged_once(
    images: Iterable[tuple[Path, Grey]], logged: set[str] | None = None
) -> Iterator[np.ndarray]:
    """The images; each remark is logged once, with the file of the first image that it concerns."""
    before = set() if logged is None else logged
    for path, (image, remarks) in images:
        for remark in remarks:
            if remark not in before:
                log.info("%s: %s; said once", path, remark)
        before.update(remarks)
        yield image


def _read(path: Path, size: tuple[int, int] | None, bits_in: dict[Path, int]) -> Grey:
    """An image file; `bits_in` are those of folders that are known. Errors as for `read_greys`."""
    try:
        data = limits.read_bytes(path, limits.IMAGE_BYTES)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    if data.startswith(b"\x89PNG") and b"IEND" not in data[-12:]:
        raise ValueError(f"{path}: cannot be read as an image (its end is missing)")
    image, complaint = decoded(data, path)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: {NO_IMAGE}")
    limits.check_pixels(path, image.shape[1], image.shape[0])
    check_size(image.shape, size, path)
    if complaint:
        log.info("%s: may be damaged (%s)", path, complaint)
    if image.dtype == np.uint8:
        return as_grey(image)
    if path.parent not in bits_in:
        bits_in[path.parent] = _bits_in(path.parent)
    bits = bits_in[path.parent]
    if image.max() >= 1 << bits:
        raise ValueError(
            f"{path}: has the value {image.max()}, beyond the {bits} bit that its camera is taken to have; "
            "--bits says how many it has"
        )
    return as_grey(image, bits)


def _bits_in(folder: Path) -> int:
    """How many bits of 16 the images of a folder have, by some of them; 16 where they are black."""
    if BITS_GIVEN in os.environ:
        return int(os.environ[BITS_GIVEN])
    paths = sorted(path for path in folder.iterdir() if is_image(path))
    places = np.unique(np.linspace(0, len(paths) - 1, LOOKED_AT).round().astype(int))
    brightest = 0
    for path in [paths[k] for k in places.tolist()]:
        try:
            image, _ = decoded(limits.read_bytes(path, limits.IMAGE_BYTES), path)
        except (OSError, ValueError):
            continue  # its reader says so
        if image is not None and image.dtype == np.uint16:
            brightest = max(brightest, int(image.max()))
    return next((bits for bits in BITS if 0 < brightest < 1 << bits), BITS[-1])


def decoded(data: bytes, path: str | Path) -> tuple[np.ndarray | None, str]:
    """The image, None if there is none, and the first line of its decoder's message. Raises a
    ValueError that names the file if it has more pixels than the limit.
    """
    with unheard() as complaints:
        try:
            image = (
                cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
            )
        except cv2.error as error:
            if "MAX_IMAGE" in str(error):
                most = f"{limits.PIXELS / 1e6:.0f} million pixels"
                raise ValueError(f"{path}: expected at most {most}, got more") from None
            image = None
        complaints.seek(0)
        lines = complaints.read(COMPLAINTS).splitlines(keepends=True)
    own = [line for line in lines if DECODERS.match(line)]
    # of other threads; a decoder's remark may end with an empty line
    os.write(2, b"".join(line for line in lines if line.strip() and line not in own))
    return image, own[0][:200].decode(errors="replace").rstrip() if own else ""


def check_size(shape: tuple[int, ...], size: tuple[int, int] | None, path: str | Path) -> None:
    """Raise a ValueError that names the file if the shape (height, width) of its image is not the
    size (width, height) that the rig says.
    """
    if size is not None and shape[:2] != (size[1], size[0]):
        raise ValueError(
            f"{path}: {shape[1]} x {shape[0]} pixels, the rig says {size[0]} x {size[1]}"
        )


def as_grey(image: np.ndarray, bits: int = 16) -> Grey:
    """Convert colour to grey and 16 bit to 8-bit levels (with their fractions).

    Parameters
    ----------
    image : ndarray of uint8 or uint16, shape (height, width) or (height, width, 3 or 4)
        Blue first.
    bits : int
        Of an image of uint16, how many it has.
    """
    remarks = []
    if image.ndim == 3:
        remarks.append("colour converted to grey")
        image = cv2.cvtColor(
            image, cv2.COLOR_BGRA2GRAY if image.shape[2] == 4 else cv2.COLOR_BGR2GRAY
        )
    if image.dtype == np.uint16:
        remarks.append(f"{bits} bit scaled to grey levels 0 to 255")
        image = (image / ((2**bits - 1) / 255)).astype(np.float32)
    return Grey(image, tuple(remarks))
