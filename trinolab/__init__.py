"""trinolab: a master handle watched by three cameras, from the frames to the slave arm.

Lengths are millimetres, times seconds, angles radians; names that end in ``_deg`` are degrees.
Rigid motions are named ``T_target_source``, so that neighbours cancel: ``T_world_handle =
T_world_cam * T_cam_handle``.

What most users need has a name here: `measure` (frames to a pose), `track` (a recording to poses),
`evaluate` (poses and their truth to errors), `sweep.sweep` (a notebook or a function to a table),
and the readers of their files.

A mistake of the caller's is a ``ValueError`` in one line that names the argument, what was expected
and what came: a wrong shape or type, lengths that differ, NaN where nothing may be missing, a
number out of the range that is documented or beyond any bench (`checks.LARGEST`). A docstring says
what is raised beside that.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import sweep as sweep
    from .cli.evaluate import evaluate as evaluate
    from .datasets import load_handle as load_handle
    from .datasets import load_rig as load_rig
    from .files.poses import read_poses as read_poses
    from .files.rigs import read_handle as read_handle
    from .files.rigs import read_rig as read_rig
    from .following.track import track_folder as track  # noqa: F401
    from .measurement import measure as measure
    from .parameters import Parameters as Parameters

__version__ = "0.1.0"

# Where each name of the face is defined: it is loaded when it is asked for. No module may be called
# like one of them, because Python would put the module in the name's place as soon as anything
# loads it; `sweep` is the folder itself.
FACE = {
    "Parameters": "parameters.Parameters",
    "evaluate": "cli.evaluate.evaluate",
    "load_handle": "datasets.load_handle",
    "load_rig": "datasets.load_rig",
    "measure": "measurement.measure",
    "read_handle": "files.rigs.read_handle",
    "read_poses": "files.poses.read_poses",
    "read_rig": "files.rigs.read_rig",
    "sweep": "sweep",
    "track": "following.track.track_folder",
}
__all__ = list(FACE)


def __getattr__(name: str) -> Any:
    if name not in FACE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, attribute = FACE[name].rpartition(".")
    if not module:
        return import_module(f"{__name__}.{name}")
    return getattr(import_module(f"{__name__}.{module}"), attribute)


def __dir__() -> list[str]:
    return sorted({*globals(), *FACE})
