"""What centroids of wrapped markers do to a pose: their bias in closed form against a sum over the
disc, and covariances against drawn errors.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.datasets import load_handle, load_rig
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import predict_centroids
from trinolab.estimators.paper import pose_of_centroids
from trinolab.handle import slants
from trinolab.metrics import nees
from trinolab.pose import fit_pose
from trinolab.uncertainty.centroids import LIGHT, NOISE_PX, PULL, centroid_bias, pulled_alike

PAIR, RAISED = load_rig("paper_pair"), load_rig("raised_40deg")
CODED = load_handle("coded")
POSE = RigidTransform.from_components(
    [10.0, -15.0, 560.0], Rotation.from_euler("ZXY", [35.0, 15.0, 20.0], degrees=True)
)


def views_of(rig, handle, T, most_deg):
    slant = np.stack([slants(handle, T, camera.centre) for camera in rig.cameras])
    return Views(*np.nonzero(slant < np.deg2rad(most_deg)))


def centres_px(rig, handle, T):
    return np.stack([camera.project(T.apply(handle.marker_centres)) for camera in rig.cameras])


@pytest.mark.parametrize("diameter_mm", [1.5, 3.0, 4.5])
def test_the_bias_is_that_of_a_sum_over_the_disc(diameter_mm):
    """The sum is in perspective; the closed form is of a view from afar, 100 radii away."""
    handle = replace(CODED, marker_diameter_mm=diameter_mm)
    views = views_of(RAISED, handle, POSE, 65.0)
    expected = (
        predict_centroids(RAISED, handle, POSE, views)[0] - centres_px(RAISED, handle, POSE)[views]
    )
    found = centroid_bias(*views, POSE, RAISED, handle).foreshortening
    size = np.linalg.norm(expected, axis=1).max()
    assert size > 0.15 * (diameter_mm / 3) ** 2
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.03 * size)


def test_light_from_the_side_pulls_as_a_slant_of_its_angle_does():
    """A sum over the disc with Lambert's light 20 deg beside the normal, seen by all cameras."""
    views = views_of(RAISED, CODED, POSE, 50.0)
    slope = np.tan(np.deg2rad(20.0))
    shading = np.tile([slope, -1.0, 0.0], (len(views.camera), 1))
    lit, even = (predict_centroids(RAISED, CODED, POSE, views, s)[0] for s in (shading, None))
    pulled = lit - even
    bias = centroid_bias(*views, POSE, RAISED, CODED)
    # the angle of the light by that of its own column: 20 deg for all
    around = CODED.marker_angles[views.marker]
    directions = np.stack([np.cos(around), np.sin(around)], axis=1)
    expected = slope / LIGHT * np.einsum("kij,kj->ki", bias.light, directions)
    size = np.linalg.norm(pulled, axis=1).max()
    np.testing.assert_allclose(pulled, expected, rtol=0, atol=0.1 * size)


def test_markers_of_a_column_are_pulled_alike():
    views = views_of(RAISED, CODED, POSE, 50.0)
    n = len(views.camera)
    pulls = pulled_alike(*views, np.tile(np.eye(2), (n, 1, 1)), POSE, RAISED, CODED)
    pulls = pulls.reshape(n, 2, n, 2)
    np.testing.assert_allclose(np.einsum("kiki->k", pulls), PULL)
    around = CODED.marker_angles[views.marker]
    assert (pulls.any(axis=(1, 3)) == np.isclose(around[:, None], around)).all()


def drawn_centroids(rig, handle, T, noise_px, rng, light=0.5, mirrored=0.0):
    """Light from each of two directions pulls by a normal number of the size `light`, by the pull of
    light at 45 deg; with `mirrored` each column is also pulled around the axis, all views of it alike.
    """
    views = views_of(rig, handle, T, 68.0)
    bias = centroid_bias(*views, T, rig, handle)
    uv = np.full((len(rig.cameras), len(handle.marker_centres), 2), np.nan)
    columns, column = np.unique(handle.marker_angles[views.marker], return_inverse=True)
    around = np.stack([np.cos(columns), np.sin(columns)], axis=1)[column]
    lights = light / LIGHT * rng.standard_normal(2)
    pulls = mirrored / LIGHT * rng.standard_normal((len(columns), 1))[column]
    uv[views] = (
        centres_px(rig, handle, T)[views]
        + bias.foreshortening
        + pulls * np.einsum("kij,kj->ki", bias.light, around)
        + bias.light @ lights
        + noise_px * rng.standard_normal(bias.foreshortening.shape)
    )
    return uv


def nees_of(rig, k, rng, noise_px, **options):
    """By all that is known, and by the noise alone; the handle is turned from draw to draw."""
    T = POSE * RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.08 * k, 0.0]))
    uv = drawn_centroids(rig, CODED, T, noise_px, rng, **options)
    fits = pose_of_centroids(uv, rig, CODED), fit_pose(uv, rig, CODED, sigma_px=noise_px)
    return [nees(pose.T_world_handle, pose.covariance, T)[0] for pose in fits]


EVERY = itertools.product((PAIR, RAISED), (NOISE_PX, 5 * NOISE_PX), (0.4, 0.7))


DRAWS = [
    (PAIR, NOISE_PX, 0.7, 60),
    (RAISED, 5 * NOISE_PX, 0.4, 60),
    *(pytest.param(*case, 240, marks=pytest.mark.heavy) for case in EVERY),
]


@pytest.mark.slow
@pytest.mark.parametrize(("rig", "noise_px", "light", "count"), DRAWS)
def test_nees_of_drawn_centroids(rig, noise_px, light, count):
    """The bias is no draw: along it an error counts less than 1. Nor is any fault drawn, of which the
    covariance knows. Without the bias NEES is several times as large.
    The two sizes of the light are those that two renderers have.
    """
    rng = np.random.default_rng(5)
    drawn = [nees_of(rig, 240 // count * k, rng, noise_px, light=light) for k in range(count)]
    known, of_noise = np.mean(drawn, axis=0)
    assert 4.0 < known < 8.0  # 240 draws know it to 0.3
    assert of_noise > 3 * known


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rig", "count"),
    [(PAIR, 30), *(pytest.param(r, 120, marks=pytest.mark.heavy) for r in (PAIR, RAISED))],
)
def test_nees_of_centroids_that_highlights_pull(rig, count):
    """As hard as on the path-traced frames. Taken for noise of single views it was above 10."""
    rng = np.random.default_rng(6)
    drawn = [
        nees_of(rig, 120 // count * k, rng, 2 * NOISE_PX, mirrored=0.7)[0] for k in range(count)
    ]
    assert 4.5 < np.mean(drawn) < 8.0


@pytest.mark.parametrize("px", [2.0, 10.0])
def test_an_image_that_lies_wrong_is_no_noise_of_its_centroids(px):
    """Along the base it makes a wrong distance, which contradicts the handle's size in both images:
    taken for noise of single centroids the error was 14 and 20 of the pose's sigmas.
    """
    silent = replace(PAIR, covariance=None)
    for k in range(2):
        T = POSE * RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.08 * k, 0.0]))
        uv = drawn_centroids(PAIR, CODED, T, NOISE_PX, np.random.default_rng([8, k]), 0.3)
        uv[1, :, 0] += px
        pose = pose_of_centroids(uv, silent, CODED)
        error_mm = np.linalg.norm(pose.T_world_handle.translation - T.translation)
        assert error_mm > px
        assert error_mm < 3 * pose.sigma_mm
