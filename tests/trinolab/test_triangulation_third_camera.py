"""Why a third camera worsens the paper's angles: what chapter 10 says of it."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids
from trinolab.handle import facing_pixels
from trinolab.metrics import pose_errors
from trinolab.pose import rigid_fit, weighted_fit
from trinolab.triangulation import points_of_pairs, triangulate, triangulate_weighted

HANDLE = load_handle("paper")
TRUTHS = load_table1().set_poses
PAIR, THREE = load_rig("paper_pair"), load_rig("paper_trinocular")


def exact(rig, T):
    """Pixels of the markers' centres up to 70 deg of slant, (cameras, markers, 2)."""
    return np.stack([facing_pixels(HANDLE, camera, T, 70.0) for camera in rig.cameras])


def biased(rig, T):
    """The centroids of the wrapped markers in their place."""
    uv = exact(rig, T).copy()
    views = Views(*np.nonzero(np.isfinite(uv[..., 0])))
    uv[views] = predict_centroids(rig, HANDLE, T, views)[0]
    return uv


def mean_angle_deg(fits):
    return pose_errors(RigidTransform.concatenate(fits), TRUTHS).geodesic_mean_deg


def angle_of_the_mean(rig, pixels):
    """Of Eq. 20, 22 and 24 at Table 1's poses."""
    return mean_angle_deg(
        [rigid_fit(HANDLE.marker_centres, triangulate(rig, pixels(rig, T))) for T in TRUTHS]
    )


def test_it_is_the_bias_of_the_centroids_and_not_the_noise():
    rng = np.random.default_rng(0)

    def noisy(rig, T):
        uv = exact(rig, T)
        return uv + rng.normal(0, 0.05, uv.shape)

    assert angle_of_the_mean(THREE, biased) > 1.5 * angle_of_the_mean(PAIR, biased)
    assert angle_of_the_mean(THREE, noisy) < angle_of_the_mean(PAIR, noisy)


def test_points_that_the_third_camera_shares_are_shifted_all_one_way():
    errors = np.concatenate(
        [points_of_pairs(THREE, biased(THREE, T)) - T.apply(HANDLE.marker_centres) for T in TRUTHS],
        axis=1,
    )
    shift = np.linalg.norm(np.nanmean(errors, axis=1), axis=1)  # mm, pairs 1-2, 1-3, 2-3
    assert shift[0] < 0.01
    assert (shift[1:] > 0.1).all()


def test_weights_gain_by_the_third_camera_on_centroids_without_bias():
    angles = []
    for rig in (PAIR, THREE):
        rng = np.random.default_rng(0)
        fits = []
        for T in TRUTHS:
            uv = exact(rig, T)
            uv = uv + rng.normal(0, 0.05, uv.shape)
            fits.append(
                weighted_fit(HANDLE.marker_centres, *triangulate_weighted(rig, uv, 0.05))[0]
            )
        angles.append(mean_angle_deg(fits))
    assert angles[1] < 0.9 * angles[0]
