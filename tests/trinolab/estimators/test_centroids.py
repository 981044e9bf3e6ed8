"""Predicted centroids against those of rendered light, and their Jacobian against finite
differences.
"""

import numpy as np
import pytest
from scenes import bent, moved
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench
from trinolab.bench.scene import radiance
from trinolab.datasets import load_rig
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids
from trinolab.handle import Handle, slants

ONE = Handle("one", 5.0, 60.0, 30.0, 3.0, (0.0,), ((0.0,),))
PLAIN = load_rig("paper_pair")
BENT = bent(PLAIN, -0.3, 0.1, 1e-3, -2e-3, 0.0)
BOTH = Views(np.array([0, 1]), np.array([0, 0]))


def pose(turn_deg, tilt_deg=15.0):
    """The marker turned from the cameras by about `turn_deg`, the axis tilted; not in the image's
    middle.
    """
    rotation = Rotation.from_euler("zxy", [20.0, tilt_deg, 180.0 + turn_deg], degrees=True)
    return RigidTransform.from_components([45.0, -30.0, 540.0], rotation)


def light_centroid(camera, T, bench):
    """Of the marker's light alone, drawn with many rays a pixel."""
    image = radiance(camera, ONE, T, bench)
    v, u = np.nonzero(image)
    return np.array([u, v]) @ image[v, u] / image[v, u].sum()


@pytest.mark.parametrize("turn_deg", [-64, 0, 45])
@pytest.mark.parametrize("rig", [PLAIN, BENT], ids=["pinhole", "distorted"])
def test_centroid_is_that_of_rendered_light(rig, turn_deg):
    bench = Bench(background_grey=0, body_grey=0, marker_supersampling=32, shading=0)
    T = pose(turn_deg)
    assert slants(ONE, T, rig.cameras[0].centre)[0] < np.deg2rad(72)
    predicted, _ = predict_centroids(rig, ONE, T, BOTH)
    drawn = np.stack([light_centroid(camera, T, bench) for camera in rig.cameras])
    # px; 32 x 32 rays a pixel are off by up to 0.004
    np.testing.assert_allclose(predicted, drawn, atol=0.006)


def test_centroid_follows_the_shading():
    T, bench = pose(50), Bench(background_grey=0, body_grey=0, marker_supersampling=32, shading=0.6)
    normal, light = T.rotation.as_matrix()[:, 2], np.array(bench.light)
    across = T.rotation.as_matrix()[:, 0]
    level = 0.4 + 0.6 * normal @ light
    shading = np.array([[0.6 * across @ light, -0.6 * normal @ light, 0.0]] * 2) / level
    even, _ = predict_centroids(PLAIN, ONE, T, BOTH)
    shaded, _ = predict_centroids(PLAIN, ONE, T, BOTH, shading)
    drawn = np.stack([light_centroid(camera, T, bench) for camera in PLAIN.cameras])
    np.testing.assert_allclose(shaded, drawn, atol=0.006)  # px
    assert np.linalg.norm(even - drawn, axis=1).min() > 0.02  # so the shading matters


@pytest.mark.parametrize("rig", [PLAIN, BENT], ids=["pinhole", "distorted"])
@pytest.mark.parametrize("turn_deg", [5, 85])
def test_jacobian_is_that_of_finite_differences(rig, turn_deg):
    T = pose(turn_deg)
    _, jacobian = predict_centroids(rig, ONE, T, BOTH)
    for j, step in enumerate(1e-4 * np.eye(6)):
        high, low = (predict_centroids(rig, ONE, moved(T, s * step), BOTH)[0] for s in (1, -1))
        # a few 1e-6 of 60 px/rad: the lens's change of area is held fixed; at 85 deg points cross
        # the horizon
        np.testing.assert_allclose(
            (high - low) / 2e-4, jacobian[:, :, j], atol=5e-3 if turn_deg < 80 else 0.5
        )


def test_marker_that_shows_nothing_has_no_centroid():
    predicted, _ = predict_centroids(PLAIN, ONE, pose(170), BOTH)
    assert np.isnan(predicted).all()
