"""A recording folder from cameras as they deliver; video files may stand in for them.

A thread of its own writes what a bounded queue hands it: grabbing never waits for the disk. What
does not fit into the queue is dropped and counted; before that, images are written without
compression.
"""

from __future__ import annotations

import logging
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from queue import Full, Queue
from threading import Thread

import cv2
import numpy as np

from trinolab.camera import Rig
from trinolab.checks import Array, as_number, frozen
from trinolab.files import recording_writer
from trinolab.files.journal import locked
from trinolab.files.rigs import read_handle, read_rig
from trinolab.handle import Handle

from .devices import Source, Taken, drain, instants_of, open_source

QUEUE = 32  # instants that wait to be written: a second, 130 MB of three cameras of 1280 x 1024
# What a handle may move between the images of an instant, and how fast hands are: a person's in
# the median, see `bench.motion.human_motion`, and one that is led with care.
ALLOWED_MM, HAND_MM_S, SLOW_MM_S = 0.1, 300.0, 20.0
MOST_OF_THEM = 0.95  # instants that a verdict is about
PREVIEW = "preview.png"
PREVIEW_S, PREVIEW_WIDTH = 0.25, 1280

log = logging.getLogger("trinolab")


@dataclass(frozen=True, eq=False)
class Captured:
    """What was recorded.

    Attributes
    ----------
    folder : Path
    times_s : ndarray, shape (n,)
        Of the middle between the first camera's grab and the last one's; the first is 0.
    spread_s : ndarray, shape (n,)
        Between these two grabs.
    dropped : int
        Instants that were taken, but could not be written in time.
    live : int
        Cameras, as opposed to videos in their place.
    """

    folder: Path
    times_s: Array
    spread_s: Array
    dropped: int
    live: int


def capture(
    cameras: Mapping[str, str],
    out: str | Path,
    rig: str | Path | None = None,
    handle: str | Path | None = None,
    seconds: float | None = None,
    fps: float | None = None,
    size: tuple[int, int] | None = None,
    preview: bool = False,
) -> Captured:
    """Record from cameras until the time is over, videos end together, or Ctrl-C.

    Parameters
    ----------
    cameras : mapping of str to str
        For each camera's name its index at this computer ("0"), or a video's path.
    out : path
        Recording folder to write, see `recording`; unfinished it has ``.partial`` behind its name.
    rig, handle : path, optional
        Rig and handle file, which become part of the recording; cameras are asked for the rig's
        sizes.
    seconds : float, optional
        To record for; without end by default.
    fps : float, optional
        Frames a second that cameras are asked for, and that videos are played with; by default the
        device's and the video's own.
    size : (int, int), optional
        Width and height that cameras are asked for, if there is no rig.
    preview : bool
        Keep ``preview.png`` in the unfinished folder: what the cameras see, four times per second.

    Raises
    ------
    ValueError
        Before anything is recorded: names that are none, or not the rig's; a camera or video that
        cannot be opened, or has not the rig's size; a folder that exists. While recording: a camera
        that stops or changes its size, a file that cannot be written; the instants before it are
        kept, and the error says where.
    """
    the_rig = None if rig is None else read_rig(rig)
    the_handle = None if handle is None else read_handle(handle)
    limit = np.inf if seconds is None else as_number(seconds, "seconds", 0.0, open_low=True)
    if fps is not None:
        as_number(fps, "fps", 0.0, 1000.0, open_low=True)
    sizes = _sizes(cameras, the_rig, size)
    partial = recording_writer.partial_of(out)
    if partial.exists():
        raise _unfinished(partial)
    sources: list[Source] = []
    held = ExitStack()
    try:
        for name, wanted in sizes.items():
            sources.append(open_source(name, cameras[name], wanted, fps))
        drain(sources)
        stream = instants_of(sources, None if the_rig is None else sizes)
        first = next(stream)  # so that what does not fit is found before there is a folder
        held.enter_context(new_folder(out, partial, the_rig or list(sizes), the_handle))
        log.info(
            "recording to %s; Ctrl-C ends it%s",
            out,
            f"; {partial / PREVIEW} shows it" if preview else "",
        )
        writer = Writer(partial, list(sizes), preview)
        error = _record(chain([first], stream), writer, limit)
        live = sum(not source.period_s for source in sources)
        return _concluded(out, partial, writer, error, live)
    finally:
        held.close()
        for source in sources:
            source.device.release()


class Writer:
    """Writes instants in a thread of its own.

    Parameters
    ----------
    partial : Path
        The unfinished recording.
    names : sequence of str
        Of the cameras.
    preview : bool
        Whether ``preview.png`` is kept up to date.
    whole : callable, optional
        Called with each instant when all of its images are there.

    Attributes
    ----------
    written : list of Taken
        Without the images; all of an instant's images are there, or it is not in the list.
    dropped : int
        Instants for which the queue had no room.
    error : Exception or None
        Why the thread writes no more.
    """

    def __init__(
        self,
        partial: Path,
        names: Sequence[str],
        preview: bool,
        whole: Callable[[Taken], None] | None = None,
    ) -> None:
        self.written: list[Taken] = []
        self.dropped = 0
        self.error: Exception | None = None
        self._partial = partial
        self._names = names
        self._preview = preview
        self._whole = whole
        self._queue: Queue[Taken | None] = Queue(QUEUE)
        self._shown_s = -np.inf
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def offer(self, taken: Taken) -> None:
        """Hand over an instant, without waiting."""
        try:
            self._queue.put_nowait(taken)
        except Full:
            self.dropped += 1

    def close(self) -> None:
        """Wait until all that was handed over is written; a KeyboardInterrupt meanwhile says where
        it is.
        """
        try:
            self._queue.put(None)
            self._thread.join()
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"what was written is in {self._partial}") from None

    def _run(self) -> None:
        with ThreadPoolExecutor(len(self._names)) as pool:  # all cameras at a time
            while (taken := self._queue.get()) is not None:
                if self.error is None:
                    try:
                        self._write(taken, pool)
                    except Exception as error:  # whatever it is, the recording ends and says so
                        self.error = error

    def _write(self, taken: Taken, pool: ThreadPoolExecutor) -> None:
        paths = recording_writer.image_paths(self._partial, self._names, len(self.written))
        fast = self._queue.qsize() > QUEUE // 4
        tasks = [
            pool.submit(recording_writer.write_image, image, path, fast)
            for image, path in zip(taken.images, paths, strict=True)
        ]
        wait(tasks)
        if wrong := next(filter(None, (task.exception() for task in tasks)), None):
            for path in paths:
                path.unlink(missing_ok=True)
            raise wrong
        if self._whole is not None:
            self._whole(taken)
        self.written.append(taken._replace(images=[]))
        if self._preview and taken.t_s >= self._shown_s + PREVIEW_S:
            self._shown_s = taken.t_s
            recording_writer.write_image(side_by_side(taken.images), self._partial / PREVIEW)


def side_by_side(images: Sequence[np.ndarray], width: int = PREVIEW_WIDTH) -> np.ndarray:
    """Grey images beside each other in one of at most `width` pixels."""
    height = min(image.shape[0] for image in images)
    wide = sum(image.shape[1] * height / image.shape[0] for image in images)
    height = max(int(height * min(1.0, width / wide)), 1)
    sizes = [(max(image.shape[1] * height // image.shape[0], 1), height) for image in images]
    return np.hstack(
        [
            cv2.resize(image, size, interpolation=cv2.INTER_AREA)
            for image, size in zip(images, sizes, strict=True)
        ]
    )


def _sizes(
    cameras: Mapping[str, str], rig: Rig | None, size: tuple[int, int] | None
) -> dict[str, tuple[int, int] | None]:
    """The size of each camera where it is known, in the rig's order."""
    if not cameras:
        raise ValueError("cameras: expected one or more, got none")
    recording_writer.check_names(cameras)
    indices = [what for what in cameras.values() if what.isdecimal()]
    if len(set(map(int, indices))) < len(indices):
        raise ValueError(
            f"cameras: expected each camera once, got the indices {', '.join(indices)}"
        )
    if rig is None:
        return dict.fromkeys(cameras, size)
    recording_writer.check_cameras(cameras, rig, "this camera of the rig is not named")
    return {camera.name: camera.size for camera in rig.cameras}


@contextmanager
def new_folder(
    out: str | Path, partial: Path, rig: Rig | Sequence[str], handle: Handle | None
) -> Iterator[None]:
    """Make the unfinished folder of a recording, or leave nothing, and keep it for this process alone
    while the block runs.

    Raises
    ------
    ValueError
        If the folder is there, perhaps because another process has made it meanwhile, or cannot be
        written; see `recording_writer.begin` also.
    """
    try:
        partial.mkdir()
    except FileExistsError:
        raise _unfinished(partial) from None
    except OSError as error:
        raise ValueError(f"{partial}: cannot be written ({error.strerror})") from None
    with locked(partial):
        try:
            recording_writer.begin(out, rig, handle)
        except ValueError:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        yield


def _unfinished(partial: Path) -> ValueError:
    """What is wrong with a recording where there is one already, unfinished or still growing."""
    try:
        with locked(partial):
            return ValueError(
                f"{partial}: an unfinished recording; keep it by another name, or remove it"
            )
    except ValueError as error:
        return error


def _record(stream: Iterable[Taken], writer: Writer, limit_s: float) -> Exception | None:
    """Hand instants over until the stream, the time or a person ends it; the error if one did."""
    start, error = None, None
    try:
        for taken in stream:
            start = taken.t_s if start is None else start
            if writer.error is not None or taken.t_s - start >= limit_s:
                break
            writer.offer(taken)
    except KeyboardInterrupt:
        log.info("interrupted: writing what was taken")
    except ValueError as caught:
        error = caught
    writer.close()
    return writer.error or error


def timing(captured: Captured) -> str:
    """What the time between the cameras' grabs means for a handle that moves: nothing for fewer than
    two cameras.

    A handle at the speed v moves v times this time between two images that are taken for one
    instant, and a measured point is as wrong. The grabs are seen, the exposures are not: a camera
    that nobody triggers exposes when it likes, and its image may wait for a frame's time.
    """
    if captured.live < 2:
        return ""
    spread_s = float(np.quantile(captured.spread_s, MOST_OF_THEM))
    speed = ALLOWED_MM / max(spread_s, 1e-6)
    costs = (
        f"in {1e3 * spread_s:.1f} ms, as {100 * MOST_OF_THEM:.0f} % of the instants took, a hand at "
        f"{HAND_MM_S:g} mm/s moves {HAND_MM_S * spread_s:.2g} mm, and one at {speed:.2g} mm/s "
        f"{ALLOWED_MM:g} mm"
    )
    if speed < SLOW_MM_S:
        return f"{costs}: fit for a handle at rest, not for a moving hand"
    fit = "a moving hand" if speed >= HAND_MM_S else "a slow hand, not for a quick one"
    frame_ms = 1e3 * np.median(np.diff(captured.times_s)) if len(captured.times_s) > 1 else np.nan
    return (
        f"{costs}: fit for {fit}, if the cameras have a common trigger; else their exposures may be "
        f"another {frame_ms:.0f} ms apart (trinolab track says how many)"
    )


def _concluded(
    out: str | Path, partial: Path, writer: Writer, error: Exception | None, live: int
) -> Captured:
    """Give the recording its name, and say what was wrong."""
    (partial / PREVIEW).unlink(missing_ok=True)
    if not writer.written:
        shutil.rmtree(partial)
        raise ValueError(str(error or "nothing was taken"))
    times = np.array([taken.t_s for taken in writer.written])
    try:
        recording_writer.finish(out, list(times - times[0]))
    except ValueError as last:
        raise ValueError(
            f"{error or last}; the images of {len(times)} instants are in {partial}"
        ) from None
    if error is not None:
        raise ValueError(f"{error}; the {len(times)} instants before are kept in {out}")
    spread = np.array([taken.spread_s for taken in writer.written])
    return Captured(Path(out), frozen(times - times[0]), frozen(spread), writer.dropped, live)
