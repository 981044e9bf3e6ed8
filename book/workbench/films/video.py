"""Films: pictures written to a video file, and videos that a page of the book plays."""

from __future__ import annotations

import html
from base64 import b64encode
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np

from trinolab.files.images import unheard
from trinolab.files.journal import locked

CUT_OFF = "cannot be written as a whole (is the disk full?)"


class Film:
    """A VP8 video that takes its name when it is whole; a context manager.

    A picture is encoded when it is added, so that nobody waits for the film's end; VP9 as OpenCV
    sets it up takes ten times as long, most of it then.

    Raises
    ------
    ValueError
        If the video cannot be written, or not as a whole, or another process writes it.
    """

    def __init__(self, path: str | Path, fps: float) -> None:
        self.path = Path(path)
        self.fps = fps
        if self.path.suffix.lower() != ".webm":
            raise ValueError(f"{path}: expected a name that ends in .webm")
        self._partial = self.path.with_name(f".{self.path.stem}.partial{self.path.suffix}")
        self._writer: cv2.VideoWriter | None = None
        self._mine = ExitStack()

    def __enter__(self) -> Film:
        try:
            self._mine.enter_context(locked(self._partial))
        except ValueError as error:
            raise ValueError(str(error).replace(str(self._partial), str(self.path))) from None
        return self

    def add(self, image: np.ndarray) -> None:
        """One more picture, (height, width, 3); all of one size."""
        if self._writer is None:
            code = cv2.VideoWriter.fourcc(*"VP80")
            with unheard():  # OpenCV finds the codec's name unusual
                self._writer = cv2.VideoWriter(
                    str(self._partial), code, self.fps, (image.shape[1], image.shape[0])
                )
            if not self._writer.isOpened():
                raise ValueError(f"{self.path}: cannot be written as a VP8 video")
        with unheard() as complaints:
            self._writer.write(image)
            complaints.seek(0)
            if b"Failed to write" in complaints.read():
                raise ValueError(f"{self.path}: {CUT_OFF}")

    def __exit__(self, kind: object, *_: object) -> None:
        with self._mine:
            if self._writer is not None:
                self._writer.release()
            good = self._writer is not None and kind is None
            if good and _is_whole(self._partial):
                self._partial.replace(self.path)
                return
            self._partial.unlink(missing_ok=True)
            if good:
                raise ValueError(f"{self.path}: {CUT_OFF}")


def _is_whole(path: Path) -> bool:
    """Whether a WebM file is as long as it says; a writer on a full disk goes on without a word."""
    with path.open("rb") as file:
        head = file.read(256)
    begin = head.find(b"\x18\x53\x80\x67") + 12  # the segment's name and its length, 4 and 8 bytes
    length = int.from_bytes(head[begin - 8 : begin]) & (1 << 56) - 1
    return begin > 11 and begin + length == path.stat().st_size


class PageVideo:
    """A film for a notebook: it holds all of itself, so that the page plays it without a network.

    Where a page cannot play it, as in a PDF, the still stands there.

    Parameters
    ----------
    path : path
        A .webm video.
    text : str
        What it shows, for readers who do not see it.
    still : ndarray, shape (height, width, 3)
        One of its pictures.
    """

    def __init__(self, path: str | Path, text: str, still: np.ndarray) -> None:
        self.data = Path(path).read_bytes()
        self.text = text
        self.still = still

    def _repr_mimebundle_(self, **_: object) -> dict[str, str]:
        data = b64encode(self.data).decode()
        png = b64encode(cv2.imencode(".png", self.still)[1].tobytes()).decode()
        page = (
            f'<video controls muted loop playsinline style="width: 100%" aria-label="{html.escape(self.text)}">'
            f'<source type="video/webm" src="data:video/webm;base64,{data}">{html.escape(self.text)}</video>'
        )
        return {"text/html": page, "image/png": png, "text/plain": self.text}
