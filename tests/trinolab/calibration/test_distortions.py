"""The number of distortion coefficients: by lenses that are known, by hand, and on real pairs."""

from dataclasses import replace

import numpy as np
import pytest
from boards import SIZE, make_rig, positions
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration import distortions
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
from trinolab.datasets import real_set
from trinolab.files.fetch import why_not
from workbench.studies.real_recordings import load_opencv_stereo
from workbench.studies.simulated_calibration import corners_of

TARGET = Target("chessboard", 7, 5, 15.0)
NAMES = ("a", "b")


def taken(lens, views, noise_px=0.05):
    """Corners of the target in both cameras, (2, views, n, 2), px, with noise."""
    exact = np.stack(
        [
            [camera.project(T.apply(np.array(TARGET.points))) for T in positions(views)]
            for camera in make_rig(np.array(lens)).cameras
        ]
    )
    return exact + np.random.default_rng(0).normal(0, noise_px, exact.shape)


@pytest.mark.heavy
@pytest.mark.parametrize(("lens", "terms"), [((0.0,) * 5, 0), ((-0.3, 0.2, 0.003, -0.002, 0.0), 4)])
def test_as_many_as_the_lens_has(lens, terms):
    uv = taken(lens, 8)
    found, why, choice = calibrate_by_choice(TARGET.points, uv, [SIZE] * 2, NAMES)
    assert choice.terms == found.distortion_terms == terms
    assert sorted(choice.left_out_px) == [0, 1, 2, 4, 5]
    assert (why == "").all()
    # a distance has two coordinates; of a left-out view's points the pose takes a little
    assert choice.left_out_px[terms] == pytest.approx(0.05 * np.sqrt(2), rel=0.1)
    # the others that do as well are in the uncertainty
    alone = calibrate(TARGET.points, uv, [SIZE] * 2, NAMES, terms)
    variance = np.diag(alone.covariance)
    more = np.diag(found.covariance) - variance
    # two starts end at some 1e-5 sigma from each other
    assert (choice.undecided == (terms,)) == (np.abs(more) < 1e-4 * variance).all()
    squares = [
        (
            calibrate(TARGET.points, uv, [SIZE] * 2, NAMES, n).cameras[0].focal
            - alone.cameras[0].focal
        )
        ** 2
        for n in choice.undecided
    ]
    expected = np.mean(squares, axis=0)
    np.testing.assert_allclose(more[:2] / variance[:2], expected / variance[:2], rtol=0, atol=1e-4)


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


def test_a_model_that_fails_drops_out(monkeypatch):
    uv = taken((0.0,) * 5, 6)

    def without_one(target, pixels, sizes, names, terms, **rest):
        if terms == 1:
            raise ValueError("uv: no cameras were found")
        return calibrate(target, pixels, sizes, names, terms, **rest)

    monkeypatch.setattr(distortions, "calibrate", without_one)
    _, _, choice = calibrate_by_choice(TARGET.points, uv, [SIZE] * 2, NAMES)
    assert sorted(choice.left_out_px) == [0, 2, 4, 5]


def test_what_is_left_out_is_not_fitted():
    # One corner of one view is 2 px off: where the view is left out no camera has bent to it.
    uv = taken((0.0,) * 5, 8)
    uv[0, 3, 0] += 2.0
    found = calibrate(TARGET.points, uv, [SIZE] * 2, NAMES, 5)
    squares = left_out_squares(np.array(TARGET.points), uv, found)
    inside = (np.linalg.norm(found.residuals_px, axis=3) ** 2).mean(axis=(0, 2))
    assert squares.argmax() == 3
    assert squares[3] > inside[3]
    assert squares[3] > 2 * np.delete(squares, 3).max()


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
    calibrate_by_choice(TARGET.points, uv, [SIZE] * 2, NAMES, steps.append)
    assert steps == [
        "camera a alone",
        "camera b alone",
        "all cameras together",
        *(f"distortions: {terms}" for terms in (0, 1, 2, 4, 5)),
    ]


def test_the_choice_by_hand():
    # 1 is worse than 5 in each view alike, 2 in two of four by as much as 5 is in the others
    five = np.array([4.0, 9.0, 4.0, 9.0])
    squares = {1: five + 1.0, 2: five + [0.1, -0.1, 0.2, 0.0], 5: five}
    choice = chosen(squares)
    assert choice.terms == 2
    assert choice.undecided == (2, 5)
    assert choice.left_out_px[1] == pytest.approx(np.sqrt(7.5))
    assert as_lines(choice)[1].startswith(
        "  rms / px in views left out, by their number: 1: 2.7386,"
    )
    assert "cannot decide between 2 and 5" in as_lines(choice)[2]
    assert len(as_lines(chosen({2: five}))) == 2


def test_too_few_views_to_leave_some_out():
    uv = taken((0.0,) * 5, 3)
    found, _, choice = calibrate_by_choice(TARGET.points, uv, [SIZE] * 2, NAMES)
    assert choice == Choice(found.distortion_terms, {}, ())
    assert "the views are too few" in as_lines(choice)[0]


def test_views_that_determine_nothing_are_refused_whatever_the_number():
    with pytest.raises(ValueError, match="uv: expected three or more views by camera 0, got 2"):
        calibrate_by_choice(TARGET.points, taken((0.0,) * 5, 2), [SIZE] * 2, NAMES)


def test_a_choice_among_nothing_is_none():
    assert chosen({}) == Choice(0, {}, ())


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


@pytest.mark.heavy
@pytest.mark.skipif(real_set("opencv_stereo") is None, reason=f"no opencv_stereo: {why_not()}")
def test_real_pairs_speak_for_four():
    # Two coefficients turn the second camera by 0.2 deg, four standard deviations of the noise.
    stereo = load_opencv_stereo()
    corners = corners_of((stereo.left, stereo.right), stereo.board)
    _, _, choice = calibrate_by_choice(
        stereo.board.points, corners, [(640, 480)] * 2, ("left", "right")
    )
    assert choice.terms == 4
    assert choice.undecided == (4,)
