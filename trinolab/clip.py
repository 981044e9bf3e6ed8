"""A short recording folder in memory: every camera's images, the empty scene and the truth."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from .camera import Rig
from .checks import Array, frozen
from .greyimage import read_grey
from .handle import Handle, read_handle
from .posetable import poses_by_frame, read_poses
from .recording import find_footage, instants, open_recording
from .rigfile import read_rig


class Clip(NamedTuple):
    """What the cameras of a rig took together, and the truth.

    Attributes
    ----------
    rig : Rig
    handle : Handle
    times_s : ndarray, shape (n,)
    films : tuple of tuples of ndarray, shape (height, width)
        The n images of each camera.
    empty : tuple of ndarray
        Each camera's image of the empty scene.
    truths : tuple of RigidTransform or None
        T_world_handle at each instant; None where there is no handle.
    """

    rig: Rig
    handle: Handle
    times_s: Array
    films: tuple[tuple[np.ndarray, ...], ...]
    empty: tuple[np.ndarray, ...]
    truths: tuple[RigidTransform | None, ...]


def read_clip(folder: str | Path) -> Clip:
    """Read a recording folder with timestamps, backgrounds and truth; 4 MB an instant of three cameras.

    Raises
    ------
    ValueError
        Names the file that is missing or cannot be read.
    """
    root, said = Path(folder), set[str]()
    rig = read_rig(root / "rig.toml")
    recorded = open_recording(find_footage(root, rig), rig, timestamps=root / "timestamps.csv")
    now = list(instants(recorded))
    empty = tuple(read_grey(root / "background" / f"{camera.name}.png", camera.size, said) for camera in rig.cameras)
    known = poses_by_frame(read_poses(root / "truth.csv"))
    times, films = [one.t_s for one in now], tuple(zip(*(one.images for one in now), strict=True))
    return Clip(rig, read_handle(root / "handle.toml"), frozen(np.array(times)), films, empty,
                tuple(known.get(one.frame) for one in now))
