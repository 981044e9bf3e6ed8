"""Recordings as files: the instants of several cameras, with their times, from image folders or
videos.

A recording folder holds ``rig.toml``, ``handle.toml``, for each camera ``images/<camera>/*.png`` or
``<camera>.mkv``, and where known ``timestamps.csv`` (``frame,t_s``), ``background/<camera>.png``
and ``truth.csv``.
"""

from __future__ import annotations

import itertools
import logging
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from ..camera import Rig
from ..checks import Array, as_number
from ..datasets import handle_of, rig_of
from ..handle import Handle
from . import limits
from .images import IMAGE_SUFFIXES, Grey, as_grey, check_size, is_image, logged_once, read_greys
from .inputs import read_csv
from .recording_writer import PARTIAL, check_cameras

LAST_FRAME = 2**53  # a pose file may have; a time in nanoseconds is no frame
USUAL_FPS = 30.0
FASTEST_FPS = 1e6
SAME_RATE = 1.01  # of two videos, as a quotient: they may round it
VIDEO_SUFFIXES = (".mkv", ".mp4", ".avi", ".mov", ".webm", ".m4v", ".mpg", ".mpeg")

log = logging.getLogger("trinolab")

# a broken video is our line to say, not FFmpeg's
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


class Footage(NamedTuple):
    """The frames of one camera.

    Attributes
    ----------
    path : Path
        A folder of images, or a video.
    names : tuple of str
        The names of the images, in order; empty for a video.
    length : int
        The number of frames; of a video that of its header, which may be wrong.
    fps : float
        Frames per second, as a video states; 0 if it does not.
    """

    path: Path
    names: tuple[str, ...]
    length: int
    fps: float = 0.0


def open_footage(path: str | Path) -> Footage:
    """Open a camera's frames: a folder of images, or a video.

    Raises
    ------
    ValueError
        Names the path: missing, a folder without images, a video that cannot be read.
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
    fps = capture.get(cv2.CAP_PROP_FPS)
    capture.release()
    return Footage(path, (), count, fps if 0 < fps < FASTEST_FPS else 0.0)


def rate_of(footage: Sequence[Footage], fps: float | None) -> float:
    """Frames per second: `fps`, else the rate that the videos state, else `USUAL_FPS`.

    Raises
    ------
    ValueError
        If `fps` is no number above 0, or without it the videos state different rates.
    """
    if fps is not None:
        return as_number(fps, "fps", low=0.0, high=FASTEST_FPS, open_low=True)
    stated = sorted((one for one in footage if one.fps), key=lambda one: one.fps)
    if not stated:
        return USUAL_FPS
    slow, fast = stated[0], stated[-1]
    if fast.fps > SAME_RATE * slow.fps:
        raise ValueError(
            f"{fast.path}: states {fast.fps:.6g} frames a second, {slow.path} {slow.fps:.6g}; --fps or "
            "--timestamps says which times hold"
        )
    return slow.fps


def frames_of(
    footage: Footage,
    size: tuple[int, int] | None = None,
    first: int = 0,
    logged: set[str] | None = None,
    wanted: Sequence[int] | None = None,
) -> Iterator[np.ndarray]:
    """The frames one after the other, shape (height, width), grey levels 0 to 255; see
    `images.read_greys`.

    Parameters
    ----------
    footage : Footage
    size : (int, int), optional
        Width and height that they must have.
    first : int
        The first frame to yield.
    logged : set of str, optional
        Remarks that are already in the log, see `images.read_greys`.
    wanted : sequence of int, optional
        The numbers of the frames to yield, rising; all by default.

    Raises
    ------
    ValueError
        Names the file that cannot be read or has another size.
    """
    if footage.names:
        names = footage.names[first:] if wanted is None else [footage.names[k] for k in wanted]
        return read_greys([footage.path / name for name in names], size, logged)
    frames = _video_frames(footage.path, size, first, wanted)
    return logged_once(((footage.path, frame) for frame in frames), logged)


def _video_frames(
    path: Path, size: tuple[int, int] | None, first: int, wanted: Sequence[int] | None
) -> Iterator[Grey]:
    capture = open_video(path)
    next_frame = 0
    try:
        for k in itertools.count(first) if wanted is None else wanted:
            for _ in range(next_frame, k):
                capture.grab()
            next_frame = k + 1
            delivered, image = capture.read()
            if not delivered:
                return
            check_size(image.shape, size, path)
            if image.ndim == 3:
                blue, green, red = cv2.split(image)  # compared one after the other they are quick
                if np.array_equal(blue, green) and np.array_equal(blue, red):
                    image = blue  # a grey video comes with three equal channels
            yield as_grey(image)
    finally:
        capture.release()


def open_video(path: Path) -> cv2.VideoCapture:
    """Open a video to read from. Raises ValueError if it cannot be read, or has frames of more pixels
    than `limits.PIXELS`.
    """
    limits.check_regular(path)
    # and not OpenCV's warning either
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened() or not os.access(path, os.R_OK):
        raise ValueError(f"{path}: cannot be read as a video")
    sides = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    limits.check_pixels(path, *(int(capture.get(side)) for side in sides))
    return capture


class Instant(NamedTuple):
    """The images of one instant: `paths` in the order of the rig's cameras; `frame` as in
    `frames_named`.
    """

    frame: int
    paths: tuple[Path, ...]


class Recording(NamedTuple):
    """A recording of all cameras of a rig.

    Attributes
    ----------
    rig : Rig
    footage : tuple of Footage
        One per camera, in the rig's order.
    length : int
        Instants; where all cameras are videos, as their headers say.
    times_s : ndarray or None
        The mid-exposure time of each frame, s; None if the times follow from `fps`.
    fps : float
    times_from : path
        The file from which `times_s` was read.
    """

    rig: Rig
    footage: tuple[Footage, ...]
    length: int
    times_s: Array | None
    fps: float
    times_from: str | Path = "timestamps"

    @property
    def rate(self) -> float:
        """Frames per second; the median rate for uneven times."""
        if self.times_s is None or len(self.times_s) < 2:
            return self.fps
        return float(1 / np.median(np.diff(self.times_s)))

    def time_of(self, frame: int) -> float:
        """The time of a frame, s. Raises ValueError if the timestamps do not contain it."""
        if self.times_s is None:
            return frame / self.fps
        if frame >= len(self.times_s):
            last = len(self.times_s) - 1
            raise ValueError(
                f"{self.times_from}: no time for frame {frame}, they end with frame {last}"
            )
        return float(self.times_s[frame])


class Frames(NamedTuple):
    """One instant: its number from 0, its time (s), and a grey image per camera, in the rig's
    order.
    """

    frame: int
    t_s: float
    images: list[np.ndarray]


def open_recording(
    sources: Mapping[str, str | Path],
    rig: Rig,
    fps: float | None = None,
    timestamps: str | Path | None = None,
) -> Recording:
    """Open the footage of all cameras of a rig.

    Parameters
    ----------
    sources : mapping of str to path
        For each camera's name its video, or its folder of images (in the order of their names).
    rig : Rig
    fps : float, optional
        Frames per second, if there are no timestamps; see `rate_of`.
    timestamps : path, optional
        CSV with the columns ``frame`` and ``t_s``.

    Raises
    ------
    ValueError
        If a camera of the rig has no source or the rig lacks one, a source cannot be read, a folder
        holds fewer images than another and not the first of them, videos state different rates, or
        the timestamps are wrong.
    """
    check_cameras(sources, rig, "no video or folder for this camera of the rig")
    footage = tuple(open_footage(sources[name]) for name in rig.names)
    times = None if timestamps is None else read_timestamps(timestamps)
    if times is not None and Path(timestamps or "").parent.name.endswith(PARTIAL):
        # Of a recording that was cut off an instant counts if its time was written: that came last.
        footage = tuple(
            one._replace(names=one.names[: len(times)], length=min(one.length, len(times)))
            for one in footage
        )
    folders = [one for one in footage if one.names]
    count = min((one.length for one in folders), default=max(one.length for one in footage))
    for short, one in itertools.permutations(folders, 2):
        if short.length < one.length and short.names != one.names[: short.length]:
            raise ValueError(
                f"{short.path}: {short.length} images, {one.path} has {one.length}, and their names do "
                "not say which belong together"
            )
    if times is not None and folders and len(times) < count:
        raise ValueError(f"{timestamps}: no time for frame {len(times)} of {count}")
    rate = rate_of(footage if times is None else (), fps)
    return Recording(rig, footage, count, times, rate, timestamps or "timestamps")


def open_folder(
    folder: str | Path,
    rig: Rig | str | Path | None = None,
    handle: Handle | str | Path | None = None,
) -> tuple[Recording, Handle]:
    """Open a recording folder: its footage, with the timestamps if there are any, its rig and its
    handle.

    Parameters
    ----------
    folder : path
    rig, handle : optional
        Replace the folder's ``rig.toml`` and ``handle.toml``: a `Rig` and a `Handle`, or files, or
        names of shipped ones, as ``raised_40deg`` and ``coded``. A rig may have some of the cameras.

    Raises
    ------
    ValueError
        Names the file that is missing or cannot be read, see `find_footage` and `open_recording`, or
        the word that names no rig or no handle.
    """
    root = _existing(folder)
    if rig is None and not (root / "rig.toml").exists():
        raise ValueError(
            f"{root}: not a recording folder with its rig (no rig.toml in it); --rig gives one"
        )
    the_rig = rig_of(root / "rig.toml" if rig is None else rig)
    times = root / "timestamps.csv"
    recording = open_recording(
        find_footage(root, the_rig), the_rig, timestamps=times if times.exists() else None
    )
    return recording, handle_of(root / "handle.toml" if handle is None else handle)


def _existing(folder: str | Path) -> Path:
    """A recording folder. Raises ValueError if it is missing, or no folder."""
    root = Path(folder)
    if root.exists() and not root.is_dir():
        raise ValueError(f"{root}: expected a recording folder, got a file")
    if not root.is_dir():
        raise ValueError(f"{root}: no such folder")
    return root


def find_footage(folder: str | Path, rig: Rig) -> dict[str, Path]:
    """Each camera's images or video in a recording folder.

    Raises
    ------
    ValueError
        If a camera has none, or more than one.
    """
    root = _existing(folder)
    videos = sorted(path for path in root.iterdir() if path.suffix.lower() in VIDEO_SUFFIXES)
    footage = {}
    for name in rig.names:
        images = [root / "images" / name] if (root / "images" / name).exists() else []
        existing = images + [video for video in videos if video.stem == name]
        if len(existing) != 1:
            what = " and ".join(path.name for path in existing[:2])
            raise ValueError(
                f"{root}: expected one folder or video of camera {name}, got "
                f"{what or f'neither images/{name} nor {name}.mkv{_other_names(videos)}'}"
            )
        footage[name] = existing[0]
    return footage


def _other_names(videos: Sequence[Path]) -> str:
    """Advice for videos whose names are not those of the cameras; empty without videos."""
    if not videos:
        return ""
    return (
        f", but {', '.join(path.name for path in videos[:3])}: name them as the cameras, or give "
        "track, refine and preflight each by --video NAME=PATH"
    )


def instants(recording: Recording, first: int = 0) -> Iterator[Frames]:
    """The instants that all cameras have, one after the other, from frame `first`. The log names a
    camera that ends before another, and the frame rate where a video states an unusual one.

    Raises
    ------
    ValueError
        Names the file that cannot be read, or holds no frame.
    """
    by_rate = recording.times_s is None and recording.fps != USUAL_FPS
    if stated := [one.path for one in recording.footage if by_rate and one.fps == recording.fps]:
        log.info(
            "%s: states %.6g frames a second, by which the times are counted; --fps or --timestamps "
            "gives others",
            stated[0],
            recording.fps,
        )
    reported: set[str] = set()
    streams = [
        frames_of(one, camera.size, first, reported)
        for one, camera in zip(recording.footage, recording.rig.cameras, strict=True)
    ]
    frame = first
    while True:
        images = [next(stream, None) for stream in streams]
        over = [
            one.path for one, image in zip(recording.footage, images, strict=True) if image is None
        ]
        if len(over) == len(images):
            if frame == 0:
                raise ValueError(f"{over[0]}: no frame in it")
            return
        if over and frame == 0:
            raise ValueError(f"{over[0]}: ends after 0 frames, another camera goes on")
        if over:
            log.info(
                "%s: ends after %d frames, another camera goes on; the %d instants that all have are "
                "taken",
                over[0],
                frame,
                frame,
            )
            return
        yield Frames(frame, recording.time_of(frame), images)  # type: ignore[arg-type]
        frame += 1


def some_instants(recording: Recording, frames: Sequence[int]) -> Iterator[Frames]:
    """Some instants, by their rising numbers; of image folders nothing else is read.

    Raises
    ------
    ValueError
        Names the file that cannot be read, or the video that ends before.
    """
    wanted = set(frames)
    streams = []
    for one, camera in zip(recording.footage, recording.rig.cameras, strict=True):
        if one.names:
            paths = [one.path / one.names[frame] for frame in frames]
            streams.append(read_greys(paths, camera.size))
        else:
            every = enumerate(frames_of(one, camera.size))
            streams.append(image for frame, image in every if frame in wanted)
    for frame in frames:
        images = [next(stream, None) for stream in streams]
        for one, image in zip(recording.footage, images, strict=True):
            if image is None:
                raise ValueError(f"{one.path}: ends before frame {frame}")
        yield Frames(frame, recording.time_of(frame), images)  # type: ignore[arg-type]


def read_timestamps(path: str | Path) -> Array:
    """Read the times of the frames 0, 1, 2, ..., s.

    Raises
    ------
    ValueError
        Names the file and the row: unreadable, a column missing, no number, frames that do not
        count from 0, times that do not increase.
    """
    table = read_csv(path, usecols=["frame", "t_s"], dtype=float)
    frame = table["frame"].to_numpy()
    times = table["t_s"].to_numpy()
    if len(times) == 0 or not np.array_equal(frame, np.arange(len(frame))):
        raise ValueError(f"{path}: column 'frame' expects 0, 1, 2, ...")
    increasing = np.isfinite(times) & np.append(True, times[1:] > times[:-1])
    if not increasing.all():
        wrong = int(increasing.argmin())
        raise ValueError(f"{path}: frame {wrong}: column 't_s' expects increasing seconds")
    return times


def list_instants(folder: str | Path, rig: Rig) -> list[Instant]:
    """The instants of a folder that contains a folder of images for each camera, with the same file
    names in each, in the order of their frames.

    Images of a camera that is not in the rig are left out, with a remark in the log.

    Raises
    ------
    ValueError
        If a camera's folder is missing or holds no image, or a name is missing in one of them.
    """
    root = Path(folder)
    if not root.is_dir():
        raise ValueError(f"{root}: no such folder")
    names = {camera: _image_names(root / camera, rig) for camera in rig.names}
    for other in sorted(
        path for path in root.iterdir() if path.is_dir() and path.name not in rig.names
    ):
        if any(is_image(path) for path in other.iterdir()):
            log.info("%s: left out, the rig has no such camera (%s)", other, ", ".join(rig.names))
    every = sorted(set().union(*names.values()))
    for camera, present in names.items():
        if missing := [name for name in every if name not in present]:
            raise ValueError(
                f"{root / camera / missing[0]}: missing, another camera has this image"
            )
    return [
        Instant(frame, tuple(root / camera / name for camera in rig.names))
        for frame, name in sorted(zip(frames_named(every), every, strict=True))
    ]


def frames_named(names: Sequence[str]) -> list[int]:
    """The frame numbers of images: the numbers in their names, else their places from 0.

    Names that differ in one whole number at their end are numbers: ``000020.png``, ``left_7.png``.
    If the part before the number differs, as in the time ``1699999999.25.png``, or two numbers are
    equal, the numbers are not those of frames.

    Parameters
    ----------
    names : sequence of str
        Of files, in the order in which they count if they are no numbers.
    """
    parts = [re.fullmatch(r"(.*?)([0-9]+)", Path(name).stem) for name in names]
    before = {part[1] if part else None for part in parts}
    numbers = [int(part[2]) for part in parts if part]
    if len(before) > 1 or len(set(numbers)) < len(names) or max(numbers) > LAST_FRAME:
        return list(range(len(names)))
    return numbers


def read_instants(listed: Sequence[Instant], rig: Rig) -> Iterator[list[np.ndarray]]:
    """Read the images of instants one after the other, a grey image per camera; see
    `images.read_greys`.

    Raises
    ------
    ValueError
        Names the file that cannot be read as an image or has another size than its camera.
    """
    reported: set[str] = set()
    streams = [
        read_greys([instant.paths[k] for instant in listed], camera.size, reported)
        for k, camera in enumerate(rig.cameras)
    ]
    return map(list, zip(*streams, strict=True))


def _image_names(folder: Path, rig: Rig) -> set[str]:
    if not folder.is_dir():
        raise ValueError(
            f"{folder}: no such folder; each camera of the rig needs one ({', '.join(rig.names)})"
        )
    return set(open_footage(folder).names)
