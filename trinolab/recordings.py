"""A recording as a caller names it: its folder, with another rig or handle in the place of its own."""

from __future__ import annotations

from pathlib import Path

from .camera import Rig
from .datasets import handle_of, rig_of
from .files.recording import Recording, open_folder
from .handle import Handle


def read_recording(
    folder: str | Path,
    rig: Rig | str | Path | None = None,
    handle: Handle | str | Path | None = None,
) -> tuple[Recording, Handle]:
    """Open a recording folder: its footage, with the timestamps if there are any, its rig and its
    handle.

    Parameters
    ----------
    folder : path
    rig, handle : optional
        In the place of the folder's ``rig.toml`` and ``handle.toml``: a `Rig` and a `Handle`, or files,
        or names of shipped ones, as ``raised_40deg`` and ``coded``. A rig may have some of the cameras.

    Raises
    ------
    ValueError
        For a word that names no rig or no handle, and as `files.recording.open_folder`.
    """
    return open_folder(
        folder,
        None if rig is None else rig_of(rig),
        None if handle is None else handle_of(handle),
    )
