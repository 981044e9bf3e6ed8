"""The misprints are really there: each is shown with what the paper prints."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trinolab.cones import Cone, cone_surface, inside
from trinolab.datasets import load_calibration, load_rig, load_table1, nearest_rotation
from trinolab.errata import printed_cones, printed_rotation_error, printed_workspace_volume
from trinolab.workspace import intersect


def printed(a, t, w, b1, b2, B):
    """Eq. 1 to 3, typed from the paper."""
    cot = 1 / np.tan(w)
    return ([a * np.sin(b1) * np.cos(t) - a * np.cos(b1) * cot, a * np.sin(t),
             a * np.cos(b1) * np.cos(t) + a * np.sin(b1) * cot],
            [a * np.sin(b2) * np.cos(t) + a * np.cos(b2) * cot + B, a * np.sin(t),
             -a * np.cos(b2) * np.cos(t) + a * np.sin(b2) * cot],
            [-a * cot + B / 2, a * np.sin(t) + B / np.sqrt(2), a * np.cos(t) + B / 2])


@pytest.mark.parametrize(("b1", "b2", "w"), [(45, 45, 20), (84.7, 84.9, 15.5), (30, 70, 40)])
def test_the_printed_formulas_lie_on_the_printed_cones(b1, b2, w):
    b1, b2, w, B = np.deg2rad(b1), np.deg2rad(b2), np.deg2rad(w), 99.19
    a, t = np.linspace(0.1, 50, 60), np.linspace(0, 7, 60)
    for cone, formula in zip(printed_cones(B, b1, b2, w), printed(a, t, w, b1, b2, B), strict=True):
        x = np.transpose(formula) - cone.apex
        angle = np.arctan2(np.linalg.norm(np.cross(x, cone.axis), axis=1), x @ cone.axis)
        np.testing.assert_allclose(angle, w, atol=1e-12)


def test_the_printed_axes():
    b1, b2 = np.deg2rad(60.0), np.deg2rad(50.0)
    one, two, three = printed_cones(1.0, b1, b2, 0.3)
    np.testing.assert_allclose(one.axis, [-np.cos(b1), 0, np.sin(b1)], atol=1e-15)
    np.testing.assert_allclose(two.axis, [np.cos(b2), 0, np.sin(b2)], atol=1e-15)
    np.testing.assert_allclose(three.axis, [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(three.apex, [0.5, np.sqrt(0.5), 0.5], atol=1e-15)


@pytest.mark.parametrize("degrees", range(10, 45))
def test_the_printed_workspace_is_empty(degrees):
    assert printed_workspace_volume(np.deg2rad(degrees)) == 0.0


@pytest.mark.parametrize("degrees", [10, 20, 30, 44])
def test_no_point_counts_as_inside_the_printed_workspace(degrees):
    # Independent of the cutting planes: points in a wide box and far around it.
    rng = np.random.default_rng(0)
    points = rng.normal(0, 1, (100_000, 3)) * rng.lognormal(0, 1.5, (100_000, 1))
    cones = printed_cones(1.0, np.pi / 4, np.pi / 4, np.deg2rad(degrees))
    for signs in itertools.product((1, -1), repeat=3):
        nappes = [Cone(c.apex, sign * c.axis, c.half_angle) for c, sign in zip(cones, signs, strict=True)]
        assert not inside(nappes, points).any()


def test_the_check_would_see_a_volume():
    # With a half angle over 45 deg the printed cones do meet somewhere, so "empty" is no property of the test.
    assert printed_workspace_volume(np.deg2rad(60)) > 0


def test_points_on_the_printed_surface_are_no_corrected_ones():
    one = printed_cones(1.0, np.pi / 4, np.pi / 4, 0.3)[0]
    assert cone_surface(one, [1.0], [0.0])[0, 0] < 0  # the printed CCD1 looks away from CCD2


def test_the_printed_rotation_is_none():
    frobenius, entry = printed_rotation_error()
    assert entry == pytest.approx(3.0e-4, abs=0.05e-4)
    assert frobenius > 1.5e-4  # the most that rounding nine entries to four decimals can do


def test_rounding_a_rotation_stays_below_the_bound():
    for rotation in Rotation.random(200, rng=np.random.default_rng(1)):
        rounded = rotation.as_matrix().round(4)
        assert np.linalg.norm(rounded - nearest_rotation(rounded).as_matrix()) <= 1.5e-4


def eq20(left, right, R, T):
    """Points of the left frame from normalised image coordinates (f = 1), by the first form of Eq. 20 as printed."""
    (X_l, Y_l), (X_r, _) = left.T, right.T
    z = (T[0] - X_r * T[2]) / (X_r * (R[2, 0] * X_l + R[2, 1] * Y_l + R[2, 2])
                               - (R[0, 0] * X_l + R[0, 1] * Y_l + R[0, 2]))
    return np.column_stack([z * X_l, z * Y_l, z])


@pytest.fixture
def seen():
    """Table 1's points, and their normalised coordinates in CCD1 and CCD2."""
    points = load_table1().set_poses.translation
    right = load_rig("paper_pair").cameras[1].T_cam_world.apply(points)
    return points, points[:, :2] / points[:, 2:], right[:, :2] / right[:, 2:]


def test_the_printed_rotation_moves_table1_along_z(seen):
    points, left, right = seen
    _, _, R_rl, T_rl = load_calibration()
    for inverse, shift in ((R_rl.T, -0.63), (np.linalg.inv(R_rl), 0.63)):
        moved = eq20(left, right, inverse, -inverse @ T_rl) - points
        assert np.linalg.norm(moved, axis=1).mean() == pytest.approx(0.64, abs=0.01)  # mm
        assert moved[:, 2].mean() == pytest.approx(shift, abs=0.01)
    exact = nearest_rotation(R_rl).as_matrix().T
    np.testing.assert_allclose(eq20(left, right, exact, -exact @ T_rl), points, atol=1e-9)  # mm


def test_the_printed_direction_of_eq25_misses_by_centimetres_in_eq20(seen):
    points, left, right = seen
    _, _, R_rl, T_rl = load_calibration()
    missed = np.linalg.norm(eq20(left, right, R_rl, T_rl) - points, axis=1)
    assert missed.mean() == pytest.approx(48, abs=0.5)  # mm
    assert missed.max() == pytest.approx(124, abs=0.5)


def test_refuses():
    with pytest.raises(ValueError, match="beta1"):
        printed_cones(1.0, 0.0, 1.0, 0.3)
    with pytest.raises(ValueError, match="half_angle"):
        printed_workspace_volume(2.0)
    assert intersect(printed_cones(1.0, 0.5, 0.5, 0.3), 64).status == "empty"
