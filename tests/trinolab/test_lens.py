"""The lens model: against OpenCV, finite differences, and at the radius where the polynomial folds
back.
"""

import cv2
import numpy as np
import pytest

from trinolab.lens import distort, undistort

LENSES = {
    "none": [0, 0, 0, 0, 0],
    "barrel": [-0.3, 0.1, 0, 0, 0],
    "pincushion": [0.2, 0.05, 0, 0, 0],
    "tangential": [0, 0, 0.01, -0.02, 0],
    "all": [-0.25, 0.08, 0.003, -0.002, -0.01],
    "rational": [0.9, 0.11, 1e-3, -2e-3, 0.003, 1.22, 0.32, 0.022],
}
each_lens = pytest.mark.parametrize(
    "k", [np.array(k, dtype=float) for k in LENSES.values()], ids=LENSES
)


def points(n=500, reach=0.5):
    return np.random.default_rng(0).uniform(-reach, reach, (n, 2))


def by_opencv(xy, k):
    """Distort with cv2.projectPoints: points at depth 1, the identity as camera matrix."""
    there = np.column_stack([xy, np.ones(len(xy))]).reshape(-1, 1, 3)
    return cv2.projectPoints(
        there, np.zeros((3, 1)), np.zeros((3, 1)), np.eye(3), k.reshape(-1, 1)
    )[0].reshape(-1, 2)


@each_lens
def test_distort_equals_opencv(k):
    np.testing.assert_allclose(distort(points(), k)[0], by_opencv(points(), k), atol=1e-14)


@each_lens
def test_undistort_inverts_opencv_s_distortion(k):
    np.testing.assert_allclose(undistort(by_opencv(points(), k), k), points(), atol=1e-11)


def test_undistort_equals_opencv():
    k = np.array(LENSES["all"], dtype=float)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    xy = points(100, 0.3)
    theirs = cv2.undistortPoints(
        xy.reshape(-1, 1, 2), np.eye(3), k.reshape(-1, 1), criteria=criteria
    )
    np.testing.assert_allclose(undistort(xy, k), theirs.reshape(-1, 2), atol=1e-9)


@each_lens
def test_jacobian_against_differences(k):
    xy, step = points(50), 1e-6
    jacobian = distort(xy, k)[1]
    for column, move in enumerate(step * np.eye(2)):
        slope = (distort(xy + move, k)[0] - distort(xy - move, k)[0]) / (2 * step)
        # central differences: 1e-6^2 and rounding
        np.testing.assert_allclose(jacobian[:, :, column], slope, atol=1e-9)


def test_points_beyond_the_fold_have_no_image():
    k = np.array([-0.5, 0, 0, 0, 0])  # r (1 - 0.5 r^2) grows up to r^2 = 2/3
    fold = np.sqrt(2 / 3)
    xy = np.array([[fold - 1e-6, 0.0], [fold + 1e-6, 0.0], [0.0, 2.0]])
    out = distort(xy, k)[0]
    assert np.isfinite(out[0]).all()
    assert np.isnan(out[1:]).all()
    # more than the largest image radius, 0.544
    assert np.isnan(undistort(np.array([[0.9, 0.0]]), k)).all()


@pytest.mark.parametrize(("k4", "what"), [(-0.5, "a pole"), (0.5, "a turn")])
def test_a_rational_lens_ends_at_its_pole_and_where_it_turns(k4, what):
    """r / (1 - r^2 / 2) has a pole at r^2 = 2, and r / (1 + r^2 / 2) grows up to there."""
    k = np.array([0, 0, 0, 0, 0, k4, 0, 0])
    xy = np.array([[np.sqrt(2) - 1e-6, 0.0], [np.sqrt(2) + 1e-6, 0.0]])
    out = distort(xy, k)[0]
    assert np.isfinite(out[0]).all(), what
    assert np.isnan(out[1]).all(), what


def test_five_coefficients_are_eight_of_which_the_last_are_zero():
    five = np.array(LENSES["all"])
    eight = np.append(five, np.zeros(3))
    np.testing.assert_array_equal(distort(points(), five)[0], distort(points(), eight)[0])
    np.testing.assert_array_equal(undistort(points(), five), undistort(points(), eight))


def test_missing_points_stay_missing():
    k = np.array(LENSES["all"], dtype=float)
    xy = np.array([[np.nan, np.nan], [0.1, -0.2]])
    for out in (distort(xy, k)[0], undistort(xy, k)):
        assert np.isnan(out[0]).all()
        assert np.isfinite(out[1]).all()
    assert undistort(np.empty((0, 2)), k).shape == (0, 2)
    assert np.isnan(undistort(np.full((3, 2), np.nan), k)).all()
