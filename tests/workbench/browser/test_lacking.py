"""What OpenCV.js lacks: OpenCV's own answers are the reference."""

import cv2
import numpy as np
import pytest
from boards import SIZE, corners, make_rig, positions

from trinolab.calibration.target import Board
from workbench.browser.guest import lacking

PINHOLE = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
NONE = np.zeros(5)


def drawn(count, seed):
    """An image of so many dots, 30 px and more apart, of which four lie together for most seeds."""
    rng = np.random.default_rng(seed)
    kept = [np.array([200, 200])]
    while len(kept) < count:
        spread = 50 if len(kept) < 4 else 180
        new = 200 + rng.integers(-spread, spread, 2)
        if min(np.hypot(*(new - one)) for one in kept) > 30:
            kept.append(new)
    image = np.zeros((400, 400), np.uint8)
    for u, v in kept:
        cv2.circle(image, (int(u), int(v)), 7, 255, -1)
    return image


def detector():
    chosen = cv2.SimpleBlobDetector_Params()
    chosen.blobColor = 255
    chosen.filterByConvexity = chosen.filterByInertia = False
    return cv2.SimpleBlobDetector_create(chosen)


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_a_grid_of_four_is_there_where_opencv_finds_it(count):
    there = []
    flags = cv2.CALIB_CB_SYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING
    for seed in range(20):
        image = drawn(count, seed)
        seen = np.array([one.pt for one in detector().detect(image)])
        assert len(seen) == count
        found, uv = cv2.findCirclesGrid(image, (2, 2), flags=flags, blobDetector=detector())
        ours = lacking.four_of_a_grid(seen)
        assert (ours is not None) == found, seed
        there.append(found)
        if found:
            ordered = [sorted(np.float32(one).reshape(4, 2).tolist()) for one in (ours, uv)]
            assert np.allclose(*ordered, atol=1e-3)  # px; OpenCV's are of single precision
    assert set(there) == ({False} if count == 3 else {False, True})


@pytest.mark.parametrize("free", [True, False])
def test_a_stereo_calibration_ends_where_opencvs_does(free):
    rig, board, poses = make_rig(lens=np.zeros(5)), Board(7, 6, 15.0), positions(8)
    views = corners(rig, poses, board, noise_px=0.1, seed=1)
    K = [camera.matrix for camera in rig.cameras]
    turn, shift = (
        rig.cameras[1].T_cam_world.rotation.as_rotvec(),
        rig.cameras[1].T_cam_world.translation,
    )
    flags = PINHOLE | (cv2.CALIB_USE_INTRINSIC_GUESS if free else cv2.CALIB_FIX_INTRINSIC)
    theirs = cv2.stereoCalibrate(
        [np.float32(board.points)] * 8,
        *[list(np.float32(of_camera)) for of_camera in views],
        *(K[0].copy(), NONE, K[1].copy(), NONE, SIZE),
        flags=flags,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12),
    )
    seen = [(T.rotation.as_rotvec(), T.translation) for T in poses]
    beside = turn + 0.01, shift + 2
    ours = lacking.stereo_pair([np.array(board.points)] * 8, views, K, seen, beside, free)
    # px and mm; OpenCV takes the pixels in single precision, 3e-5 px
    assert np.allclose(ours.first, theirs[1], atol=1e-2)
    assert np.allclose(ours.second, theirs[3], atol=1e-2)
    assert np.allclose(ours.R, theirs[5], atol=1e-5)
    assert np.allclose(ours.T, theirs[6], atol=1e-2)
    assert ours.rms == pytest.approx(theirs[0], rel=1e-3)
