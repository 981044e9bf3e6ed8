"""The two standard recordings, rendered when they are asked for and kept in the user's cache."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .checks import as_whole
from .datasets import load_handle, load_rig
from .fetch import cache_folder
from .rendering import SECONDS, made_from, scripted, write_recording

try:
    import fcntl
except ImportError:  # a system without such locks
    fcntl = None  # type: ignore[assignment]


def standard_recording(name: str, seed: int = 0, seconds: float = SECONDS, rig_name: str = "raised_40deg",
                       handle_name: str = "coded", progress: bool = True) -> Path:
    """The folder of a standard recording, 30 frames a second; rendered, in a minute or two, if it is not there yet.

    A recording belongs to its name, seed, length, rig and handle, and to the code that renders it: whatever of these
    changes, it is rendered anew. The first seconds of a longer one are the same.

    Parameters
    ----------
    name : {"calm", "hard"}
        See `script`.
    seed : int
        Of motion and noise.
    seconds : float
        Length.
    rig_name, handle_name : str
        Of the shipped rigs and handles.
    progress : bool
        Show a progress bar on standard error, if that is a terminal.

    Raises
    ------
    ValueError
        If a name is unknown, the seed or the length is out of range, or the cache cannot be written.
    """
    job = scripted(name, load_rig(rig_name), load_handle(handle_name), as_whole(seed, "seed", 0, 2**63 - 1), seconds)
    manifest = made_from(job, name)
    key = hashlib.sha256(json.dumps(manifest).encode()).hexdigest()[:12]
    folder = recordings_folder() / f"{name}-{rig_name}-{handle_name}-{seed}-{key}"
    if not folder.is_dir():
        with _alone(folder):
            if not folder.is_dir():
                write_recording(job, folder, manifest, progress)
    return folder


def recordings_folder() -> Path:
    """Where standard recordings are kept: a folder of the user's cache, which may be removed at any time."""
    return cache_folder() / "recordings"


def clear_recordings() -> int:
    """Remove all standard recordings; the number of bytes that this frees."""
    files = [path for path in recordings_folder().rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files)
    shutil.rmtree(recordings_folder(), ignore_errors=True)
    return size


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process at a time render a recording; the others wait for it."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with folder.with_name(f"{folder.name}.lock").open("w") as lock:
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX)
            yield
    except OSError as error:
        raise ValueError(f"{folder.parent}: cannot be written ({error.strerror})") from None
