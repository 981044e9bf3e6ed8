"""Eq. 23-24 against SciPy's align_vectors and minimisers, differences, and closed forms by hand."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle
from trinolab.pose import Pose, rigid_fit, rigid_fit_covariance, rigid_fit_gain, weighted_fit
from trinolab.rigid import motion_between, shifted

# mm and rad; the numbers up to 600 at 1e-16, in a few sums: the worst exact fit is 1e-13 off
EXACT = 1e-9
T_TRUE = RigidTransform.from_components(
    [-35.0, 12.5, 560.0], Rotation.from_euler("ZYX", [-87, 50, -178], degrees=True)
)
MARKERS = load_handle("paper").marker_centres
TWO_COLUMNS = MARKERS[:4]  # coplanar: the paper's minimum of four markers

SETS = {
    "twelve markers": MARKERS,
    "four coplanar": TWO_COLUMNS,
    "three": MARKERS[:3],
    "six random": np.random.default_rng(0).normal(0, 10, (6, 3)),
    "five coplanar random": np.random.default_rng(1).normal(0, 10, (5, 3)) * [1, 1, 0],
}


def reference_fit(source, target):
    """The same least-squares problem by SciPy: centroids apart, then Rotation.align_vectors."""
    rotation, _ = Rotation.align_vectors(target - target.mean(axis=0), source - source.mean(axis=0))
    return RigidTransform.from_components(
        target.mean(axis=0) - rotation.apply(source.mean(axis=0)), rotation
    )


def assert_same(T, reference, atol):
    np.testing.assert_allclose(T.as_matrix(), reference.as_matrix(), rtol=0, atol=atol)
    assert np.linalg.det(T.rotation.as_matrix()) > 0


@pytest.mark.parametrize("points", SETS.values(), ids=SETS)
@pytest.mark.parametrize("sigma", [0.05, 3.0])
def test_noisy_points_give_the_fit_of_align_vectors(points, sigma):
    """Of flat sets about half are reflections without the guard, although they fit to the last
    digit; mirrored sets are, whatever their form.
    """
    assert_same(rigid_fit(points, T_TRUE.apply(points)), T_TRUE, EXACT)
    for seed in range(10):
        target = T_TRUE.apply(points) + np.random.default_rng(seed).normal(0, sigma, points.shape)
        # Noise of 3 mm brings singular values close to one another; two SVDs still agree to
        # 1.2e-13.
        assert_same(rigid_fit(points, target), reference_fit(points, target), EXACT)
    source = points * [1.0, 1.1, 1.3]  # three different extents: the best rotation is unique
    target = T_TRUE.apply(source * [-1.0, 1.0, 1.0])
    assert_same(rigid_fit(source, target), reference_fit(source, target), EXACT)


@pytest.mark.parametrize("offset", [1.0, 1e-2, 1e-4])
def test_nearly_collinear_points_still_give_the_pose(offset):
    source = np.array(
        [(0.0, -10.0, 0.0), (offset, 0.0, 0.0), (0.0, 10.0, 0.0), (0.0, 25.0, -offset)]
    )
    # The turn about the line rests on the offset alone: rounding of 1e-13 mm (numbers near 560)
    # over it.
    assert_same(rigid_fit(source, T_TRUE.apply(source)), T_TRUE, EXACT + 1e-10 / offset)


def test_rows_with_nan_in_either_set_are_left_out():
    source, target = np.array(MARKERS), T_TRUE.apply(MARKERS)
    source[2], target[5, 1], target[7] = np.nan, np.nan, np.nan
    target[[2, 11]] += 1000.0  # a wrong point whose partner is missing does no harm ...
    source[11, 0] = np.nan
    assert_same(rigid_fit(source, target), T_TRUE, EXACT)


LINE = np.outer([-10.0, 0.0, 10.0, 25.0], [0.6, 0.0, 0.8])
NO_POSE = {
    "none": (np.empty((0, 3)), np.empty((0, 3))),
    "two": (MARKERS[:2], MARKERS[:2]),
    "two without NaN": (MARKERS[:4], np.vstack([MARKERS[:2], np.full((2, 3), np.nan)])),
    "a line": (LINE, T_TRUE.apply(LINE)),
    "target on a line": (MARKERS[:4], T_TRUE.apply(LINE)),
    "a line with noise": (LINE, LINE + np.random.default_rng(5).normal(0, 0.1, (4, 3))),
    "one place": (MARKERS[[0, 0, 0]], MARKERS[[0, 0, 0]]),
    "two places": (MARKERS[[0, 1, 1]], MARKERS[[0, 1, 1]]),
    "three places in a nanometre": (1e-11 * MARKERS[:3], 1e-11 * MARKERS[:3]),
}


@pytest.mark.parametrize("case", NO_POSE)
def test_no_pose_without_three_points_off_a_line(case):
    source, target = NO_POSE[case]
    assert rigid_fit(source, target) is None
    assert weighted_fit(source, target, np.ones((len(source), 1, 1)) * np.eye(3)) is None


# --- covariance


def drawn(points, rng):
    """Points with noise of different covariances with correlations, and these."""
    roots = rng.normal(0, 0.02, (len(points), 3, 3))
    noise = np.einsum("nij,nj->ni", roots, rng.normal(size=points.shape))
    return T_TRUE.apply(points) + noise, roots @ roots.transpose(0, 2, 1)


@pytest.mark.parametrize("name", ["four coplanar", "six random"])
def test_gain_and_covariance_are_those_of_differences(name):
    points = SETS[name] + [0.0, 15.0, 0.0]
    target, C = T_TRUE.apply(points), drawn(points, np.random.default_rng(7))[1]
    gain = rigid_fit_gain(points, T_TRUE)
    for n, k in np.ndindex(len(points), 3):
        step = np.zeros_like(target)
        step[n, k] = 1e-4
        there, back = (rigid_fit(points, target + sign * step) for sign in (1, -1))
        slope = (motion_between(there, T_TRUE) - motion_between(back, T_TRUE)) / 2e-4
        np.testing.assert_allclose(gain[n, :, k], slope, rtol=0, atol=1e-7)
    expected = sum(G @ one @ G.T for G, one in zip(gain, C, strict=True))
    found = rigid_fit_covariance(points, T_TRUE, C)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ["four coplanar", "six random"])
def test_a_weighted_fit_is_that_of_a_minimiser(name):
    target, C = drawn(SETS[name], np.random.default_rng(8))
    target, C = np.vstack([target, [[0, np.nan, 0]]]), np.concatenate([C, [np.eye(3)]])
    points = np.vstack([SETS[name], [[1, 2, 3]]])
    T, covariance = weighted_fit(points, target, C)
    roots = np.linalg.inv(np.linalg.cholesky(C[:-1]))

    def misfit(motion):
        away = shifted(T, motion).apply(points[:-1]) - target[:-1]
        return (roots @ away[..., None]).ravel()

    best = least_squares(misfit, [0.01] * 3 + [1e-3] * 3, x_scale=[1] * 3 + [0.1] * 3, xtol=1e-15)
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(best.x / sigma, 0, rtol=0, atol=1e-4)
    expected = np.linalg.inv(best.jac.T @ best.jac)
    np.testing.assert_allclose((covariance - expected) / np.outer(sigma, sigma), 0, atol=1e-4)


def test_a_poses_sigmas_are_roots_of_traces_of_the_whole():
    random = np.diag([0.04, 0.09, 0.36, 1e-4, 2e-4, 6e-4])
    common = np.diag([0.16, 0, 0, 0, 0, 1.6e-3])
    pose = Pose("measured", T_TRUE, random, 0.1, 4, 2)
    assert pose.sigma_mm == pytest.approx(0.7, abs=1e-12)  # sqrt(0.04 + 0.09 + 0.36)
    assert pose.sigma_deg == pytest.approx(np.degrees(0.03), abs=1e-12)  # sqrt(9e-4) rad
    pose = Pose("measured", T_TRUE, lambda: random, 0.1, 4, 2, common)
    np.testing.assert_array_equal(pose.covariance, random + common)
    found = pose.sigma_mm, pose.systematic_mm, pose.sigma_deg, pose.systematic_deg
    expected = np.sqrt(0.65), 0.4, np.degrees(0.05), np.degrees(0.04)
    assert found == pytest.approx(expected, abs=1e-12)


C4 = np.broadcast_to(np.eye(3), (4, 3, 3))
SKEW = C4 + 1e-8 * np.eye(3, k=1)
NEGATIVE = C4 * [[1], [1], [-1e-8]]


REFUSED = [
    (rigid_fit, (np.zeros((4, 2)), np.zeros((4, 3))), r"points_source: expected shape \(n, 3\)"),
    (rigid_fit, (MARKERS, MARKERS[:4]), r"points_target: expected shape \(12, 3\)"),
    (rigid_fit_covariance, (TWO_COLUMNS, T_TRUE, SKEW), "covariances: expected symmetric"),
    (rigid_fit_covariance, (TWO_COLUMNS, T_TRUE, NEGATIVE), "a negative eigenvalue"),
    (rigid_fit_covariance, (TWO_COLUMNS, None, C4), "T_target_source: .* got NoneType"),
    (rigid_fit_covariance, (LINE, T_TRUE, C4), "points_source: expected three or more points"),
    (rigid_fit_gain, (LINE, T_TRUE), "points_source: expected three or more points"),
]


@pytest.mark.parametrize(("call", "given", "message"), REFUSED)
def test_mistakes_are_named(call, given, message):
    with pytest.raises(ValueError, match=message):
        call(*given)
