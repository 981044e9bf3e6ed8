"""Eq. 19-22 against exact pixels, numbers by hand, dense least squares and Monte Carlo."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.camera import Camera, Rig, T_between
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.triangulation import (
    depth_forms,
    mean_point,
    triangulate,
    triangulate_pair,
    triangulate_weighted,
    triangulation_covariance,
)

IDENTITY = RigidTransform.identity()
BARREL = [-0.25, 0.12, 0.001, -0.0008, 0.02]
MARKERS = np.concatenate(
    [T.apply(load_handle("paper").marker_centres) for T in load_table1().set_poses]
)
# exact pixels are rounded at 1e-13 px; the worst point of the shipped rigs is 5e-13 mm off
EXACT_MM = 1e-9

each_rig = pytest.mark.parametrize("name", ["paper_pair", "paper_trinocular", "raised_40deg"])


def camera(name, fx, fy, cx, cy, T_world_cam=IDENTITY, size=(640, 480), distortions=(0,) * 5):
    return Camera(name, size, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], distortions, T_world_cam.inv())


def at(x, y, z, rotvec=(0, 0, 0)):
    return RigidTransform.from_components([x, y, z], Rotation.from_rotvec(rotvec))


def project(rig, points):
    return np.stack([c.project(points) for c in rig.cameras])


def assert_whitened(samples, covariance, atol):
    """The samples' covariance, whitened by the predicted one, is the identity."""
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    assert_allclose(np.linalg.eigvalsh(np.cov((samples @ whiten.T).T)), 1.0, rtol=0, atol=atol)


LEFT = camera("left", 800, 400, 320, 240)


def test_a_point_computed_by_hand():
    # centre (320, 0, 300), looking along -x with x along the world's z: the point is at (100, -30,
    # 300); u = 900 (100/300) + 300, v = 600 (-30/300) + 200
    right = camera("across", 900, 600, 300, 200, at(320, 0, 300, (0, -np.pi / 2, 0)))
    # u = 800 (20/400) + 320, v = 400 (-30/400) + 240
    point = triangulate_pair(LEFT, right, [(360, 210)], [(600, 140)])
    assert_allclose(point, [(20, -30, 400)], rtol=0, atol=EXACT_MM)


@each_rig
@pytest.mark.parametrize("distortions", [(0,) * 5, BARREL], ids=["plain", "distorted"])
def test_exact_pixels_give_the_truth_by_both_forms(name, distortions):
    """In a world that is no camera's frame."""
    M = at(-210, 340, 95, (0.7, -1.1, 2.0))
    cameras = [
        Camera(c.name, c.size, c.matrix, distortions, c.T_cam_world * M.inv())
        for c in load_rig(name).cameras
    ]
    points = M.apply(MARKERS)
    for i, j in Rig(tuple(cameras)).pairs:
        left, right = cameras[i], cameras[j]
        uv = left.project(points), right.project(points)
        ours = triangulate_pair(left, right, *uv)
        assert_allclose(ours, points, rtol=0, atol=EXACT_MM)
        xy = left.normalise(uv[0]), right.normalise(uv[1])
        numerator, denominator = depth_forms(*xy, T_between(right, left))
        z = left.T_cam_world.apply(points)[:, 2:]
        # mm; the form that the baseline hardly supports loses three digits: worst 9e-10
        assert_allclose(numerator / denominator, z * [1, 1], rtol=0, atol=1e-8)


def test_noisy_points_are_the_least_squares_solution_of_both_forms_on_the_left_ray():
    rig = load_rig("raised_40deg")
    rng = np.random.default_rng(1)
    for i, j in rig.pairs:
        left, right = rig.cameras[i], rig.cameras[j]
        uv = [c.project(MARKERS[:20]) + rng.normal(0, 0.5, (20, 2)) for c in (left, right)]
        xy = left.normalise(uv[0]), right.normalise(uv[1])
        points = left.T_cam_world.apply(triangulate_pair(left, right, *uv))
        T = T_between(right, left)
        for (x, y), (X, Y), found in zip(*xy, points, strict=True):
            # X_r = R X_l + T and x_r = X_r/z_r, y_r = Y_r/z_r, as two linear equations in z
            ray, t = T.rotation.apply([x, y, 1]), T.translation
            A, b = (
                [[ray[0] - X * ray[2]], [ray[1] - Y * ray[2]]],
                [X * t[2] - t[0], Y * t[2] - t[1]],
            )
            # mm; z is 600 mm, condition 1
            assert found == pytest.approx(
                np.linalg.lstsq(A, b)[0][0] * np.array([x, y, 1]), abs=1e-7
            )


def test_triangulate_averages_the_pairs_that_see_a_marker():
    rig = load_rig("raised_40deg")
    uv = project(rig, MARKERS[:8]) + np.random.default_rng(4).normal(0, 0.3, (3, 8, 2))
    # seen by: all; all but one; one camera only (two ways); none
    hidden = {1: [0], 2: [1], 3: [2], 4: [0, 1], 5: [1, 2], 6: [0, 1, 2]}
    for marker, cameras in hidden.items():
        uv[cameras, marker] = np.nan
    points = triangulate(rig, uv)
    for marker in range(8):
        each = [
            triangulate_pair(rig.cameras[i], rig.cameras[j], uv[i, [marker]], uv[j, [marker]])[0]
            for i, j in rig.pairs
            if not {i, j} & set(hidden.get(marker, []))
        ]
        expected = sum(each) / len(each) if each else np.full(3, np.nan)
        assert_allclose(points[marker], expected, rtol=0, atol=EXACT_MM)
        mean = mean_point([[p] for p in each] or [[expected]])
        assert_allclose(mean, [expected], rtol=0, atol=EXACT_MM)
    assert triangulate(rig, np.empty((3, 0, 2))).shape == (0, 3)
    assert triangulation_covariance(rig, np.empty((3, 0, 2)), 0.1).shape == (0, 3, 3)


PLAIN = camera("left", 800, 800, 320, 240)
SIDE = camera("side", 800, 800, 320, 240, at(100, 0, 0))
# beyond the points and looking away from them: its ray, prolonged backwards, meets the other's
BEYOND = camera("beyond", 800, 800, 320, 240, at(100, 0, 600))
NO_POINT = {
    "parallel": (PLAIN, SIDE, (350, 240), (350, 240)),
    "diverging": (PLAIN, SIDE, (340, 240), (360, 240)),
    # as by extrinsics whose baseline has the wrong sign: it reprojects exactly, at a negative depth
    "behind both": (SIDE, PLAIN, (360, 180), (160, 180)),
    "left missing": (PLAIN, SIDE, (np.nan, 240), (300, 240)),
    "right missing": (PLAIN, SIDE, (340, 240), (300, np.nan)),
    # the point (20, 0, 400) lies at (-80, 0, -200) before it: u = 800 (-80/-200) + 320
    "behind right": (PLAIN, BEYOND, (360, 240), (640, 240)),
    "behind left": (BEYOND, PLAIN, (640, 240), (360, 240)),
    # 10^12 mm away: 1e-10 rad between the rays
    "nearly parallel": (PLAIN, SIDE, (320, 240), (320 - 8e-8, 240)),
}


@pytest.mark.parametrize("case", NO_POINT)
def test_no_point_from_such_pixels(case):
    left, right, uv_left, uv_right = NO_POINT[case]
    good = np.array([[20.0, 0.0, 2000.0]])
    points = triangulate_pair(
        left,
        right,
        np.vstack([[uv_left], left.project(good)]),
        np.vstack([[uv_right], right.project(good)]),
    )
    assert np.isnan(points[0]).all()
    assert_allclose(points[1], good[0], rtol=0, atol=EXACT_MM)


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
    uv[:2] = np.nan
    assert np.isnan(triangulation_covariance(rig, uv, sigma)).all()


def test_weights_are_the_inverse_covariances_of_the_pairs():
    """The mean by the formula, and its covariance, of pairs that share pixels, by draws."""
    rig, draws = load_rig("raised_40deg"), 5000
    sigma = np.repeat([[0.05], [0.1], [0.2]], draws, axis=1)
    noise = sigma[..., None] * np.random.default_rng(6).normal(size=(3, draws, 2))
    uv = project(rig, MARKERS[:1]) + noise
    uv[2, 0] = uv[1:, 1] = np.nan
    points, covariances = triangulate_weighted(rig, uv, sigma)
    alone = [
        triangulate_weighted(rig.part([i, j]), uv[[i, j], :3], sigma[[i, j], :3])
        for i, j in rig.pairs
    ]
    assert_allclose(points[0], alone[0][0][0], rtol=0, atol=EXACT_MM)
    assert np.isnan(points[1]).all()
    assert np.isnan(covariances[1]).all()
    weights = [np.linalg.inv(covariance[2]) for _, covariance in alone]
    pulled = sum(W @ point[2] for W, (point, _) in zip(weights, alone, strict=True))
    assert_allclose(points[2], np.linalg.solve(sum(weights), pulled), atol=1e-7)
    # as above
    assert_whitened(points[2:], covariances[2:].mean(axis=0), atol=0.09)


PAIR = load_rig("paper_pair")
TWO = np.zeros((2, 2))
FOUR = np.zeros((2, 4, 2))


REFUSED = [
    (depth_forms, (np.zeros((2, 3)), TWO, IDENTITY), r"xy_left: expected shape \(n, 2\)"),
    (depth_forms, (TWO, TWO, np.eye(4)), "T_right_left: expected one RigidTransform"),
    (triangulate_pair, (LEFT, LEFT, TWO, TWO), "cameras left and left: expected two places"),
    (triangulate, (PAIR, np.zeros((3, 4, 2))), r"uv: expected shape \(2, n, 2\)"),
    (triangulate, ("paper_pair", FOUR), "rig: expected a Rig, as trinolab.load_rig gives"),
    (triangulation_covariance, (PAIR, FOUR, 0.0), r"sigma_px: expected .* in \(0, 1e\+06\]"),
    (triangulation_covariance, (PAIR, FOUR, 0.1, 0.0), r"step_px: expected .* in \[1e-06, 1\]"),
]


@pytest.mark.parametrize(("call", "given", "message"), REFUSED)
def test_mistakes_are_named(call, given, message):
    with pytest.raises(ValueError, match=message):
        call(*given)
