"""A headless Chromium that stays: pages are opened in it one after the other, with the network off.

It is spoken to by the Chrome DevTools Protocol, a message of JSON at a time.
"""

from __future__ import annotations

import base64
import itertools
import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import websocket

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    # one page is open at a time: fewer processes draw it in less time
    "--in-process-gpu",
    "--renderer-process-limit=1",
    "--disable-site-isolation-trials",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--remote-debugging-port=0",
    "--remote-allow-origins=*",
]
ANSWERS_S = 120.0  # an answer that takes longer is none
# What MathJax has to do is done when its promise is, and figures are there when they are complete.
READY = """
(async () => {
    if (document.readyState !== 'complete')
        await new Promise(done => addEventListener('load', done, {once: true}));
    if (window.MathJax && MathJax.startup) await MathJax.startup.promise;
    return true;
})()
"""

# A change of colours, or the opening of a fold, takes the theme a while, which nobody here has time for.
AT_ONCE = """
document.head.insertAdjacentHTML('beforeend',
    '<style>*, *::before, *::after { transition: none !important; animation: none !important; }</style>')
"""


HANGS_S = 300.0  # a browser that takes longer hangs, however busy the machine is


def _wait_until(is_so: Callable[[], bool], process: subprocess.Popen) -> None:
    """Wait until something is so. Raises TimeoutError if the browser ends before, or hangs."""
    end = time.monotonic() + HANGS_S
    while not is_so():
        if process.poll() is not None or time.monotonic() > end:
            raise TimeoutError("the browser has ended, or hangs")
        time.sleep(0.005)


class Browser:
    """Chromium with a profile of its own in a folder."""

    def __init__(self, folder: Path) -> None:
        self._process = subprocess.Popen(
            [str(CHROMIUM), *FLAGS, f"--user-data-dir={folder}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "HOME": str(folder)},
        )
        port = folder / "DevToolsActivePort"
        _wait_until(lambda: port.exists() and port.read_text().count("\n") == 1, self._process)
        number, path = port.read_text().split("\n")
        self._socket = websocket.create_connection(
            f"ws://127.0.0.1:{number}{path}", timeout=ANSWERS_S
        )
        self._numbers = itertools.count(1)
        self._session: str | None = None
        self._target: str | None = None
        self._addresses: dict[str, str] = {}  # of requests, by their number
        self.errors: list[str] = []

    def open(
        self, address: str, width: int = 1280, height: int = 900, before: str | None = None
    ) -> None:
        """Open a page in a tab of its own and of this size, and wait until its formulas are set.

        `errors` then holds what the console called an error, and requests that failed. A script
        `before` is run in the page, and in each of its frames, before their own.
        """
        self._session = None
        if self._target is not None:
            self._ask("Target.closeTarget", {"targetId": self._target})
        self._target = str(self._ask("Target.createTarget", {"url": "about:blank"})["targetId"])
        tab = {"targetId": self._target, "flatten": True}
        self._session = self._ask("Target.attachToTarget", tab)["sessionId"]
        self.errors.clear()
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._ask(f"{domain}.enable")
        self.resize(width, height)
        if before is not None:
            self._ask("Page.addScriptToEvaluateOnNewDocument", {"source": before})
        self.navigate(address)
        self.evaluate(READY)

    def navigate(self, address: str) -> None:
        """Begin to load an address in the tab that is open."""
        self._ask("Page.navigate", {"url": address})

    def look_away(self) -> None:
        """Hear of requests no more: every frame that a WebSocket brings is one, with all its bytes,
        and Chromium keeps what nobody takes.
        """
        self._ask("Network.disable")

    def arrives(self, end: str) -> None:
        """Wait until the tab is at an address that ends so: one page may lead to the next by itself."""

        def is_there() -> bool:
            with suppress(RuntimeError):  # the page has gone while it was asked
                return str(self.evaluate("location.pathname")).endswith(end)
            return False

        _wait_until(is_there, self._process)

    def resize(self, width: int, height: int = 900) -> None:
        """Give the window another size, in pixels of the page."""
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False},
        )

    def picture(self) -> bytes:
        """What the window shows, as a PNG file."""
        return base64.b64decode(self._ask("Page.captureScreenshot")["data"])

    def scheme(self, name: str) -> None:
        """Ask pages for their ``light`` or ``dark`` colours."""
        features = [{"name": "prefers-color-scheme", "value": name}]
        self._ask("Emulation.setEmulatedMedia", {"features": features})

    def press(self, key: str, up: bool = True) -> None:
        """Press a key, by its name in JavaScript, and let it go again, or not."""
        code = {"Tab": 9, "Enter": 13, " ": 32, "ArrowRight": 39}.get(key, ord(key[0].upper()))
        about: dict[str, Any] = {"key": key, "windowsVirtualKeyCode": code}
        text = {"text": {"Enter": "\r"}.get(key, key)} if len(key) == 1 or key == "Enter" else {}
        self._ask("Input.dispatchKeyEvent", {"type": "keyDown", **about, **text})
        if up:
            self.let_go(key)

    def let_go(self, key: str) -> None:
        """Let a key go."""
        self._ask("Input.dispatchKeyEvent", {"type": "keyUp", "key": key})

    def click(self, selector: str) -> None:
        """Click the middle of an element with the mouse, wherever on the page it is."""
        u, v = self.middle(selector)
        self._mouse("mousePressed", u, v)
        self._mouse("mouseReleased", u, v)

    def drag(self, selector: str, right: float, down: float) -> None:
        """Drag from the middle of an element by so many pixels, in ten steps."""
        u, v = self.middle(selector)
        self._mouse("mousePressed", u, v)
        for k in range(1, 11):
            self._mouse("mouseMoved", u + right * k / 10, v + down * k / 10)
        self._mouse("mouseReleased", u + right, v + down)

    def touch(self, kind: str, *place: float, time_s: float | None = None) -> None:
        """A finger's ``touchStart``, ``touchMove`` or ``touchEnd``, at a place of the window, at a time
        in s since 1970, or now.
        """
        points = [{"x": place[0], "y": place[1]}] if place else []
        when = {} if time_s is None else {"timestamp": time_s}
        self._ask("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points, **when})

    def middle(self, selector: str) -> tuple[float, float]:
        """The middle of an element, which is brought into the window."""
        place = self.evaluate(
            "(one => { one.scrollIntoView({block: 'center', behavior: 'instant'});"
            " const b = one.getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2]; })"
            f"(document.querySelector({json.dumps(selector)}))"
        )
        return float(place[0]), float(place[1])

    def _mouse(self, kind: str, u: float, v: float) -> None:
        about = {"x": u, "y": v, "button": "left", "buttons": 1, "clickCount": 1}
        self._ask("Input.dispatchMouseEvent", {"type": kind, **about})

    def evaluate(self, expression: str) -> Any:
        """The value of an expression of JavaScript in the page; a promise is waited for."""
        answer = self._ask(
            "Runtime.evaluate",
            {"expression": expression, "awaitPromise": True, "returnByValue": True},
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(json.dumps(answer["exceptionDetails"])[:500])
        return answer["result"].get("value")

    def picture_of(self, element: str) -> str:
        """What an element, an expression of JavaScript, shows: a PNG in base64, twice as fine as the
        window.
        """
        clip = self.evaluate(
            f"(one => {{ one.scrollIntoView({{block: 'center', behavior: 'instant'}});"
            " const b = one.getBoundingClientRect();"
            " return {x: b.x + scrollX, y: b.y + scrollY, width: b.width, height: b.height, scale: 2};"
            f" }})({element})"
        )
        return str(self._ask("Page.captureScreenshot", {"format": "png", "clip": clip})["data"])

    def print(self, **settings: Any) -> str:
        """The page as a PDF in base64, with the settings of `Page.printToPDF`."""
        return str(self._ask("Page.printToPDF", settings)["data"])

    def close(self) -> None:
        """End the process."""
        self._socket.close()
        self._process.kill()
        self._process.wait()

    def _ask(self, method: str, parameters: dict[str, Any] | None = None) -> dict[str, Any]:
        number = next(self._numbers)
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters or {}}
        if self._session is not None:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv())
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        """Keep what is an error among the events that come by themselves."""
        about = event.get("params", {})
        match event.get("method"):
            case "Runtime.exceptionThrown":
                self._fail(json.dumps(about["exceptionDetails"])[:300])
            case "Runtime.consoleAPICalled" if about["type"] in ("error", "assert"):
                self._fail(f"console: {json.dumps(about['args'])[:300]}")
            case "Log.entryAdded" if about["entry"]["level"] == "error":
                self._fail(f"{about['entry']['text']} {about['entry'].get('url', '')}")
            case "Network.requestWillBeSent":
                self._addresses[about["requestId"]] = about["request"]["url"]
            case "Network.loadingFailed" if not about.get("canceled"):
                address = self._addresses.get(about["requestId"], "")
                self._fail(f"{about['errorText']} {address}")

    def _fail(self, what: str) -> None:
        """The theme preloads its icons' fonts in a way that a browser refuses for pages read from
        files; they come all the same, by the style sheet.
        """
        if "webfonts/fa-" not in what:
            self.errors.append(what)
