"""What the page shows: the scene once, then for each frame numbers and small pictures in one message."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from scipy.special import chdtri

from trinolab.camera import Camera, Rig
from trinolab.files.poses import POSE_COLUMNS, pose_row
from trinolab.following.posetracker import Tracked
from trinolab.handle import Handle, on_cylinder
from trinolab.pose import Pose
from trinolab.slave.arm import Robot
from workbench.films.overlay import camera_view

from .loop import Shown
from .pointing import Doing
from .settings import SLIDERS
from .solids import shapes

WIDTH, QUALITY = 480, 80  # of a camera's picture, px, and of its JPEG
FIELD_MM = 620.0  # to which a camera's field of view is drawn
ELLIPSOID = math.sqrt(chdtri(3, 0.05))  # standard deviations that hold 95 % of three normal numbers
NUMBERS = (*POSE_COLUMNS[2:5], *POSE_COLUMNS[9:17])  # of a pose, for the page


def scene(rig: Rig, handle: Handle, robot: Robot) -> dict[str, Any]:
    """What does not change: the cameras' fields of view (world frame), the handle (its frame), the
    arm's shapes (those of their bodies), mm, and the sliders.
    """
    turns = 2 * np.pi * np.arange(25) / 24
    rings = [
        on_cylinder(handle.radius_mm, turns, end).tolist()
        for end in (handle.bottom_mm, handle.top_mm)
    ]
    return {
        "cameras": [
            {"name": camera.name, "size": camera.size, "field": _field(camera)}
            for camera in rig.cameras
        ],
        "handle": {
            "rings": rings,
            "markers": handle.marker_centres.tolist(),
            "radius": handle.radius_mm,
            "ends": [handle.bottom_mm, handle.top_mm],
            "disc": handle.marker_diameter_mm / 2,
            "bright": handle.markers == "bright",
        },
        "shapes": shapes(robot),
        "sliders": [slider._asdict() for slider in SLIDERS],
    }


def message(shown: Shown, rig: Rig, way: Mapping[str, float], simulated: bool) -> bytes:
    """A frame for the page: the length of a JSON text in four bytes, the text, and a JPEG a camera.

    Parameters
    ----------
    shown : Shown
    rig : Rig
    way : mapping of str to float
        Times of the last frame that the page has drawn, ms.
    simulated : bool
        Whether a hand can be moved.
    """
    pictures = (
        []
        if shown.frames is None
        else [
            _jpeg(_of_camera(image, camera, shown.tracked, c))
            for c, (camera, image) in enumerate(zip(rig.cameras, shown.frames.images, strict=True))
        ]
    )
    text = json.dumps(
        {
            **_numbers(shown),
            "way": way,
            "simulated": simulated,
            "pictures": list(map(len, pictures)),
        },
        allow_nan=False,
    ).encode()
    return b"".join([len(text).to_bytes(4), text, *pictures])


def _of_camera(image: np.ndarray, camera: Camera, tracked: Tracked | None, c: int) -> np.ndarray:
    """A camera's picture without its name, which the page writes over it in a size to be read."""
    return camera_view(image, camera, tracked, c, min(WIDTH, camera.size[0]), named=False)


def _numbers(shown: Shown) -> dict[str, Any]:
    """All that the page writes or draws by itself."""
    moment = shown.moment
    pose = None if shown.tracked is None else shown.tracked.measurement.pose
    T = None if pose is None else pose.T_world_handle
    row = {} if pose is None else dict(zip(POSE_COLUMNS, pose_row(0, 0.0, pose), strict=True))
    return {
        "number": shown.number,
        "status": "lost" if pose is None else pose.status,
        "pose": {name: _finite(row.get(name)) for name in NUMBERS},
        "T": None if T is None else np.round(T.as_matrix()[:3].ravel(), 5).tolist(),
        "ellipsoid": None if pose is None else ellipsoid(pose),
        "arm": shown.arm,
        "bodies": shown.bodies,
        "target": np.round(moment.state.target.translation, 2).tolist(),
        "force": _finite(np.linalg.norm(moment.reading.force)),
        "held": moment.state.held,
        "limits": list(moment.limits),
        "clutch": shown.clutch,
        "troubles": shown.troubles,
        "notes": shown.notes,
        "recording": shown.recording[0],
        "said": shown.recording[1],
        "folder": str(shown.finished or ""),
        "rate": round(shown.rate_hz, 1),
        "spread": 0.0 if shown.frames is None else round(1e3 * shown.frames.spread_s, 1),
        "tracker": shown.tracker,
        "values": shown.values,
        "task": None if shown.task is None else _listed(shown.task),
        "points": shown.task_status,
        "demonstration": shown.demonstration,
    }


def ellipsoid(pose: Pose) -> list[float] | None:
    """The matrix (3, 3), row by row, mm, by which the unit sphere becomes the ellipsoid about the
    position that holds 95 %; None where no covariance is known.
    """
    covariance = pose.covariance[:3, :3]
    if not np.isfinite(covariance).all():
        return None
    variances, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T
    return np.round(ELLIPSOID * root.ravel(), 5).tolist()


def _listed(task: Doing) -> dict[str, Any]:
    """What there is to do, for JSON."""
    return {
        name: np.round(value, 2).tolist() if isinstance(value, np.ndarray | tuple) else value
        for name, value in task._asdict().items()
    }


def _field(camera: Camera) -> list[list[float]]:
    """A camera's centre and the corners of what it sees at a depth, world frame, (5, 3), mm."""
    width, height = camera.size
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    xy = (corners - camera.principal_point) / camera.focal
    far = FIELD_MM * np.column_stack([xy, np.ones(4)])
    return camera.T_world_cam.apply(np.vstack([np.zeros(3), far])).tolist()


def _jpeg(view: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", view, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


def _finite(value: Any) -> float | None:
    """A number for JSON, which knows no NaN."""
    return None if value is None or not math.isfinite(value) else round(float(value), 4)
