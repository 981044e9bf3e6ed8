"""The calibration against exact corners, and SciPy's least squares over everything."""

import numpy as np
import pytest
from boards import SIZE, corners, make_rig, motion, positions
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration.adjust import Calibrated, calibrate, posed
from trinolab.calibration.start import homography, intrinsics, target_pose
from trinolab.calibration.target import Board
from trinolab.camera import Camera, Rig, displaced

BOARD = Board(7, 6, 15.0)
LENS = np.array([-0.22, 0.08, 1e-3, -8e-4, 0.02])
STRAIGHT = make_rig(np.zeros(5), 3)
TRIO = make_rig(LENS, 3)


def check_same(found, true, share=1.0):
    # rounding, magnified by the least determined parameter
    for a, b in zip(found.cameras, true.cameras, strict=True):
        np.testing.assert_allclose(a.matrix, b.matrix, rtol=0, atol=1e-8 * share)  # px
        np.testing.assert_allclose(a.distortions, b.distortions, rtol=0, atol=1e-7 * share)
        np.testing.assert_allclose(a.centre, b.centre, rtol=0, atol=1e-8 * share)  # mm
        turn = a.T_cam_world.rotation * b.T_cam_world.rotation.inv()
        assert turn.magnitude() < 1e-10 * share


# --- Zhang's start


@given(arrays(float, (3, 3), elements=st.floats(-1, 1)), st.integers(0, 2**32 - 1))
def test_homography_returns_what_made_the_points(change, seed):
    true = np.array([[40.0, 3, 300], [-5, 45, 200], [1e-2, -2e-2, 1]]) * (1 + 0.1 * change)
    xy = np.random.default_rng(seed).uniform(-3, 3, (12, 2))
    image = np.column_stack([xy, np.ones(12)]) @ true.T
    H = homography(xy, image[:, :2] / image[:, 2:])
    # entries up to 360
    np.testing.assert_allclose(H / H[2, 2], true / true[2, 2], rtol=0, atol=1e-6)
    assert (H @ np.r_[xy.mean(axis=0), 1])[2] > 0


def test_homography_needs_four_points_that_are_not_in_line():
    xy = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    gone = xy.copy()
    gone[2] = np.nan
    line = np.column_stack([np.arange(6.0), 2 * np.arange(6.0)])
    for a, b in ((xy[:3], xy[:3]), (xy, gone), (line, line), (np.ones((6, 2)), np.ones((6, 2)))):
        assert homography(a, b) is None
    assert homography(xy, xy) is not None


def homographies(poses, noise_px=0.0, camera=0):
    uv = corners(STRAIGHT, poses, BOARD, noise_px)[camera]
    return [homography(BOARD.points[:, :2], pixels) for pixels in uv]


def test_start_is_exact_without_distortion():
    camera, poses = STRAIGHT.cameras[1], positions(5)
    H = homographies(poses, camera=1)
    K = intrinsics(H, SIZE)
    np.testing.assert_allclose(K, camera.matrix, rtol=0, atol=1e-6)  # px
    for h, T in zip(H, poses, strict=True):
        expected = (camera.T_cam_world * T).as_matrix()
        for sign in (1, -1):  # a homography has no sign of its own
            found = target_pose(sign * h, K).as_matrix()
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_a_start_that_cannot_be():
    # three positions of nearly one tilt: noise decides where the closed form puts the principal
    # point, and the image's centre is taken
    poses = [motion([-60 + x, -50, 400], [0.2, 0.15, 0]) for x in (0, 5, 10)]
    K = intrinsics(homographies(poses, 1.0), SIZE)
    np.testing.assert_allclose(K[:2, 2], [239.5, 179.5], atol=1e-9)
    assert 350 < K[0, 0] < 1050
    H = homographies([motion([x, -50, 400]) for x in (-60, -50, -40)])
    for few, says in ((H, "positions of different tilt"), (H[:2], "three or more, got 2")):
        with pytest.raises(ValueError, match=f"homographies: expected {says}"):
            intrinsics(few, SIZE)
    for matrices in ((np.ones((3, 3)), np.eye(3)), (np.eye(3), np.ones((3, 3)))):
        with pytest.raises(ValueError, match="H, K: expected invertible"):
            target_pose(*matrices)


# --- exact corners


@pytest.mark.parametrize("terms", [0, 2, 4, 5])
def test_exact_corners_give_the_cameras_back(terms):
    """From Zhang's start, and from a calibration of noisy corners."""
    rig, poses = make_rig(np.where(np.arange(5) < terms, LENS, 0), 3), positions(8)
    rough = calibrate(BOARD.points, corners(rig, poses, BOARD, 1.0), [SIZE] * 3)
    exact = corners(rig, poses, BOARD)
    found, again = (
        calibrate(BOARD.points, exact, [SIZE] * 3, rig.names, terms, start=start)
        for start in (None, rough)
    )
    check_same(found, rig)
    check_same(again, rig, 10)
    assert found.rms_px < 1e-9
    # poses alone, with the cameras held; one view is seen by two of them
    exact[2, 1] = np.nan
    near = [motion([0.5, -1, 2], [0.01, -0.005, 0.01]) * T for T in poses]
    left = posed(found, BOARD.points, exact, near)
    np.testing.assert_allclose(left, 0 * exact, rtol=0, atol=1e-6)
    for a, b in zip(found.T_world_target, poses, strict=True):
        np.testing.assert_allclose(a.as_matrix(), b.as_matrix(), atol=1e-8)
    assert found.rig.names == rig.names
    assert (found.intrinsic_sigma[:, 4 + terms :] == 0).all()


@pytest.mark.slow
def test_missing_views_and_corners():
    uv = corners(TRIO, positions(14), BOARD)
    uv[0, 7:] = np.nan  # the first and the third camera share nothing
    uv[2, :7] = np.nan
    uv[1, 4, ::3] = np.nan
    uv[1, 5, 3:] = np.nan  # three corners: the view is left out
    uv[2, 12, 7:] = np.nan  # one row, all on a line: left out
    uv[:, 13] = np.nan
    found = calibrate(BOARD.points, uv, [SIZE] * 3)
    # fewer views for each: ten times less determined than above
    check_same(found, TRIO, 10)
    assert found.rig.names == ("ccd1", "ccd2", "ccd3")
    assert [T is None for T in found.T_world_target] == [False] * 13 + [True]
    used = np.isfinite(found.view_rms_px)
    assert used.tolist() == [
        [k < 7 for k in range(14)],
        [k not in (5, 13) for k in range(14)],
        [6 < k < 12 for k in range(14)],
    ]
    np.testing.assert_array_equal(np.isfinite(found.residuals_px[1, 4]), np.isfinite(uv[1, 4]))


# --- against a plain least squares over everything


def as_vector(cameras, poses, terms):
    """Lenses, then T_world_cam of all but the first camera and the target's poses, as translations
    and rotation vectors.
    """
    motions = [c.T_world_cam for c in cameras[1:]] + list(poses)
    lenses = [[*c.focal, *c.principal_point, *c.distortions[:terms]] for c in cameras]
    places = [[*T.translation, *T.rotation.as_rotvec()] for T in motions]
    return np.concatenate([np.ravel(lenses), np.ravel(places)])


def projected(x, terms):
    """What two cameras see by such a vector."""
    lenses, places = np.split(x, [2 * (4 + terms)])
    second, *views = [motion(p[:3], p[3:]) for p in places.reshape(-1, 6)]
    cameras = []
    for lens, T in zip(lenses.reshape(2, -1), (motion([0, 0, 0]), second), strict=True):
        K = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
        cameras.append(
            Camera(f"c{len(cameras)}", SIZE, K, np.pad(lens[4:], (0, 5 - terms)), T.inv())
        )
    return corners(Rig(tuple(cameras)), views, BOARD)


@pytest.mark.slow
def test_it_agrees_with_a_plain_least_squares_over_everything():
    # Another algorithm: no start, nothing eliminated, rotation vectors, differences for slopes.
    terms, poses = 2, positions(4)
    rig = make_rig(np.array([-0.12, 0.05, 0, 0, 0]))
    uv = corners(rig, poses, BOARD, 0.2)
    uv[0, 1, ::3] = np.nan
    uv[1, 2] = np.nan
    valid = np.isfinite(uv)
    found = calibrate(BOARD.points, uv, [SIZE] * 2, rig.names, terms)
    plain = least_squares(
        lambda x: (projected(x, terms) - uv)[valid],
        as_vector(rig.cameras, poses, terms),
        method="lm",
        jac="3-point",
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-12,
    )
    variance = 2 * plain.cost / (valid.sum() - len(plain.x))
    assert found.sigma_px == pytest.approx(np.sqrt(variance), rel=1e-9)
    whole = np.linalg.inv(plain.jac.T @ plain.jac) * variance
    sigma = np.sqrt(np.diag(whole))
    off = as_vector(found.cameras, found.T_world_target, terms) - plain.x
    assert np.abs(off / sigma).max() < 1e-4
    # the covariance: of lenses and place itself; small turns are not changes of the vector
    scale = np.outer(sigma[:15], sigma[:15])
    np.testing.assert_allclose(
        found.covariance[:15, :15] / scale, whole[:15, :15] / scale, rtol=0, atol=1e-5
    )
    np.testing.assert_allclose(found.intrinsic_sigma[1, :6], sigma[6:12], rtol=1e-5)
    residuals = corners(found.rig, found.T_world_target, BOARD) - uv
    np.testing.assert_allclose(found.residuals_px, residuals, atol=1e-9)
    square = (residuals**2).sum(axis=3)
    assert found.rms_px == pytest.approx(np.sqrt(np.nanmean(square)), abs=1e-12)
    assert found.view_rms_px[0, 1] == pytest.approx(np.sqrt(np.nanmean(square[0, 1])), abs=1e-12)
    assert np.isnan(found.view_rms_px[1, 2])


def calibration(rig, covariance, terms=5):
    return Calibrated(
        rig.cameras, (), covariance, terms, np.zeros((len(rig.cameras), 0, 0, 2)), 0.1
    )


# --- started from another calibration


# --- uncertainty


def test_the_covariance_as_that_of_a_rig():
    """A small change of each of the calibration's numbers, made to the cameras themselves, is the
    change that the rig's covariance has of it.
    """
    rig, poses = make_rig(), positions(2)
    before = corners(rig, poses, BOARD)
    for k in range(24):
        change = np.zeros(24)  # 9 of each lens, place and turn of the second camera
        change[k] = 1e-6
        found = calibration(rig, np.outer(change, change))
        place = np.outer(change[18:], change[18:])
        np.testing.assert_array_equal(found.relative_covariance(1), place)
        assert not found.relative_covariance(0).any()
        matrix = found.rig_covariance.matrix
        largest = int(np.diag(matrix).argmax())
        moved = displaced(rig, matrix[largest] / np.sqrt(matrix[largest, largest]))
        cameras = []
        for camera, (fx, fy, cx, cy, *bent) in zip(
            rig.cameras, change[:18].reshape(2, 9), strict=True
        ):
            K = camera.matrix + np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 0]])
            T = camera.T_world_cam
            if camera is rig.cameras[1]:
                turned = Rotation.from_rotvec(change[21:]) * T.rotation
                T = RigidTransform.from_components(T.translation + change[18:21], turned)
            lens = camera.distortions + np.array(bent)
            cameras.append(Camera(camera.name, SIZE, K, lens, T.inv()))
        step = corners(Rig(tuple(cameras)), poses, BOARD) - before
        ours = corners(moved, poses, BOARD) - before
        same, opposite = (np.abs(ours - s * step).max() for s in (1, -1))
        assert min(same, opposite) < 1e-4 * np.abs(step).max(), k


# --- bad input


def test_what_determines_no_cameras_is_refused():
    rig, flat = make_rig(), make_rig(np.zeros(5))
    uv = corners(rig, positions(6), BOARD)
    before = calibrate(BOARD.points, uv, [SIZE] * 2)
    few, apart = uv.copy(), uv.copy()
    few[1, 2:] = np.nan
    apart[0, :3] = apart[1, 3:] = np.nan
    frontal = corners(flat, [motion([-45 + x, -38, 400 + x]) for x in (0, 9, 20)], BOARD)
    alike = corners(flat, [motion([-45 + x, -38, 400], [0.3, 0.2, 0]) for x in (0, 9, 20)], BOARD)
    four = [0, 6, 35, 41]
    of_four = {"uv": uv[:1, :3, four], "target": BOARD.points[four], "sizes": [SIZE]}
    table = [
        ("sizes: expected one for each of 2", {"sizes": [SIZE]}),
        (r"uv: expected shape \(n, n, 42, 2\)", {"uv": np.zeros((2, 4, 41, 2))}),
        ("target: expected a flat target", {"target": BOARD.points + [0, 0, 1]}),
        ("target: expected finite", {"target": np.full((42, 3), np.nan)}),
        ("distortion_terms: expected one of", {"distortion_terms": 3}),
        ("uv: expected three or more views by camera 1, got 2", {"uv": few}),
        ("uv: expected three or more views by camera 1, got 2", {"uv": few, "start": before}),
        ("uv: camera 1 shares no view with the others", {"uv": apart}),
        ("uv: expected views that determine all", {"uv": apart, "start": before}),
        ("uv: expected views that determine all", {"uv": alike, "distortion_terms": 0}),
        ("uv: camera 0: .*expected positions of different tilt", {"uv": frontal}),
        # a lens has nine numbers, a pose six
        ("uv: expected more than 27 measured coordinates, got 24", of_four),
        ("start: expected one of pixels of shape", {"uv": uv[:, 1:], "start": before}),
        ("lenses: expected 2 cameras, 5 distortion_terms", {"lenses": rig.cameras[:1]}),
    ]
    for says, arguments in table:
        with pytest.raises(ValueError, match=says):
            calibrate(**{"target": BOARD.points, "uv": uv, "sizes": [SIZE] * 2} | arguments)


def test_what_a_calibration_does_not_have_is_refused():
    for camera in (-1, 2):
        with pytest.raises(ValueError, match=f"camera: expected 0 to 1, got {camera}"):
            calibration(make_rig(), np.zeros((24, 24))).relative_covariance(camera)
    rig = make_rig(np.array([-2.0, 0, 0, 0, 0]), 3)  # it folds at 0.41 from the axis
    folded = calibration(rig, np.zeros((39, 39)))
    with pytest.raises(ValueError, match="no cameras were found that explain them"):
        posed(folded, BOARD.points, np.full((3, 1, 42, 2), 300.0), [motion([250, 0, 400])])
