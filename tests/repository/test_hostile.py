"""A sample of the hostile instants; `make verify` has the thousand."""

import numpy as np
import pytest
from hostile import KINDS, hostile, is_wrong
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import load_handle, load_rig
from trinolab.measurement import measure
from trinolab.parameters import Parameters
from trinolab.pose import LOST, Pose

RIG, CODED = load_rig("paper_pair"), load_handle("coded")


@pytest.mark.parametrize("kind", KINDS)
def test_no_wrong_pose_is_called_measured(kind):
    instant = hostile(np.random.default_rng(0), RIG, CODED, kind)
    pose = measure(instant.frames, RIG, CODED, parameters=Parameters(estimator="paper")).pose
    assert not is_wrong(pose, instant, CODED)


def test_wrong_is_off_by_2_mm_or_5_deg():
    instant = hostile(np.random.default_rng(0), RIG, CODED, "camera turned")
    T = instant.truths[0]
    for step, wrong in (([1.9, 0, 0], False), ([0, 2.1, 0], True)):
        moved = RigidTransform.from_translation(step) * T
        assert is_wrong(Pose("measured", moved, np.eye(6), 0.1, 4, 2), instant, CODED) == wrong
        assert not is_wrong(Pose("ambiguous", moved, np.eye(6), 0.1, 4, 2), instant, CODED)
    assert not is_wrong(LOST, instant, CODED)
    nothing = instant._replace(truths=[])
    assert is_wrong(Pose("measured", T, np.eye(6), 0.1, 4, 2), nothing, CODED)
