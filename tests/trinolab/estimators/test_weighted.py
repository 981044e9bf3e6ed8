"""The covariance of the weighted fit where a centre is less sure in one direction than in the other."""

import numpy as np
import pytest

from trinolab.bench.hand import true_visibility
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.estimators.centroids import CentrePixels
from trinolab.estimators.pixels import FLOOR_PX
from trinolab.estimators.weighted import honest_fit
from trinolab.metrics import nees
from trinolab.pose import weighted_fit
from trinolab.triangulation import triangulate_weighted

RIG, HANDLE = load_rig("raised_40deg"), load_handle("coded")
T = load_table1().set_poses[0]
SHORT_PX, LONG_PX = 0.005, 0.04  # of a centre's error along two directions


@pytest.mark.parametrize("along_deg", [0.0, 90.0])
def test_nees_where_centres_are_surer_in_one_direction(along_deg):
    """Centres drawn with that noise: the fit weighs by one sigma a centre, its covariance does not."""
    rng = np.random.default_rng(5)
    visible = np.stack([true_visibility(camera, HANDLE, T) for camera in RIG.cameras])
    exact = np.stack([c.project(T.apply(HANDLE.marker_centres)) for c in RIG.cameras])
    exact[~visible] = np.nan
    a = np.deg2rad(along_deg)
    axes = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    noise = axes @ np.diag([SHORT_PX**2, LONG_PX**2]) @ axes.T
    covariance = np.where(visible[..., None, None], noise, np.nan)
    sigma = np.where(visible, np.sqrt(np.trace(noise) / 2), np.nan)
    # of which the fit keeps the floor beside it
    drawn = noise + FLOOR_PX**2 * np.eye(2)
    found = []
    for _ in range(200):
        uv = exact + rng.multivariate_normal(np.zeros(2), drawn, visible.shape)
        points = triangulate_weighted(RIG, uv, np.hypot(sigma, FLOOR_PX))
        near, _ = weighted_fit(HANDLE.marker_centres, *points)
        centres = CentrePixels(uv, sigma, covariance, np.zeros_like(covariance))
        pose = honest_fit(near, np.eye(6), centres, RIG, HANDLE)
        found.append(nees(near, pose.covariance, T)[0])
    # five standard deviations of a mean of 200
    assert np.mean(found) == pytest.approx(6, abs=5 * np.sqrt(12 / 200))
