"""Cameras of this computer, and videos in their place: opened, and grabbed together.

All cameras are grabbed first, so that they are as near to one instant as they can be; then their
images are fetched.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from trinolab.files.recording import open_video

WAITED_S = 1e-3  # a grab that takes as long has waited for its frame
# where Linux has its cameras, and their names
DEVICES, ABOUT = Path("/dev"), Path("/sys/class/video4linux")
TRIED = 10  # indices that are tried on another system


class Source(NamedTuple):
    """A camera, or a video in its place, which is played in steps of `period_s`; a camera sets the
    pace (0).
    """

    name: str
    device: cv2.VideoCapture
    period_s: float


class Attached(NamedTuple):
    """A camera of this computer: its index, its name if the system says it, width and height, px,
    and frames per second as it stands; or what is wrong with it, and no size.
    """

    number: int
    name: str
    size: tuple[int, int] | None
    fps: float
    problem: str


class Taken(NamedTuple):
    """One instant: its time, the time from the first grab to the last (s), and a grey image a
    camera, uint8.
    """

    t_s: float
    spread_s: float
    images: list[np.ndarray]


def open_source(
    name: str, what: str, size: tuple[int, int] | None = None, fps: float | None = None
) -> Source:
    """Open a camera by its index, or a video by its path; a camera is asked for the size and the
    rate.

    Raises
    ------
    ValueError
        Names the camera that cannot be opened.
    """
    if what.isdecimal() and len(what) < 5:
        device = open_index(int(what))
        if not device.isOpened():
            raise ValueError(
                f"{name}: camera {what} cannot be opened ({_why_not(int(what))}); {_those_there()}"
            )
        wanted = {cv2.CAP_PROP_FPS: fps} if fps else {}
        wanted |= (
            {cv2.CAP_PROP_FRAME_WIDTH: size[0], cv2.CAP_PROP_FRAME_HEIGHT: size[1]} if size else {}
        )
        for key, value in wanted.items():
            device.set(key, value)
        return Source(name, device, 0.0)
    if Path(what).is_dir():
        raise ValueError(f"{name}: {what}: expected a camera's index or a video, got a folder")
    if not Path(what).is_file():
        raise ValueError(f"{name}: {what}: no such camera or video")
    device = open_video(Path(what))
    rate = fps or device.get(cv2.CAP_PROP_FPS)
    return Source(name, device, 1 / rate if 0 < rate <= 1000 else 1 / 30)


def list_cameras() -> list[Attached]:
    """The cameras of this computer, each opened for a moment; also those that cannot be opened."""
    on_linux = ABOUT.is_dir()
    cameras = [_tried(index) for index in (_indices() if on_linux else range(TRIED))]
    return [one for one in cameras if on_linux or not one.problem]


def _tried(index: int) -> Attached:
    device = open_index(index)
    try:
        if not device.isOpened():
            return Attached(index, _name_of(index), None, 0.0, _why_not(index))
        delivered, image = device.read()
        fps = float(device.get(cv2.CAP_PROP_FPS))
    finally:
        device.release()
    if not delivered or image is None:
        return Attached(index, _name_of(index), None, 0.0, "delivers no image")
    return Attached(index, _name_of(index), (image.shape[1], image.shape[0]), fps, "")


def _indices() -> list[int]:
    """Of the devices that Linux lists as cameras; some have a second one, which has no images."""
    numbers = [path.name.removeprefix("video") for path in ABOUT.glob("video*")]
    return sorted(int(number) for number in numbers if number.isdecimal())


def _name_of(index: int) -> str:
    try:
        return (ABOUT / f"video{index}" / "name").read_text(encoding="utf-8").strip()
    except (OSError, ValueError):  # another system, or no name
        return ""


def _why_not(index: int) -> str:
    """Why a camera cannot be opened, as far as that can be seen."""
    path = DEVICES / f"video{index}"
    if not ABOUT.is_dir():
        return "there is none, another program uses it, or the system forbids it"
    if not path.exists():
        return f"there is no {path}"
    if not os.access(path, os.R_OK | os.W_OK):
        return f"no permission for {path}; its users are in the group {path.group()}"
    return "another program uses it, or it is no camera"


def _those_there() -> str:
    """What to try instead of a camera that cannot be opened."""
    if not ABOUT.is_dir():
        return "trinolab capture --list tries all"
    named = [f"{index} ({_name_of(index) or 'no name'})" for index in _indices()]
    return f"there are {', '.join(named)}" if named else "this computer has no camera"


def drain(sources: Sequence[Source]) -> None:
    """Let go of the frames that cameras have kept while others were opened: a grab that has to wait
    brings a new one.

    A first round starts the cameras. All take their rounds at a time, so that none keeps much in
    the meantime.
    """
    live = [source.device for source in sources if not source.period_s]
    with ThreadPoolExecutor(len(sources)) as pool:
        for _ in range(2):
            list(pool.map(_grab_until_new, live))


def instants_of(
    sources: Sequence[Source], sizes: Mapping[str, tuple[int, int] | None] | None = None
) -> Iterator[Taken]:
    """Grab all, then fetch the images, as fast as the slowest source delivers; videos end it
    together.

    Where all are videos an instant has their time; a camera's is that of this computer.

    Raises
    ------
    ValueError
        Names the camera that stops, or has another size than in `sizes` or before.
    """
    period = max(source.period_s for source in sources)
    played = all(source.period_s for source in sources)
    known = dict(sizes or {})
    start = 0.0
    for k in count():
        if k and period:
            time.sleep(max(0.0, start + k * period - time.perf_counter()))
        grabbed = [(source.device.grab(), time.perf_counter()) for source in sources]
        at = [t for _, t in grabbed]
        start = start or at[0]
        if k and played and not any(good for good, _ in grabbed):
            return
        images = [
            fetched(source, good, k, known)
            for source, (good, _) in zip(sources, grabbed, strict=True)
        ]
        if played:  # the time that a video tells, however long it takes to read it
            yield Taken(start + k * period, 0.0, images)
        else:
            yield Taken((at[0] + at[-1]) / 2, at[-1] - at[0], images)


def _grab_until_new(device: cv2.VideoCapture) -> None:
    for _ in range(10):  # no driver keeps more
        before = time.perf_counter()
        device.grab()
        if time.perf_counter() - before > WAITED_S:
            return


def open_index(index: int) -> cv2.VideoCapture:
    """Open a camera, while OpenCV keeps what is wrong to itself."""
    logging = cv2.utils.logging
    before = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(index)
    finally:
        logging.setLogLevel(before)


def fetched(
    source: Source, grabbed: bool, k: int, known: dict[str, tuple[int, int] | None]
) -> np.ndarray:
    """The grey image of a source that has grabbed; `known` holds the sizes, and learns one."""
    delivered, image = source.device.retrieve() if grabbed else (False, None)
    if not delivered or image is None:
        raise ValueError(f"{source.name}: delivers no image after {k} instants")
    size = (image.shape[1], image.shape[0])
    wanted = known.get(source.name)
    if wanted is None:
        known[source.name] = wanted = size
    if size != wanted:
        raise ValueError(
            f"{source.name}: {size[0]} x {size[1]} pixels after {k} instants, expected "
            f"{wanted[0]} x {wanted[1]}"
        )
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
