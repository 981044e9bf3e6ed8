"""Rigid motions, beside SciPy's, which computes them in another way."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import rigid

ANGLES = (0.0, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 2.0, 3.0, np.pi - 1e-5, np.pi - 1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_rotation_vectors_and_matrices_are_scipy_s(angle):
    rng = np.random.default_rng(1)
    for axis in [*np.eye(3), *-np.eye(3), *rng.standard_normal((50, 3))]:
        vector = angle * axis / np.linalg.norm(axis)
        theirs = Rotation.from_rotvec(vector)
        assert np.abs(rigid.rotation_matrix(vector) - theirs.as_matrix()).max() < 4e-15
        assert np.abs(rigid.rotation_vector(theirs.as_matrix()) - vector).max() < 4e-15
        w, *xyz = rigid.quaternion(theirs.as_matrix())
        assert np.abs(theirs.as_quat(canonical=True) - [*xyz, w]).max() < 4e-15


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_a_turn_has_one_of_its_two_axes(axis):
    R = Rotation.from_rotvec(np.pi * axis).as_matrix()
    assert np.abs(np.abs(rigid.rotation_vector(R)) - np.pi * axis).max() < 4e-15


def test_what_lies_between_two_poses_leads_from_one_to_the_other():
    rng = np.random.default_rng(1)
    for _ in range(50):
        turns = Rotation.random(2, rng=rng)
        a, b = RigidTransform.from_components(500 * rng.standard_normal((2, 3)), turns)
        again = rigid.shifted(b, rigid.motion_between(a, b))
        assert np.abs(again.as_matrix() - a.as_matrix()).max() < 1e-12
        theirs = (a.rotation * b.rotation.inv()).as_rotvec()
        assert np.abs(rigid.motion_between(a, b)[3:] - theirs).max() < 1e-14


@pytest.mark.parametrize(
    ("mm", "rad", "expected"),
    [(0.9, 0.09, False), (1.1, 0.0, True), (0.0, 0.11, True), (1.0, 0.0, False)],
)
def test_poses_are_apart_by_a_distance_or_an_angle(mm, rad, expected):
    a = RigidTransform.from_components([mm, 0, 0], Rotation.from_rotvec([0, 0, rad]))
    assert rigid.apart(a, RigidTransform.identity(), 1.0, 0.1) == expected


def test_a_placed_rotation_is_made_whole():
    R = Rotation.random(rng=np.random.default_rng(1)).as_matrix()
    found = rigid.rotation_of(rigid.placed(np.zeros(3), R + 1e-6 * np.arange(9).reshape(3, 3)))
    assert np.abs(found @ found.T - np.eye(3)).max() < 1e-9
    assert found == pytest.approx(R, abs=2e-5)


@given(arrays(float, 3, elements=st.floats(-3, 3)), arrays(float, 3, elements=st.floats(-1, 1)))
def test_left_jacobian(rotvec, change):
    J, step = rigid.left_jacobian(rotvec), 1e-6 * change
    turned = Rotation.from_rotvec(rotvec + step) * Rotation.from_rotvec(rotvec).inv()
    # second order of 2e-6
    np.testing.assert_allclose(turned.as_rotvec(), J @ step, rtol=0, atol=2e-11)
