"""The number of distortion coefficients: by lenses that are known, by hand, and on real pairs."""

from dataclasses import replace

import numpy as np
import pytest
from boards import SIZE, corners, make_rig, positions
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration.adjust import Calibrated, calibrate
from trinolab.calibration.distortions import (
    Choice,
    as_lines,
    calibrate_by_choice,
    chosen,
    left_out_squares,
    spread_of_cameras,
)
from trinolab.calibration.target import Target
from trinolab.camera import Camera

TARGET = Target("chessboard", 7, 5, 15.0)
NAMES = ("a", "b")


def taken(lens, views):
    """Corners of the target in both cameras, px, with noise."""
    return corners(make_rig(np.array(lens)), positions(views), TARGET, 0.05)


WIDE = {  # by how far off the axis their points lie, deg: focal length, px, reach of the target, mm
    "five, to 47": ([-0.31, 0.11, 0, 0, -0.018], 640.0, (230, 160)),
    # as of a fisheye
    "rational, to 67": ([8.74, 3.67, 0, 0, 0.1084, 9.1, 6.62, 0.698], 380.0, (400, 300)),
}


def wide(lens, focal, reach, views, noise_px=0.1, seed=3):
    """Cameras of a wide lens, and where they see the target all over their images."""
    rng = np.random.default_rng(seed)
    size = (960, 720)
    cameras = [
        Camera.look_at(name, size, focal, [x, 0, 0], [0, 0, 330], distortions=lens)
        for name, x in zip(NAMES, (-60.0, 60.0), strict=True)
    ]
    board = Target("chessboard", 9, 6, 20.0)
    points = np.array(board.points) - np.mean(board.points, axis=0)
    uv = np.empty((2, views, len(points), 2))
    for v in range(views):
        R = Rotation.from_euler("xyz", rng.uniform(-1, 1, 3) * [35, 35, 12], degrees=True)
        place = rng.uniform(-1, 1, 3) * [*reach, 60] + [0, 0, 330]
        T = RigidTransform.from_components(place, R)
        for c, camera in enumerate(cameras):
            uv[c, v] = camera.project(T.apply(points))
            uv[c, v, ~camera.sees(T.apply(points))] = np.nan
    return board, cameras, uv + rng.normal(0, noise_px, uv.shape)


@pytest.mark.heavy
@pytest.mark.parametrize(("lens", "focal", "reach"), WIDE.values(), ids=WIDE)
def test_a_wide_lens_is_described_by_the_models_that_can(lens, focal, reach):
    board, cameras, uv = wide(lens, focal, reach, 20)
    sizes = [camera.size for camera in cameras]
    found, _, choice = calibrate_by_choice(board.points, uv, sizes, NAMES)
    assert choice.terms == (5 if len(lens) == 5 else 8)
    assert found.sigma_px == pytest.approx(0.1, rel=0.1)
    truth = (cameras[1].T_cam_world * cameras[0].T_world_cam).inv()
    off = found.cameras[1].centre - truth.translation
    assert (np.abs(off) < 4 * np.sqrt(np.diag(found.relative_covariance(1))[:3])).all()
    focal_off = found.cameras[0].focal - focal
    assert (np.abs(focal_off) < 4 * found.intrinsic_sigma[0, :2]).all()


@pytest.mark.slow
def test_views_left_out_are_judged_by_cameras_calibrated_from_nothing_without_them():
    """Another way: Zhang's start for each part, and SciPy's least squares for the target's pose."""
    uv = taken((-0.2, 0.0, 0.0, 0.0, 0.0), 7)
    uv[1, 4, ::3] = np.nan
    points = np.array(TARGET.points)
    squares = left_out_squares(points, uv, calibrate(points, uv, [SIZE] * 2, NAMES, 2))
    for part in range(5):
        left_out = np.arange(part, 7, 5)
        others = calibrate(points, np.delete(uv, left_out, axis=1), [SIZE] * 2, NAMES, 2)
        for view in left_out:
            valid = np.isfinite(uv[:, view])

            def misfit(x, cameras=others.cameras, measured=uv[:, view], valid=valid):
                T = RigidTransform.from_components(x[:3], Rotation.from_rotvec(x[3:]))
                return (np.stack([c.project(T.apply(points)) for c in cameras]) - measured)[valid]

            true = positions(7)[view]
            start = np.concatenate([true.translation, true.rotation.as_rotvec()])
            plain = least_squares(misfit, start, method="lm", x_scale="jac", ftol=1e-13)
            assert squares[view] == pytest.approx(2 * plain.cost / (valid.sum() / 2), rel=1e-5)


def test_each_step_is_reported():
    uv = taken((0.0,) * 5, 6)
    steps = []
    _, _, choice = calibrate_by_choice(TARGET.points, uv, [SIZE] * 2, NAMES, steps.append)
    assert steps == [
        "camera a alone",
        "camera b alone",
        "all cameras together",
        *(f"distortions: {terms}" for terms in (0, 1, 2, 4, 5)),
    ]
    assert sorted(choice.left_out_px) == [0, 1, 2, 4, 5]


def test_the_choice_by_hand():
    # 1 is worse than 5 in each view alike, 2 in two of four by as much as 5 is in the others
    five = np.array([4.0, 9.0, 4.0, 9.0])
    squares = {1: five + 1.0, 2: five + [0.1, -0.1, 0.2, 0.0], 5: five}
    choice = chosen(squares)
    assert choice.terms == 2
    assert choice.undecided == (2, 5)
    assert choice.left_out_px[1] == pytest.approx(np.sqrt(7.5))
    lines = as_lines(choice)
    assert "by their number: 1: 2.7386," in lines[1]
    assert "cannot decide between 2 and 5" in lines[2]
    assert len(as_lines(chosen({2: five}))) == 2
    assert chosen({}) == Choice(0, {}, ())


def test_too_few_views_to_leave_some_out():
    found, _, choice = calibrate_by_choice(TARGET.points, taken((0.0,) * 5, 3), [SIZE] * 2, NAMES)
    assert choice == Choice(found.distortion_terms, {}, ())
    assert "the views are too few" in as_lines(choice)[0]
    with pytest.raises(ValueError, match="uv: expected three or more views by camera 0, got 2"):
        calibrate_by_choice(TARGET.points, taken((0.0,) * 5, 2), [SIZE] * 2, NAMES)


def test_the_way_to_another_calibration_by_hand():
    """In the order of the covariance: lens by lens as many numbers as are fitted, then places."""
    cameras = make_rig(np.zeros(5)).cameras
    matrix = cameras[0].matrix + [[1.0, 0, 3], [0, 2, 4], [0, 0, 0]]
    lens = np.array([0.05, 0.06, 0.07, 0.08, 0.09])
    first = replace(cameras[0], matrix=matrix, distortions=lens)
    further = RigidTransform.from_translation([0.1, 0.2, 0.3]) * cameras[1].T_world_cam
    second = replace(cameras[1], T_cam_world=further.inv())
    best, other = (
        Calibrated(both, (), np.zeros((18, 18)), 2, np.zeros((2, 0, 0, 2)), 0.1)
        for both in (cameras, (first, second))
    )
    way = [1, 2, 3, 4, 0.05, 0.06, *[0] * 6, 0.1, 0.2, 0.3, 0, 0, 0]
    np.testing.assert_allclose(spread_of_cameras(other, best), np.outer(way, way), atol=1e-9)
