"""What one camera took: a folder of images or a video, frame after frame as grey images."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .greyimage import IMAGE_SUFFIXES, as_grey, check_size, is_image, read_grey

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # a broken video is our line to say, not FFmpeg's
import cv2

VIDEO_SUFFIXES = (".mkv", ".mp4", ".avi", ".mov", ".webm", ".m4v", ".mpg", ".mpeg")


class Footage(NamedTuple):
    """The frames of one camera.

    Attributes
    ----------
    path : Path
        A folder of images, or a video.
    names : tuple of str
        Of the images, in the order of their names; empty for a video.
    length : int
        Of the frames; of a video what its header says, which need not be so.
    """

    path: Path
    names: tuple[str, ...]
    length: int


def open_footage(path: str | Path) -> Footage:
    """Find out what a camera's frames are.

    Raises
    ------
    ValueError
        Names the path: not there, a folder without an image, no video that can be read.
    """
    path = Path(path)
    if path.is_dir():
        names = tuple(sorted(file.name for file in path.iterdir() if is_image(file)))
        if not names:
            raise ValueError(f"{path}: no image in it ({', '.join(IMAGE_SUFFIXES)})")
        return Footage(path, names, len(names))
    if not path.exists():
        raise ValueError(f"{path}: no such file or folder")
    capture = open_video(path)
    count = int(min(max(capture.get(cv2.CAP_PROP_FRAME_COUNT), 0), 2**31))
    capture.release()
    return Footage(path, (), count)


def frames_of(footage: Footage, size: tuple[int, int] | None = None, first: int = 0,
              said: set[str] | None = None) -> Iterator[np.ndarray]:
    """The frames one after the other, shape (height, width), grey levels 0 to 255.

    Parameters
    ----------
    footage : Footage
    size : (int, int), optional
        Width and height that they must have.
    first : int
        The first frame to give.
    said : set of str, optional
        What the log has said of conversions, see `greyimage.as_grey`.

    Raises
    ------
    ValueError
        Names the file that cannot be read or has another size.
    """
    said = set() if said is None else said
    if footage.names:
        yield from (read_grey(footage.path / name, size, said) for name in footage.names[first:])
        return
    capture = open_video(footage.path)
    try:
        for _ in range(first):
            capture.grab()
        while True:
            there, image = capture.read()
            if not there:
                return
            check_size(image, size, footage.path)
            if image.ndim == 3 and np.array_equal(image[..., 0], image[..., 1]) \
                    and np.array_equal(image[..., 0], image[..., 2]):
                image = np.ascontiguousarray(image[..., 0])  # a grey video comes with three equal channels
            yield as_grey(image, footage.path, said)
    finally:
        capture.release()


def open_video(path: Path) -> cv2.VideoCapture:
    """Open a video to read from. Raises ValueError if it cannot be read."""
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)  # and not OpenCV's warning either
    try:
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened() or not os.access(path, os.R_OK):
        raise ValueError(f"{path}: cannot be read as a video")
    return capture
