"""How large the errors of a rig are by what is seen: rigs that say nothing, drawn good and bad, on
drawn centroids and on rendered images.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.motion import random_pose
from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance
from trinolab.camera import RigCovariance
from trinolab.datasets import load_handle, load_rig
from trinolab.handle import slants
from trinolab.identity.parameters import IdentityParameters
from trinolab.identity.reconcile import reconciled
from trinolab.measurement import measure
from trinolab.metrics import nees
from trinolab.pose import fit_pose
from trinolab.rigid import motion_between
from workbench.studies.broken import miscalibrated
from workbench.studies.replication import CHECKED, EVERY

CODED = load_handle("coded")
RAISED = load_rig("raised_40deg")
POSE = RigidTransform.from_components([20.0, -10.0, 560.0], Rotation.from_rotvec([0.2, 0.3, 0.4]))
DRAWS = 24


@cache
def clean():
    """The three images without noise."""
    bench = Bench()
    return [blurred(radiance(camera, CODED, POSE, bench), bench) for camera in RAISED.cameras]


def scores(count, px, deg, estimator, stated=None):
    """The errors by sigma, mm, of the poses that drawn rigs of the first cameras measure."""
    rng = np.random.default_rng([35, count])
    ratios = []
    for _ in range(DRAWS):
        images = [digitise(image, Bench(), rng) for image in clean()[:count]]
        rig = miscalibrated(RAISED.part(range(count)), px, deg, rng)
        rig = replace(rig, covariance=stated and stated(rig.names))
        pose = measure(images, rig, CODED, POSE, EVERY[estimator]).pose
        if pose.status != "measured":
            continue
        away = motion_between(pose.T_world_handle, POSE)[:3]
        ratios.append(np.linalg.norm(away) / pose.sigma_mm)
    return np.array(ratios)


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def centroids(rig, T, noise_px, rng):
    """What a rig sees of the coded handle's markers that are turned away by less than 60 deg."""
    uv = np.full((len(rig.cameras), len(CODED.marker_centres), 2), np.nan)
    for c, camera in enumerate(rig.cameras):
        facing = slants(CODED, T, camera.centre) < np.deg2rad(60)
        uv[c, facing] = camera.project(T.apply(CODED.marker_centres[facing]))
    return uv + noise_px * rng.standard_normal(uv.shape)


def mean_nees(count, px, deg, draws, noise_px=0.01):
    """Of drawn poses, seen by the first cameras and measured with a drawn rig."""
    rng = np.random.default_rng([3, count])
    rig = RAISED.part(range(count))
    total = []
    while len(total) < draws:
        T = random_pose(rng)
        uv = centroids(rig, T, noise_px, rng)
        if np.isfinite(uv[:2, :, 0]).all(axis=0).sum() < 4:
            continue
        drawn = miscalibrated(rig, px, deg, rng)
        here, _ = reconciled(drawn, CODED, uv, T, 0.1, IdentityParameters())
        pose = fit_pose(uv, here, CODED, sigma_px=noise_px)
        total.append(nees(pose.T_world_handle, pose.covariance, T)[0])
    return np.mean(total)


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize(("px", "deg"), [(0.1, 0.005), (0.3, 0.02)])
def test_rigs_that_say_nothing_have_covariances_of_the_size_of_their_errors_good_or_bad(
    count, px, deg
):
    """Between good and bad lies a factor of 15 in the covariance. The mean of 120 is known to 0.4 for
    the good ones and to 1.5 for the bad ones: two or three cameras tell little of a size.
    """
    assert 4.0 < mean_nees(count, px, deg, 120) < 9.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "estimator"),
    [
        (3, "patches"),
        *(
            pytest.param(count, estimator, marks=pytest.mark.heavy)
            for count, estimator in (
                (2, "patches"),
                (2, "paper"),
                (3, "paper"),
                (2, CHECKED),
                (3, CHECKED),
            )
        ),
    ],
)
def test_rigs_that_say_nothing_are_about_as_far_off_as_their_sigmas_good_or_bad(count, estimator):
    """Errors of 0.28 and 1.07 px an image, of which a pair shows one way of four."""
    good = scores(count, 0.1, 0.005, estimator)
    bad = scores(count, 0.3, 0.02, estimator)
    assert min(len(good), len(bad)) > 0.95 * DRAWS
    assert 0.4 < rms(good) < 1.4
    assert 0.6 < rms(bad) < 1.9
    assert max(good.max(), bad.max()) < 5.0


@pytest.mark.slow
def test_a_rig_that_says_it_is_exact_and_is_not_is_found_out_where_that_shows():
    """By its own word its poses, those that are not refused, would be tens of sigmas off; the
    handle's size contradicts it.
    """
    ratios = scores(2, 0.3, 0.02, "patches", stated=RigCovariance.exact)
    assert len(ratios) >= DRAWS / 4
    assert np.median(ratios) < 3.0
