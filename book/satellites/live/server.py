"""The page's server: one page, on this computer, that knows the token; nobody and nothing else.

A frame is sent when the page has drawn all but one of those before: it draws one while the next is on
its way. It is then drawn from what is newest: nothing else queues up, and a page that was stopped goes
on with the present.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import logging
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from .loop import Loop, Shown
from .picture import message, scene

PAGE = Path(__file__).parent / "page"
FILES = {
    "": ("index.html", "text/html"),
    "live.js": ("live.js", "text/javascript"),
    "solids.js": ("solids.js", "text/javascript"),
    "replay.js": ("replay.js", "text/javascript"),
    "live.css": ("live.css", "text/css"),
}
# what words that make no sense raise, among them whole numbers of hundreds of digits
NONSENSE = (
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    ArithmeticError,
    RecursionError,
)
LOGS = ("tornado.access", "tornado.application", "tornado.general", "asyncio")
LOOPBACK = ("127.0.0.1", "localhost", "::1")
UNDER_WAY = 2  # frames that the page has not drawn yet: with one it would wait for each
LONGEST = 4096  # bytes of what a page may say
MOST_MM, MOST_RAD = 50.0, 0.5  # that one word moves the simulated hand
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'; base-uri 'none'",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class _Sent(NamedTuple):
    """A frame under way: its number, the stages so far (ms), when its images were here (0 for old
    ones) and when it was sent, s.
    """

    number: int
    stages: dict[str, float]
    arrived_s: float
    t_s: float


class Desk:
    """Who sits before the page: the one tab that is in charge, and what it has drawn.

    Parameters
    ----------
    loop : Loop
    """

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.tab: Socket | None = None
        self._sent = 0
        self._sending = False
        # of the frames that the tab has not drawn yet, by their numbers
        self._under_way: dict[object, _Sent] = {}
        self._way: dict[str, float] = {}
        self.pointing_task: asyncio.Task[None] | None = None

    def enter(self, tab: Socket) -> None:
        """A tab comes: it is in charge if none is, else it is told so."""
        if self.tab is not None:
            tab.say({"busy": "this page is open in another tab, which is in charge"})
            return
        self.tab = tab
        self._under_way = {}
        self._sent = 0
        self._sending = False  # to this one
        source = self.loop.source
        tab.say({"scene": scene(source.rig, source.handle, self.loop.arm_session.robot)})
        self.wake()

    def take_over(self, tab: Socket) -> None:
        """A tab takes the place of the one in charge; the clutch opens."""
        before, self.tab = self.tab, None
        if before is not None and before is not tab:
            before.say({"busy": "another tab has taken over"})
        self.loop.clutch(False)
        self.loop.note("another tab has taken over: clutch opened")
        self.enter(tab)

    def leave(self, tab: Socket) -> None:
        """A tab is gone; if it was in charge, the clutch opens."""
        if tab is self.tab:
            self.tab = None
            self.loop.clutch(False)
            self.loop.note("the page is gone: clutch opened")

    def drawn(self, number: object) -> None:
        """The tab has drawn a frame: its way is known, and another one may be sent."""
        sent = self._under_way.pop(number, None)
        if sent is None:
            return
        now = time.monotonic()
        if sent.arrived_s:
            whole = 1e3 * (now - sent.arrived_s)
            self._way = {**sent.stages, "page": 1e3 * (now - sent.t_s), "whole": whole}
        self.loop.heard(sent.number)
        self.wake()

    def wake(self) -> None:
        """Send what is newest, if there is room for it on the way to the tab."""
        newest = self.loop.newest
        if (
            self.tab is None
            or self._sending
            or len(self._under_way) >= UNDER_WAY
            or newest is None
            or newest.number == self._sent
        ):
            return
        self._sending = True
        self.pointing_task = asyncio.create_task(self._send(self.tab, newest))

    async def _send(self, tab: Socket, shown: Shown) -> None:
        """Draw a frame in another thread, and send it."""
        self._sent = shown.number
        begin = time.monotonic()
        source = self.loop.source
        try:
            data = await asyncio.to_thread(
                message, shown, source.rig, self._way, source.hand is not None
            )
            if tab is self.tab:
                done = time.monotonic()
                stages = {**shown.stages._asdict(), "draw": 1e3 * (done - begin)}
                arrived_s = shown.frames.arrived_s if shown.new and shown.frames else 0.0
                self._under_way[shown.number] = _Sent(shown.number, stages, arrived_s, done)
                with suppress(WebSocketClosedError):
                    await tab.write_message(data, binary=True)
        finally:
            if tab is self.tab:
                self._sending = False
        self.wake()


class _Guarded(RequestHandler):
    """Refuses whoever does not know the token, or comes from another page."""

    def initialize(self, desk: Desk, token: str, hosts: tuple[str, ...]) -> None:
        self.desk = desk
        self._token = token
        self._hosts = hosts

    def prepare(self) -> None:
        given = self.request.path.split("/")[1]
        host = self.request.host
        name = host.rpartition(":")[0].strip("[]")
        origin = self.request.headers.get("Origin")
        if (
            not hmac.compare_digest(given.encode(), self._token.encode())
            or (self._hosts and name not in self._hosts)
            or origin not in (None, f"http://{host}")
        ):
            raise HTTPError(403)

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain")
        self.finish(f"{status_code}: {self._reason}\n")


class _Nothing(_Guarded):
    """What is asked for by an address that is none of this server's: an absolute one, ``*``, the
    place to connect to.
    """

    def prepare(self) -> None:
        raise HTTPError(404)


class _File(_Guarded):
    """The page's own files."""

    def get(self, name: str) -> None:
        if name not in FILES:
            raise HTTPError(404)
        if not name and not self.request.path.endswith("/"):
            self.redirect(f"{self.request.path}/")  # the other files lie beside it
            return
        file, kind = FILES[name]
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.write((PAGE / file).read_bytes())


class Socket(_Guarded, WebSocketHandler):
    """A tab's connection: frames go out, words come in."""

    def check_origin(self, origin: str) -> bool:
        return origin == f"http://{self.request.host}"

    def prepare(self) -> None:
        super().prepare()
        if self.request.headers.get("Origin") is None:  # a browser always says it here
            raise HTTPError(403)

    def open(self, *_: str) -> None:
        self.set_nodelay(True)
        self.desk.enter(self)

    def on_close(self) -> None:
        self.desk.leave(self)

    def on_message(self, text: str | bytes) -> None:
        try:
            words = json.loads(text, parse_constant=_no_number)
            if not isinstance(words, dict):
                raise ValueError("expected an object")
            if "take" in words:
                self.desk.take_over(self)
            elif self.desk.tab is self:
                obey(words, self.desk)
        except NONSENSE as error:
            self.say({"refused": f"not understood: {error}"[:200]})

    def say(self, words: dict[str, Any]) -> None:
        """Send words; those who have gone do not hear them."""
        with suppress(WebSocketClosedError):
            self.write_message(json.dumps(words))


def _no_number(word: str) -> None:
    raise ValueError(f"expected a number, got {word}")


def obey(words: dict[str, Any], desk: Desk) -> None:
    """Do what the page in charge says. Raises one of `NONSENSE` for what makes no sense."""
    loop = desk.loop
    known: dict[str, Callable[[Any], None]] = {
        "drawn": desk.drawn,
        "clutch": lambda on: loop.clutch(on is True),
        "record": lambda on: loop.record(on is True),
        "set": lambda pair: loop.set(pair[0], pair[1]),
        "tracker": loop.follow_by,
        "hand": lambda how: move_hand(loop, how),
        "task": lambda how: loop.begin_task(how["operator"], how["times"]),
        "end": lambda _: loop.end_task(),
        "there": lambda _: loop.press(),
        "show": lambda _: loop.demonstrate(),
    }
    if set(words) - {"drawn"}:
        loop.touch()
    for name, value in words.items():
        if name not in known:
            raise ValueError(f"expected one of {', '.join(known)}, got {name[:20]!r}")
        known[name](value)


def move_hand(loop: Loop, how: dict[str, Any]) -> None:
    """Move the simulated hand as a camera sees it: to its right, down and away, mm, and turned about
    these axes, rad; or let it go by itself, or home.
    """
    hand = loop.source.hand
    if hand is None:
        raise ValueError("hand: there is none to move")
    if "drawn" in how:
        hand.drawn = how["drawn"] is True
    elif "alone" in how:
        hand.by_itself = how["alone"] is True
    elif "home" in how:
        hand.go_home()
    else:
        camera = loop.source.rig.cameras[int(how.get("camera", 0))]
        way, turn = (np.array(how.get(key, (0, 0, 0)), float) for key in ("mm", "rad"))
        if way.shape != (3,) or turn.shape != (3,) or not np.isfinite([way, turn]).all():
            raise ValueError("hand: expected three numbers")
        R = camera.T_world_cam.rotation
        hand.move(
            R.apply(np.clip(way, -MOST_MM, MOST_MM)), R.apply(np.clip(turn, -MOST_RAD, MOST_RAD))
        )


async def serve(
    loop: Loop, token: str, host: str, port: int, on_open: Callable[[str], None]
) -> None:
    """Let the page in until Ctrl-C, or until the loop fails.

    Parameters
    ----------
    loop : Loop
    token : str
    host : str
        Address of this computer to listen at; only a loopback one keeps others out.
    port : int
        0 for any that is free.
    on_open : callable
        Gets the page's address.

    Raises
    ------
    ValueError
        If nobody can listen there.
    """
    desk = Desk(loop)
    shared = {"desk": desk, "token": token, "hosts": LOOPBACK if host in LOOPBACK else ()}
    application = Application(
        [(r"/[^/]*/socket", Socket, shared), (r"/[^/]*/?(.*)", _File, shared)],
        default_handler_class=_Nothing,
        default_handler_args=shared,
        websocket_max_message_size=LONGEST,
        log_function=lambda _: None,  # it would write the token into the terminal
    )
    try:
        sockets = bind_sockets(port, host)
    except OSError as error:
        raise ValueError(f"{host}, port {port}: cannot be opened ({error.strerror})") from None
    server = HTTPServer(application, max_body_size=LONGEST)
    server.add_sockets(sockets)
    stop = asyncio.Event()
    running = asyncio.get_running_loop()
    _on_interruption(running, stop)

    def on_new() -> None:
        with suppress(RuntimeError):  # the server has ended meanwhile
            running.call_soon_threadsafe(stop.set if loop.failed else desk.wake)

    loop.on_new = on_new
    on_new()  # of what was before anybody listened: the loop may have failed
    name = f"[{host}]" if ":" in host else host
    on_open(f"http://{name}:{sockets[0].getsockname()[1]}/{token}/")
    try:
        with _unsaid(token):
            await stop.wait()
    finally:
        loop.on_new = lambda: None
        loop.clutch(False)
        if desk.tab is not None:
            desk.tab.say({"bye": "trinolab has ended; the arm holds"})
            desk.tab.close()
            await asyncio.sleep(0)
        server.stop()
        await server.close_all_connections()


@contextmanager
def _unsaid(token: str) -> Iterator[None]:
    """Keep the token out of the logs of tornado and asyncio, which name the address of a request that
    fails, while the block runs.
    """

    def without_token(record: logging.LogRecord) -> bool:
        record.msg = record.getMessage().replace(token, "TOKEN")
        record.args = ()
        if record.exc_info:
            text = logging.Formatter().formatException(record.exc_info)
            record.exc_text = text.replace(token, "TOKEN")
            record.exc_info = None
        return True

    loggers = [logging.getLogger(name) for name in LOGS]
    for logger in loggers:
        logger.addFilter(without_token)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeFilter(without_token)


def _on_interruption(running: asyncio.AbstractEventLoop, stop: asyncio.Event) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        try:
            running.add_signal_handler(number, stop.set)
        except (NotImplementedError, RuntimeError, ValueError):  # Windows, or another thread
            with suppress(ValueError):
                signal.signal(number, lambda *_: running.call_soon_threadsafe(stop.set))
