"""The estimators that fit all views, on rendered frames and on draws from their own models."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenes import bent, facing, moved
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from trinolab.bench.optics import Bench, blurred
from trinolab.bench.scene import radiance, render_rig, scaled
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.estimators import Identified, estimate
from trinolab.estimators.centroids import centre_pixels, predict_centroids
from trinolab.estimators.fitted import measured_pose
from trinolab.estimators.pixels import fit_patches
from trinolab.estimators.reprojection import fit_centroids, fit_pixels
from trinolab.handle import facing_pixels, slants
from trinolab.parameters import Parameters
from trinolab.pose import LOST
from trinolab.rigid import motion_between
from trinolab.uncertainty import assess

PAIR, TRIO = (load_rig(name) for name in ("paper_pair", "raised_40deg"))
HANDLE = load_handle("paper")
POSES = load_table1().set_poses
each_fit = pytest.mark.parametrize(
    "fit", [fit_centroids, fit_patches], ids=["centroids", "patches"]
)


def start_near(T, seed=0):
    """As far off as an identification leaves it."""
    rng = np.random.default_rng(seed)
    return moved(T, np.r_[rng.normal(0, 0.1, 3), rng.normal(0, 0.006, 3)])


def error(fit, T):
    """Position (mm) and rotation vector (rad), world frame."""
    return motion_between(fit.T_world_handle, T)


@pytest.mark.slow
@each_fit
def test_pose_is_found_to_hundredths(fit):
    frames = render_rig(PAIR, HANDLE, POSES[2], Bench(), np.random.default_rng(2))
    found = fit(frames, PAIR, HANDLE, start_near(POSES[2], 2))
    e = error(found, POSES[2])
    assert np.linalg.norm(e[:3]) < 0.03  # mm
    assert np.rad2deg(np.linalg.norm(e[3:])) < 0.15
    assert e @ np.linalg.solve(found.covariance, e) < chi2.ppf(0.9999, 6)
    assert found.shown.all()
    assert found.residual_px < 0.1


@pytest.mark.slow
@each_fit
def test_lens_distortion_dark_markers_blur_and_another_light(fit):
    rig = bent(TRIO, -0.2, 0.1, 1e-3, -1e-3, 0.0)
    handle = replace(HANDLE, markers="dark")
    bench = Bench(blur_px=1.3, light=(0.6, -0.5, -0.6), shading=0.5, background_grey=120)
    frames = render_rig(rig, handle, POSES[5], bench, np.random.default_rng(1))
    e = error(fit(frames, rig, handle, start_near(POSES[5], 1)), POSES[5])
    assert np.linalg.norm(e[:3]) < 0.03
    assert np.rad2deg(np.linalg.norm(e[3:])) < 0.2


@each_fit
def test_what_is_hidden_does_not_pull(fit):
    """A finger over half of two markers; and two cameras that see nothing at all."""
    T = POSES[6]
    frames = render_rig(TRIO, HANDLE, T, Bench(), np.random.default_rng(1))
    covered = [frames[0].copy(), *frames[1:]]
    uv = TRIO.cameras[0].project(T.apply(HANDLE.marker_centres))
    seen = np.flatnonzero(slants(HANDLE, T, TRIO.cameras[0].centre) < np.deg2rad(60))
    for k in seen[:2]:
        u, v = np.round(uv[k]).astype(int)
        covered[0][v - 12 : v + 12, u : u + 14] = 110
    found = fit(covered, TRIO, HANDLE, start_near(T, 3))
    e = error(found, T)
    assert np.linalg.norm(e[:3]) < 0.02
    assert np.rad2deg(np.linalg.norm(e[3:])) < 0.12
    assert not found.shown[(found.views.camera == 0) & np.isin(found.views.marker, seen[:2])].any()
    dark = [frames[0], np.full_like(frames[1], 20), np.full_like(frames[2], 20)]
    found = fit(dark, TRIO, HANDLE, start_near(T, 2))
    e = error(found, T)
    assert set(found.views.camera[found.shown]) == {0}
    assert np.linalg.norm(e[:3]) < 0.4  # mm, most of it along the line of sight
    assert e @ np.linalg.solve(found.covariance, e) < chi2.ppf(0.9999, 6)


def test_too_little_in_view_is_no_fit():
    away = RigidTransform.from_translation([0.0, 0.0, -500.0]) * POSES[0]
    frames = [np.zeros((1024, 1280), np.uint8)] * 3
    assert fit_patches(frames, TRIO, HANDLE, away) is None
    assert fit_centroids(frames, TRIO, HANDLE, away) is None


def test_wrong_match_is_outvoted():
    T = POSES[7]
    views, _ = facing(TRIO, HANDLE, T, 65)
    uv, _ = predict_centroids(TRIO, HANDLE, T, views)
    uv = uv + np.random.default_rng(0).normal(0, 0.02, uv.shape)
    uv[1] += [9.0, -4.0]
    spread = np.broadcast_to(0.02**2 * np.eye(2), (len(uv), 2, 2))
    robust, _ = fit_pixels(uv, spread, TRIO, HANDLE, views, start_near(T), steps=10)
    plain, _ = fit_pixels(uv, spread, TRIO, HANDLE, views, start_near(T), steps=10, huber=1e9)
    off = [np.linalg.norm(found.translation - T.translation) for found in (robust, plain)]
    assert off[0] < 0.05 < off[1]  # mm


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "most_px"), [(1.0, 0.02), (1.4, 0.1)], ids=["", "saturated"])
def test_registered_centroids_have_no_bias(gain, most_px):
    """A sample of `make verify`; nor do saturated pixels pull by more than a tenth."""
    bench = Bench()
    clean = [
        gain * blurred(radiance(camera, HANDLE, POSES[4], bench), bench) for camera in TRIO.cameras
    ]
    assert any((image > 255).sum() > 200 for image in clean) == (gain > 1)
    frames = [np.minimum(image, 255) for image in clean]
    found = centre_pixels(frames, TRIO, HANDLE, POSES[4], 60.0)
    truth = [camera.project(POSES[4].apply(HANDLE.marker_centres)) for camera in TRIO.cameras]
    assert np.nanmax(np.abs(found.uv - truth)) < most_px


def seen_exactly(rig, T):
    return np.stack([facing_pixels(HANDLE, camera, T, 70.0) for camera in rig.cameras])


@cache
def small_pair():
    """The pair at half its size, and what it sees of a handle."""
    rig = replace(PAIR, cameras=tuple(scaled(camera, 0.5) for camera in PAIR.cameras))
    bench = Bench(supersampling=4, marker_supersampling=8)
    return rig, render_rig(rig, HANDLE, POSES[5], bench, np.random.default_rng(1))


@pytest.mark.parametrize(
    "parameters",
    [
        Parameters(estimator="paper", check=True),
        Parameters(estimator="reprojection"),
        Parameters(estimator="patches"),
    ],
    ids=["checked", "reprojection", "patches"],
)
def test_images_that_contradict_each_other_make_a_pose_less_sure(parameters):
    """One image lies a pixel higher, across the epipolar lines: no pose explains both."""
    rig, (left, right) = small_pair()
    poses = []
    for up in (0, 1):
        uv = seen_exactly(rig, POSES[5]) - [[[0, 0]], [[0, up]]]
        images = [left, np.roll(right, -up, axis=0)]
        poses.append(estimate(Identified(images, uv, POSES[5], rig), rig, HANDLE, parameters))
    agreeing, contradicting = poses
    assert contradicting.sigma_mm > 3 * agreeing.sigma_mm
    for pose in poses:
        e = error(pose, POSES[5])
        assert e @ np.linalg.solve(pose.covariance, e) < chi2.ppf(0.99, 6)


def test_a_pose_that_may_well_be_a_false_one_is_lost():
    rig, images = small_pair()
    fit = fit_patches(images, rig, HANDLE, POSES[5])
    found = assess(fit.linear, rig, HANDLE)
    assert measured_pose(fit, found).status == "measured"
    # one in three is further off than 2 mm, or than 5 deg
    for sigma in (np.eye(6)[0] * 2 / 0.967, np.eye(6)[4] * np.deg2rad(5) / 0.967):
        unsure = found._replace(systematic=np.diag(sigma**2), covariance_random=1e-12 * np.eye(6))
        assert measured_pose(fit, unsure) is LOST


def test_where_the_pixels_show_no_marker_there_is_no_pose():
    """Whatever the markers' places say that somebody found; the check leaves the paper's pose."""
    nothing = [np.full(camera.size[::-1], 40.0) for camera in PAIR.cameras]
    instant = Identified(nothing, seen_exactly(PAIR, POSES[5]), start_near(POSES[5]), PAIR)

    def estimated(**parameters):
        return estimate(instant, PAIR, HANDLE, Parameters(**parameters))

    assert estimated(estimator="reprojection") is estimated(estimator="patches") is LOST
    checked, papers = (estimated(estimator="paper", check=check) for check in (True, False))
    assert repr(checked.T_world_handle) == repr(papers.T_world_handle)
    np.testing.assert_array_equal(checked.covariance, papers.covariance)
    assert np.linalg.norm(error(papers, POSES[5])) < 1e-9  # the pixels are exact
