"""Where live frames come from: cameras, videos, a recording folder, or the simulated bench; of each
only the latest frame.

Each feed has a thread of its own, which overwrites what nobody has fetched: a reader that is late
sees the present. A feed that fails is opened anew every second, as a camera is that was pulled out.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from threading import Condition, Event, Lock, Thread
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.motion import motion_at, orientation
from trinolab.bench.optics import Bench
from trinolab.bench.scenario import HOLDING
from trinolab.bench.scene import render_rig, scaled
from trinolab.camera import Rig
from trinolab.files.recording import Recording, instants
from trinolab.handle import Handle
from workbench.capture.devices import fetched, open_source

FROZEN_S = 0.5  # without a new image, or with the same one, a camera is said to have stopped
RETRY_S = 1.0
ENDS_S = 5.0  # a camera that delivers nothing may keep its thread longer
SIMULATED_FPS = 30.0
# of the simulated hand: the way that it goes by itself, and how it follows the mouse
PATH_S, PATH_STEP_S, PATH_MM_S, PATH_DEG_S = 60.0, 0.02, 60.0, 8.0
FOLLOWS_S = 0.1
RANGES_MM = np.array([[-95.0, 95.0], [-50.0, 50.0], [530.0, 610.0]])
HOME = RigidTransform.from_components([0.0, 0.0, 570.0], orientation(-np.pi / 2, np.pi / 2, 0.0))
QUICK = Bench(supersampling=4, marker_supersampling=8)

Shown = tuple[float, list[np.ndarray]]  # time of exposure, s, and images


class Latest(NamedTuple):
    """The latest frames of all cameras.

    Attributes
    ----------
    number : int
        Counts what was fetched.
    t_s, spread_s : float
        Middle of the cameras' times, and how far they are apart, s.
    arrived_s : float
        When the last of the images was here, s.
    images : list of ndarray of uint8, shape (height, width)
        One a camera.
    """

    number: int
    t_s: float
    spread_s: float
    arrived_s: float
    images: list[np.ndarray]


class Feed:
    """A thread that keeps the latest images of one camera, or of several that belong together.

    Parameters
    ----------
    name : str
    frames : callable
        Begins the frames, which end when the event is set; what it raises is the feed's trouble.
    live : bool
        Whether this is a camera, whose noise makes no two images the same.
    """

    def __init__(self, name: str, frames: Callable[[Event], Iterator[Shown]], live: bool) -> None:
        self.name = name
        self.number = 0
        self.t_s = self.arrived_s = self.changed_s = time.monotonic()
        self.images: list[np.ndarray] = []
        self.problem = ""
        self.latest_frames = frames
        self._live = live

    def run(self, changed: Condition, stopped: Event) -> None:
        """Fetch frames until the event is set."""
        while not stopped.is_set():
            try:
                for t_s, images in self.latest_frames(stopped):
                    with changed:
                        self.keep(t_s, images)
                        changed.notify_all()
                    if stopped.is_set():
                        return
                problem = "has ended"
            except (ValueError, OSError, EOFError, cv2.error) as error:
                problem = " ".join(str(error).split()).removeprefix(f"{self.name}: ")
            with changed:
                self.problem = problem
                changed.notify_all()
            stopped.wait(RETRY_S)

    def trouble(self, now: float) -> str:
        """What is wrong at a time, in words; nothing if all is well."""
        if self.problem:
            return f"{self.name}: {self.problem}"
        if now - self.arrived_s > FROZEN_S:
            return f"{self.name}: no new image for {now - self.arrived_s:.0f} s"
        if self._live and self.arrived_s - self.changed_s > FROZEN_S:
            return f"{self.name}: the image stands still (frozen?)"
        return ""

    def keep(self, t_s: float, images: list[np.ndarray]) -> None:
        now = time.monotonic()
        if not (self._live and self.images and np.array_equal(images[0], self.images[0])):
            self.changed_s = now
        self.number += 1
        self.t_s, self.arrived_s = t_s, now
        self.images = images
        self.problem = ""


class Source:
    """The feeds of all cameras; a context manager that runs them.

    Parameters
    ----------
    rig : Rig
    handle : Handle
    feeds : sequence of Feed
        One a camera in the rig's order, or one for all.
    hand : SimulatedHand, optional
    """

    def __init__(
        self, rig: Rig, handle: Handle, feeds: Sequence[Feed], hand: SimulatedHand | None = None
    ) -> None:
        self.rig = rig
        self.handle = handle
        self.hand = hand
        self.feeds = feeds
        self._changed = Condition()
        self._stopped = Event()
        self._given = 0
        self._used = [0] * len(feeds)

    def __enter__(self) -> Source:
        self._threads = [
            Thread(target=feed.run, args=(self._changed, self._stopped), daemon=True)
            for feed in self.feeds
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        for thread in self._threads:
            thread.join(ENDS_S)

    def next(self, wait_s: float) -> Latest | None:
        """The latest frames, as soon as each feed has a new one; None if one has none by then."""
        with self._changed:
            if not self._changed.wait_for(self._all_new, wait_s):
                return None
            self._used = [feed.number for feed in self.feeds]
            times = [feed.t_s for feed in self.feeds]
            self._given += 1
            return Latest(
                self._given,
                (min(times) + max(times)) / 2,
                max(times) - min(times),
                max(feed.arrived_s for feed in self.feeds),
                [image for feed in self.feeds for image in feed.images],
            )

    def troubles(self) -> list[str]:
        """What is wrong with the feeds, in words."""
        with self._changed:
            now = time.monotonic()
            return list(filter(None, (feed.trouble(now) for feed in self.feeds)))

    def _all_new(self) -> bool:
        return all(feed.number > used for feed, used in zip(self.feeds, self._used, strict=True))


def of_cameras(
    cameras: dict[str, str], rig: Rig, handle: Handle, fps: float | None = None
) -> Source:
    """Cameras of this computer by their indices. Raises ValueError if one cannot be opened now."""
    feeds = []
    for camera in rig.cameras:
        what = cameras[camera.name]
        first = open_source(camera.name, what, camera.size, fps)
        feeds.append(Feed(camera.name, _camera(first, what, camera.size, fps), True))
    return Source(rig, handle, feeds)


def of_recording(recording: Recording, handle: Handle) -> Source:
    """A recording, or videos, played at their own pace and again from the start at their end."""

    def frames(stopped: Event) -> Iterator[Shown]:
        while not stopped.is_set():
            begin = time.monotonic()
            first = None
            for now in instants(recording):
                first = now.t_s if first is None else first
                ahead = begin + now.t_s - first - time.monotonic()
                if ahead > 0:
                    stopped.wait(ahead)
                else:
                    begin -= ahead  # reading is slower than the pace: nothing is caught up
                if stopped.is_set():
                    return
                yield time.monotonic(), [as_bytes(image) for image in now.images]

    return Source(recording.rig, handle, [Feed("recording", frames, False)])


def of_bench(rig: Rig, handle: Handle, seed: int = 0) -> Source:
    """The simulated bench, whose images are half as large; nothing blurs what moves.

    It draws in a process of its own, so that the loop has its thread for itself.
    """
    small = replace(rig, cameras=tuple(scaled(camera, 0.5) for camera in rig.cameras))
    hand = SimulatedHand(seed)

    def frames(stopped: Event) -> Iterator[Shown]:
        with closing(_drawing(small, handle, seed)) as ask:
            while not stopped.is_set():
                begin = time.monotonic()
                ask.send((hand.pose(begin), hand.drawn))
                while not ask.poll(0.1):
                    if stopped.is_set():
                        return
                yield begin, ask.recv()
                stopped.wait(max(0.0, begin + 1 / SIMULATED_FPS - time.monotonic()))

    return Source(small, handle, [Feed("simulation", frames, False)], hand)


def _drawing(rig: Rig, handle: Handle, seed: int) -> Connection:
    """A process that draws each pose that it gets, and ends when this one does."""
    context = multiprocessing.get_context("spawn")
    ours, its = context.Pipe()
    context.Process(target=_draw, args=(its, rig, handle, seed), daemon=True).start()
    its.close()  # so that its end is seen here
    return ours


def _draw(asked: Connection, rig: Rig, handle: Handle, seed: int) -> None:
    """Draw until the other end is closed. Ctrl-C is for the process that asks."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    rng = np.random.default_rng([seed, 1])
    with suppress(EOFError, OSError):
        while True:
            T, drawn = asked.recv()
            asked.send(render_rig(rig, handle, T, QUICK, rng, HOLDING if drawn else None))


class SimulatedHand:
    """The pose of the simulated handle: along a path by itself, or where the mouse takes it.

    Parameters
    ----------
    seed : int
        Of the path.

    Attributes
    ----------
    by_itself : bool
    drawn : bool
        Whether hand and forearm are drawn, which takes four times as long.
    """

    def __init__(self, seed: int = 0) -> None:
        times = np.arange(0.0, PATH_S, PATH_STEP_S)
        rng = np.random.default_rng([seed, 0])
        self._path = motion_at(rng, times, speed_mm_s=PATH_MM_S, turn_deg_s=PATH_DEG_S)
        self._lock = Lock()
        self.clock_now = self.goal = self._path[0]
        self.time_s = self._walked_s = 0.0
        self.by_itself = True
        self.drawn = False

    def pose(self, t_s: float) -> RigidTransform:
        """T_world_handle at a time, mm; times increase."""
        with self._lock:
            dt = min(max(t_s - self.time_s, 0.0), 0.2)  # a pause is no jump
            self.time_s = t_s
            if self.by_itself:
                self._walked_s += dt
                phase = self._walked_s / PATH_STEP_S % (2 * len(self._path) - 2)
                self.goal = self._path[round(min(phase, 2 * len(self._path) - 2 - phase))]
            share = 1 - np.exp(-dt / FOLLOWS_S)
            distance = self.goal.translation - self.clock_now.translation
            turn = (self.goal.rotation * self.clock_now.rotation.inv()).as_rotvec()
            self.clock_now = RigidTransform.from_components(
                self.clock_now.translation + share * distance,
                Rotation.from_rotvec(share * turn) * self.clock_now.rotation,
            )
            return self.clock_now

    def move(self, by_mm: ArrayLike, turn_rad: ArrayLike) -> None:
        """Take the handle somewhere else, world frame, within the cameras' common field of view."""
        with self._lock:
            self.by_itself = False
            self.goal = RigidTransform.from_components(
                np.clip(self.goal.translation + np.asarray(by_mm, float), *RANGES_MM.T),
                Rotation.from_rotvec(turn_rad) * self.goal.rotation,
            )

    def go_home(self) -> None:
        """Take the handle to the middle, upright."""
        with self._lock:
            self.by_itself = False
            self.goal = HOME


def as_bytes(image: np.ndarray) -> np.ndarray:
    """An image with whole grey levels, uint8."""
    return image if image.dtype == np.uint8 else np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _camera(
    first: Any, what: str, size: tuple[int, int], fps: float | None
) -> Callable[[Event], Iterator[Shown]]:
    """The frames of a camera that is open already; later it is opened anew."""
    opened = [first]

    def frames(stopped: Event) -> Iterator[Shown]:
        source = opened.pop() if opened else open_source(first.name, what, size, fps)
        known: dict[str, tuple[int, int] | None] = {first.name: size}
        try:
            k = 0
            while not stopped.is_set():
                grabbed = source.device.grab()
                t_s = time.monotonic()
                yield t_s, [fetched(source, grabbed, k, known)]
                k += 1
        finally:
            source.device.release()

    return frames
