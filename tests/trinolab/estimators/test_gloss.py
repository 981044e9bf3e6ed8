"""Gloss: light that varnish sends back of marker and body alike, which the image model has where the
windows show it.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.estimators import pixels, reprojection
from trinolab.estimators.centroids import register
from trinolab.estimators.imagemodel import (
    first_state,
    has_gloss,
    linearise,
    marker_shading,
    with_gloss,
)
from trinolab.estimators.patches import patches
from trinolab.estimators.rows import BODY, GLOSS, GREYS, MARKER, PREDICTED
from trinolab.metrics import nees
from trinolab.rigid import apart, shifted
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
    rng = np.random.default_rng(100 + row)
    way, turn = rng.standard_normal((2, 3))
    off = RigidTransform.from_components(
        mm * way / np.linalg.norm(way),
        Rotation.from_rotvec(np.deg2rad(deg) * turn / np.linalg.norm(turn)),
    )
    return POSES[row] * off


def error_of(fit, row):
    """Distance, mm, and angle, rad."""
    found, truth = fit.T_world_handle, POSES[row]
    angle = (found.rotation * truth.rotation.inv()).magnitude()
    return np.array([np.linalg.norm(found.translation - truth.translation), angle])


@pytest.fixture(scope="module")
def varnished():
    return {row: images_of(row, varnished=True) for row in ROWS}


def without_gloss(monkeypatch):
    for module in (pixels, reprojection):
        monkeypatch.setattr(module, "shows_gloss", lambda *_: False, raising=False)


@pytest.mark.slow
def test_gloss_is_in_the_model_where_it_shows(varnished, monkeypatch):
    """Four poses: the covariance holds with it. Light from the side pulls around the axis: without gloss
    the angles are off by more than twice as much.
    """
    starts = {row: off_by(row, 0.1, 1.0) for row in ROWS}
    fits = {row: pixels.fit_patches(varnished[row], RIG, PAPER, starts[row]) for row in ROWS}
    for row, fit in fits.items():
        found = assess(fit.linear, RIG, PAPER)
        covariance = found.covariance_random + found.systematic
        value = nees(found.T_world_handle, covariance, POSES[row])[0]
        assert value < chi2.ppf(0.9999, 6)
    without_gloss(monkeypatch)
    plain = {row: pixels.fit_patches(varnished[row], RIG, PAPER, starts[row]) for row in ROWS}
    errors, plain_errors = (
        np.mean([error_of(fit, row) for row, fit in found.items()], axis=0)
        for found in (fits, plain)
    )
    assert errors[0] < plain_errors[0]
    assert errors[1] < 0.5 * plain_errors[1]


@pytest.mark.slow
def test_gloss_is_in_the_model_of_a_handle_that_moves(monkeypatch):
    """Four poses, smeared by 4 px: the covariance holds with it, and its angles are twice as near."""
    expected = MOTION, np.diag([0.3, 0.3, 0.3, 0.01, 0.01, 0.01]) ** 2
    images = {row: images_of(row, varnished=True, motion=MOTION) for row in ROWS}

    def found():
        for row, taken in images.items():
            start = off_by(row, 0.1, 1.0)
            yield row, pixels.fit_patches(taken, RIG, PAPER, start, motion_blur=expected)

    fits = dict(found())
    for row, fit in fits.items():
        found = assess(fit.linear, RIG, PAPER)
        covariance = found.covariance_random + found.systematic
        value = nees(found.T_world_handle, covariance, POSES[row])[0]
        assert value < chi2.ppf(0.9999, 6)
    without_gloss(monkeypatch)
    angles = [error_of(fit, row)[1] for row, fit in fits.items()]
    plain = [error_of(fit, row)[1] for row, fit in found()]
    assert np.mean(angles) < 0.5 * np.mean(plain)


@pytest.mark.slow
def test_a_scene_without_gloss_is_fitted_without_it(monkeypatch):
    images = {row: images_of(row, varnished=False) for row in ROWS}
    starts = {row: off_by(row, 0.1, 1.0) for row in ROWS}
    fits = [pixels.fit_patches(images[row], RIG, PAPER, starts[row]) for row in ROWS]
    without_gloss(monkeypatch)
    for row, fit in zip(ROWS, fits, strict=True):
        plain = pixels.fit_patches(images[row], RIG, PAPER, starts[row])
        np.testing.assert_array_equal(
            fit.T_world_handle.as_matrix(), plain.T_world_handle.as_matrix()
        )
        np.testing.assert_array_equal(fit.covariance, plain.covariance)


def test_centroids_are_registered_with_gloss(varnished):
    for row in ROWS:
        fit = reprojection.fit_centroids(varnished[row], RIG, PAPER, off_by(row, 0.1, 1.0))
        assert not apart(fit.T_world_handle, POSES[row], 0.03, np.deg2rad(0.3))


def test_a_handle_that_is_a_pixel_away_has_no_gloss():
    """What is left of a long step looks like it."""
    images, start = images_of(6, varnished=False), off_by(6, 0.5, 0.5)
    windows = patches(images, RIG, PAPER, start, 72.0)
    state, registered = register(first_state(start, RIG), windows, RIG, PAPER)
    assert np.median(np.linalg.norm(registered.shift, axis=1)) > 0.5
    assert not has_gloss(state)


def test_gloss_is_added_to_marker_and_body(varnished):
    """Ten grey levels of each function, on all of the body and nowhere else."""
    windows = patches(varnished[1], RIG, PAPER, POSES[1], 60.0)
    state, _ = register(first_state(POSES[1], RIG), windows, RIG, PAPER)
    plain = with_gloss(state)
    before = linearise(plain, windows, RIG, PAPER)
    rows = before.rows.copy()  # the next model takes the memory
    for k in range(3):
        greys = plain.greys.copy()
        greys[:, 5 + k] += 10.0
        glossy = plain._replace(greys=greys)
        assert has_gloss(glossy)
        assert marker_shading(greys) is None
        added = linearise(glossy, windows, RIG, PAPER).predicted - rows[:, PREDICTED]
        np.testing.assert_allclose(added, 10 * rows[:, GREYS + 5 + k], atol=1e-9)
        np.testing.assert_array_equal(rows[:, GREYS + 5 + k], rows[:, GLOSS + k])
        assert np.abs(added[rows[:, BODY] < 1e-6]).max(initial=0.0) < 1e-4
        on_marker = rows[:, MARKER] > 0.99
        on_body = (rows[:, BODY] > 0.99) & (rows[:, MARKER] < 0.01)
        assert np.abs(added[on_marker]).max() > 0.02
        assert np.abs(added[on_body]).max() > 0.02
