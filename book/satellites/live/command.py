"""What `trinolab live` does: a source, a loop, an arm, and a page, until Ctrl-C."""

from __future__ import annotations

import asyncio
import html
import os
import secrets
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import cv2

from trinolab.camera import Rig
from trinolab.checks import as_number, as_whole
from trinolab.datasets import data_path, handle_file, rig_file
from trinolab.files.recording import VIDEO_SUFFIXES, open_folder, open_recording
from trinolab.files.rigs import read_camera, read_handle, read_rig
from trinolab.handle import Handle
from trinolab.methods import DEFAULT, estimator_of
from trinolab.slave.arm import load_robot
from trinolab.slave.mapping import MappingParameters, alignment
from workbench.teleop.session import Session

from . import sources
from .loop import NO_FRAME_S, SILENCE_S, Loop
from .pointing import Pointing
from .recorder import Recorder
from .sources import Source

TICK_S = 0.008  # from one command to the arm to the next: 125 per second, as a UR5 takes them
LONGEST_S = 0.25  # that the arm catches up, or a busy computer would fall behind ever more
SIMULATED_STALE_S = 1.0  # a busy computer draws few images per second, and no hand is in danger
LOG = "pointing.csv"
REDIRECT = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>trinolab live</title>
<meta http-equiv="refresh" content="0; url={0}"></head>
<body><p><a href="{0}">The page of trinolab live</a></p></body></html>
"""
SWITCH_S = 0.0005  # threads change places so often: the arm's steps give theirs away each time


def live(
    source: Source,
    out: str | Path = ".",
    robot: str | Path = "ur5",
    method: str = DEFAULT,
    host: str = "127.0.0.1",
    port: int = 0,
    silence_s: float = SILENCE_S,
    log: str | Path | None = None,
    on_open: Callable[[str], None] = print,
) -> str:
    """Run the live system with its page until Ctrl-C.

    Parameters
    ----------
    source : Source
        See `chosen`.
    out : path
        A folder, for recordings.
    robot : str or path
        See `arm.load_robot`.
    method : str
        The estimator, see `methods.METHODS`.
    host : str
        Address of this computer at which the page is; with another one than the loopback address
        whoever knows the token gets in from outside.
    port : int
        0 for any that is free.
    silence_s : float
        So long may the page be silent while the clutch is closed.
    log : path, optional
        Of the pointing task; `LOG` in the folder `out` without it. Rows are added to those that
        are there.
    on_open : callable
        Gets the page's address.

    Returns
    -------
    str
        What is to be said of the last recording.

    Raises
    ------
    ValueError
        Names the argument that cannot be used, or says why the loop has ended.
    """
    try:
        from .server import serve
    except ImportError:
        raise ValueError("the live page needs the package tornado (extra 'live')") from None
    if not Path(out).is_dir():
        raise ValueError(f"{out}: no such folder to write recordings into")
    as_whole(port, "port", 0, 65535)
    as_number(silence_s, "silence_s", 0.0, open_low=True)
    estimator = estimator_of(method)
    view = read_camera(data_path("robots", "ur5_view.toml"))
    mapping = MappingParameters(
        alignment=alignment(view), stale_s=NO_FRAME_S if source.hand is None else SIMULATED_STALE_S
    )
    session = Session(load_robot(robot), mapping, tick_s=TICK_S, longest_s=LONGEST_S)
    recorder = Recorder(Path(out), source.rig, source.handle)
    pointing = Pointing(Path(out) / LOG if log is None else Path(log), mapping.alignment)
    loop = Loop(source, session, recorder, pointing, estimator, silence_s)
    if source.hand is not None:
        loop.demonstrate()
    sys.setswitchinterval(SWITCH_S)
    cv2.setNumThreads(1)  # the threads are those of the feeds
    with source:
        loop.start()
        try:
            asyncio.run(serve(loop, secrets.token_urlsafe(16), host, port, on_open))
        finally:
            loop.close()
    if loop.failed is not None:
        raise ValueError(f"{loop.failed}; {recorder.status}".removesuffix("; "))
    return recorder.status


def chosen(
    cameras: Mapping[str, str] | None = None,
    recording: str | Path | None = None,
    rig: str | Path | None = None,
    handle: str | Path | None = None,
    fps: float | None = None,
    seed: int = 0,
) -> Source:
    """The source: cameras or videos by their names, a recording folder, else the simulated bench.

    Raises
    ------
    ValueError
        For cameras without a rig or a handle, or that are not the rig's; cameras beside videos; a
        file or a camera that cannot be opened.
    """
    if recording is not None:
        return sources.of_recording(*open_folder(recording, rig, handle))
    if not cameras:
        return sources.of_bench(
            read_rig(rig or rig_file("raised_40deg")),
            read_handle(handle or handle_file("coded")),
            as_whole(seed, "seed", low=0),
        )
    if rig is None or handle is None:
        raise ValueError("cameras: need --rig and --handle")
    return _of_cameras(dict(cameras), read_rig(rig), read_handle(handle), fps)


def _of_cameras(cameras: dict[str, str], rig: Rig, handle: Handle, fps: float | None) -> Source:
    videos = [what.lower().endswith(VIDEO_SUFFIXES) for what in cameras.values()]
    if all(videos):
        return sources.of_recording(open_recording(cameras, rig, fps), handle)
    if any(videos):
        raise ValueError("cameras: expected cameras or videos, got both")
    if missing := [name for name in rig.names if name not in cameras]:
        raise ValueError(f"{missing[0]}: this camera of the rig is not named")
    if unknown := [name for name in cameras if name not in rig.names]:
        raise ValueError(f"{unknown[0]}: a camera that the rig does not have")
    return sources.of_cameras(cameras, rig, handle, fps)


@contextmanager
def show(address: str) -> Iterator[None]:
    """Open the page in the person's browser, where there is one.

    The browser is told of a file that leads there, and that nobody else may read: what stands in the
    command line of a process can be read by all users of the computer. The file is removed at the end
    of the block.
    """
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        yield
        return
    # made for its owner alone, mode 0600
    handle, name = tempfile.mkstemp(prefix="trinolab-", suffix="-open.html")
    try:
        with open(handle, "w", encoding="utf-8") as file:
            file.write(REDIRECT.format(html.escape(address)))
        webbrowser.open(Path(name).as_uri())
        yield
    finally:
        Path(name).unlink(missing_ok=True)
