"""How large the errors of a rig are by what is seen: rigs that say nothing, drawn good and bad, on
rendered images.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance
from trinolab.camera import RigCovariance
from trinolab.datasets import load_handle, load_rig
from trinolab.measurement import measure
from trinolab.parameters import Parameters
from trinolab.rigid import motion_between
from workbench.studies.broken import miscalibrated

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
        pose = measure(images, rig, CODED, POSE, Parameters(estimator=estimator)).pose
        if pose.status != "measured":
            continue
        away = motion_between(pose.T_world_handle, POSE)[:3]
        ratios.append(np.linalg.norm(away) / pose.sigma_mm)
    return np.array(ratios)


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


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
                (2, "paper_checked"),
                (3, "paper_checked"),
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
