"""The tracker's state as a text, so that a track that was interrupted goes on as if it had not been.

A number is written with all its digits, but what is made of the text is not the state to the last
one: a quaternion is brought to length 1 again. Hence a track goes on with the state that its text says
wherever it keeps one, whether it is interrupted or not.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from ..camera import Camera, Rig, RigCovariance
from ..checks import Array, as_array, as_number, as_whole
from .posefilter import Motion
from .posetracker import TrackState


def text_of(state: TrackState, rig: Rig) -> str:
    """A state as one line of JSON; `rig` is the one that is tracked with."""
    measured_with = None if state.rig is None or state.rig is rig else _rig_numbers(state.rig)
    return json.dumps(
        {
            "t_s": state.t_s,
            "motion": _motion_numbers(state.motion),
            "seen": _motion_numbers(state.seen),
            "sure": state.sure,
            "rig": measured_with,
            "systematic": np.asarray(state.systematic).tolist(),
            "blurred": bool(state.blurred),
            "cursor": state.cursor,
        }
    )


def state_of(text: str, rig: Rig) -> TrackState:
    """The state that a text says. Raises ValueError if it says none, or that of another rig."""
    try:
        content = json.loads(text)
        return TrackState(
            as_number(content["t_s"], "t_s"),
            _motion(content["motion"]),
            _motion(content["seen"]),
            content["sure"] is True,
            None if content["rig"] is None else _rig(content["rig"], rig),
            _numbers(content["systematic"], (6, 6)),
            content["blurred"] is True,
            as_whole(content["cursor"], "cursor", low=0),
        )
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"no state of a track ({error})") from None


def _motion_numbers(motion: Motion | None) -> dict[str, Any] | None:
    if motion is None:
        return None
    return {
        "t_s": motion.t_s,
        "pose": _pose_numbers(motion.pose),
        "rates": motion.rates.tolist(),
        "covariance": motion.covariance.tolist(),
    }


def _motion(content: Mapping[str, Any] | None) -> Motion | None:
    if content is None:
        return None
    return Motion(
        as_number(content["t_s"], "t_s"),
        _pose(content["pose"]),
        _numbers(content["rates"], (12,)),
        _numbers(content["covariance"], (18, 18)),
    )


def _rig_numbers(rig: Rig) -> dict[str, Any]:
    """What a measurement makes of a rig: its cameras' numbers and what is left to know of them."""
    return {
        "cameras": [
            {
                "matrix": camera.matrix.tolist(),
                "distortions": camera.distortions.tolist(),
                "pose": _pose_numbers(camera.T_cam_world),
            }
            for camera in rig.cameras
        ],
        "covariance": None if rig.covariance is None else rig.covariance.matrix.tolist(),
    }


def _rig(content: Mapping[str, Any], rig: Rig) -> Rig:
    cameras = tuple(
        _camera(numbers, camera)
        for numbers, camera in zip(content["cameras"], rig.cameras, strict=True)
    )
    if content["covariance"] is None:
        return Rig(cameras)
    return Rig(cameras, RigCovariance(rig.names, content["covariance"]))


def _camera(content: Mapping[str, Any], camera: Camera) -> Camera:
    return replace(
        camera,
        matrix=content["matrix"],
        distortions=content["distortions"],
        T_cam_world=_pose(content["pose"]),
    )


def _pose_numbers(pose: RigidTransform) -> list[list[float]]:
    return [pose.translation.tolist(), pose.rotation.as_quat().tolist()]


def _pose(content: Any) -> RigidTransform:
    translation, quaternion = content
    turn = Rotation.from_quat(_numbers(quaternion, (4,)))
    return RigidTransform.from_components(_numbers(translation, (3,)), turn)


def _numbers(content: ArrayLike, shape: tuple[int, ...]) -> Array:
    """An array that may be written to, as those of the tracker."""
    return np.array(as_array(content, "state", shape, finite=False))
