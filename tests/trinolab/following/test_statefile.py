"""The tracker's state as a text, and back."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import CAMERA_PARAMETERS, Rig, RigCovariance, displaced
from trinolab.datasets import load_rig
from trinolab.following import posefilter
from trinolab.following.posetracker import TrackState
from trinolab.following.statefile import state_of, text_of

RIG = load_rig("raised_40deg")
POSE = RigidTransform.from_components([3.0, -2.0, 560.0], Rotation.from_rotvec([0.3, -1.0, 2.0]))


def a_state():
    """A state of which nothing is zero."""
    rng = np.random.default_rng(0)
    n = len(CAMERA_PARAMETERS) * len(RIG.cameras)
    parts = rng.normal(size=(n, n))
    known = RigCovariance(RIG.names, 1e-6 * parts @ parts.T)
    rig = Rig(displaced(RIG, 1e-3 * rng.normal(size=n)).cameras, known)
    p = posefilter.PoseFilterParameters()
    seen = posefilter.begin(0.1, POSE, np.diag(rng.uniform(1, 2, 6)), p)
    motion = posefilter.predict(seen._replace(rates=rng.normal(size=12)), 0.15, p)
    return TrackState(0.15, motion, seen, True, rig, rng.normal(size=(6, 6)), True, 4)


def numbers(state):
    """All that a state says, as one list of numbers."""
    parts = [state.t_s, state.sure, state.blurred, state.cursor, *np.ravel(state.systematic)]
    for motion in (state.motion, state.seen):
        parts += [motion.t_s, *motion.rates, *motion.covariance.ravel()]
        parts += motion.pose.as_matrix().ravel().tolist()
    for camera in state.rig.cameras:
        parts += [*camera.matrix.ravel(), *camera.distortions]
        parts += camera.T_cam_world.as_matrix().ravel().tolist()
    return np.array([*parts, *state.rig.covariance.matrix.ravel()], float)


def test_a_state_comes_back_from_its_text():
    state = a_state()
    back = state_of(text_of(state, RIG), RIG)
    np.testing.assert_allclose(numbers(back), numbers(state), rtol=1e-14, atol=1e-14)
    assert back.rig.names == RIG.names


def test_what_is_not_there_comes_back_as_well():
    state = TrackState(0.5, None, None, False)
    assert "rig" in (text := text_of(state, RIG))
    assert state_of(text, RIG)[:5] == (0.5, None, None, False, None)
    # the rig that is tracked with need not be written
    assert json.loads(text_of(state._replace(rig=RIG), RIG))["rig"] is None


def test_what_is_no_state_is_refused():
    content = json.loads(text_of(a_state(), RIG))
    wrong = [
        {**content, "systematic": [1.0]},
        {**content, "motion": {**content["motion"], "pose": [[0, 0, 0], [0, 0, 0, 0]]}},
        {**content, "motion": {**content["motion"], "covariance": "1"}},
        {**content, "rig": {**content["rig"], "cameras": content["rig"]["cameras"][:2]}},
        {**content, "t_s": None},
        [],
        3,
    ]
    for other in wrong:
        with pytest.raises(ValueError, match=r"."):
            state_of(json.dumps(other), RIG)
