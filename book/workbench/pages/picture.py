"""README's picture: the beginning of the built start page, with a frame of its film.

.venv/bin/python -m workbench.pages.picture

writes ``book/_static/start.webp`` after `make book`.
"""

from __future__ import annotations

import base64
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from .browser import Browser
from .figures import HTML, ROOT
from .printing import PREPARE

OUT = ROOT / "book" / "_static" / "start.webp"
WIDTH, HEIGHT = 1200, 815  # px
QUALITY = 60  # of WebP, in percent
# The page as high as its picture.
CUT = f"Object.assign(document.body.style, {{height: '{HEIGHT}px', overflow: 'hidden'}})"


def write_picture(page: Path, out: Path = OUT) -> None:
    """Write the first screen of a built page as WebP, its film halted in the middle."""
    with TemporaryDirectory() as profile:
        browser = Browser(Path(profile))
        browser.open(page.as_uri(), WIDTH, HEIGHT)
        browser.evaluate(f"{PREPARE}([])")
        browser.evaluate(CUT)
        shot = base64.b64decode(browser.picture_of("document.body"))
        browser.close()
    shown = np.asarray(cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR))
    shown = cv2.resize(shown, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    _, coded = cv2.imencode(".webp", shown, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    out.write_bytes(coded.tobytes())


if __name__ == "__main__":
    write_picture(HTML / "book" / "start.html")
