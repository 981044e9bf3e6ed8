"""The lens model: against OpenCV, finite differences, and at the radius where the polynomial folds
back.
"""

import cv2
import numpy as np
import pytest

from trinolab.lens import distort, project_with_slopes, undistort

LENSES = {
    "none": [0, 0, 0, 0, 0],
    "tangential": [0, 0, 0.01, -0.02, 0],
    "all": [-0.25, 0.08, 0.003, -0.002, -0.01],
    "rational": [0.9, 0.11, 1e-3, -2e-3, 0.003, 1.22, 0.32, 0.022],
}
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (500, 2))


@pytest.mark.parametrize("name", LENSES)
def test_a_lens_is_opencvs_and_its_slopes_and_inverse_are_its_own(name):
    k = np.array(LENSES[name], dtype=float)
    # points at depth 1, the identity as camera matrix
    there = np.column_stack([POINTS, np.ones(500)])
    theirs = cv2.projectPoints(there, np.zeros(3), np.zeros(3), np.eye(3), k)[0].reshape(-1, 2)
    out, jacobian = distort(POINTS, k)
    np.testing.assert_allclose(out, theirs, atol=1e-14)
    np.testing.assert_allclose(undistort(theirs, k), POINTS, atol=1e-11)
    for column, move in enumerate(1e-6 * np.eye(2)):
        slope = (distort(POINTS + move, k)[0] - distort(POINTS - move, k)[0]) / 2e-6
        # central differences: 1e-6^2 and rounding
        np.testing.assert_allclose(jacobian[:, :, column], slope, atol=1e-9)


FOLDS = [
    ([-0.5, 0, 0, 0, 0], 2 / 3),  # r (1 - 0.5 r^2) grows up to there
    ([0, 0, 0, 0, 0, -0.5, 0, 0], 2),  # r / (1 - r^2 / 2) has a pole
    ([0, 0, 0, 0, 0, 0.5, 0, 0], 2),  # r / (1 + r^2 / 2) turns
    ([0, 0, 0, 0, -1 / 7], 1),
    ([0, -1 / 5, 0, 0, 0], 1),
    ([0, 0, 0, 0, 0, 0, 1 / 3, 0], 1),
    ([0, 0, 0, 0, 0, 0, 0, 1 / 5], 1),
]


@pytest.mark.parametrize(("lens", "radius2"), FOLDS)
def test_points_beyond_the_fold_have_no_image(lens, radius2):
    k, radius = np.array(lens, dtype=float), np.sqrt(radius2)
    out = distort(np.array([[radius - 1e-6, 0.0], [radius + 1e-6, 0.0], [0.0, 2 * radius]]), k)[0]
    assert np.isfinite(out[0]).all()
    assert np.isnan(out[1:]).all()
    if len(k) == 5:  # beyond the largest image radius
        assert np.isnan(undistort(1.01 * out[:1], k)).all()


@pytest.mark.parametrize("name", ["all", "rational"])
def test_slopes_of_projected_points_against_differences(name):
    lens = np.array([800.0, 700, 300, 250, *LENSES[name]])
    local = np.random.default_rng(1).uniform([-100, -100, 350], [100, 100, 450], (20, 3))
    _, by_lens, by_local = project_with_slopes(lens, local)
    for k, move in enumerate(1e-5 * np.eye(len(lens))):
        slope = (
            project_with_slopes(lens + move, local)[0] - project_with_slopes(lens - move, local)[0]
        )
        np.testing.assert_allclose(by_lens[..., k], slope / 2e-5, rtol=1e-6, atol=1e-6)
    for k, move in enumerate(1e-3 * np.eye(3)):
        slope = (
            project_with_slopes(lens, local + move)[0] - project_with_slopes(lens, local - move)[0]
        )
        np.testing.assert_allclose(by_local[..., k], slope / 2e-3, rtol=1e-6, atol=1e-6)


def test_missing_points_stay_missing():
    k = np.array(LENSES["all"])
    xy = np.array([[np.nan, 0.1], [0.1, -0.2]])
    for out in (distort(xy, k)[0], undistort(xy, k)):
        assert np.isnan(out[0]).all()
        assert np.isfinite(out[1]).all()
    assert undistort(np.empty((0, 2)), k).shape == (0, 2)
    assert np.isnan(undistort(np.full((3, 2), np.nan), k)).all()
