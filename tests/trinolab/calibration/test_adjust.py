"""The calibration against exact corners, OpenCV, and SciPy's least squares over everything."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.calibration.adjust import Calibrated, calibrate, posed
from trinolab.calibration.start import homography, intrinsics, target_pose
from trinolab.calibration.target import Board
from trinolab.camera import Camera, Rig, displaced

SIZE = (640, 480)
BOARD = Board(7, 6, 20.0)
K_LEFT = np.array([[700.0, 0, 330], [0, 690, 228], [0, 0, 1]])
K_RIGHT = np.array([[715.0, 0, 310], [0, 708, 250], [0, 0, 1]])
K_THIRD = np.array([[650.0, 0, 322], [0, 655, 241], [0, 0, 1]])
LENS = np.array(
    [
        [-0.25, 0.08, 1e-3, -8e-4, 0.02],
        [-0.2, 0.05, -5e-4, 6e-4, 0.0],
        [0.1, -0.1, 1e-3, 1e-3, 0.01],
    ]
)


def motion(translation, rotvec=(0, 0, 0)):
    return RigidTransform.from_components(
        translation, Rotation.from_rotvec(np.array(rotvec, float))
    )


def make_rig(lens=LENS):
    """Three cameras; world is the first one's frame."""
    poses = [
        motion([0, 0, 0]),
        motion([90, 5, 10], [0.02, -0.2, 0.01]),
        motion([-60, -120, 40], [0.3, 0.1, -0.05]),
    ]
    return Rig(
        tuple(
            Camera(f"c{k}", SIZE, K, d, T.inv())
            for k, (K, d, T) in enumerate(zip((K_LEFT, K_RIGHT, K_THIRD), lens, poses, strict=True))
        )
    )


def positions(count=8, seed=3):
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (count, 3)))
    centres = rng.uniform([-40, -30, 380], [60, 30, 480], (count, 3))
    return RigidTransform.from_components(centres - turns.apply(BOARD.points.mean(axis=0)), turns)


def project(rig, poses):
    return np.stack(
        [[camera.project(T.apply(np.array(BOARD.points))) for T in poses] for camera in rig.cameras]
    )


def check_same(found, true, atol_px, atol_mm, atol_rad, atol_lens):
    for a, b in zip(found.cameras, true.cameras, strict=True):
        np.testing.assert_allclose(a.matrix, b.matrix, rtol=0, atol=atol_px)
        np.testing.assert_allclose(a.distortions, b.distortions, rtol=0, atol=atol_lens)
        np.testing.assert_allclose(a.centre, b.centre, rtol=0, atol=atol_mm)
        assert (a.T_cam_world.rotation * b.T_cam_world.rotation.inv()).magnitude() < atol_rad


# --- Zhang's start


def test_homography_by_hand():
    # doubles x, trebles y, moves by (10, 20)
    xy = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.3, 0.7]])
    H = homography(xy, xy * [2, 3] + [10, 20])
    np.testing.assert_allclose(H / H[2, 2], [[2, 0, 10], [0, 3, 20], [0, 0, 1]], atol=1e-12)
    assert H[2, 2] > 0


@given(arrays(float, (3, 3), elements=st.floats(-1, 1)), st.integers(0, 2**32 - 1))
def test_homography_returns_what_made_the_points(change, seed):
    true = np.array([[40.0, 3, 300], [-5, 45, 200], [1e-2, -2e-2, 1]]) * (1 + 0.1 * change)
    xy = np.random.default_rng(seed).uniform(-3, 3, (12, 2))
    image = np.column_stack([xy, np.ones(12)]) @ true.T
    H = homography(xy, image[:, :2] / image[:, 2:])
    # entries up to 360
    np.testing.assert_allclose(H / H[2, 2], true / true[2, 2], rtol=0, atol=1e-6)


def test_homography_needs_four_points_that_are_not_in_line():
    xy = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    assert homography(xy[:3], xy[:3]) is None
    gone = xy.copy()
    gone[2] = np.nan
    assert homography(xy, gone) is None
    line = np.column_stack([np.arange(6.0), 2 * np.arange(6.0)])
    assert homography(line, line) is None
    assert homography(np.ones((6, 2)), np.ones((6, 2))) is None
    assert homography(xy, xy) is not None


def test_start_is_exact_without_distortion():
    rig, poses = make_rig(np.zeros((3, 5))), positions(5)
    H = [homography(BOARD.points[:, :2], uv) for uv in project(rig, poses)[1]]
    K = intrinsics(H, SIZE)
    np.testing.assert_allclose(K, K_RIGHT, rtol=0, atol=1e-6)  # px
    for h, T in zip(H, poses, strict=True):
        expected = rig.cameras[1].T_cam_world * T
        for sign in (1, -1):  # a homography has no sign of its own
            np.testing.assert_allclose(
                target_pose(sign * h, K).as_matrix(), expected.as_matrix(), rtol=0, atol=1e-6
            )


def test_start_falls_back_on_the_image_centre():
    # two positions of one tilt, and one nearly of it: noise decides where the closed form puts the
    # principal point
    rig, rng = make_rig(np.zeros((3, 5))), np.random.default_rng(0)
    poses = [motion([-60 + x, -50, 400], [0.2, 0.15, 0]) for x in (0, 5, 10)]
    uv = project(rig, poses)[0] + rng.normal(0, 1.0, (3, len(BOARD.points), 2))
    K = intrinsics([homography(BOARD.points[:, :2], pixels) for pixels in uv], SIZE)
    np.testing.assert_allclose(K[:2, 2], [319.5, 239.5], atol=1e-9)
    assert 400 < K[0, 0] < 1200


def test_frontal_positions_are_refused():
    rig = make_rig(np.zeros((3, 5)))
    uv = project(rig, [motion([x, -50, 400]) for x in (-60, -50, -40)])[0]
    H = [homography(BOARD.points[:, :2], pixels) for pixels in uv]
    with pytest.raises(ValueError, match="homographies: expected positions of different tilt"):
        intrinsics(H, SIZE)
    with pytest.raises(ValueError, match="homographies: expected three or more, got 2"):
        intrinsics(H[:2], SIZE)


@pytest.mark.parametrize("name", ["H", "K"])
def test_target_pose_refuses_singular_matrices(name):
    matrices = {"H": np.eye(3), "K": np.eye(3), name: np.ones((3, 3))}
    with pytest.raises(ValueError, match="H, K: expected invertible"):
        target_pose(**matrices)


# --- exact corners


def test_exact_corners_give_the_cameras_back():
    rig, poses = make_rig(), positions()
    found = calibrate(BOARD.points, project(rig, poses), [SIZE] * 3, rig.names)
    # rounding, magnified by the least determined parameter; worst seen 5e-10 px, 4e-10 mm, 3e-9 for
    # k3
    check_same(found, rig, 1e-8, 1e-8, 1e-10, 1e-7)
    assert found.rms_px < 1e-9
    for a, b in zip(found.T_world_target, poses, strict=True):
        np.testing.assert_allclose(a.as_matrix(), b.as_matrix(), atol=1e-8)
    assert found.rig.names == ("c0", "c1", "c2")


@pytest.mark.slow
def test_missing_views_and_corners():
    rig, poses = make_rig(), positions(14)
    uv = project(rig, poses)
    uv[0, 7:] = np.nan  # the first and the third camera share nothing
    uv[2, :7] = np.nan
    uv[1, 4, ::3] = np.nan
    uv[1, 5, 3:] = np.nan  # three corners: the view is left out
    uv[2, 12, 7:] = np.nan  # one row, all on a line: left out
    uv[:, 13] = np.nan
    found = calibrate(BOARD.points, uv, [SIZE] * 3)
    # fewer views for each: ten times less determined than above
    check_same(found, rig, 1e-7, 1e-7, 1e-9, 1e-6)
    assert [T is None for T in found.T_world_target] == [False] * 13 + [True]
    used = np.isfinite(found.view_rms_px)
    assert used.tolist() == [
        [k < 7 for k in range(14)],
        [k not in (5, 13) for k in range(14)],
        [6 < k < 12 for k in range(14)],
    ]
    np.testing.assert_array_equal(np.isfinite(found.residuals_px[1, 4]), np.isfinite(uv[1, 4]))


@pytest.mark.parametrize("terms", [0, 2, 4])
def test_fewer_distortions(terms):
    lens = np.where(np.arange(5) < terms, LENS, 0.0)
    rig = make_rig(lens)
    found = calibrate(BOARD.points, project(rig, positions()), [SIZE] * 3, distortion_terms=terms)
    check_same(found, rig, 1e-8, 1e-8, 1e-10, 1e-7)
    assert (found.intrinsic_sigma[:, 4 + terms :] == 0).all()


# --- against OpenCV, on the same noisy corners


@pytest.fixture(scope="module")
def noisy():
    """Exact corners of two cameras with 0.1 px of noise, and what OpenCV makes of them."""
    rig = Rig(make_rig().cameras[:2])
    uv = project(rig, positions(9)) + np.random.default_rng(4).normal(
        0, 0.1, (2, 9, len(BOARD.points), 2)
    )
    uv = uv.astype(np.float32).astype(float)  # OpenCV takes single precision
    board = [BOARD.points.astype(np.float32).reshape(-1, 1, 3)] * 9
    sides = [[view.astype(np.float32).reshape(-1, 1, 2) for view in side] for side in uv]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 500, 1e-14)
    mono = [cv2.calibrateCamera(board, side, SIZE, None, None, criteria=stop) for side in sides]
    start = [np.array(part) for one in mono for part in one[1:3]]
    stereo = cv2.stereoCalibrate(
        board, *sides, *start, SIZE, flags=cv2.CALIB_USE_INTRINSIC_GUESS, criteria=stop
    )
    return uv, mono, stereo


def test_one_camera_as_opencv(noisy):
    uv, mono, _ = noisy
    for side, (rms, K, distortions, *_) in zip(uv, mono, strict=True):
        found = calibrate(BOARD.points, side[None], [SIZE])
        # both stop where the sum of squares stops falling; its valley is flat: 1e-3 of a standard
        # deviation
        assert found.rms_px == pytest.approx(rms, abs=1e-9)
        sigma = found.intrinsic_sigma[0]
        assert (
            np.abs(found.cameras[0].matrix - K)[[0, 1, 0, 1], [0, 1, 2, 2]] < 1e-2 * sigma[:4]
        ).all()
        assert (np.abs(found.cameras[0].distortions - distortions.ravel()) < 1e-2 * sigma[4:]).all()


def test_two_cameras_as_opencv(noisy):
    uv, _, (rms, K1, d1, K2, d2, R, T, *_) = noisy
    found = calibrate(BOARD.points, uv, [SIZE] * 2)
    assert found.rms_px == pytest.approx(rms, abs=1e-9)
    for k, (K, d) in enumerate(((K1, d1), (K2, d2))):
        sigma = found.intrinsic_sigma[k]
        assert (
            np.abs(found.cameras[k].matrix - K)[[0, 1, 0, 1], [0, 1, 2, 2]] < 1e-2 * sigma[:4]
        ).all()
        assert (np.abs(found.cameras[k].distortions - d.ravel()) < 1e-2 * sigma[4:]).all()
    # OpenCV's R, T go left to right; sigma_T is 0.02 to 0.1 mm here
    np.testing.assert_allclose(
        found.cameras[1].T_cam_world.translation, T.ravel(), rtol=0, atol=1e-3
    )
    np.testing.assert_allclose(
        found.cameras[1].T_cam_world.rotation.as_matrix(), R, rtol=0, atol=1e-5
    )


# --- against a plain least squares over everything


def as_vector(cameras, poses, terms):
    """Lenses, then T_world_cam of all but the first camera and the target's poses, as translations
    and rotation vectors.
    """
    motions = [c.T_world_cam for c in cameras[1:]] + list(poses)
    lenses = [[*c.focal, *c.principal_point, *c.distortions[:terms]] for c in cameras]
    places = [[*T.translation, *T.rotation.as_rotvec()] for T in motions]
    return np.concatenate([np.ravel(lenses), np.ravel(places)])


def projected(x, names, terms):
    """What cameras see by such a vector, (cameras, views, n, 2)."""
    lenses, places = np.split(x, [len(names) * (4 + terms)])
    motions = [motion(p[:3], p[3:]) for p in places.reshape(-1, 6)]
    seats = [motion([0, 0, 0]), *motions[: len(names) - 1]]
    views = motions[len(names) - 1 :]
    points = np.concatenate([T.apply(np.array(BOARD.points)) for T in views])
    uv = []
    for lens, T in zip(lenses.reshape(len(names), -1), seats, strict=True):
        K = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
        uv.append(Camera("c", SIZE, K, np.pad(lens[4:], (0, 5 - terms)), T.inv()).project(points))
    return np.reshape(uv, (len(names), len(views), -1, 2))


@pytest.mark.slow
def test_it_agrees_with_a_plain_least_squares_over_everything():
    # Another algorithm: no start, nothing eliminated, rotation vectors, differences for slopes.
    terms, names = 2, ("c0", "c1")
    rig = Rig(make_rig(np.where(np.arange(5) < terms, LENS, 0.0)).cameras[:2])
    poses = positions(4)
    uv = project(rig, poses) + np.random.default_rng(7).normal(0, 0.2, (2, 4, 42, 2))
    uv[0, 1, ::3] = np.nan
    uv[1, 2] = np.nan
    valid = np.isfinite(uv)
    found = calibrate(BOARD.points, uv, [SIZE] * 2, names, terms)
    plain = least_squares(
        lambda x: (projected(x, names, terms) - uv)[valid],
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
    own = found.covariance[:15, :15] / np.outer(sigma[:15], sigma[:15])
    expected = whole[:15, :15] / np.outer(sigma[:15], sigma[:15])
    np.testing.assert_allclose(own, expected, rtol=0, atol=1e-5)


def test_poses_with_the_cameras_held_are_those_of_a_plain_least_squares():
    rig, poses = make_rig(), positions(3)
    uv = project(rig, poses) + np.random.default_rng(8).normal(0, 0.3, (3, 3, 42, 2))
    uv[1, 0, 10:] = np.nan
    uv[2, 1] = np.nan
    calibrated = Calibrated(rig.cameras, (), np.zeros((39, 39)), 5, np.zeros((3, 0, 0, 2)), 0.1)
    near = [motion([0.5, -1, 2], [0.01, -0.005, 0.01]) * T for T in poses]
    left = posed(calibrated, BOARD.points, uv, near)
    for k, T in enumerate(poses):
        valid = np.isfinite(uv[:, k])

        def misfit(x, k=k, T=T, valid=valid):
            return (project(rig, [motion(x[:3], x[3:]) * T])[:, 0] - uv[:, k])[valid]

        plain = least_squares(
            misfit, np.zeros(6), method="lm", x_scale="jac", ftol=1e-13, xtol=1e-13
        )
        # ours stops where the sum falls by 1e-12 of it, at some 1e-5 of a pose's sigma of 0.1 px
        np.testing.assert_allclose(left[:, k][valid], plain.fun, rtol=0, atol=1e-5)
    assert np.array_equal(np.isfinite(left), np.isfinite(uv))


def test_poses_beyond_the_lens_model_are_refused():
    rig = make_rig(np.array([[-2.0, 0, 0, 0, 0]] * 3))  # it folds at 0.41 from the axis
    calibrated = Calibrated(rig.cameras, (), np.zeros((39, 39)), 5, np.zeros((3, 0, 0, 2)), 0.1)
    aside = [motion([250, 0, 400])]
    with pytest.raises(ValueError, match="no cameras were found that explain them"):
        posed(calibrated, BOARD.points, np.full((3, 1, 42, 2), 300.0), aside)


# --- started from another calibration


@pytest.mark.parametrize("terms", [0, 2, 5])
def test_the_start_does_not_decide_the_end(terms):
    uv = project(make_rig(), positions()) + np.random.default_rng(9).normal(0, 0.1, (3, 8, 42, 2))
    uv[2, 5] = np.nan
    before = calibrate(BOARD.points, uv, [SIZE] * 3, distortion_terms=4)
    fewer = uv.copy()
    fewer[:, 3] = np.nan
    again = calibrate(BOARD.points, fewer, [SIZE] * 3, None, terms, start=before)
    afresh = calibrate(BOARD.points, fewer, [SIZE] * 3, None, terms)
    # where a sum of squares stops falling by 1e-12 of it: parts of 1e5 of a standard deviation
    for k in range(3):
        sigma = afresh.intrinsic_sigma[k] + 1e-12
        for name in ("focal", "principal_point"):
            a, b = (getattr(one.cameras[k], name) for one in (again, afresh))
            assert (np.abs(a - b) < 1e-4 * sigma[:4].max()).all()
        off = again.cameras[k].distortions - afresh.cameras[k].distortions
        assert (np.abs(off) <= 1e-4 * sigma[4:]).all()
    np.testing.assert_allclose(again.residuals_px, afresh.residuals_px, rtol=0, atol=1e-5)
    scale = np.sqrt(np.diag(afresh.covariance))
    off = (again.covariance - afresh.covariance) / np.outer(scale, scale)
    np.testing.assert_allclose(off, 0, rtol=0, atol=1e-5)
    assert [T is None for T in again.T_world_target] == [k == 3 for k in range(8)]


def test_a_start_that_has_too_little_in_common_is_refused():
    uv = project(make_rig(), positions())
    before = calibrate(BOARD.points, uv, [SIZE] * 3)
    few = uv.copy()
    few[1, 2:] = np.nan
    refuse(
        "uv: expected three or more views by camera 1, got 2", few, sizes=[SIZE] * 3, start=before
    )
    apart = uv.copy()
    apart[0, :4] = apart[1:, 4:] = np.nan
    refuse("uv: expected views that determine all", apart, sizes=[SIZE] * 3, start=before)
    refuse("start: expected one of pixels of shape", uv[:2], start=before)


# --- uncertainty


def _changed(camera, lens, T_world_cam):
    """A camera with changed lens, and at another place if there is one."""
    fx, fy, cx, cy = lens[:4]
    matrix = camera.matrix + np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 0]])
    T = camera.T_cam_world if T_world_cam is None else T_world_cam.inv()
    return Camera(camera.name, camera.size, matrix, camera.distortions + lens[4:], T)


def test_the_covariance_as_that_of_a_rig():
    """A small change of each of the calibration's numbers, made to the cameras themselves, is the
    change that the rig's covariance has of it.
    """
    rig = Rig(make_rig().cameras[:2])
    for k in range(24):
        change = np.zeros(24)  # 9 of each lens, place and turn of the second camera
        change[k] = 1e-6
        found = Calibrated(
            rig.cameras, (None,), np.outer(change, change), 5, np.zeros((2, 1, 1, 2)), 0.1
        )
        matrix = found.rig_covariance.matrix
        largest = int(np.diag(matrix).argmax())
        moved = displaced(rig, matrix[largest] / np.sqrt(matrix[largest, largest]))
        lens = change[:18].reshape(2, 9)
        T = rig.cameras[1].T_world_cam
        turned = Rotation.from_rotvec(np.array(change[21:])) * T.rotation
        place = RigidTransform.from_components(T.translation + change[18:21], turned)
        expected = project(
            Rig(tuple(map(_changed, rig.cameras, lens, (None, place)))), positions(2)
        )
        step = expected - project(rig, positions(2))
        found_step = project(moved, positions(2)) - project(rig, positions(2))
        same, opposite = (np.abs(found_step - s * step).max() for s in (1, -1))
        assert min(same, opposite) < 1e-4 * np.abs(step).max(), k


@pytest.mark.heavy
def test_covariance_by_monte_carlo():
    rig, rng, sigma = (
        Rig(make_rig(np.where(np.arange(5) < 1, LENS, 0.0)).cameras[:2]),
        np.random.default_rng(5),
        0.2,
    )
    exact = project(rig, positions(5))
    found = [
        calibrate(
            BOARD.points, exact + rng.normal(0, sigma, exact.shape), [SIZE] * 2, distortion_terms=1
        )
        for _ in range(50)
    ]
    off = np.array(
        [
            np.concatenate(
                [
                    *(
                        np.append(
                            f.cameras[k].matrix[[0, 1, 0, 1], [0, 1, 2, 2]],
                            f.cameras[k].distortions[0],
                        )
                        for k in (0, 1)
                    ),
                    f.cameras[1].centre - rig.cameras[1].centre,
                    (
                        f.cameras[1].T_world_cam.rotation * rig.cameras[1].T_cam_world.rotation
                    ).as_rotvec(),
                ]
            )
            for f in found
        ]
    )
    said = np.sqrt(np.mean([np.diag(f.covariance) for f in found], axis=0))
    # a standard deviation from 50 draws is known to 10 %; the worst of 16 may be off by three times
    # that
    np.testing.assert_allclose(off.std(axis=0), said, rtol=0.3)
    # correlations: those above 0.9 in the mean covariance show in the draws
    whole = np.mean([f.covariance for f in found], axis=0)
    np.testing.assert_allclose(np.corrcoef(off.T), whole / np.outer(said, said), rtol=0, atol=0.4)
    # 50 x 796 degrees of freedom
    assert np.mean([f.sigma_px for f in found]) == pytest.approx(sigma, rel=0.02)
    one = found[0]
    np.testing.assert_array_equal(one.relative_covariance(1), one.covariance[10:, 10:])
    np.testing.assert_array_equal(one.relative_covariance(0), 0)
    np.testing.assert_allclose(one.intrinsic_sigma[1, :5], np.sqrt(np.diag(one.covariance))[5:10])
    with pytest.raises(ValueError, match="camera: expected 0 to 1, got 2"):
        one.relative_covariance(2)


def test_residuals_and_their_rms():
    rig = Rig(make_rig().cameras[:2])
    uv = project(rig, positions(5)) + np.random.default_rng(6).normal(
        0, 0.1, (2, 5, len(BOARD.points), 2)
    )
    uv[1, 2] = np.nan
    found = calibrate(BOARD.points, uv, [SIZE] * 2)
    again = (
        np.stack(
            [
                [camera.project(T.apply(np.array(BOARD.points))) for T in found.T_world_target]
                for camera in found.cameras
            ]
        )
        - uv
    )
    np.testing.assert_allclose(found.residuals_px, again, atol=1e-9)
    square = (again**2).sum(axis=3)
    assert found.rms_px == pytest.approx(np.sqrt(np.nanmean(square)), abs=1e-12)
    assert found.view_rms_px[0, 2] == pytest.approx(np.sqrt(square[0, 2].mean()), abs=1e-12)
    assert np.isnan(found.view_rms_px[1, 2])


# --- bad input


def refuse(match, uv=None, target=BOARD.points, sizes=(SIZE, SIZE), **rest):
    uv = project(Rig(make_rig().cameras[:2]), positions(4)) if uv is None else uv
    with pytest.raises(ValueError, match=match):
        calibrate(target, uv, sizes, **rest)


def test_caller_mistakes_are_named():
    refuse("sizes: expected one for each of 2", sizes=[SIZE])
    refuse(r"uv: expected shape \(n, n, 42, 2\)", uv=np.zeros((2, 4, 41, 2)))
    refuse("target: expected a flat target", target=BOARD.points + [0, 0, 1])
    refuse("distortion_terms: expected one of", distortion_terms=3)
    refuse("target: expected finite", target=np.full((42, 3), np.nan))


def test_views_that_say_too_little():
    uv = project(Rig(make_rig().cameras[:2]), positions(6))
    few = uv.copy()
    few[1, 2:] = np.nan
    refuse("uv: expected three or more views by camera 1, got 2", uv=few)
    apart = uv.copy()
    apart[0, :3] = apart[1, 3:] = np.nan
    refuse("uv: camera 1 shares no view with the others", uv=apart)
    alike = [motion([-60 + x, -50, 400], [0.3, 0.2, 0]) for x in (0, 9, 20)]
    without_lens = project(Rig(make_rig(np.zeros((3, 5))).cameras[:2]), alike)
    refuse("uv: expected views that determine all parameters", uv=without_lens, distortion_terms=0)


def test_frontal_views_and_few_corners_name_the_camera_or_the_numbers():
    frontal = [motion([-60 + x, -50, 400 + x]) for x in (0, 9, 20)]
    uv = project(Rig(make_rig(np.zeros((3, 5))).cameras[:2]), frontal)
    refuse("uv: camera 0: .*expected positions of different tilt", uv=uv)
    corners = [0, 6, 35, 41]
    few = project(Rig(make_rig().cameras[:2]), positions(3))[:1, :, corners]
    refuse(  # a lens has nine numbers, a pose six
        "uv: expected more than 27 measured coordinates, got 24",
        uv=few,
        target=BOARD.points[corners],
        sizes=[SIZE],
        distortion_terms=5,
    )


def test_the_first_camera_s_place_is_exact_and_others_have_their_covariance():
    cameras = make_rig().cameras[:2]
    covariance = np.diag(np.arange(1.0, 15.0))
    found = Calibrated(cameras, (), covariance, 0, np.zeros((2, 0, 0, 2)), 0.1)
    np.testing.assert_array_equal(found.relative_covariance(0), np.zeros((6, 6)))
    np.testing.assert_array_equal(found.relative_covariance(1), np.diag(np.arange(9.0, 15.0)))
    for camera in (-1, 2):
        with pytest.raises(ValueError, match=f"camera: expected 0 to 1, got {camera}"):
            found.relative_covariance(camera)


@settings(max_examples=25, deadline=None)
@given(arrays(float, (2, 3, 4, 2), elements=st.floats(-1e4, 1e4) | st.just(np.nan)))
def test_nonsense_is_refused_or_finite(uv):
    target = np.array([[0, 0, 0], [40, 0, 0], [40, 30, 0], [0, 30, 0.0]])
    try:
        found = calibrate(target, uv, [SIZE] * 2, distortion_terms=0)
    except ValueError:
        return
    assert np.isfinite(found.covariance).all()
    assert np.isfinite(found.rms_px)
