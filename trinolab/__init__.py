"""A master handle watched by three cameras, from the frames to the slave arm.

Read `measurement` first and then `tracker`: these two files are the paper. The names below are in
`trinolab` itself, in the order of the data; the second column has the paper's equations.

====================  ===========  =============================================================
name                  equations    what it is
====================  ===========  =============================================================
`Camera`              Eq. 19       a pinhole camera with its lens and its place
`Rig`                              the cameras that watch together
`Handle`                           the rod and its markers
`load_rig`                         a shipped rig by its name
`load_handle`                      a shipped handle by its name
`read_rig`                         a rig file
`read_handle`                      a handle file
`write_rig`                        a rig to a file that the commands read
`write_handle`                     a handle to such a file
`intersect`           Eq. 1-4      the cameras' common field of view
`Target`                           a target that calibrates cameras
`calibrate`           Eq. 25       images of a target to a rig file
`render`                           a recording with its truth, from the simulated bench
`read_recording`                   a recording folder: its footage and its handle
`Parameters`                       the parameters of a measurement, stage by stage
`background`          Eq. 5-6      the moving pixels: `difference` (5) and `update` (6)
`kalman`              Eq. 7-15     the filter: `predict` (9, 10), `update` (13-15), `gate`
`find_markers`        Eq. 16       the markers in an image
`match`               Eq. 17-18    the same marker in two images
`triangulate`         Eq. 19-22    matches to points
`rigid_fit`           Eq. 23-24    points to a pose
`measure`             Eq. 16-24    the frames of one instant to a pose
`tracker`             Eq. 5-24     instant after instant: `start` and `step`
`track`                            a recording folder to a file of poses
`refine`                           a recording of the moving handle to a better rig and handle
`mapping`             Sect. 3.1    the hand's motion to the tool's: `step`
`pose_errors`         Eq. 26-27    poses and their truth to errors
`read_poses`                       a file of poses
`evaluate`            Eq. 26-27    poses and their truth, files or tables, to errors
`sweep`                            a notebook or a function at many settings
====================  ===========  =============================================================

A rig or a handle is given as a value, as its file, or by the name of a shipped one:
``trinolab.measure(frames, "raised_40deg", "coded")``. `measure`, `track` and the commands use the
estimator ``best`` unless another one is named, as in ``Parameters(estimator="paper")``; `tracker`
uses the paper's.

``trinolab eq 18`` names the function that implements an equation, its file and line, the test that
checks it and the chapter that derives it.

Lengths are millimetres, times seconds, angles radians; names that end in ``_deg`` are degrees.
Rigid motions are named ``T_target_source``, so that neighbours cancel: ``T_world_handle =
T_world_cam * T_cam_handle``.

A caller's mistake raises a ``ValueError`` whose one line names the argument, what was expected and
what was given: a wrong shape or type, lengths that differ, NaN where nothing may be missing, a
number outside the documented range or beyond any bench (`checks.LARGEST`). A docstring lists
further errors.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import background as background
    from . import kalman as kalman
    from . import tracker as tracker
    from .bench.rendering import render as render
    from .calibration.calibrate import calibrate_rig as calibrate  # noqa: F401
    from .calibration.target import Target as Target
    from .camera import Camera as Camera
    from .camera import Rig as Rig
    from .datasets import load_handle as load_handle
    from .datasets import load_rig as load_rig
    from .evaluation import evaluate as evaluate
    from .files.poses import read_poses as read_poses
    from .files.recording import open_folder as read_recording  # noqa: F401
    from .files.rigs import read_handle as read_handle
    from .files.rigs import read_rig as read_rig
    from .files.rigs import write_handle as write_handle
    from .files.rigs import write_rig as write_rig
    from .following.refine import refine_folder as refine  # noqa: F401
    from .following.track import track_folder as track  # noqa: F401
    from .handle import Handle as Handle
    from .markers import find_markers as find_markers
    from .matching import match as match
    from .measurement import measure as measure
    from .metrics import pose_errors as pose_errors
    from .parameters import Parameters as Parameters
    from .pose import rigid_fit as rigid_fit
    from .slave import mapping as mapping
    from .triangulation import triangulate as triangulate
    from .workspace.intersection import intersect as intersect

__version__ = "0.2.0"

# `files.limits.PIXELS`. OpenCV asks when it is loaded, and nothing above loads it.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", "50000000")

# Where each name of the face is defined, as module:attribute: it is loaded when it is asked for. No
# module may be called like the function of another one, because Python would put the module in the
# function's place as soon as anything loads it.
FACE = {
    "Camera": "trinolab.camera:Camera",
    "Rig": "trinolab.camera:Rig",
    "Handle": "trinolab.handle:Handle",
    "load_rig": "trinolab.datasets:load_rig",
    "load_handle": "trinolab.datasets:load_handle",
    "read_rig": "trinolab.files.rigs:read_rig",
    "read_handle": "trinolab.files.rigs:read_handle",
    "write_rig": "trinolab.files.rigs:write_rig",
    "write_handle": "trinolab.files.rigs:write_handle",
    "intersect": "trinolab.workspace.intersection:intersect",
    "Target": "trinolab.calibration.target:Target",
    "calibrate": "trinolab.calibration.calibrate:calibrate_rig",
    "render": "trinolab.bench.rendering:render",
    "read_recording": "trinolab.files.recording:open_folder",
    "Parameters": "trinolab.parameters:Parameters",
    "background": "trinolab.background",
    "kalman": "trinolab.kalman",
    "find_markers": "trinolab.markers:find_markers",
    "match": "trinolab.matching:match",
    "triangulate": "trinolab.triangulation:triangulate",
    "rigid_fit": "trinolab.pose:rigid_fit",
    "measure": "trinolab.measurement:measure",
    "tracker": "trinolab.tracker",
    "track": "trinolab.following.track:track_folder",
    "refine": "trinolab.following.refine:refine_folder",
    "mapping": "trinolab.slave.mapping",
    "pose_errors": "trinolab.metrics:pose_errors",
    "read_poses": "trinolab.files.poses:read_poses",
    "evaluate": "trinolab.evaluation:evaluate",
    "sweep": "workbench.sweep",
}
__all__ = list(FACE)


def __getattr__(name: str) -> Any:
    if name not in FACE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, _, attribute = FACE[name].partition(":")
    loaded = import_module(module)
    return getattr(loaded, attribute) if attribute else loaded


def __dir__() -> list[str]:
    return sorted({*globals(), *FACE})
