"""The rows of a track that are finished, in a file beside its pose file: an interruption loses none of them."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

import pandas as pd

from ..pose import Pose
from .outputs import check_target, write_whole
from .poses import POSE_COLUMNS, STATUSES, pose_row

PARTIAL = ".partial"  # behind the name of a pose file that is not finished


class Rows:
    """The finished rows of a track, in a file that grows; those of the same track interrupted are taken up.

    Its first line names the track. A row that was cut off, or is damaged, is dropped with all behind it.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path, self._head = path, f"# trinolab track {fingerprint}\n{','.join(POSE_COLUMNS)}\n"
        check_target(path)
        write_whole(path, self._head + "".join(f"{line}\n" for line in self._whole()))

    def add(self, frame: int, t_s: float, pose: Pose) -> None:
        """One more row; it is with the system when this returns. Raises ValueError if it cannot be written."""
        cells = (f"{cell:.9g}" if isinstance(cell, float) else str(cell) for cell in pose_row(frame, t_s, pose))
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(",".join("" if cell == "nan" else cell for cell in cells) + "\n")
        except OSError as error:
            raise ValueError(f"{self.path}: cannot be written ({error.strerror})") from None

    def table(self) -> pd.DataFrame:
        """The rows so far."""
        return pd.read_csv(io.StringIO("\n".join([",".join(POSE_COLUMNS), *self._whole()])))

    def kept(self) -> int:
        """How many rows are kept, where the track has stopped; of none there is no file."""
        if not (count := len(self._whole())):
            self.path.unlink(missing_ok=True)
        return count

    def _whole(self) -> list[str]:
        """The lines of the rows that are whole, from the first frame on."""
        text = self.path.read_text(encoding="utf-8", errors="replace") if self.path.exists() else ""
        if not text.startswith(self._head):
            return []
        lines = text[len(self._head):].split("\n")[:-1]  # behind the last one there is nothing, or a row cut off
        return [line for _, line in takewhile(_is_row, enumerate(lines))]


def fingerprint(files: Sequence[str | Path], sources: Mapping[str, str | Path], *options: Any) -> str:
    """What tells one track from another: the contents of its files, its footage as it lies there, its options."""
    contents = [hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in files]
    where = {name: [str(Path(path).resolve()), _stamp(Path(path))] for name, path in sources.items()}
    return hashlib.sha256(json.dumps([contents, where, [str(o) for o in options]]).encode()).hexdigest()[:16]


def _stamp(path: Path) -> list[tuple[str, int, int]]:
    """Names, sizes and times of a video, or of a folder's images."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return [(file.name, (about := file.stat()).st_size, about.st_mtime_ns) for file in files]


def _is_row(numbered: tuple[int, str]) -> bool:
    """Whether a line is the row of its frame."""
    frame, cells = numbered[0], numbered[1].split(",")
    try:
        numbers = [float(cell) for cell in cells[:-1] if cell]
    except ValueError:
        return False
    return len(cells) == len(POSE_COLUMNS) and cells[-1] in STATUSES and bool(numbers) and cells[0] == str(frame)
