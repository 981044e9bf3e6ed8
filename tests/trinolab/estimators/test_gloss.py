"""Gloss: light that varnish sends back of marker and body alike, which the image model has where the
windows show it.
"""

import numpy as np
import pytest
from scenes import moved
from scipy.stats import chi2

from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.estimators import pixels, reprojection
from trinolab.metrics import nees
from trinolab.rigid import apart, motion_between, shifted
from trinolab.uncertainty import assess

RIG, PAPER = load_rig("raised_40deg"), load_handle("paper")
POSES = load_table1().set_poses
# what a body of one paint shows under a light from the side alone
VARNISH = Bench(
    body_grey=55,
    marker_grey=55,
    background_grey=0,
    texture_contrast=0,
    shading=1,
    light=(-1, -0.5, -0.6),
)
ROWS = (1, 6, 11, 16)


# while the shutter is open, mm and rad, world frame
MOTION = np.array([0.6, 0.3, 0.0, 0.0, 0.0, 0.0])
MOMENTS = np.linspace(-0.5, 0.5, 5)


def images_of(row, varnished, motion=None):
    """A frame a camera; varnish adds its light to that of the standard scene."""
    bench, rng = Bench(), np.random.default_rng(row)
    poses = [POSES[row]] if motion is None else [shifted(POSES[row], s * motion) for s in MOMENTS]
    images = []
    for camera in RIG.cameras:
        light = sum(radiance(camera, PAPER, T, bench) for T in poses)
        if varnished:
            light = light + sum(radiance(camera, PAPER, T, VARNISH) for T in poses)
        images.append(digitise(blurred(light / len(poses), bench), bench, rng))
    return images


def off_by(row, mm, deg):
    way, turn = np.random.default_rng(100 + row).standard_normal((2, 3))
    size = np.array([mm, np.deg2rad(deg)])[:, None]
    step = size * [way, turn] / np.linalg.norm([way, turn], axis=1)[:, None]
    return moved(POSES[row], step.ravel())


def error_of(fit, row):
    """Distance, mm, and angle, rad."""
    return np.linalg.norm(motion_between(fit.T_world_handle, POSES[row]).reshape(2, 3), axis=1)


@pytest.fixture(scope="module")
def varnished():
    return {row: images_of(row, varnished=True) for row in ROWS}


def without_gloss(monkeypatch):
    for module in (pixels, reprojection):
        monkeypatch.setattr(module, "shows_gloss", lambda *_: False, raising=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "motion"), [(ROWS, None), (ROWS[:1], MOTION)], ids=["still", "smeared by 4 px"]
)
def test_gloss_is_in_the_model_where_it_shows(rows, motion, varnished, monkeypatch):
    """The covariance holds with it. Light from the side pulls around the axis: without gloss the
    angles are off by more than twice as much.
    """
    blur = motion if motion is None else (motion, np.diag([0.3] * 3 + [0.01] * 3) ** 2)

    images = {row: varnished[row] if blur is None else images_of(row, True, motion) for row in rows}

    def fitted(row):
        return pixels.fit_patches(images[row], RIG, PAPER, off_by(row, 0.1, 1.0), motion_blur=blur)

    fits = {row: fitted(row) for row in rows}
    for row, fit in fits.items():
        found = assess(fit.linear, RIG, PAPER)
        covariance = found.covariance_random + found.systematic
        assert nees(found.T_world_handle, covariance, POSES[row])[0] < chi2.ppf(0.9999, 6)
    without_gloss(monkeypatch)
    errors = np.mean([error_of(fit, row) for row, fit in fits.items()], axis=0)
    plain = np.mean([error_of(fitted(row), row) for row in rows], axis=0)
    assert errors[1] < 0.5 * plain[1]
    assert motion is not None or errors[0] < plain[0]


@pytest.mark.slow
def test_a_scene_without_gloss_is_fitted_without_it(monkeypatch):
    images, start = images_of(6, varnished=False), off_by(6, 0.1, 1.0)
    fit = pixels.fit_patches(images, RIG, PAPER, start)
    without_gloss(monkeypatch)
    plain = pixels.fit_patches(images, RIG, PAPER, start)
    assert repr(fit.T_world_handle) == repr(plain.T_world_handle)
    np.testing.assert_array_equal(fit.covariance, plain.covariance)


def test_centroids_are_registered_with_gloss(varnished):
    for row in ROWS[:2]:
        fit = reprojection.fit_centroids(varnished[row], RIG, PAPER, off_by(row, 0.1, 1.0))
        assert not apart(fit.T_world_handle, POSES[row], 0.03, np.deg2rad(0.3))
