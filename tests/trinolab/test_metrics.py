"""Errors of poses and tracks: against plain loops, against numbers by hand, and at the places where
angles go wrong.
"""

import math

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import metrics
from trinolab.datasets import load_handle, load_table1
from trinolab.metrics import geodesic_deg, pose_from_euler_deg

IDENTITY = RigidTransform.identity()
SYMMETRIES, NO_SYMMETRY = load_handle("paper").symmetries, load_handle("coded").symmetries
ANGLES = ("alpha", "beta", "gamma")


def random_poses(n, rng):
    return RigidTransform.from_components(rng.normal(0, 100, (n, 3)), Rotation.random(n, rng=rng))


def moved(shifts_mm):
    return RigidTransform.from_translation(shifts_mm)


def turned(angles_deg):
    """Turns about the handle's axis."""
    turns = Rotation.from_rotvec(np.outer(angles_deg, [0, 1, 0]), degrees=True)
    return RigidTransform.from_rotation(turns)


def test_table1_gives_the_known_means_and_those_of_plain_loops():
    table = load_table1()
    distances, angles = [], {name: [] for name in ANGLES}
    for _, row in table.frame.iterrows():
        measured, true = ([row[f"{side}_{c}_mm"] for c in "xyz"] for side in ("measured", "set"))
        distances.append(math.dist(measured, true))
        for name in ANGLES:
            angles[name].append(abs(row[f"measured_{name}_deg"] - row[f"set_{name}_deg"]))
    found = metrics.pose_errors(table.measured, table.set_poses)
    middle = sorted(distances)[9:11]
    assert found.n == 20
    # Means of numbers printed to 0.01 mm and 0.1 deg, worked out by a separate program.
    assert (found.E_t_mm, found.geodesic_mean_deg) == pytest.approx((0.312, 0.94), rel=5e-3)
    assert found.E_t_mm == pytest.approx(sum(distances) / 20, abs=1e-12)
    assert found.position_median_mm == pytest.approx(sum(middle) / 2, abs=1e-12)
    assert found.position_max_mm == pytest.approx(max(distances), abs=1e-12)
    for name in ANGLES:
        median = sum(sorted(angles[name])[9:11]) / 2
        assert getattr(found, f"E_{name}_deg") == pytest.approx(sum(angles[name]) / 20, abs=1e-9)
        assert getattr(found, f"{name}_median_deg") == pytest.approx(median, abs=1e-9)


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
    # deg; worst near beta = 90 deg
    np.testing.assert_allclose(metrics.euler_deg(poses), angles, atol=1e-7)


def test_gimbal_lock_gives_a_pose_and_no_warning():
    # warnings are errors in this test run
    pose = pose_from_euler_deg([0.0, 0.0, 0.0], [30.0, 90.0, 20.0])
    angles = metrics.euler_deg(pose)
    assert angles[1:] == pytest.approx((90.0, 0.0), abs=1e-6)
    again = pose_from_euler_deg([0.0, 0.0, 0.0], angles)
    assert geodesic_deg(again, pose)[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("measured", "true", "difference"),
    [(179, -179, -2), (-179, 179, 2), (10, -10, 20), (90, -90, 180), (-90, 90, 180)],
)
def test_differences_are_wrapped(measured, true, difference):
    pair = [pose_from_euler_deg([0.0] * 3, [angle, 0.0, 0.0]) for angle in (measured, true)]
    assert metrics.angle_differences_deg(*pair)[0, 0] == pytest.approx(difference, abs=1e-9)


def test_geodesic_angle_does_not_depend_on_the_frame():
    rng = np.random.default_rng(2)
    # of growing size, the largest last but one
    degrees = np.array([1.0, 2.0, 3.0, 4.0, 170.0, 7.0])
    turns = Rotation.from_rotvec(np.deg2rad(degrees)[:, None] * np.array([0.6, 0.0, 0.8]))
    truths, other = random_poses(6, rng), random_poses(1, rng)[0]
    estimates = RigidTransform.from_components(truths.translation, truths.rotation * turns)
    for left in (IDENTITY, other):
        np.testing.assert_allclose(
            geodesic_deg(left * estimates, left * truths), degrees, atol=1e-9
        )
    found = metrics.pose_errors(estimates, truths)
    summary = (found.geodesic_mean_deg, found.geodesic_median_deg, found.geodesic_max_deg)
    assert summary == pytest.approx((187 / 6, 3.5, 170))


@pytest.mark.parametrize("function", [metrics.nearest_equivalent, metrics.track_equivalent])
def test_the_closer_of_equivalents_whose_rotations_are_equal_is_taken(function):
    there = moved([0.0, 5.0, 0.0])
    # a rotation that is equal but for rounding, and the one that is nearer but turned
    rounded = RigidTransform.from_components([0.0, 5.0, 0.0], Rotation.from_rotvec([0, 1e-12, 0]))
    off = RigidTransform.from_components([0.0, 5.0, 0.0], Rotation.from_rotvec([0, 1e-3, 0]))
    for symmetries in ([IDENTITY, there], [IDENTITY, rounded], [off, IDENTITY, there]):
        found = function(there.inv(), IDENTITY, symmetries)
        assert found.translation[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
        assert geodesic_deg(found, IDENTITY)[0] < 1e-9


def test_track_equivalent_keeps_a_flip_as_an_error():
    truths = random_poses(10, np.random.default_rng(4))
    track = truths * RigidTransform.concatenate(
        [*[SYMMETRIES[5]] * 9, SYMMETRIES[5] * SYMMETRIES[3]]
    )
    found = geodesic_deg(metrics.track_equivalent(track, truths, SYMMETRIES), truths)
    assert found[:9].max() < 1e-5
    assert found[9] > 30.0
    nearest = metrics.nearest_equivalent(track, truths, SYMMETRIES)
    assert geodesic_deg(nearest, truths).max() < 1e-5


def test_a_single_pose_counts_as_one():
    assert metrics.pose_errors(IDENTITY, moved([3.0, 4.0, 0.0])).E_t_mm == 5.0


# --- tracks


def track(n):
    angles = [[10.0 * k, 20.0, -30.0 * k] for k in range(n)]
    return pose_from_euler_deg([[10.0 * k, 0.0, 600.0] for k in range(n)], angles)


@pytest.mark.parametrize(
    ("choice", "count"),
    [([0] * 6, 0), ([4] * 6, 0), ([0, 0, 3, 3, 3, 3], 1), ([0, 1, 0, 1, 0, 1], 5), ([0], 0)],
)
def test_flips_by_hand(choice, count):
    T = track(len(choice))
    poses = T * RigidTransform.concatenate([SYMMETRIES[k] for k in choice])
    assert metrics.flips(poses, T, SYMMETRIES) == count


def test_far_off_has_two_limits():
    T = track(4)
    poses = (
        moved([[0, 0, 1.99], [0, 2.01, 0], [0, 0, 0], [0, 0, 0]]) * T * turned([0, 0, 4.99, 5.01])
    )
    assert metrics.far_off(poses, T, NO_SYMMETRY) == 2
    assert metrics.far_off(poses, T, NO_SYMMETRY, far_mm=3.0) == 1
    assert metrics.far_off(poses, T, NO_SYMMETRY, 0.0, 0.0) == 4
    with pytest.raises(ValueError, match="far_deg: expected a number"):
        metrics.far_off(poses, T, NO_SYMMETRY, far_deg=-1.0)
    with pytest.raises(ValueError, match="far_mm: expected a number"):
        metrics.far_off(poses, T, NO_SYMMETRY, far_mm=-1.0)


WAITS = [
    ("0000", None, (), None),
    ("1111", None, (), None),
    ("1001", None, (2,), None),
    ("0101100010", None, (1, 3), 1),
    ("1000", None, (), 3),
    ("10010", "10110", (1,), 0),
    ("1001", "1001", (0,), None),
]


@pytest.mark.parametrize(("row", "counted", "ended", "unended"), WAITS)
def test_waits_by_hand(row, counted, ended, unended):
    counts = None if counted is None else [c == "1" for c in counted]
    assert metrics.waits([c == "1" for c in row], counts) == (ended, unended)


def test_four_markers_by_one_camera_or_three_by_two_fix_a_pose():
    assert metrics.can_be_measured([[4, 0, 0], [3, 3, 0], [0, 3, 4]]).all()
    assert not metrics.can_be_measured([[3, 2, 2], [3, 0, 0], [0, 0, 0]]).any()


# --- covariances


def test_nees_is_the_squared_number_of_standard_deviations():
    """2, 1 and 1 sigma along, and 1, 1 and 3 sigma about the world's axes, whatever the pose."""
    truth = random_poses(1, np.random.default_rng(2))[0]
    C = np.diag([0.1, 0.2, 0.3, 0.01, 0.02, 0.03]) ** 2
    shift, turn = [0.2, 0.2, 0.3], Rotation.from_rotvec([0.01, 0.02, 0.09])
    found = RigidTransform.from_components(truth.translation + shift, turn * truth.rotation)
    assert metrics.nees(found, C, truth) == pytest.approx([17, 6, 11])


def test_nees_counts_correlation():
    C = np.eye(6)
    C[0, 5] = C[5, 0] = 0.6  # x and the turn about z go together
    found = RigidTransform.from_components([1.0, 0, 0], Rotation.from_rotvec([0, 0, 1.0]))
    assert metrics.nees(found, C, IDENTITY) == pytest.approx([2 / 1.6, 1, 1])


TWO = RigidTransform.identity(2)


REFUSED = [
    (metrics.pose_errors, (np.eye(4), IDENTITY), "estimates: expected a RigidTransform"),
    (metrics.pose_errors, (IDENTITY, [1]), "truths: expected a RigidTransform"),
    (metrics.pose_errors, (TWO, RigidTransform.identity(3)), "2 and 3"),
    (metrics.pose_errors, (moved([[np.nan, 0, 0]]), IDENTITY), "estimates: .*, got NaN"),
    (metrics.pose_errors, (TWO[[]], TWO[[]]), "estimates: .*, got none"),
    (pose_from_euler_deg, ([[0, 0, 0]], [[0, 0, 0], [0, 0, 0]]), "angles_deg"),
    (metrics.euler_deg, (np.eye(3),), "poses"),
    (metrics.nearest_equivalent, (IDENTITY, IDENTITY, []), "symmetries"),
    (metrics.waits, ([True, False], [True]), r"measured, counted: expected shape \(n,\)"),
    (metrics.waits, (np.ones((2, 2)),), "measured, counted"),
]


@pytest.mark.parametrize(("call", "given", "message"), REFUSED)
def test_refuses(call, given, message):
    with pytest.raises(ValueError, match=message):
        call(*given)
