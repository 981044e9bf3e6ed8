"""A sample of the hostile instants; `make verify` has the thousand."""

import numpy as np
import pytest
from hostile import KINDS, hostile, is_wrong
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import load_handle, load_rig
from trinolab.measurement import measure
from trinolab.parameters import Parameters
from trinolab.pose import Pose

RIG, CODED = load_rig("paper_pair"), load_handle("coded")


@pytest.mark.parametrize("kind", KINDS)
def test_no_wrong_pose_is_called_measured(kind):
    instant = hostile(np.random.default_rng(0), RIG, CODED, kind)
    pose = measure(instant.frames, RIG, CODED, parameters=Parameters(estimator="paper")).pose
    assert not is_wrong(pose, instant, CODED)


def test_wrong_is_off_by_2_mm_and_called_measured():
    instant = hostile(np.random.default_rng(0), RIG, CODED, "camera turned")
    for step, status, wrong in (
        (1.9, "measured", False),
        (2.1, "measured", True),
        (2.1, "ambiguous", False),
    ):
        moved = RigidTransform.from_translation([step, 0, 0]) * instant.truths[0]
        assert is_wrong(Pose(status, moved, np.eye(6), 0.1, 4, 2), instant, CODED) == wrong
