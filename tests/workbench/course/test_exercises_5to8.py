"""Chapters 5 to 8: functions agree with the package's or with another algorithm, and values and the
numbers in the solutions' texts with other ways to compute them.
"""

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import j1
from solutions import agrees, broken

from trinolab import datasets, identity, matching, measurement, metrics, pose, triangulation
from trinolab.bench import optics, scene
from trinolab.calibration import eq25, start
from trinolab.camera import Camera, epipolar_lines, fundamental_matrix
from trinolab.handle import facing_pixels
from trinolab.parameters import Parameters
from workbench.course.exercises import exercise
from workbench.course.grading import call_of

PLACES = datasets.load_table1().set_poses
RIG, ROD = datasets.load_rig("paper_pair"), datasets.load_handle("paper")


def two_cameras(K_left, K_right, R, T):
    """The package's cameras, the left one's frame the world."""
    motions = RigidTransform.identity(), RigidTransform.from_components(T, Rotation.from_matrix(R))
    pairs = zip(("left", "right"), (K_left, K_right), motions, strict=True)
    return [Camera(name, (1280, 1024), K, np.zeros(5), motion) for name, K, motion in pairs]


# Chapter 5


def test_the_longest_plateau_by_another_labelling():
    """SciPy's labels, and a plain search for the longest run."""

    def longest_run(image):
        image = np.array(image)
        counts = [ndimage.label(image > t, np.ones((3, 3)))[1] for t in range(image.max())]
        runs = [
            (first - last, first)  # the longest, and of these the lowest, is the smallest
            for first in range(len(counts))
            for last in range(first, len(counts))
            if len(set(counts[first : last + 1])) == 1 and counts[first] >= 4
        ]
        if not runs:
            return np.nan
        negative, first = min(runs)
        return first - negative / 2

    asked = exercise("05.3")
    for (image,) in call_of(asked).cases:
        assert np.array_equal(asked.solution(image), longest_run(image), equal_nan=True)


def test_bias_scatter_and_thresholds():
    """The bias by adding up strips, the search step by step."""
    rho, radius, theta = 0.75, 5.0, np.deg2rad(65)
    a = np.linspace(-rho, rho, 100_001)
    weight = np.sqrt(rho**2 - a**2) * np.cos(theta + a / radius)
    place = radius * np.sin(theta + a / radius)
    off_mm = radius * np.sin(theta) - (place * weight).sum() / weight.sum()
    agrees("05.1", share=0.5, bias_px=off_mm * 5.214)

    def scatter(R, sigma):
        return sigma * (R + 2) ** 2 / (2 * np.sqrt(np.pi) * R**2 * 120)

    agrees("05.1", scatter_px=scatter(3.9, 3.1))
    agrees("05.4", scatter_px=scatter(7.8, np.sqrt(0.05 * 150 + 6.0**2)))

    low, high, thresholds = 45.0, 220.0, []
    while high - low >= 1:
        high = (low + high) / 2
        thresholds.append(high)
    agrees("05.2", thresholds=len(thresholds), last_threshold=high)
    agrees("05.2", first_count=8 if thresholds[0] > 120 else 4, last_count=8 if high > 120 else 4)


def test_centroids_that_are_moved():
    truth = PLACES[9]
    frames = scene.render_rig(RIG, ROD, truth, optics.Bench(), np.random.default_rng(0))
    seen = measurement.measure(frames, RIG, ROD, truth, Parameters(estimator="paper"))
    uv = identity.labelled_pixels(seen.labels, [spots.uv for spots in seen.markers], 12)
    T = seen.pose.T_world_handle
    epsilon = 0.3
    share = 1 - (j1(2 * epsilon) / (2 * epsilon)) / (j1(epsilon) / epsilon)
    centres = T.apply(ROD.marker_centres)
    off = []
    for camera, found in zip(RIG.cameras, uv, strict=True):
        e = np.cross(T.rotation.apply([0, 1, 0]), camera.centre - centres)
        e /= np.linalg.norm(e, axis=1, keepdims=True)
        sine = (T.rotation.apply(np.array(ROD.marker_normals)) * e).sum(axis=1, keepdims=True)
        moved = found + camera.project(centres) - camera.project(centres - 5 * sine * share * e)
        true = camera.project(truth.apply(ROD.marker_centres))
        off.append(np.linalg.norm([found - true, moved - true], axis=2))
    before, after = np.sqrt(np.nanmean(np.square(off), axis=(0, 2)))
    agrees("05.5", before_px=before, after_px=after)


def test_centroids_to_the_upper_left():
    v, u = np.indices((31, 31))

    def off(function, radius, noise=0.0):
        inside = np.clip(radius + 0.5 - np.hypot(u - 15, v - 15), 0, 1)
        ground = noise * np.random.default_rng(0).random(u.shape)
        return function(45 + ground + 175 * inside, 15, 15, 6) - 15

    asked = exercise("05.6")
    assert np.allclose(off(broken("05.6"), 3.0), 0)
    assert np.all((off(broken("05.6"), 6.0) < -0.05) & (off(broken("05.6"), 6.0) > -0.5))
    assert np.all(off(broken("05.6"), 3.0, noise=12.0) < -0.01)
    assert np.allclose(off(asked.solution, 6.0), 0)
    for image, column, row, half in call_of(asked).cases:
        window = image[row - half : row + half + 1, column - half : column + half + 1]
        y, x = ndimage.center_of_mass(window - window.min())
        assert np.allclose(
            asked.solution(image, column, row, half), [column - half + x, row - half + y]
        )


# Chapter 6


def test_epipolar_lines_are_the_package_s_and_scatter_as_expected():
    """Noise is drawn for the scatter, on a pair that is right but for it."""
    line, scatter = exercise("06.3").solution, exercise("06.5").solution
    rng = np.random.default_rng(1)
    for K_left, K_right, R, T, uv in call_of(exercise("06.3")).cases:
        left, right = two_cameras(K_left, K_right, R, T)
        ours, theirs = line(K_left, K_right, R, T, uv), epipolar_lines(left, right, [uv])[0]
        assert np.allclose(ours, np.sign(ours @ theirs) * theirs, rtol=0, atol=1e-6)  # px
        a, b, c = ours
        other = np.array([-a * c, -b * c]) + rng.uniform(-300, 300) * np.array([-b, a])
        sigma = 0.1
        drawn = [place + rng.normal(0, sigma, (4000, 2)) for place in (uv, other)]
        lines = epipolar_lines(left, right, drawn[0])
        off = (lines * np.column_stack([drawn[1], np.ones(4000)])).sum(axis=1)
        expected = scatter(fundamental_matrix(left, right), uv, other, sigma)
        assert abs(off.std() / expected - 1) < 0.05


def test_noise_costs_the_correlation_that_is_expected():
    rng = np.random.default_rng(0)
    solution = exercise("06.4").solution
    for scatter, left, right in ((9.0, 3.0, 3.0), (20.0, 5.0, 30.0)):
        patch = rng.normal(120, scatter, (400, 400))
        views = [patch + rng.normal(0, sigma, patch.shape) for sigma in (left, right)]
        assert abs(matching.ncc(*views) - solution(patch, left, right)) < 0.005
    assert abs(solution([[9.0, -9.0]], 3.0, 3.0) - 0.9) < 1e-12


def test_spots_and_nails():
    rng = np.random.default_rng(0)
    beside = np.abs(rng.uniform(0, 320, (100_000, 5)) - 160)
    wrong = exercise("06.1").asked["wrong"].value
    assert abs((beside < 2).sum(axis=1).mean() - wrong) < 4 * np.sqrt(wrong / 100_000)
    cameras = two_cameras(np.eye(3), np.eye(3), np.eye(3), [-100, 0, 0])
    steps = [np.diff(one.project([[50, 0, 550], [50, 0, 570]])[:, 0])[0] for one in cameras]
    agrees("06.2", share=1e-6, left_step=steps[0], right_step=steps[1])


def test_lines_miss_when_the_world_is_not_the_left_camera():
    rng = np.random.default_rng(0)
    R, T = Rotation.from_rotvec([0.02, -0.17, 0.01]).as_matrix(), np.array([-97.0, 2.0, 9.0])
    world = Rotation.from_rotvec(rng.normal(0, 0.3, 3)).as_matrix()
    shift = np.array([30.0, -200.0, 560.0])
    on_table = (world, shift, R @ world, R @ shift + T)
    for function, right in ((broken("06.8"), False), (exercise("06.8").solution, True)):
        assert np.allclose(function(np.eye(3), np.zeros(3), R, T)[1], T)
        assert np.allclose(function(*on_table)[1], T) is right
        assert np.allclose(function(*on_table)[0], R)


# Chapter 7


def test_the_square_lens_agrees_with_zhang_s():
    """With three positions and exact corners the lens with two focal lengths is the same."""
    asked = exercise("07.3")
    compared = 0
    for homographies, size in call_of(asked).cases:
        K = asked.solution(homographies, size)
        for H in homographies:  # what defines it: the columns become perpendicular, of one length
            a, b = (np.linalg.inv(K) @ H)[:, :2].T
            assert abs(a @ b) < 1e-9 * (a @ a)
            assert abs(a @ a - b @ b) < 1e-9 * (a @ a)
        if len(homographies) > 2:
            assert np.allclose(K, start.intrinsics(homographies, size), rtol=1e-6)
            compared += 1
    assert compared >= 2


def test_motions_and_positions_of_a_board():
    """The motion by the package, the number of positions by search."""
    found = {}
    for degrees in (0, 30):
        left = RigidTransform.identity()  # of the board, which is the left camera's frame
        rotation = Rotation.from_euler("y", degrees, degrees=True)
        right = RigidTransform.from_components([100, 0, 0], rotation).inv()
        found[degrees] = eq25.relative_pose(right, left).translation  # of the left in the right
    agrees("07.1", T_x=found[0][0], turned_x=found[30][0], turned_z=found[30][2])

    positions = np.arange(14, 1000)
    enough = positions[0.165 * np.sqrt(14 / positions) <= 0.031][0]
    agrees("07.2", positions=enough, noise_factor=np.sqrt(enough / 14))

    noise = 0.165 * np.sqrt(14)
    single, averaged = noise / np.sqrt(28), noise / np.sqrt(20 * 4)
    agrees("07.8", single_mm=single, averaged_mm=averaged, factor=np.hypot(1, 1))


# Chapter 8


def test_a_point_and_a_fit_are_the_package_s():
    """Points where there is one, and NaN where there is none; motions with the missing rows."""
    asked = exercise("08.3")
    found = []
    for xy_left, xy_right, R, T in call_of(asked).cases:
        left, right = two_cameras(np.eye(3), np.eye(3), R, T)
        theirs = triangulation.triangulate_pair(left, right, [xy_left], [xy_right])[0]
        ours = asked.solution(xy_left, xy_right, R, T)
        assert np.allclose(ours, theirs, rtol=0, atol=1e-9, equal_nan=True)  # mm
        found.append(bool(np.isfinite(ours).all()))
    assert (sum(found), len(found)) == (8, 13)

    asked = exercise("08.4")
    for on_rod, measured in call_of(asked).cases:
        theirs = pose.rigid_fit(on_rod, measured).as_matrix()
        assert np.allclose(asked.solution(on_rod, measured), theirs, rtol=0, atol=1e-9)


def test_the_midpoint_is_nearest_to_both_rays():
    """The point with the least sum of squared distances from both rays, by their projections."""
    asked = exercise("08.5")
    for rays in call_of(asked).cases:
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for centre, ray in (rays[:2], rays[2:]):
            across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
            normal, right = normal + across, right + across @ centre
        nearest = np.linalg.solve(normal, right)
        assert np.allclose(asked.solution(*rays), nearest, rtol=0, atol=1e-6)  # mm


def test_scatter_of_depth_and_a_baseline_with_the_other_sign():
    rng = np.random.default_rng(0)
    f, baseline, depth = 2950.0, 99.0, 570.0
    noise = rng.normal(0, 0.1, (2, 200_000))
    z = f * baseline / (f * baseline / depth + noise[0] - noise[1])
    agrees("08.1", sigma_z=z.std(), sigma_x=(z * noise[0] / f).std())

    K = np.diag([1000.0, 1000, 1])
    file = two_cameras(K, K, np.eye(3), [100, 0, 0])  # as it is in the file: at x = -100
    answer = exercise("08.2").answer
    images = [K @ one.T_cam_world.apply([answer["x"], 30, answer["z"]]) for one in file]
    assert np.allclose([uv[:2] / uv[2] for uv in images], [[50, -75], [-200, -75]])


def test_mirrored_fits():
    rng = np.random.default_rng(0)
    mirrored = {4: 0, 12: 0}
    for count in mirrored:
        rod = ROD.marker_centres[:count]
        for turn in Rotation.random(100, rng=rng):
            measured = rod @ turn.as_matrix().T + rng.normal(0, 0.05, (count, 3))
            of, on = (points - points.mean(axis=0) for points in (measured, rod))
            U, S, Vt = np.linalg.svd(of.T @ on)
            mirrored[count] += np.linalg.det(U @ Vt) < 0
            assert (S[2] < 1e-9 * S[0]) == (count == 4)
    agrees("08.6", of_four=mirrored[4], of_twelve="some" if mirrored[12] else "none")


def test_weights_help_against_noise_alone():
    """Exercise 8.7, in fewer draws."""
    rng = np.random.default_rng(0)
    rig = datasets.load_rig("raised_40deg")
    fits = [], []
    for T in PLACES:
        exact = np.stack([facing_pixels(ROD, camera, T, 70.0) for camera in rig.cameras])
        for _ in range(3):
            uv = exact + rng.normal(0, 0.1, exact.shape)
            plain = triangulation.triangulate(rig, uv)
            weighted, _ = triangulation.triangulate_weighted(rig, uv, 0.1)
            for some, points in zip(fits, (plain, weighted), strict=True):
                some.append(pose.rigid_fit(ROD.marker_centres, points))
    repeated = PLACES[np.repeat(np.arange(20), 3)]
    plain, weighted = (
        metrics.pose_errors(RigidTransform.concatenate(some), repeated).geodesic_mean_deg
        for some in fits
    )
    # 60 fits scatter twice as much as the 200 of the exercise
    agrees("08.7", noise_ratio=weighted / plain)


def test_a_camera_that_is_turned_by_5_degrees_is_off_by_10():
    turn = Rotation.from_rotvec([0, 5, 0], degrees=True)
    points = np.random.default_rng(0).normal(0, 50, (6, 3)) + [0, 0, 560]
    wrong = broken("08.8")(points, turn.as_matrix(), np.zeros(3))
    right = exercise("08.8").solution(points, turn.as_matrix(), np.zeros(3))
    assert np.allclose(right, turn.inv().apply(points))
    between, _ = Rotation.align_vectors(wrong, right)
    assert np.rad2deg(between.magnitude()) == pytest.approx(10)
