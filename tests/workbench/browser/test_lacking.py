"""What OpenCV.js lacks: OpenCV's own answers are the reference."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.browser.guest import lacking

SIZE = 640, 480
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
    rng = np.random.default_rng(1)
    board = np.array([[25.0 * x, 25.0 * y, 0] for y in range(5) for x in range(7)])
    K = (
        np.array([[800.0, 0, 330], [0, 810, 235], [0, 0, 1]]),
        np.array([[790.0, 0, 310], [0, 795, 245], [0, 0, 1]]),
    )
    turn, shift = Rotation.from_rotvec([0.02, -0.25, 0.01]), np.array([-120.0, 3, 15])
    views = [[], []]
    poses = []
    for _ in range(8):
        pose = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)), [-70, -50, rng.uniform(480, 640)]
        in_first = pose[0].apply(board) + pose[1]
        poses.append((pose[0].as_rotvec(), np.array(pose[1])))
        for k, X in enumerate((in_first, turn.apply(in_first) + shift)):
            uv = (X / X[:, 2:]) @ K[k].T
            views[k].append(uv[:, :2] + rng.normal(0, 0.1, (len(X), 2)))
    flags = PINHOLE | (cv2.CALIB_USE_INTRINSIC_GUESS if free else cv2.CALIB_FIX_INTRINSIC)
    theirs = cv2.stereoCalibrate(
        [np.float32(board)] * 8,
        *[[np.float32(one) for one in of_camera] for of_camera in views],
        K[0].copy(),
        NONE,
        K[1].copy(),
        NONE,
        SIZE,
        flags=flags,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12),
    )
    ours = lacking.stereo_pair(
        [board] * 8, views, K, poses, (turn.as_rotvec() + 0.01, shift + 2), free
    )
    # px and mm; OpenCV takes the pixels in single precision, 3e-5 px
    assert np.allclose(ours.first, theirs[1], atol=1e-2)
    assert np.allclose(ours.second, theirs[3], atol=1e-2)
    assert np.allclose(ours.R, theirs[5], atol=1e-5)
    assert np.allclose(ours.T, theirs[6], atol=1e-2)
    assert ours.rms == pytest.approx(theirs[0], rel=1e-3)
