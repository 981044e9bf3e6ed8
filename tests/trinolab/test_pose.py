"""Eq. 23-24 against SciPy's align_vectors and minimisers, closed forms by hand, and Monte Carlo."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle
from trinolab.pose import (
    LOST,
    Pose,
    rigid_fit,
    rigid_fit_covariance,
    rigid_fit_gain,
    weighted_fit,
)

# mm and rad; the numbers up to 600 at 1e-16, in a few sums: the worst exact fit is 1e-13 off
EXACT = 1e-9
T_TRUE = RigidTransform.from_components(
    [-35.0, 12.5, 560.0], Rotation.from_euler("ZYX", [-87, 50, -178], degrees=True)
)
MARKERS = load_handle("paper").marker_centres
TWO_COLUMNS = MARKERS[:4]  # coplanar: the paper's minimum of four markers
MIRROR = np.array([-1.0, 1.0, 1.0])

SETS = {
    "twelve markers": MARKERS,
    "four coplanar": TWO_COLUMNS,
    "three": MARKERS[:3],
    "six random": np.random.default_rng(0).normal(0, 10, (6, 3)),
    "five coplanar random": np.random.default_rng(1).normal(0, 10, (5, 3)) * [1, 1, 0],
    "three random": np.random.default_rng(2).normal(0, 10, (3, 3)),
}
each_set = pytest.mark.parametrize("points", SETS.values(), ids=SETS.keys())


def reference_fit(source, target):
    """The same least-squares problem by SciPy: centroids apart, then Rotation.align_vectors."""
    rotation, _ = Rotation.align_vectors(target - target.mean(axis=0), source - source.mean(axis=0))
    return RigidTransform.from_components(
        target.mean(axis=0) - rotation.apply(source.mean(axis=0)), rotation
    )


def assert_same(T, reference, atol):
    np.testing.assert_allclose(T.as_matrix(), reference.as_matrix(), rtol=0, atol=atol)
    assert np.linalg.det(T.rotation.as_matrix()) > 0


def unguarded_matrix(source, target):
    """U V^T of the fit without the guard: the best orthogonal matrix, which may be a reflection."""
    U, _, Vt = np.linalg.svd((target - target.mean(axis=0)).T @ (source - source.mean(axis=0)))
    return U @ Vt


# --- the fit
# --------------------------------------------------------------------------------------------------------


def test_a_pose_by_hand():
    # Rz(90 deg) takes (x, y, z) to (-y, x, z); then (10, 20, 500) is added.
    source = [(1, 0, 0), (0, 2, 0), (0, 0, 3), (4, 5, 6)]
    target = [(10, 21, 500), (8, 20, 500), (10, 20, 503), (5, 24, 506)]
    expected = [[0, -1, 0, 10], [1, 0, 0, 20], [0, 0, 1, 500], [0, 0, 0, 1]]
    np.testing.assert_allclose(rigid_fit(source, target).as_matrix(), expected, rtol=0, atol=EXACT)


@each_set
def test_exact_points_give_the_pose(points):
    assert_same(rigid_fit(points, T_TRUE.apply(points)), T_TRUE, EXACT)


@each_set
@pytest.mark.parametrize("sigma", [0.05, 3.0])
def test_noisy_points_give_the_fit_of_align_vectors(points, sigma):
    for seed in range(20):
        target = T_TRUE.apply(points) + np.random.default_rng(seed).normal(0, sigma, points.shape)
        # Noise of 3 mm brings singular values close to one another; two SVDs still agree to
        # 1.2e-13.
        assert_same(rigid_fit(points, target), reference_fit(points, target), EXACT)


@pytest.mark.parametrize("offset", [1.0, 1e-2, 1e-4])
def test_nearly_collinear_points_still_give_the_pose(offset):
    source = np.array(
        [(0.0, -10.0, 0.0), (offset, 0.0, 0.0), (0.0, 10.0, 0.0), (0.0, 25.0, -offset)]
    )
    target = T_TRUE.apply(source)
    # The turn about the line rests on the offset alone: rounding of 1e-13 mm (numbers near 560)
    # over it.
    assert_same(rigid_fit(source, target), T_TRUE, EXACT + 1e-10 / offset)
    assert_same(rigid_fit(source, target), reference_fit(source, target), EXACT + 1e-10 / offset)


@pytest.mark.parametrize("name", ["twelve markers", "six random"])
def test_a_mirrored_set_gives_the_best_rotation_not_the_reflection(name):
    source = SETS[name] * [1.0, 1.1, 1.3]  # three different extents: the best rotation is unique
    target = T_TRUE.apply(source * MIRROR)
    assert np.linalg.det(unguarded_matrix(source, target)) < 0
    assert_same(rigid_fit(source, target), reference_fit(source, target), EXACT)


@pytest.mark.parametrize("name", ["four coplanar", "three", "five coplanar random", "three random"])
def test_a_flat_set_and_its_mirror_image_are_congruent(name):
    source = SETS[name]
    target = T_TRUE.apply(source * MIRROR)
    T = rigid_fit(source, target)
    np.testing.assert_allclose(T.apply(source), target, rtol=0, atol=EXACT)


def test_the_guard_is_needed_for_flat_sets():
    # Without it about half of the flat sets come out as reflections, although they fit to the last
    # digit.
    reflected = {name: 0 for name in ("four coplanar", "three", "twelve markers")}
    for name in reflected:
        source = SETS[name]
        for seed in range(50):
            rng = np.random.default_rng(seed)
            T = RigidTransform.from_components(rng.normal(0, 100, 3), Rotation.random(rng=rng))
            target = T.apply(source) + rng.normal(0, 0.05, source.shape)
            reflected[name] += np.linalg.det(unguarded_matrix(source, target)) < 0
            assert_same(rigid_fit(source, target), reference_fit(source, target), EXACT)
    assert reflected["twelve markers"] == 0
    assert 10 <= reflected["four coplanar"] <= 40  # of 50, by chance: 25 +- 3.5
    assert 10 <= reflected["three"] <= 40


def test_no_other_motion_fits_better():
    rng = np.random.default_rng(3)
    target = T_TRUE.apply(TWO_COLUMNS) + rng.normal(0, 0.5, TWO_COLUMNS.shape)
    T = rigid_fit(TWO_COLUMNS, target)

    def misfit(change):
        # turned about their middle, so that turn and shift part
        arms = T.apply(TWO_COLUMNS) - target.mean(axis=0)
        return (
            Rotation.from_rotvec(change[3:]).apply(arms) + target.mean(axis=0) + change[:3] - target
        ).ravel()

    start = np.array([0.5, -0.5, 0.5, 1e-3, -1e-3, 1e-3])
    best = least_squares(
        misfit, start, x_scale=[1, 1, 1, 0.1, 0.1, 0.1], jac="3-point", xtol=1e-15, ftol=1e-15
    )
    np.testing.assert_allclose(best.x, 0, rtol=0, atol=1e-6)  # mm, rad; the differences leave 1e-8


def test_the_fit_does_not_depend_on_the_order_or_the_frame():
    rng = np.random.default_rng(4)
    target = T_TRUE.apply(MARKERS) + rng.normal(0, 0.2, MARKERS.shape)
    T, order = rigid_fit(MARKERS, target), rng.permutation(12)
    assert_same(rigid_fit(MARKERS[order], target[order]), T, EXACT)
    world = RigidTransform.from_components(
        [300.0, -80.0, 45.0], Rotation.from_rotvec([0.3, 2.0, -1.0])
    )
    assert_same(rigid_fit(MARKERS, world.apply(target)), world * T, EXACT)
    handle = world.inv()
    assert_same(rigid_fit(handle.apply(MARKERS), target), T * handle.inv(), EXACT)


def test_rows_with_nan_in_either_set_are_left_out():
    source, target = np.array(MARKERS), T_TRUE.apply(MARKERS)
    source[2], target[5, 1], target[7] = np.nan, np.nan, np.nan
    target[[2, 11]] += 1000.0  # a wrong point whose partner is missing does no harm ...
    source[11, 0] = np.nan
    assert_same(rigid_fit(source, target), T_TRUE, EXACT)


LINE = np.outer([-10.0, 0.0, 10.0, 25.0], [0.6, 0.0, 0.8])


@pytest.mark.parametrize(
    ("source", "target"),
    [
        (np.empty((0, 3)), np.empty((0, 3))),
        (MARKERS[:2], MARKERS[:2]),
        (MARKERS[:4], np.vstack([MARKERS[:2], np.full((2, 3), np.nan)])),
        (LINE, T_TRUE.apply(LINE)),
        (MARKERS[:4], T_TRUE.apply(LINE)),
        (LINE, T_TRUE.apply(LINE) + np.random.default_rng(5).normal(0, 0.1, (4, 3))),
        (MARKERS[[0, 0, 0]], T_TRUE.apply(MARKERS[[0, 0, 0]])),
        (MARKERS[[0, 1, 1]], T_TRUE.apply(MARKERS[[0, 1, 1]])),
    ],
    ids=[
        "none",
        "two",
        "two without NaN",
        "a line",
        "target on a line",
        "a line, measured with noise",
        "one place",
        "two places",
    ],
)
def test_no_pose_without_three_points_off_a_line(source, target):
    assert rigid_fit(source, target) is None


# --- Eq. 24 as printed
# ----------------------------------------------------------------------------------------------


def homogeneous(points):
    return np.column_stack([points, np.ones(len(points))]).T  # (4, n)


def test_eq24_as_printed_is_singular_for_the_papers_minimum():
    model = homogeneous(TWO_COLUMNS)
    assert model.shape == (4, 4)
    singular = np.linalg.svd(model, compute_uv=False)
    assert np.linalg.matrix_rank(model) == 3
    # 20, 8.9, 5 and 0: rows 10, 10, -10, -10 and the like, and the rounding of 1e-16 of them
    np.testing.assert_allclose(singular, [20, 8.888194, 5, 0], rtol=0, atol=1e-6)


def test_eq24_solved_as_printed_is_no_rigid_motion():
    def fitted(points, noise):
        M = homogeneous(T_TRUE.apply(points) + noise)
        return np.linalg.lstsq(homogeneous(points).T, M.T, rcond=1e-9)[0].T

    flat = fitted(TWO_COLUMNS, 0)[:3, :3]  # exact points: the solution of least norm
    assert np.abs(flat.T @ flat - np.eye(3)).max() > 0.5
    exact = fitted(MARKERS[:6], 0)  # three columns are enough, without noise
    np.testing.assert_allclose(exact, T_TRUE.as_matrix(), rtol=0, atol=EXACT)
    noise = np.random.default_rng(6).normal(0, 0.1, (6, 3))
    noisy = fitted(MARKERS[:6], noise)[:3, :3]
    assert np.abs(noisy.T @ noisy - np.eye(3)).max() > 0.02  # 0.1 mm on arms of 5 mm
    assert rigid_fit(MARKERS[:6], T_TRUE.apply(MARKERS[:6]) + noise) is not None


# --- covariance
# -----------------------------------------------------------------------------------------------------


def test_covariance_of_a_square_by_hand():
    # Corners (+-a, +-b, 0), errors of sigma a coordinate: the mean has sigma^2/4; turns about x, y,
    # z have the lever sums 4 b^2, 4 a^2, 4 (a^2 + b^2).
    a, b, sigma = 3.0, 10.0, 0.1
    corners = np.array([(a, b, 0), (-a, b, 0), (-a, -b, 0), (a, -b, 0)])
    expected = sigma**2 / 4 * np.diag([1, 1, 1, 1 / b**2, 1 / a**2, 1 / (a**2 + b**2)])
    covariances = np.broadcast_to(sigma**2 * np.eye(3), (4, 3, 3))
    found = rigid_fit_covariance(corners, RigidTransform.identity(), covariances)
    # mm^2, rad^2; rounding of numbers below 0.01
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)
    # Turned by 90 deg about z the two lever arms change places, in the target's frame.
    turned = RigidTransform.from_rotation(Rotation.from_rotvec([0, 0, np.pi / 2]))
    swapped = expected[np.ix_([1, 0, 2, 4, 3, 5], [1, 0, 2, 4, 3, 5])]
    np.testing.assert_allclose(
        rigid_fit_covariance(corners, turned, covariances), swapped, rtol=0, atol=1e-15
    )
    # With the origin d along y beside the corners, a turn about x moves it by d along z.
    d = 7.0
    shifted = rigid_fit_covariance(corners + [0, d, 0], RigidTransform.identity(), covariances)
    assert shifted[2, 2] == pytest.approx(sigma**2 / 4 * (1 + d**2 / b**2), abs=1e-15)
    assert shifted[2, 3] == pytest.approx(-d * sigma**2 / 4 / b**2, abs=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["four coplanar", pytest.param("three random", marks=pytest.mark.heavy)]
)
def test_covariance_against_monte_carlo(name):
    rng = np.random.default_rng(7)
    points, draws = SETS[name] + [0.0, 15.0, 0.0], 700
    # a different covariance for each point, with correlations
    roots = rng.normal(0, 0.02, (len(points), 3, 3))
    noise = np.einsum("nij,knj->kni", roots, rng.normal(size=(draws, len(points), 3)))
    fits = [rigid_fit(points, T_TRUE.apply(points) + n) for n in noise]
    errors = np.array(
        [
            np.concatenate(
                [
                    T.translation - T_TRUE.translation,
                    (T.rotation * T_TRUE.rotation.inv()).as_rotvec(),
                ]
            )
            for T in fits
        ]
    )
    whiten = np.linalg.inv(
        np.linalg.cholesky(rigid_fit_covariance(points, T_TRUE, roots @ roots.transpose(0, 2, 1)))
    )
    spread = np.linalg.eigvalsh(np.cov((errors @ whiten.T).T))
    # Eigenvalues of 700 whitened draws in 6 dimensions spread by 2 sqrt(6/700) = 0.19.
    np.testing.assert_allclose(spread, 1.0, rtol=0, atol=0.27)


def test_covariance_does_not_depend_on_the_unit_of_length():
    C = np.broadcast_to(0.01 * np.eye(3), (4, 3, 3))
    mm = rigid_fit_covariance(TWO_COLUMNS, T_TRUE, C)
    m = rigid_fit_covariance(TWO_COLUMNS / 1000, T_TRUE, C / 1e6)
    scale = np.repeat([1000.0, 1.0], 3)
    # mm^2, rad^2; entries below 0.01
    np.testing.assert_allclose(m * np.outer(scale, scale), mm, rtol=0, atol=1e-14)


# --- Pose
# -----------------------------------------------------------------------------------------------------------


def test_a_poses_sigmas_are_roots_of_traces():
    covariance = np.diag([0.04, 0.09, 0.36, 1e-4, 2e-4, 6e-4])
    pose = Pose("measured", T_TRUE, covariance, 0.1, 4, 2)
    assert pose.sigma_mm == pytest.approx(0.7, abs=1e-12)  # sqrt(0.04 + 0.09 + 0.36)
    assert pose.sigma_deg == pytest.approx(np.degrees(0.03), abs=1e-12)  # sqrt(9e-4) rad


def test_the_covariance_is_the_whole_and_its_parts_have_names():
    new, common = np.diag([1e-4, 0, 0, 0, 0, 1e-6]), np.diag([1e-2, 0, 0, 0, 0, 1e-6])
    pose = Pose("measured", T_TRUE, new, 0.1, 4, 2, common)
    np.testing.assert_array_equal(pose.covariance, new + common)
    np.testing.assert_array_equal(pose.covariance_random, new)
    np.testing.assert_array_equal(pose.systematic, common)


def test_what_two_instants_share_is_no_error_of_their_difference():
    """The example of `Pose`, drawn: 0.01 mm anew in each instant, 0.10 mm by the rig."""
    rng = np.random.default_rng(0)
    x = 0.10 * rng.standard_normal((20_000, 1)) + 0.01 * rng.standard_normal((20_000, 100))
    # 20,000 draws know a standard deviation to 0.5 %
    assert x[:, 0].std() == pytest.approx(0.1005, rel=0.02)
    assert x.mean(axis=1).std() == pytest.approx(0.1000, rel=0.02)
    assert (x[:, 1] - x[:, 0]).std() == pytest.approx(0.0141, rel=0.02)


def test_a_lost_pose_has_no_numbers():
    assert (LOST.status, LOST.T_world_handle, LOST.markers, LOST.cameras) == ("lost", None, 0, 0)
    assert np.isnan([LOST.sigma_mm, LOST.sigma_deg, LOST.residual_px]).all()


# --- a caller's mistakes
# --------------------------------------------------------------------------------------------

C4 = np.broadcast_to(np.eye(3), (4, 3, 3))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: rigid_fit(np.zeros((4, 2)), np.zeros((4, 3))),
            r"points_source: expected shape \(n, 3\), got \(4, 2\)",
        ),
        (
            lambda: rigid_fit(MARKERS, MARKERS[:4]),
            r"points_target: expected shape \(12, 3\), got \(4, 3\)",
        ),
        (
            lambda: rigid_fit("abc", MARKERS),
            r"points_source: expected numbers of shape \(n, 3\), got str",
        ),
        (
            lambda: rigid_fit_covariance(np.zeros(3), T_TRUE, C4),
            r"points_source: expected shape \(n, 3\), got \(3,\)",
        ),
        (
            lambda: rigid_fit_covariance(LINE * np.nan, T_TRUE, C4),
            "points_source: expected finite numbers",
        ),
        (
            lambda: rigid_fit_covariance(TWO_COLUMNS, T_TRUE, C4[:3]),
            r"covariances: expected shape \(4, 3, 3\)",
        ),
        (
            lambda: rigid_fit_covariance(TWO_COLUMNS, T_TRUE, C4 * np.nan),
            "covariances: expected finite numbers",
        ),
        (
            lambda: rigid_fit_covariance(TWO_COLUMNS, None, C4),
            "T_target_source: expected one RigidTransform, got NoneType",
        ),
        (
            lambda: rigid_fit_covariance(LINE, T_TRUE, C4),
            "points_source: expected three or more points that are not on",
        ),
        (
            lambda: rigid_fit_gain(LINE, T_TRUE),
            "points_source: expected three or more points that are not on",
        ),
        (
            lambda: rigid_fit_covariance(MARKERS[:2], T_TRUE, C4[:2]),
            "points_source: expected three or more points",
        ),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_weighted_fit_of_points_on_one_line_is_none():
    assert weighted_fit(LINE, T_TRUE.apply(LINE), np.tile(np.eye(3), (len(LINE), 1, 1))) is None
