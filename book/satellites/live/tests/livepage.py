"""What the tests of the live page have in common: sources that do as they are told, a page's tab, and
the command as a process.
"""

import asyncio
import json
import time
from contextlib import suppress
from dataclasses import replace
from functools import partial
from threading import Event, Thread
from types import SimpleNamespace

import numpy as np
import websocket
from processes import wait_until
from scipy.spatial.transform import RigidTransform, Rotation

from satellites.live import loop as live_loop
from satellites.live.loop import WAIT_S, Loop
from satellites.live.pointing import Pointing
from satellites.live.recorder import Recorder
from satellites.live.server import serve
from satellites.live.sources import HOME, QUICK, Feed, Latest, Source
from trinolab.bench.scene import render_rig, scaled
from trinolab.datasets import data_path, load_handle, load_rig
from trinolab.files.rigs import read_camera
from trinolab.following.posetracker import Tracked
from trinolab.markers import Markers
from trinolab.measurement import Measurement
from trinolab.pose import Pose
from trinolab.slave.arm import load_robot
from trinolab.slave.mapping import MappingParameters, alignment
from workbench.teleop.session import Session

TICK_S = 0.008  # of the arm
TOKEN = "a-token-of-the-tests"
TARGETS_MM = [[40.0, 20.0]]  # distance and width
LONG_S = 600.0  # a page of a test is never silent for so long
RIG = load_rig("raised_40deg")
RIG = replace(RIG, cameras=tuple(scaled(camera, 0.5) for camera in RIG.cameras))
HANDLE = load_handle("coded")
HELD = render_rig(RIG, HANDLE, HOME, QUICK, np.random.default_rng(0))
NOBODY = render_rig(RIG, HANDLE, None, QUICK, np.random.default_rng(1))


class Bench:
    """A source whose cameras show what they are told, or fail with words."""

    def __init__(self, images=HELD):
        self.images = images
        self.broken = ""
        feeds = [Feed(name, partial(self._frames, c), False) for c, name in enumerate(RIG.names)]
        self.source = Source(RIG, HANDLE, feeds)

    def _frames(self, c, stopped):
        while not stopped.is_set():
            if self.broken and c == 1:
                raise ValueError(self.broken)
            yield time.monotonic(), [self.images[c].copy()]
            stopped.wait(0.05)


def a_loop(source, folder, silence_s=LONG_S):
    """A loop with an arm, not started."""
    view = read_camera(data_path("robots", "ur5_view.toml"))
    # a busy computer may take long for a frame: that is no matter here
    mapping = MappingParameters(alignment=alignment(view), stale_s=5.0)
    session = Session(load_robot(), mapping, tick_s=0.02, longest_s=0.1)
    recorder = Recorder(folder, source.rig, source.handle)
    pointing = Pointing(folder / "pointing.csv", mapping.alignment, TARGETS_MM)
    return Loop(source, session, recorder, pointing, "patches", silence_s)


class Live:
    """Source, loop and server in threads of this process; a context manager."""

    def __init__(self, source, folder, silence_s=LONG_S):
        self.loop = a_loop(source, folder, silence_s)
        self.address = ""
        self._opened = Event()
        self._server = Thread(target=self._serve)
        self._asyncio = None

    def __enter__(self):
        self.loop.source.__enter__()
        self.loop.start()
        self._server.start()
        self._opened.wait()
        return self

    def __exit__(self, *_):
        self._asyncio.call_soon_threadsafe(self.pointing_task.cancel)
        self._server.join()
        self.loop.source.__exit__()
        self.loop.close()

    def _serve(self):
        async def run():
            self._asyncio = asyncio.get_running_loop()
            self.pointing_task = asyncio.current_task()
            await serve(self.loop, TOKEN, "127.0.0.1", 0, self._open)

        with suppress(asyncio.CancelledError):
            asyncio.run(run())

    def _open(self, address):
        self.address = address
        self._opened.set()

    def seen(self, what):
        """Wait until the newest round is as `what` wants it; return it."""
        return wait_until(lambda: (now := self.loop.newest) and what(now) and now)


class Tab:
    """A page without a browser: a connection that draws what comes, when it is asked to."""

    def __init__(self, address, origin=None):
        host = address.split("/")[2]
        self._socket = websocket.create_connection(
            f"ws://{host}/{address.split('/')[3]}/socket",
            origin=origin or f"http://{host}",
            timeout=120,
        )

    def say(self, **words):
        self._socket.send(json.dumps(words))

    def send(self, text):
        self._socket.send(text)

    def hear(self):
        """The next message: words, or the numbers of a frame."""
        said = self._socket.recv()
        if isinstance(said, bytes):
            length = int.from_bytes(said[:4])
            return json.loads(said[4 : 4 + length])
        return json.loads(said)

    def until(self, what):
        """Draw frames until what comes is as wanted."""
        while not what(said := self.hear()):
            if "number" in said:
                self.say(drawn=said["number"])
        if "number" in said:
            self.say(drawn=said["number"])
        return said

    def close(self):
        self._socket.close()
        self._socket.shutdown()  # also one that the other side has broken off


def shows(browser, what):
    """Wait until an expression holds in the page."""
    return wait_until(lambda: browser.evaluate(f"Boolean({what})"))


FRAME_S = 1 / 30


class Driven:
    """A loop without images and without waiting: its clock is the test's, the tracker says where the
    handle is, and `frame` and `nothing` are its rounds.
    """

    def __init__(self, folder, monkeypatch, hand=None):
        self.now = 100.0
        clock = SimpleNamespace(monotonic=lambda: self.now, strftime=time.strftime)
        monkeypatch.setattr(live_loop, "time", clock)
        self.images = HELD
        self.hand = hand
        self.handle = at(0.0)  # T_world_handle, where there is no simulated hand
        self.troubles = []
        self.ticks = []
        self._next = None
        self._number = 0
        self.source = SimpleNamespace(
            rig=RIG,
            handle=HANDLE,
            hand=hand,
            next=lambda wait_s: self._next,
            troubles=lambda: self.troubles,
        )
        self.loop = a_loop(self.source, folder, LONG_S if hand is None else 1.0)
        if hand is None:
            self.loop.arm_session = Session(
                load_robot(), MappingParameters(), tick_s=TICK_S, longest_s=3.0
            )
        monkeypatch.setattr(self.loop, "follow", self._follow)

    def _follow(self, latest, follower):
        where = self.hand.pose(self.now) if self.hand else self.handle
        pose = Pose("measured", where, 1e-4 * np.eye(6), 0.1, 12, 3)
        nobody = Markers(*np.split(np.empty((0, 6)), [2, 4, 5], axis=1), ())
        return Tracked(Measurement(pose, (nobody,) * 3, (np.empty(0, int),) * 3), (None,) * 3)

    def frame(self, dt=FRAME_S, age_s=0.0):
        """A round with a frame that was exposed some time ago."""
        self.now += dt
        self._number += 1
        self._next = Latest(self._number, self.now - age_s, 0.0, self.now, self.images)
        return self._round()

    def nothing(self):
        """A round in which no frame came."""
        self.now += WAIT_S
        self._next = None
        return self._round()

    def _round(self):
        self.loop.go_round()
        self.ticks.append(self.loop.newest.moment.ticks)
        return self.loop.newest

    def rounds(self, seconds, drawn=True):
        """Rounds with frames, and a page that draws them."""
        for _ in range(round(seconds / FRAME_S)):
            self.frame()
            if drawn:
                self.loop.heard(self.loop.newest.number)
        return self.loop.newest


def at(x_mm, turn_rad=0.0):
    """A pose of the handle, to the side and turned."""
    return RigidTransform.from_components(
        [x_mm, 0.0, 570.0], Rotation.from_rotvec([0, turn_rad, 0])
    )
