"""What the live cameras show, kept as a recording folder that `track` and `teleop` read.

While it grows it is called NAME.partial, as all unfinished recordings are. Of each instant first the
images are written and then its time, a line at a time: whatever ends the process, the lines that
are there have their images, and the folder can be read as it is. Until it has its name no other
process writes into it.
"""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from threading import Thread

from trinolab.camera import Rig
from trinolab.files import recording_writer
from trinolab.files.journal import Journal
from trinolab.files.outputs import time_text
from trinolab.handle import Handle
from workbench.capture.capture import Writer, new_folder
from workbench.capture.devices import Taken

TIMES, CLUTCH = "timestamps.csv", "clutch.csv"


class Recorder:
    """Starts and stops recordings, one after the other.

    Parameters
    ----------
    folder : Path
        In which each gets a folder of its own, named after the time.
    rig : Rig
    handle : Handle

    Attributes
    ----------
    status : str
        How the recording stands, in words for the page.
    finished : Path or None
        The last recording that was written to its end.
    """

    def __init__(self, folder: Path, rig: Rig, handle: Handle) -> None:
        self.status = ""
        self.finished: Path | None = None
        self._folder = folder
        self._rig = rig
        self._handle = handle
        self.clock_now: _Running | None = None
        self._last: Thread | None = None

    @property
    def running(self) -> bool:
        """Whether a recording grows."""
        return self.clock_now is not None

    def start(self) -> None:
        """Begin a recording, if none grows; `status` says where, or why not."""
        if self.clock_now is not None:
            return
        out = self._folder / f"live-{datetime.now():%Y%m%d-%H%M%S}"
        try:
            self.clock_now = _Running(out, self._rig, self._handle)
        except ValueError as error:
            self.status = f"not recording: {error}"
        else:
            self.status = f"recording to {out}"

    def add(self, taken: Taken, clutch: bool) -> None:
        """Hand one more instant over, if a recording grows; an error ends the recording."""
        if self.clock_now is None:
            return
        self.clock_now.add(taken, clutch)
        if self.clock_now.writer.error is not None:
            self.stop()

    def stop(self) -> None:
        """End the recording; what waits to be written is written meanwhile."""
        if self.clock_now is None:
            return
        running, self.clock_now = self.clock_now, None
        self.status = f"writing the end of {running.out}"
        self._last = Thread(target=self._conclude, args=(running,))
        self._last.start()

    def close(self) -> None:
        """End the recording and wait until it is written."""
        self.stop()
        if self._last is not None:
            self._last.join()

    def _conclude(self, running: _Running) -> None:
        self.status = running.conclude()
        if running.out.is_dir():
            self.finished = running.out


class _Running:
    """A recording that grows."""

    def __init__(self, out: Path, rig: Rig, handle: Handle) -> None:
        self.out = out
        self._first_s: float | None = None
        self._clutch: bool | None = None
        self._rig = rig
        self.partial = recording_writer.partial_of(out)
        with ExitStack() as held:
            held.enter_context(new_folder(out, self.partial, rig, handle))
            try:
                self._open_files()
            except ValueError:
                shutil.rmtree(self.partial, ignore_errors=True)
                raise
            self._held = held.pop_all()
        self.writer = Writer(self.partial, rig.names, False, self._whole)

    def _open_files(self) -> None:
        with ExitStack() as opened:
            self._times, self._switch = (
                opened.enter_context(Journal(self.partial / name, head, lambda *_: True))
                for name, head in ((TIMES, "frame,t_s\n"), (CLUTCH, "t_s,closed\n"))
            )
            self._files = opened.pop_all()

    def add(self, taken: Taken, clutch: bool) -> None:
        self._first_s = taken.t_s if self._first_s is None else self._first_s
        t_s = taken.t_s - self._first_s
        if clutch != self._clutch and self.writer.error is None:
            self._clutch = clutch
            try:
                self._switch.add_line(f"{time_text(t_s)},{int(clutch)}")
            except ValueError as error:
                self.writer.error = error
        self.writer.offer(taken._replace(t_s=t_s))

    def conclude(self) -> str:
        """Write the rest, give the folder its name, and let others have it; say how it ended."""
        with self._held:
            return self._concluded()

    def _concluded(self) -> str:
        self.writer.close()
        count = len(self.writer.written)
        error = self.writer.error
        self._files.close()
        if not count:
            shutil.rmtree(self.partial, ignore_errors=True)
            return f"recording stopped: {error or 'nothing was taken'}"
        where = self.out
        try:
            for path in recording_writer.image_paths(self.partial, self._rig, count):
                path.unlink(missing_ok=True)  # of an instant whose time could not be written
            for name in (TIMES, CLUTCH):
                _drop_cut_off(self.partial / name)
            recording_writer.give_name(self.out)
        except (ValueError, OSError) as last:
            error = error or last
            where = self.partial
        late = f", {self.writer.dropped} dropped" if self.writer.dropped else ""
        if error is not None:
            return f"recording stopped: {error}; the {count} instants before are in {where}"
        return f"recorded {count} instants{late}: {where}"

    def _whole(self, taken: Taken) -> None:
        self._times.add_line(f"{len(self.writer.written)},{time_text(taken.t_s)}")


def _drop_cut_off(path: Path) -> None:
    """Shorten a file to its whole lines: on a full disk the last one may have been cut off."""
    text = path.read_bytes()
    with path.open("r+b") as file:
        file.truncate(text.rfind(b"\n") + 1)
