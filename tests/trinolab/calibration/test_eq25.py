"""Eq. 25 by hand and for many motions."""

import numpy as np
import pytest
from boards import motion
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration.eq25 import mean_relative_pose, relative_pose


def test_relative_pose():
    # the board 500 mm in front of the left camera; the right camera 100 mm to the right sees it 100
    # mm to the left
    T = relative_pose(motion([0, 0, 500]), motion([-100, 0, 500]))
    np.testing.assert_allclose(T.translation, [100, 0, 0], atol=1e-12)
    # the right camera sees the board 200 mm ahead, turned by -90 deg about y: R_rl = Ry(90), and
    # Ry(90) (0, 0, 200) is (200, 0, 0), so T_rl = (0, 0, 500) - (200, 0, 0)
    T = relative_pose(motion([0, 0, 500]), motion([0, 0, 200], [0, -np.pi / 2, 0]))
    np.testing.assert_allclose(T.translation, [-200, 0, 500], atol=1e-12)
    np.testing.assert_allclose(
        T.rotation.as_matrix(), [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-12
    )


VECTORS = arrays(float, (2, 3), elements=st.floats(-1e3, 1e3))


@pytest.mark.slow
@given(VECTORS, VECTORS, VECTORS, VECTORS, VECTORS)
def test_eq_25_carries_right_to_left(t_l, w_l, t_r, w_r, points):
    left, right = (
        RigidTransform.from_components(t, Rotation.from_rotvec(w / 300))
        for t, w in ((t_l, w_l), (t_r, w_r))
    )
    many = relative_pose(left, right)
    assert len(many) == 2
    for k, point in enumerate(points):
        T = relative_pose(left[k], right[k])
        # what both cameras see of one point of the target; lengths up to 5e3 mm leave rounding of
        # 1e-12 mm
        np.testing.assert_allclose(
            T.apply(right[k].apply(point)), left[k].apply(point), rtol=0, atol=1e-9
        )
        np.testing.assert_allclose(many[k].as_matrix(), T.as_matrix(), rtol=0, atol=1e-9)


def test_what_is_no_motion_or_of_another_length_is_refused():
    one = motion([0, 0, 1])
    four, five = (RigidTransform.concatenate([one] * n) for n in (4, 5))
    for left, right, says in (
        (one, np.eye(4), "T_right_target: expected a RigidTransform"),
        (Rotation.identity(), one, "T_left_target: expected a RigidTransform"),
        (four, five, r"T_right_target: expected shape \(4,\), got \(5,\)"),
        (one, one, "two or more positions, got 1"),
        (four[:1], four[:1], "two or more positions, got 1"),
    ):
        with pytest.raises(ValueError, match=says):
            mean_relative_pose(left, right)


def test_the_mean_of_two_positions_by_hand():
    """The right camera is seen at 100 and at 2 mm, turned about z by nothing and by 0.2 rad."""
    left = RigidTransform.concatenate(
        [motion([0, 0, 500]), motion([2, 0, 500]) * motion([0, 0, 0], [0, 0, 0.2])]
    )
    right = RigidTransform.concatenate([motion([-100, 0, 500]), motion([0, 0, 500])])
    mean = mean_relative_pose(left, right)
    np.testing.assert_allclose(mean.T_left_right.translation, [51, 0, 0], atol=1e-12)
    np.testing.assert_allclose(mean.T_left_right.rotation.as_rotvec(), [0, 0, 0.1], atol=1e-12)
    assert mean.positions == 2
    # the variance of two values is half of their difference squared, that of their mean a quarter
    off = np.array([98, 0, 0, 0, 0, -0.2])
    np.testing.assert_allclose(mean.covariance, np.outer(off, off) / 4, atol=1e-9)
