"""Eq. 25 by hand and by Monte Carlo."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration.eq25 import mean_relative_pose, relative_pose


def motion(translation, rotvec=(0, 0, 0)):
    return RigidTransform.from_components(
        translation, Rotation.from_rotvec(np.array(rotvec, float))
    )


def positions(count, seed=3):
    """Of a target before a camera."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (count, 3)))
    return RigidTransform.from_components(
        rng.uniform([-100, -80, 380], [0, 0, 480], (count, 3)), turns
    )


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


FINITE = st.floats(-1e3, 1e3)
VECTORS = arrays(float, 3, elements=FINITE)


@pytest.mark.slow
@given(VECTORS, VECTORS, VECTORS, VECTORS, VECTORS)
def test_eq_25_carries_right_to_left(t_l, w_l, t_r, w_r, point):
    T_l, T_r = motion(t_l, w_l / 300), motion(t_r, w_r / 300)
    T = relative_pose(T_l, T_r)
    # what both cameras see of one point of the target; lengths up to 5e3 mm leave rounding of 1e-12
    # mm
    np.testing.assert_allclose(T.apply(T_r.apply(point)), T_l.apply(point), rtol=0, atol=1e-9)
    back = relative_pose(T_r, T_l)
    np.testing.assert_allclose((T * back).as_matrix(), np.eye(4), rtol=0, atol=1e-9)


def test_relative_pose_of_many_is_each():
    left, right = positions(5), positions(5, seed=8)
    each = relative_pose(left, right)
    assert len(each) == 5
    np.testing.assert_allclose(
        each[3].as_matrix(), relative_pose(left[3], right[3]).as_matrix(), atol=1e-12
    )


@pytest.mark.parametrize("bad", [None, np.eye(4), Rotation.identity()])
def test_relative_pose_refuses_what_is_no_motion(bad):
    with pytest.raises(ValueError, match="T_right_target: expected a RigidTransform"):
        relative_pose(RigidTransform.identity(), bad)
    with pytest.raises(ValueError, match="T_left_target: expected a RigidTransform"):
        relative_pose(bad, RigidTransform.identity())


def test_relative_pose_refuses_other_lengths():
    with pytest.raises(ValueError, match=r"T_right_target: expected shape \(4,\), got \(5,\)"):
        relative_pose(positions(4), positions(5))
    with pytest.raises(ValueError, match="two or more positions, got 1"):
        mean_relative_pose(positions(1), positions(1))
    with pytest.raises(ValueError, match="two or more positions, got 1"):
        mean_relative_pose(motion([0, 0, 1]), motion([0, 0, 1]))


def test_the_mean_of_two_positions_by_hand():
    """The right camera is seen at 100 and at 102 mm: 101 mm, whose variance is half of 2 mm^2."""
    left = RigidTransform.concatenate([motion([0, 0, 500]), motion([2, 0, 500])])
    right = RigidTransform.concatenate([motion([-100, 0, 500])] * 2)
    mean = mean_relative_pose(left, right)
    np.testing.assert_allclose(mean.T_left_right.translation, [101, 0, 0], atol=1e-12)
    np.testing.assert_allclose(mean.covariance, np.diag([1.0, 0, 0, 0, 0, 0]), atol=1e-12)
    assert mean.positions == 2


@pytest.mark.heavy
def test_mean_and_its_uncertainty_by_monte_carlo():
    rng, truth, n = np.random.default_rng(0), motion([100, -3, 8], [0.01, 0.2, -0.02]), 14
    right, draws = positions(n), []
    for _ in range(300):
        noisy = [motion(rng.normal(0, 0.5, 3), rng.normal(0, 2e-3, 3)) * truth * T for T in right]
        draws.append(mean_relative_pose(RigidTransform.concatenate(noisy), right))
    assert draws[0].positions == n
    off = np.array(
        [
            np.concatenate(
                [
                    d.T_left_right.translation - truth.translation,
                    (d.T_left_right.rotation * truth.rotation.inv()).as_rotvec(),
                ]
            )
            for d in draws
        ]
    )
    reported = np.sqrt(np.mean([np.diag(d.covariance) for d in draws], axis=0))
    # a standard deviation from 300 draws is known to 4 %
    np.testing.assert_allclose(off.std(axis=0), reported, rtol=0.16)
    assert (np.abs(off.mean(axis=0)) < 4 * reported / np.sqrt(300)).all()
