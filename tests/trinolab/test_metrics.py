"""Errors of poses: against plain loops, against numbers by hand, and at the places where angles go
wrong.
"""

import math

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle, load_table1
from trinolab.metrics import (
    angle_differences_deg,
    angle_errors_deg,
    euler_deg,
    geodesic_deg,
    nearest_equivalent,
    nees,
    pose_errors,
    pose_from_euler_deg,
    position_error,
    track_equivalent,
)


def random_poses(n, rng):
    return RigidTransform.from_components(rng.normal(0, 100, (n, 3)), Rotation.random(n, rng=rng))


def test_table1_gives_the_known_means():
    table = load_table1()
    errors = pose_errors(table.measured, table.set_poses)
    assert errors.n == 20
    # Means of numbers printed to 0.01 mm and 0.1 deg: exact to rounding, worked out by a separate
    # program.
    assert errors.E_t_mm == pytest.approx(0.312, abs=5e-4)
    assert (errors.E_alpha_deg, errors.E_beta_deg, errors.E_gamma_deg) == pytest.approx(
        (0.71, 0.55, 0.64), abs=1e-9
    )
    assert errors.geodesic_mean_deg == pytest.approx(0.94, abs=5e-3)
    assert errors.position_median_mm == pytest.approx(0.286, abs=5e-4)


def test_means_against_plain_loops():
    frame = load_table1().frame
    distances, angles = [], []
    for _, row in frame.iterrows():
        distances.append(
            math.dist([row[f"measured_{c}_mm"] for c in "xyz"], [row[f"set_{c}_mm"] for c in "xyz"])
        )
        angles.append(
            [
                abs(row[f"measured_{a}_deg"] - row[f"set_{a}_deg"])
                for a in ("alpha", "beta", "gamma")
            ]
        )
    table = load_table1()
    assert position_error(table.measured, table.set_poses) == pytest.approx(
        sum(distances) / 20, abs=1e-12
    )
    assert angle_errors_deg(table.measured, table.set_poses) == pytest.approx(
        np.mean(angles, axis=0), abs=1e-9
    )


def test_euler_angles_by_hand():
    # A turn by 90 deg about Z carries x to y; then beta about the new Y tips x below the
    # horizontal: x -> (0, c, -s).
    pose = pose_from_euler_deg([1.0, 2.0, 3.0], [90.0, 30.0, 0.0])
    assert pose.apply([1.0, 0.0, 0.0]) == pytest.approx(
        [1.0, 2.0 + math.sqrt(0.75), 3.0 - 0.5], abs=1e-12
    )
    assert euler_deg(pose) == pytest.approx([90.0, 30.0, 0.0], abs=1e-9)


def test_euler_angles_against_the_product_of_three_turns():
    rng = np.random.default_rng(1)
    angles = rng.uniform([-180, -90, -180], [180, 90, 180], (200, 3))
    poses = pose_from_euler_deg(rng.normal(size=(200, 3)), angles)
    for matrix, (alpha, beta, gamma) in zip(
        poses.rotation.as_matrix(), np.deg2rad(angles), strict=True
    ):
        ca, sa, cb, sb, cg, sg = (f(x) for x in (alpha, beta, gamma) for f in (math.cos, math.sin))
        Rz = np.array([[ca, -sa, 0], [sa, ca, 0], [0, 0, 1]])
        Ry = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
        Rx = np.array([[1, 0, 0], [0, cg, -sg], [0, sg, cg]])
        np.testing.assert_allclose(matrix, Rz @ Ry @ Rx, atol=1e-14)
    np.testing.assert_allclose(euler_deg(poses), angles, atol=1e-7)  # deg; worst near beta = 90 deg


def test_gimbal_lock_gives_a_pose_and_no_warning():
    # warnings are errors in this test run
    pose = pose_from_euler_deg([0.0, 0.0, 0.0], [30.0, 90.0, 20.0])
    alpha, beta, gamma = euler_deg(pose)
    assert (beta, gamma) == pytest.approx((90.0, 0.0), abs=1e-6)
    again = pose_from_euler_deg([0.0, 0.0, 0.0], [alpha, beta, gamma])
    assert geodesic_deg(again, pose)[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("measured", "true", "difference"),
    [
        (179.0, -179.0, -2.0),
        (-179.0, 179.0, 2.0),
        (10.0, -10.0, 20.0),
        (90.0, -90.0, 180.0),
        (-90.0, 90.0, 180.0),
    ],
)
def test_differences_are_wrapped(measured, true, difference):
    estimate, truth = (
        pose_from_euler_deg([0.0, 0.0, 0.0], [angle, 0.0, 0.0]) for angle in (measured, true)
    )
    assert angle_differences_deg(estimate, truth)[0, 0] == pytest.approx(difference, abs=1e-9)


def test_geodesic_angle_does_not_depend_on_the_frame():
    rng = np.random.default_rng(2)
    turn = Rotation.from_rotvec(np.deg2rad(7.0) * np.array([0.6, 0.0, 0.8]))
    truths, other = random_poses(50, rng), random_poses(1, rng)[0]
    estimates = RigidTransform.from_components(truths.translation, truths.rotation * turn)
    for left in (RigidTransform.identity(), other):
        np.testing.assert_allclose(geodesic_deg(left * estimates, left * truths), 7.0, atol=1e-9)


def test_nearest_equivalent_finds_every_symmetry():
    rng = np.random.default_rng(3)
    symmetries = load_handle("paper").symmetries
    truths = random_poses(60, rng)
    chosen = RigidTransform.concatenate([symmetries[k] for k in rng.integers(0, 12, 60)])
    small = RigidTransform.from_components(
        rng.normal(0, 0.1, (60, 3)), Rotation.from_rotvec(rng.normal(0, 0.01, (60, 3)))
    )
    found = nearest_equivalent(truths * small * chosen, truths, symmetries)
    # The symmetries map the handle to itself, so undoing the right one leaves truth * small up to
    # conjugation: at most 0.01 * sqrt(3) * 4 rad.
    assert geodesic_deg(found, truths).max() < 4.0
    assert pose_errors(truths * chosen, truths).geodesic_mean_deg > 30.0


def test_nearest_equivalent_takes_the_closer_of_equal_rotations():
    truth = RigidTransform.identity()
    shift = RigidTransform.from_translation([0.0, 5.0, 0.0])
    found = nearest_equivalent(shift.inv(), truth, [RigidTransform.identity(), shift])
    assert found.translation[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_track_equivalent_keeps_a_flip_as_an_error():
    rng = np.random.default_rng(4)
    symmetries = load_handle("paper").symmetries
    truths = random_poses(10, rng)
    turned = truths * symmetries[5]
    np.testing.assert_allclose(
        geodesic_deg(track_equivalent(turned, truths, symmetries), truths), 0.0, atol=1e-5
    )
    flipped = RigidTransform.concatenate(
        [*(turned[k] for k in range(9)), turned[9] * symmetries[3]]
    )
    found = geodesic_deg(track_equivalent(flipped, truths, symmetries), truths)
    assert found[:9].max() < 1e-5
    assert found[9] > 30.0
    assert geodesic_deg(nearest_equivalent(flipped, truths, symmetries), truths).max() < 1e-5


def test_a_single_pose_counts_as_one():
    assert (
        pose_errors(
            RigidTransform.identity(), RigidTransform.from_translation([3.0, 4.0, 0.0])
        ).E_t_mm
        == 5.0
    )


def bad_pose():
    return RigidTransform.from_translation([[np.nan, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("estimates", "truths", "message"),
    [
        (np.eye(4), RigidTransform.identity(), "estimates: expected a RigidTransform"),
        (RigidTransform.identity(), [1], "truths: expected a RigidTransform"),
        (RigidTransform.identity(2), RigidTransform.identity(3), "2 and 3"),
        (
            bad_pose(),
            RigidTransform.identity(1),
            "estimates: expected one valid pose or more, got NaN",
        ),
    ],
)
def test_refuses(estimates, truths, message):
    with pytest.raises(ValueError, match=message):
        pose_errors(estimates, truths)


def test_refuses_other_shapes_and_no_symmetry():
    with pytest.raises(ValueError, match="angles_deg"):
        pose_from_euler_deg([[0, 0, 0]], [[0, 0, 0], [0, 0, 0]])
    with pytest.raises(ValueError, match="position_mm"):
        pose_from_euler_deg([0, np.nan, 0], [0, 0, 0])
    with pytest.raises(ValueError, match="poses"):
        euler_deg(np.eye(3))
    with pytest.raises(ValueError, match="symmetries"):
        nearest_equivalent(RigidTransform.identity(), RigidTransform.identity(), [])


def test_nees_is_the_squared_number_of_standard_deviations():
    """2 sigma in x, and 3 sigma about the world's z, whatever the pose: 4 + 9, and each alone."""
    truth = random_poses(1, np.random.default_rng(2))[0]
    C = np.diag([0.1, 0.2, 0.3, 0.01, 0.02, 0.03]) ** 2
    turn = Rotation.from_rotvec([0, 0, 0.09])
    found = RigidTransform.from_components(truth.translation + [0.2, 0, 0], turn * truth.rotation)
    assert nees(found, C, truth) == pytest.approx([13, 4, 9])
    assert nees(truth, C, truth) == pytest.approx([0, 0, 0], abs=1e-20)


def test_nees_counts_correlation():
    C = np.eye(6)
    C[0, 5] = C[5, 0] = 0.6  # x and the turn about z go together
    found = RigidTransform.from_components([1.0, 0, 0], Rotation.from_rotvec([0, 0, 1.0]))
    assert nees(found, C, RigidTransform.identity()) == pytest.approx([2 / 1.6, 1, 1])


@pytest.mark.parametrize(
    ("covariance", "named"), [(np.eye(5), "covariance"), (np.full((6, 6), np.nan), "covariance")]
)
def test_nees_refuses(covariance, named):
    one = RigidTransform.identity()
    with pytest.raises(ValueError, match=named):
        nees(one, covariance, one)
    with pytest.raises(ValueError, match="estimate"):
        nees(random_poses(2, np.random.default_rng(0)), np.eye(6), one)
