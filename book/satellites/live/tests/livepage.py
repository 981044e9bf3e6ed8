"""What the tests of the live page have in common: sources that do as they are told, a page's tab, and
the command as a process.
"""

import asyncio
import json
import time
from contextlib import suppress
from dataclasses import replace
from threading import Event, Thread

import numpy as np
import websocket
from processes import wait_until

from satellites.live.loop import Loop
from satellites.live.pointing import Pointing
from satellites.live.recorder import Recorder
from satellites.live.server import serve
from satellites.live.sources import HOME, QUICK, Feed, Source
from trinolab.bench.scene import render_rig, scaled
from trinolab.datasets import data_path, load_handle, load_rig
from trinolab.files.rigs import read_camera
from trinolab.slave.arm import load_robot
from trinolab.slave.mapping import MappingParameters, alignment
from workbench.teleop.session import Session

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

    def __init__(self, images=HELD, live=False):
        self.images = images
        self.broken = ""
        self.paused = False
        feeds = [Feed(name, self.latest_frames(c), live) for c, name in enumerate(RIG.names)]
        self.source = Source(RIG, HANDLE, feeds)

    def latest_frames(self, c):
        def frames(stopped):
            while not stopped.is_set():
                if self.broken and c == 1:
                    raise ValueError(self.broken)
                if not (self.paused and c == 1):
                    yield time.monotonic(), [self.images[c].copy()]
                stopped.wait(0.05)

        return frames


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
