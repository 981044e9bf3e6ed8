"""A headless Chromium in which pages are opened one after the other, with the network off.

Playwright drives the Chromium of the system.
"""

from __future__ import annotations

import json
import shutil
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar
from urllib.parse import urlsplit

from playwright.sync_api import ConsoleMessage, Playwright, Request, sync_playwright

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
FLAGS = [
    "--disable-gpu",
    # One page is open at a time: fewer processes draw it in less time.
    "--in-process-gpu",
    "--renderer-process-limit=1",
    "--disable-site-isolation-trials",
    "--disable-quic",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
]
HANGS_MS = 300_000.0  # a browser that takes longer hangs, however busy the machine is
# MathJax is ready when its promise is fulfilled.
READY = "(async () => { if (window.MathJax && MathJax.startup) await MathJax.startup.promise; })()"
# Changes of colours and of folds are shown without the theme's transitions.
AT_ONCE = """
document.head.insertAdjacentHTML('beforeend',
    '<style>*, *::before, *::after { transition: none !important; animation: none !important; }</style>')
"""


P, T = ParamSpec("P"), TypeVar("T")
# Playwright's event loop runs in the thread that starts it, which can then have no other one.
THREAD_NAME = "browser"
_thread = ThreadPoolExecutor(1, THREAD_NAME)


def _in_thread(method: Callable[P, T]) -> Callable[P, T]:
    """A method that is called in Playwright's thread."""

    @wraps(method)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        if threading.current_thread().name.startswith(THREAD_NAME):
            return method(*args, **kwargs)
        return _thread.submit(method, *args, **kwargs).result()

    return called


@cache
def _playwright() -> Playwright:
    """The driver, of which a process has one."""
    return sync_playwright().start()


class Browser:
    """Chromium with a profile in a folder, and the page that is open in it."""

    @_in_thread
    def __init__(self, folder: Path) -> None:
        self._context = _playwright().chromium.launch_persistent_context(
            folder, executable_path=CHROMIUM, args=FLAGS, chromium_sandbox=False
        )
        self._context.set_default_timeout(HANGS_MS)
        self._use(self._context.pages[0])

    @_in_thread
    def open(
        self, address: str, width: int = 1280, height: int = 900, before: str | None = None
    ) -> None:
        """Open a page in a tab of its own and of this size, and wait until its formulas are set.

        Parameters
        ----------
        address : str
        width, height : int
            Of the window, px.
        before : str, optional
            A script that is run in the page, and in each of its frames, before their own.
        """
        last, page = self._page, self._context.new_page()
        last.close()
        self._use(page)
        self.resize(width, height)
        if before is not None:
            page.add_init_script(before)
        page.goto(address)
        self.evaluate(READY)

    def _use(self, page: Any) -> None:
        """Take a tab; `errors` holds its errors of the console and of requests."""
        self._page = page
        self.errors: list[str] = []
        self._devtools = self._context.new_cdp_session(page)
        page.on("pageerror", lambda error: self._fail(str(error)))
        page.on("console", self._note)
        page.on("requestfailed", self._note_failed)

    @_in_thread
    def arrives(self, end: str) -> None:
        """Wait until the tab is at an address that ends so: one page may lead to the next by itself."""
        self._page.wait_for_url(lambda address: urlsplit(address).path.endswith(end))

    @_in_thread
    def resize(self, width: int, height: int = 900) -> None:
        """Give the window another size, px."""
        self._page.set_viewport_size({"width": width, "height": height})

    @_in_thread
    def press(self, key: str, up: bool = True) -> None:
        """Press a key, by its name in JavaScript, and let it go again, or not."""
        self._page.keyboard.down(key)
        if up:
            self.let_go(key)

    @_in_thread
    def let_go(self, key: str) -> None:
        """Let a key go."""
        self._page.keyboard.up(key)

    @_in_thread
    def click(self, selector: str) -> None:
        """Click the middle of an element with the mouse, wherever on the page it is."""
        self._page.mouse.click(*self.middle(selector))

    @_in_thread
    def drag(self, selector: str, right: float, down: float) -> None:
        """Drag from the middle of an element by so many pixels, in ten steps."""
        u, v = self.middle(selector)
        self._page.mouse.move(u, v)
        self._page.mouse.down()
        self._page.mouse.move(u + right, v + down, steps=10)
        self._page.mouse.up()

    @_in_thread
    def touch(self, kind: str, *place: float, time_s: float | None = None) -> None:
        """Send a finger's ``touchStart``, ``touchMove`` or ``touchEnd``, at a place of the window, at a
        time in s since 1970, or now.
        """
        points = [{"x": place[0], "y": place[1]}] if place else []
        when = {} if time_s is None else {"timestamp": time_s}
        self._ask("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points, **when})

    @_in_thread
    def middle(self, selector: str) -> tuple[float, float]:
        """The middle of an element, which is brought into the window."""
        place = self.evaluate(
            "(one => { one.scrollIntoView({block: 'center', behavior: 'instant'});"
            " const b = one.getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2]; })"
            f"(document.querySelector({json.dumps(selector)}))"
        )
        return float(place[0]), float(place[1])

    @_in_thread
    def evaluate(self, expression: str) -> Any:
        """The value of an expression of JavaScript in the page's scope; a promise is waited for."""
        answer = self._ask(
            "Runtime.evaluate",
            {"expression": expression, "awaitPromise": True, "returnByValue": True},
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(json.dumps(answer["exceptionDetails"])[:500])
        return answer["result"].get("value")

    @_in_thread
    def picture_of(self, element: str) -> str:
        """A picture of an element, an expression of JavaScript: a PNG in base64, twice as fine as the
        window.
        """
        clip = self.evaluate(
            f"(one => {{ one.scrollIntoView({{block: 'center', behavior: 'instant'}});"
            " const b = one.getBoundingClientRect();"
            " return {x: b.x + scrollX, y: b.y + scrollY, width: b.width, height: b.height, scale: 2};"
            f" }})({element})"
        )
        return str(self._ask("Page.captureScreenshot", {"format": "png", "clip": clip})["data"])

    @_in_thread
    def pdf(self, **settings: Any) -> bytes:
        """The page as a PDF file, with the settings of Playwright's `Page.pdf`."""
        return self._page.pdf(**settings)

    @_in_thread
    def close(self) -> None:
        """End Chromium."""
        self._context.close()

    def _ask(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        """An answer by the DevTools protocol, for what Playwright has no call."""
        return dict(self._devtools.send(method, parameters))

    def _note(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "assert"):
            self._fail(f"console: {message.text} {message.location.get('url', '')}")

    def _note_failed(self, request: Request) -> None:
        if request.failure != "net::ERR_ABORTED":  # the page asks for it no more
            self._fail(f"{request.failure} {request.url}")

    def _fail(self, error: str) -> None:
        """Keep an error. The theme preloads its icons' fonts in a way that a browser refuses for pages
        read from files; they come all the same, by the style sheet.
        """
        if "webfonts/fa-" not in error:
            self.errors.append(error)
