"""Eq. 19-22 against numbers by hand, OpenCV's triangulation, dense least squares and Monte
Carlo.
"""

import cv2
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Camera, Rig, T_between
from trinolab.datasets import load_calibration, load_handle, load_rig, load_table1
from trinolab.rigid import nearest_rotation
from trinolab.triangulation import (
    depth_forms,
    mean_point,
    triangulate,
    triangulate_pair,
    triangulation_covariance,
)

IDENTITY = RigidTransform.identity()
BARREL = [-0.25, 0.12, 0.001, -0.0008, 0.02]
SHIPPED = ("paper_pair", "paper_trinocular", "raised_40deg")
MARKERS = np.concatenate(
    [T.apply(load_handle("paper").marker_centres) for T in load_table1().set_poses]
)
# exact pixels are rounded at 1e-13 px; the worst point of the shipped rigs is 5e-13 mm off
EXACT_MM = 1e-9

each_rig = pytest.mark.parametrize("name", SHIPPED)


def camera(name, fx, fy, cx, cy, T_world_cam=IDENTITY, size=(640, 480), distortions=(0,) * 5):
    return Camera(name, size, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], distortions, T_world_cam.inv())


def at(x, y, z, rotvec=(0, 0, 0)):
    return RigidTransform.from_components([x, y, z], Rotation.from_rotvec(rotvec))


def project(rig, points):
    return np.stack([c.project(points) for c in rig.cameras])


def moved(rig, T_new_old):
    """The same rig with its cameras given in another world frame."""
    return Rig(
        tuple(
            Camera(c.name, c.size, c.matrix, c.distortions, c.T_cam_world * T_new_old.inv())
            for c in rig.cameras
        )
    )


def eq20_as_printed(xy_left, xy_right, R, T, f_left, f_right):
    """Both z of Eq. 20, letter by letter, for one point; image coordinates in px from the principal
    point.
    """
    (X_l, Y_l), (X_r, Y_r) = xy_left, xy_right
    (r1, r2, r3), (r4, r5, r6), (r7, r8, r9) = R
    t_x, t_y, t_z = T
    common = r7 * X_l + r8 * Y_l + r9 * f_left
    first = (
        f_left
        * (f_right * t_x - X_r * t_z)
        / (X_r * common - f_right * (r1 * X_l + r2 * Y_l + r3 * f_left))
    )
    second = (
        f_left
        * (f_right * t_y - Y_r * t_z)
        / (Y_r * common - f_right * (r4 * X_l + r5 * Y_l + r6 * f_left))
    )
    return first, second


def printed_points(left, right, T_right_left, points, form):
    """Points in the left camera's frame by one of Eq. 20's forms of z."""
    xy = left.normalise(left.project(points))
    numerator, denominator = depth_forms(xy, right.normalise(right.project(points)), T_right_left)
    return np.column_stack([xy, np.ones(len(xy))]) * (numerator / denominator)[:, form, None]


def assert_whitened(samples, covariance, atol):
    """The samples' covariance, whitened by the predicted one, is the identity."""
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    np.testing.assert_allclose(
        np.linalg.eigvalsh(np.cov((samples @ whiten.T).T)), 1.0, rtol=0, atol=atol
    )


# --- by hand
# --------------------------------------------------------------------------------------------------------

LEFT = camera("left", 800, 400, 320, 240)


@pytest.mark.parametrize(
    ("right", "uv_right"),
    [
        # centre (100, 0, 0): the point is at (-80, -30, 400); u = 1000 (-80/400) + 300, v = 500
        # (-30/400) + 200
        (camera("beside", 1000, 500, 300, 200, at(100, 0, 0)), (100, 162.5)),
        # centre (0, 50, 0): the point is at (20, -80, 400); u = 1000 (20/400) + 300, v = 500
        # (-80/400) + 200
        (camera("below", 1000, 500, 300, 200, at(0, 50, 0)), (350, 100)),
        # centre (320, 0, 300), looking along -x with x along the world's z: the point is at (100,
        # -30, 300); u = 900 (100/300) + 300, v = 600 (-30/300) + 200
        (camera("across", 900, 600, 300, 200, at(320, 0, 300, (0, -np.pi / 2, 0))), (600, 140)),
    ],
    ids=["beside", "below", "across"],
)
def test_a_point_computed_by_hand(right, uv_right):
    # u = 800 (20/400) + 320, v = 400 (-30/400) + 240
    point = triangulate_pair(LEFT, right, [(360, 210)], [uv_right])
    np.testing.assert_allclose(point, [(20, -30, 400)], rtol=0, atol=EXACT_MM)


# --- other algorithms
# -----------------------------------------------------------------------------------------------


def opencv_points(left, right, uv_left, uv_right):
    """cv2.undistortPoints and cv2.triangulatePoints, in the left camera's frame."""
    xy = [
        cv2.undistortPoints(
            uv[:, None],
            np.array(c.matrix),
            np.array(c.distortions),
            # OpenCV 4: (n, 1, 2)
            criteria=(cv2.TERM_CRITERIA_COUNT, 100, 0),
        ).reshape(-1, 2)
        for c, uv in ((left, uv_left), (right, uv_right))
    ]
    homogeneous = cv2.triangulatePoints(
        np.eye(3, 4), T_between(right, left).as_matrix()[:3], xy[0].T, xy[1].T
    )
    return (homogeneous[:3] / homogeneous[3]).T


@each_rig
@pytest.mark.parametrize("distortions", [(0,) * 5, BARREL], ids=["plain", "distorted"])
def test_exact_pixels_give_opencvs_points_and_the_truth(name, distortions):
    cameras = [
        Camera(c.name, c.size, c.matrix, distortions, c.T_cam_world) for c in load_rig(name).cameras
    ]
    for i, j in Rig(tuple(cameras)).pairs:
        left, right = cameras[i], cameras[j]
        uv = left.project(MARKERS), right.project(MARKERS)
        ours = triangulate_pair(left, right, *uv)
        np.testing.assert_allclose(ours, MARKERS, rtol=0, atol=EXACT_MM)
        reference = left.T_world_cam.apply(opencv_points(left, right, *uv))
        np.testing.assert_allclose(ours, reference, rtol=0, atol=EXACT_MM)  # worst 7e-13


def test_noisy_pixels_give_a_point_close_to_opencvs():
    left, right = load_rig("paper_pair").cameras
    rng = np.random.default_rng(0)
    uv = [c.project(MARKERS) + rng.normal(0, 0.1, (len(MARKERS), 2)) for c in (left, right)]
    gap = np.linalg.norm(
        triangulate_pair(left, right, *uv) - opencv_points(left, right, *uv), axis=1
    )
    # They share the error across the epipolar line in different ways. A pixel is 0.19 mm wide at
    # the handle, so 0.1 px of noise moves a point sideways by about 0.02 mm; four times that bounds
    # 240 points. (It moves z by 0.1 mm.)
    assert gap.max() < 0.08
    assert gap.max() > 1e-3  # they are two algorithms


def test_noisy_z_is_the_least_squares_solution_of_both_forms():
    rig = load_rig("raised_40deg")
    rng = np.random.default_rng(1)
    for i, j in rig.pairs:
        left, right = rig.cameras[i], rig.cameras[j]
        uv = [c.project(MARKERS[:20]) + rng.normal(0, 0.5, (20, 2)) for c in (left, right)]
        xy = left.normalise(uv[0]), right.normalise(uv[1])
        z = left.T_cam_world.apply(triangulate_pair(left, right, *uv))[:, 2]
        T = T_between(right, left)
        for (x, y), (X, Y), found in zip(*xy, z, strict=True):
            # X_r = R X_l + T and x_r = X_r/z_r, y_r = Y_r/z_r, as two linear equations in z
            ray, t = T.rotation.apply([x, y, 1]), T.translation
            A, b = (
                [[ray[0] - X * ray[2]], [ray[1] - Y * ray[2]]],
                [X * t[2] - t[0], Y * t[2] - t[1]],
            )
            # mm; z is 600 mm, condition 1
            assert found == pytest.approx(np.linalg.lstsq(A, b)[0][0], abs=1e-7)


def test_z_reproduces_the_right_pixel_best_along_the_left_ray():
    # The forms weigh the two axes by the depth only, so the optimum of the reprojection error lies
    # close by.
    left, right = load_rig("paper_trinocular").cameras[1:]
    rng = np.random.default_rng(2)
    uv = [c.project(MARKERS[:5]) + rng.normal(0, 0.1, (5, 2)) for c in (left, right)]
    rays, points = left.rays(uv[0]), triangulate_pair(left, right, *uv)
    for ray, point, seen in zip(rays, points, uv[1], strict=True):
        distance = np.linalg.norm(point - left.centre)
        # on the left ray
        np.testing.assert_allclose(left.centre + distance * ray, point, rtol=0, atol=EXACT_MM)

        def cost(s, ray=ray, seen=seen):
            return ((right.project([left.centre + s[0] * ray])[0] - seen) ** 2).sum()

        best = minimize(
            cost, [distance + 0.5], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-12}
        ).x[0]
        # mm; the noise moves the point by 0.02 mm, the weights by 0.1 px in 3000
        assert abs(best - distance) < 2e-4


# --- Eq. 20 as printed
# ----------------------------------------------------------------------------------------------


@each_rig
def test_both_printed_forms_agree_with_each_other_and_the_truth(name):
    rig = load_rig(name)
    for i, j in rig.pairs:
        # one focal length a camera, as the paper has it
        left, right = (
            camera(c.name, f, f, 600, 500, c.T_world_cam, (1280, 1024))
            for c, f in ((rig.cameras[i], 2956.0), (rig.cameras[j], 2939.0))
        )
        T = T_between(right, left)
        X_l, X_r = (
            left.project(MARKERS) - left.principal_point,
            right.project(MARKERS) - right.principal_point,
        )
        printed = np.array(
            [
                eq20_as_printed(a, b, T.rotation.as_matrix(), T.translation, 2956.0, 2939.0)
                for a, b in zip(X_l, X_r, strict=True)
            ]
        )
        truth = left.T_cam_world.apply(MARKERS)[:, 2]
        # mm; the form that the baseline hardly supports loses three digits: worst 9e-10
        np.testing.assert_allclose(printed, np.column_stack([truth, truth]), rtol=0, atol=1e-8)
        numerator, denominator = depth_forms(X_l / 2956.0, X_r / 2939.0, T)
        np.testing.assert_allclose(numerator / denominator, printed, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("centre", "lost"), [((0, 100, 0), 0), ((100, 0, 0), 1)], ids=["vertical", "horizontal"]
)
def test_a_form_fails_where_the_baseline_has_no_component_along_its_axis(centre, lost):
    left, right = camera("a", 800, 800, 320, 240), camera("b", 800, 800, 320, 240, at(*centre))
    points = np.array([(20.0, -30.0, 400.0), (-5.0, 12.0, 500.0)])
    uv = left.project(points), right.project(points)
    numerator, denominator = depth_forms(
        left.normalise(uv[0]), right.normalise(uv[1]), T_between(right, left)
    )
    assert np.abs(numerator[:, lost]).max() == 0  # 0/0: the form says nothing
    assert np.abs(denominator[:, lost]).max() < 1e-15  # rounding of normalised coordinates below 1
    good = 1 - lost
    np.testing.assert_allclose(
        numerator[:, good] / denominator[:, good], points[:, 2], rtol=0, atol=EXACT_MM
    )
    np.testing.assert_allclose(triangulate_pair(left, right, *uv), points, rtol=0, atol=EXACT_MM)


def test_noise_ruins_the_form_that_the_baseline_does_not_support():
    rng = np.random.default_rng(3)

    def medians(rig, i, j):
        left, right = rig.cameras[i], rig.cameras[j]
        xy = [
            c.normalise(c.project(MARKERS) + rng.normal(0, 0.05, (len(MARKERS), 2)))
            for c in (left, right)
        ]
        numerator, denominator = depth_forms(*xy, T_between(right, left))
        truth = left.T_cam_world.apply(MARKERS)[:, 2:]
        both = (numerator * denominator).sum(1) / (denominator**2).sum(1)
        return np.median(np.abs(np.column_stack([numerator / denominator, both]) - truth), axis=0)

    first, second, both = medians(load_rig("paper_pair"), 0, 1)
    assert second > 100 * first  # 12.7 mm against 0.054 mm over many draws
    assert both < 1.1 * first
    first, second, both = medians(load_rig("raised_40deg"), 0, 2)
    assert first > 10 * second  # 0.48 mm against 0.02 mm
    assert both < 1.1 * second


def test_eq25s_motion_put_straight_into_eq20_misses_by_48_mm():
    left, right = load_rig("paper_pair").cameras
    positions = load_table1().set_poses.translation
    _, _, R_rl, T_rl = load_calibration()
    right_to_left = RigidTransform.from_components(T_rl, nearest_rotation(R_rl))
    miss = np.linalg.norm(
        printed_points(left, right, right_to_left, positions, 0) - positions, axis=1
    )
    assert miss.mean() == pytest.approx(47.9, abs=0.1)  # mm; two programs gave 48 and at most 124
    assert miss.max() == pytest.approx(124.0, abs=0.1)
    for form in (0, 1):
        inverted = printed_points(left, right, right_to_left.inv(), positions, form)
        # the second form loses three digits
        np.testing.assert_allclose(inverted, positions, rtol=0, atol=1e-8)


# --- change of frame and mean
# ---------------------------------------------------------------------------------------


def test_pair_2_3_is_carried_to_ccd1s_frame():
    rig = load_rig("raised_40deg")
    ccd1, ccd2, ccd3 = rig.cameras
    T_12 = T_between(ccd1, ccd2)  # Eq. 21's R_rl1, T_rl1
    in_ccd2 = printed_points(ccd2, ccd3, T_between(ccd3, ccd2), MARKERS, 1)
    by_hand = in_ccd2 @ T_12.rotation.as_matrix().T + T_12.translation
    ours = triangulate_pair(ccd2, ccd3, ccd2.project(MARKERS), ccd3.project(MARKERS))
    np.testing.assert_allclose(ours, by_hand, rtol=0, atol=EXACT_MM)
    # mm; 13.7: without it the test would see it
    assert np.linalg.norm(in_ccd2 - ours, axis=1).min() > 10


@each_rig
def test_points_move_along_with_the_world(name):
    rig = load_rig(name)
    T_new_old = at(-210, 340, 95, (0.7, -1.1, 2.0))
    uv = project(rig, MARKERS)
    there = triangulate(moved(rig, T_new_old), uv)
    np.testing.assert_allclose(there, T_new_old.apply(triangulate(rig, uv)), rtol=0, atol=EXACT_MM)
    np.testing.assert_allclose(there, T_new_old.apply(MARKERS), rtol=0, atol=EXACT_MM)


def test_mean_leaves_out_the_pairs_that_have_no_point():
    nan = (np.nan,) * 3
    points = [
        [(0, 0, 3), (1, 2, 3), nan],
        [(3, 0, 0), nan, nan],
        [(0, 3, 0), (3, 2, 1), (1, np.nan, 1)],
    ]
    np.testing.assert_array_equal(mean_point(points), [(1, 1, 1), (2, 2, 2), nan])


def test_triangulate_averages_the_pairs_that_see_a_marker():
    rig = load_rig("raised_40deg")
    rng = np.random.default_rng(4)
    uv = project(rig, MARKERS[:8]) + rng.normal(0, 0.3, (3, 8, 2))
    # seen by: all; all but one; one camera only (two ways); none
    hidden = {1: [0], 2: [1], 3: [2], 4: [0, 1], 5: [1, 2], 6: [0, 1, 2]}
    for marker, cameras in hidden.items():
        uv[cameras, marker] = np.nan
    points = triangulate(rig, uv)
    for marker in range(8):
        seen = [c for c in range(3) if c not in hidden.get(marker, [])]
        each = [
            triangulate_pair(rig.cameras[i], rig.cameras[j], uv[i, [marker]], uv[j, [marker]])[0]
            for i in seen
            for j in seen
            if i < j
        ]
        expected = sum(each) / len(each) if each else np.full(3, np.nan)
        np.testing.assert_allclose(points[marker], expected, rtol=0, atol=EXACT_MM)


def test_no_marker_gives_no_point():
    rig = load_rig("paper_trinocular")
    assert triangulate(rig, np.empty((3, 0, 2))).shape == (0, 3)
    assert triangulation_covariance(rig, np.empty((3, 0, 2)), 0.1).shape == (0, 3, 3)


# --- what gives no point
# --------------------------------------------------------------------------------------------

SIDE = camera("side", 800, 800, 320, 240, at(100, 0, 0))


@pytest.mark.parametrize(
    ("uv_left", "uv_right"),
    [
        ((350, 240), (350, 240)),  # parallel rays
        ((340, 240), (360, 240)),  # rays that meet behind both cameras
        ((np.nan, 240), (300, 240)),
        ((340, 240), (300, np.nan)),
    ],
    ids=["parallel", "diverging", "left missing", "right missing"],
)
def test_no_point_from_such_pixels(uv_left, uv_right):
    left = camera("left", 800, 800, 320, 240)
    points = triangulate_pair(left, SIDE, [uv_left, (340, 240)], [uv_right, (300, 240)])
    assert np.isnan(points[0]).all()
    # 800 * 100/40; 20/800 of it
    np.testing.assert_allclose(points[1], (20 * 5 / 2, 0, 2000), rtol=0, atol=EXACT_MM)


@pytest.mark.parametrize("swap", [False, True])
def test_a_point_behind_one_camera_is_no_point(swap):
    # B stands beyond the point and looks away from it: its ray through the pixel, prolonged
    # backwards, meets A's.
    A, B = camera("A", 800, 800, 320, 240), camera("B", 800, 800, 320, 240, at(100, 0, 600))
    # the point (20, 0, 400) lies at (-80, 0, -200) before B: u = 800 (-80/-200) + 320
    pixels = [[(360, 240)], [(640, 240)]]
    assert np.isnan(
        triangulate_pair(A, B, *pixels) if not swap else triangulate_pair(B, A, *pixels[::-1])
    ).all()


def test_the_limit_of_parallel_rays_is_far_away():
    left = camera("left", 800, 800, 320, 240)
    # 10 km, 1e-5 rad between the rays; 1e-10 rad
    points = np.array([(0.0, 0.0, 1e7), (0.0, 0.0, 1e12)])
    found = triangulate_pair(left, SIDE, left.project(points), SIDE.project(points))
    # mm; rounding of 1e-16 over 1e-5 rad, times 1e7 mm: 1e-4
    assert found[0, 2] == pytest.approx(1e7, abs=1)
    assert np.isnan(found[1]).all()


def test_inverted_extrinsics_do_not_pass_unseen():
    # A parallel rig with the sign of its baseline wrong reprojects exactly, every depth negative.
    left = camera("left", 800, 800, 320, 240)
    wrong = camera("wrong", 800, 800, 320, 240, at(-100, 0, 0))
    points = np.array([(20.0, -30.0, 400.0), (-40.0, 15.0, 500.0)])
    assert np.isnan(triangulate_pair(left, wrong, left.project(points), SIDE.project(points))).all()


# --- covariance
# -----------------------------------------------------------------------------------------------------


def test_covariance_of_a_parallel_pair_by_hand():
    # z = f B/(u_l - u_r), x = z (u_l - cx)/f, y = z (v_l - cy)/f on the left axis: x, y = 0, u_l -
    # u_r = f B/z = 200
    left = camera("left", 800, 800, 320, 240)
    covariance = triangulation_covariance(Rig((left, SIDE)), [[(320, 240)], [(120, 240)]], 0.1)[0]
    sigma_z, sigma_x = 400**2 / (800 * 100) * np.sqrt(2) * 0.1, 400 / 800 * 0.1
    shared = 400**2 / (800 * 100) * 0.1 * sigma_x  # u_l moves x up and z down
    expected = [[sigma_x**2, 0, -shared], [0, sigma_x**2, 0], [-shared, 0, sigma_z**2]]
    # mm^2; the differences are good to 1e-11
    np.testing.assert_allclose(covariance, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("hidden", [None, 0, 1, 2])
def test_covariance_against_monte_carlo(hidden):
    rig, sigma, draws = load_rig("raised_40deg"), 0.1, 5000
    uv = project(rig, MARKERS[:1])
    if hidden is not None:
        uv[hidden] = np.nan
    noise = np.random.default_rng(5).normal(0, sigma, (3, draws, 2))
    # Eigenvalues of 5000 whitened draws in 3 dimensions spread by 2 sqrt(3/5000) = 0.05; worst of
    # 20 seeds 0.063.
    assert_whitened(
        triangulate(rig, uv + noise), triangulation_covariance(rig, uv, sigma)[0], atol=0.09
    )


def test_covariance_follows_the_noise_and_is_nan_without_a_point():
    rig = load_rig("paper_trinocular")
    uv = project(rig, MARKERS[:3])
    uv[:2, 1] = np.nan
    one, three = triangulation_covariance(rig, uv, 0.1), triangulation_covariance(rig, uv, 0.3)
    assert np.isnan(one[1]).all()
    # mm^2; entries below 0.01
    np.testing.assert_allclose(three[[0, 2]], 9 * one[[0, 2]], rtol=0, atol=1e-12)
    seen_by_none = np.full((3, 2, 2), np.nan)
    assert np.isnan(triangulation_covariance(rig, seen_by_none, 0.1)).all()


# --- a caller's mistakes
# --------------------------------------------------------------------------------------------

PAIR = load_rig("paper_pair")
CCD1, CCD2 = PAIR.cameras
TWO = np.zeros((2, 2))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: depth_forms(np.zeros((2, 3)), TWO, IDENTITY),
            r"xy_left: expected shape \(n, 2\), got \(2, 3\)",
        ),
        (
            lambda: depth_forms(TWO, np.zeros((3, 2)), IDENTITY),
            r"xy_right: expected shape \(2, 2\), got \(3, 2\)",
        ),
        (
            lambda: depth_forms(TWO, TWO, np.eye(4)),
            "T_right_left: expected one RigidTransform, got ndarray",
        ),
        (
            lambda: triangulate_pair(CCD1, CCD2, np.zeros(2), TWO),
            r"uv_left: expected shape \(n, 2\), got \(2,\)",
        ),
        (
            lambda: triangulate_pair(CCD1, CCD2, TWO, np.zeros((2, 3))),
            r"uv_right: expected shape \(2, 2\), got \(2, 3\)",
        ),
        (
            lambda: triangulate_pair(CCD1, CCD2, TWO, np.zeros((3, 2))),
            r"uv_right: expected shape \(2, 2\), got \(3, 2\)",
        ),
        (
            lambda: triangulate_pair(LEFT, LEFT, TWO, TWO),
            "cameras left and left: expected two places, got one",
        ),
        (
            lambda: triangulate(PAIR, np.zeros((3, 4, 2))),
            r"uv: expected shape \(2, n, 2\), got \(3, 4, 2\)",
        ),
        (lambda: mean_point(TWO), r"points: expected shape \(n, n, 3\), got \(2, 2\)"),
        (
            lambda: triangulation_covariance(PAIR, np.zeros((2, 4)), 0.1),
            r"uv: expected shape \(2, n, 2\), got \(2, 4\)",
        ),
        (
            lambda: triangulation_covariance(PAIR, np.zeros((2, 4, 2)), 0.0),
            r"sigma_px: expected a number in \(0, 1e\+06\]",
        ),
        (
            lambda: triangulation_covariance(PAIR, np.zeros((2, 4, 2)), np.nan),
            "sigma_px: expected a number",
        ),
        (
            lambda: triangulation_covariance(PAIR, np.zeros((2, 4, 2)), 0.1, 0.0),
            "step_px: expected a number",
        ),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
