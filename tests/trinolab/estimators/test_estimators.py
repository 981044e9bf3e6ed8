"""The estimators that fit all views, on rendered frames and on draws from their own models."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import radiance, render_rig, scaled
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.estimators import Identified, estimate
from trinolab.estimators.appearance import Views
from trinolab.estimators.centroids import centre_pixels, predict_centroids
from trinolab.estimators.fitted import measured_pose
from trinolab.estimators.pixels import fit_patches
from trinolab.estimators.reprojection import fit_centroids, fit_pixels
from trinolab.handle import facing_pixels, slants
from trinolab.measurement import measure
from trinolab.parameters import Parameters
from trinolab.pose import LOST
from trinolab.uncertainty import assess

PAIR, TRIO, ABOVE = (load_rig(name) for name in ("paper_pair", "raised_40deg", "paper_trinocular"))
HANDLE = load_handle("paper")
POSES = load_table1().set_poses
each_fit = pytest.mark.parametrize(
    "fit", [fit_centroids, fit_patches], ids=["centroids", "patches"]
)


def moved(T, step):
    return T * RigidTransform.from_components(step[:3], Rotation.from_rotvec(step[3:]))


def start_near(T, seed=0):
    """As far off as an identification leaves it."""
    rng = np.random.default_rng(seed)
    return moved(T, np.r_[rng.normal(0, 0.1, 3), rng.normal(0, 0.006, 3)])


def error(fit, T):
    """Position (mm) and rotation vector (rad), world frame."""
    turn = (fit.T_world_handle.rotation * T.rotation.inv()).as_rotvec()
    return np.r_[fit.T_world_handle.translation - T.translation, turn]


@pytest.mark.slow
@each_fit
@pytest.mark.parametrize(
    "rig",
    [
        pytest.param(PAIR, id="pair"),
        pytest.param(ABOVE, id="above", marks=pytest.mark.heavy),
        pytest.param(TRIO, id="raised", marks=pytest.mark.heavy),
    ],
)
def test_pose_is_found_to_hundredths(fit, rig):
    for k in (2, 11):
        frames = render_rig(rig, HANDLE, POSES[k], Bench(), np.random.default_rng(k))
        found = fit(frames, rig, HANDLE, start_near(POSES[k], k))
        e = error(found, POSES[k])
        assert np.linalg.norm(e[:3]) < 0.03  # mm
        assert np.rad2deg(np.linalg.norm(e[3:])) < 0.15
        assert e @ np.linalg.solve(found.covariance, e) < chi2.ppf(0.9999, 6)
        assert found.shown.all()
        assert found.residual_px < 0.1


@pytest.mark.slow
@each_fit
def test_lens_distortion_dark_markers_blur_and_another_light(fit):
    rig = Rig(
        tuple(replace(c, distortions=np.array([-0.2, 0.1, 1e-3, -1e-3, 0.0])) for c in TRIO.cameras)
    )
    handle = replace(HANDLE, markers="dark")
    bench = Bench(blur_px=1.3, light=(0.6, -0.5, -0.6), shading=0.5, background_grey=120)
    frames = render_rig(rig, handle, POSES[5], bench, np.random.default_rng(1))
    e = error(fit(frames, rig, handle, start_near(POSES[5], 1)), POSES[5])
    assert np.linalg.norm(e[:3]) < 0.03
    assert np.rad2deg(np.linalg.norm(e[3:])) < 0.2


@each_fit
def test_one_camera_is_enough(fit):
    frames = render_rig(TRIO, HANDLE, POSES[3], Bench(), np.random.default_rng(1))
    dark = [frames[0], np.full_like(frames[1], 20), np.full_like(frames[2], 20)]
    found = fit(dark, TRIO, HANDLE, start_near(POSES[3], 2))
    e = error(found, POSES[3])
    assert set(found.views.camera[found.shown]) == {0}
    assert np.linalg.norm(e[:3]) < 0.4  # mm, most of it along the line of sight
    assert e @ np.linalg.solve(found.covariance, e) < chi2.ppf(0.9999, 6)


@each_fit
def test_hidden_markers_do_not_pull(fit):
    frames = render_rig(TRIO, HANDLE, POSES[6], Bench(), np.random.default_rng(1))
    uv = TRIO.cameras[0].project(POSES[6].apply(HANDLE.marker_centres))
    seen = np.flatnonzero(slants(HANDLE, POSES[6], TRIO.cameras[0].centre) < np.deg2rad(60))
    for k in seen[:2]:  # a finger over half of a marker
        u, v = np.round(uv[k]).astype(int)
        frames[0][v - 12 : v + 12, u : u + 14] = 110
    found = fit(frames, TRIO, HANDLE, start_near(POSES[6], 3))
    e = error(found, POSES[6])
    assert np.linalg.norm(e[:3]) < 0.02
    assert np.rad2deg(np.linalg.norm(e[3:])) < 0.12
    assert not found.shown[(found.views.camera == 0) & np.isin(found.views.marker, seen[:2])].any()


def test_too_little_in_view_is_no_fit():
    away = RigidTransform.from_translation([0.0, 0.0, -500.0]) * POSES[0]
    frames = [np.zeros((1024, 1280), np.uint8)] * 3
    assert fit_patches(frames, TRIO, HANDLE, away) is None
    assert fit_centroids(frames, TRIO, HANDLE, away) is None


def all_views(rig, T):
    slant = np.stack([slants(HANDLE, T, camera.centre) for camera in rig.cameras])
    return Views(*np.nonzero(slant < np.deg2rad(65)))


@pytest.mark.heavy
def test_reprojection_covariance_is_honest():
    """NEES over 1,000 draws of the centroids, inside its 95 % band."""
    rng, T, sigma = np.random.default_rng(4), POSES[7], 0.05
    views = all_views(PAIR, T)
    exact, _ = predict_centroids(PAIR, HANDLE, T, views)
    spread = np.broadcast_to(sigma**2 * np.eye(2), (len(exact), 2, 2))
    nees = []
    for _ in range(1000):
        drawn = exact + rng.normal(0, sigma, exact.shape)
        found, C = fit_pixels(drawn, spread, PAIR, HANDLE, views, T, huber=1e9, steps=2)
        e = np.r_[
            found.translation - T.translation, (found.rotation * T.rotation.inv()).as_rotvec()
        ]
        nees.append(e @ np.linalg.solve(C, e))
    low, high = chi2.ppf([0.025, 0.975], 6000) / 1000
    assert low < np.mean(nees) < high


def test_wrong_match_is_outvoted():
    T, views = POSES[7], all_views(TRIO, POSES[7])
    uv, _ = predict_centroids(TRIO, HANDLE, T, views)
    uv = uv + np.random.default_rng(0).normal(0, 0.02, uv.shape)
    uv[1] += [9.0, -4.0]
    spread = np.broadcast_to(0.02**2 * np.eye(2), (len(uv), 2, 2))
    robust, _ = fit_pixels(uv, spread, TRIO, HANDLE, views, start_near(T), steps=10)
    plain, _ = fit_pixels(uv, spread, TRIO, HANDLE, views, start_near(T), steps=10, huber=1e9)
    off = [np.linalg.norm(found.translation - T.translation) for found in (robust, plain)]
    assert off[0] < 0.05 < off[1]  # mm


@pytest.mark.heavy
def test_patches_covariance_is_honest_on_rendered_noise():
    """A sample of `make verify`: the mean NEES of 60 draws, within four standard deviations."""
    rng, bench, nees = np.random.default_rng(5), Bench(), []
    for k in (1, 8, 15):
        clean = [
            blurred(radiance(camera, HANDLE, POSES[k], bench), bench) for camera in PAIR.cameras
        ]
        for _ in range(20):
            found = fit_patches(
                [digitise(image, bench, rng) for image in clean], PAIR, HANDLE, start_near(POSES[k])
            )
            e = error(found, POSES[k])
            nees.append(e @ np.linalg.solve(found.covariance, e))
    assert abs(np.mean(nees) - 6) < 4 * np.sqrt(12 / len(nees))


@pytest.mark.heavy
def test_covariance_of_pairs_is_honest_on_rendered_noise():
    """As above for the paper's pose with its check, 24 draws: its bias is in the covariance."""
    rng, bench, nees = np.random.default_rng(6), Bench(), []
    for k in (2, 9, 16):
        clean = [
            blurred(radiance(camera, HANDLE, POSES[k], bench), bench) for camera in TRIO.cameras
        ]
        for _ in range(8):
            images = [digitise(image, bench, rng) for image in clean]
            pose = measure(
                images, TRIO, HANDLE, POSES[k], Parameters(estimator="paper", check=True)
            ).pose
            e = error(pose, POSES[k])
            nees.append(e @ np.linalg.solve(pose.covariance, e))
    assert abs(np.mean(nees) - 6) < 4 * np.sqrt(12 / len(nees))


@pytest.mark.slow
def test_registered_centroids_have_no_bias_along_the_slant():
    """A sample of `make verify`: frames without noise, markers up to 65 deg."""
    worst = 0.0
    for k in (0, 4, 9):
        frames = [
            blurred(radiance(camera, HANDLE, POSES[k], Bench()), Bench()) for camera in TRIO.cameras
        ]
        found = centre_pixels(frames, TRIO, HANDLE, POSES[k], 65.0)
        truth = np.stack(
            [camera.project(POSES[k].apply(HANDLE.marker_centres)) for camera in TRIO.cameras]
        )
        worst = max(worst, np.nanmax(np.abs(found.uv - truth)))
    assert worst < 0.02  # px in a single marker; a bin's mean must be within 0.01


def test_saturated_pixels_do_not_pull():
    frames = render_rig(PAIR, HANDLE, POSES[4], Bench(), np.random.default_rng(0), gain=1.4)
    assert any((frame == 255).sum() > 200 for frame in frames)
    found = centre_pixels(frames, PAIR, HANDLE, POSES[4], 60.0)
    truth = np.stack(
        [camera.project(POSES[4].apply(HANDLE.marker_centres)) for camera in PAIR.cameras]
    )
    assert np.nanmax(np.abs(found.uv - truth)) < 0.1  # px


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


def without_light(rig):
    return [np.full(camera.size[::-1], 40.0) for camera in rig.cameras]


@pytest.mark.parametrize("estimator", ["reprojection", "patches"])
def test_where_the_pixels_show_no_marker_there_is_no_pose(estimator):
    """Whatever the markers' places say that somebody found."""
    instant = Identified(without_light(PAIR), seen_exactly(PAIR, POSES[5]), POSES[5], PAIR)
    assert estimate(instant, PAIR, HANDLE, Parameters(estimator=estimator)) is LOST


def test_where_the_pixels_show_no_marker_the_check_leaves_the_papers_pose():
    uv = seen_exactly(PAIR, POSES[5])
    instant = Identified(without_light(PAIR), uv, start_near(POSES[5]), PAIR)
    checked, papers = (
        estimate(instant, PAIR, HANDLE, Parameters(check=check)) for check in (True, False)
    )
    np.testing.assert_array_equal(
        checked.T_world_handle.as_matrix(), papers.T_world_handle.as_matrix()
    )
    np.testing.assert_array_equal(checked.covariance, papers.covariance)
    assert np.linalg.norm(error(papers, POSES[5])) < 1e-9  # the pixels are exact
