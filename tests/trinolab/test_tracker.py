"""The chain of one instant, on rendered frames."""

from functools import cache, partial

import numpy as np
import pytest
from instants import POSE as T
from instants import frames
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import kalman, measurement, tracker
from trinolab.bench.hand import Arm
from trinolab.bench.motion import smooth_motion
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, load_rig
from trinolab.parameters import Parameters
from trinolab.rigid import motion_between
from trinolab.tracker import start, step

PAIR, TRIO = "paper_pair", "raised_40deg"
RIG, PAPER, CODED = load_rig(PAIR), load_handle("paper"), load_handle("coded")
IMAGE = (1024, 1280)
measure = partial(measurement.measure, parameters=Parameters(estimator="paper"))


def errors(pose, truth=T):
    """Of position and rotation, mm and deg."""
    away = motion_between(pose.T_world_handle, truth)
    return np.linalg.norm(away[:3]), np.rad2deg(np.linalg.norm(away[3:]))


@pytest.mark.parametrize(("rig", "cameras"), [(PAIR, 2), (TRIO, 3)])
def test_coded_layout_is_measured_without_a_prior(rig, cameras):
    pose = measure(frames(rig, "coded"), rig, CODED).pose
    distance, angle = errors(pose)
    assert (pose.status, pose.cameras) == ("measured", cameras)
    assert distance < 0.3  # mm; the centroid's bias allows 0.2
    assert angle < 2.5  # deg
    assert pose.residual_px < 1.5


def test_paper_layout_is_ambiguous_without_and_measured_with_a_prior():
    images = frames(PAIR, "paper")
    alone = measure(images, RIG, PAPER).pose
    assert alone.status == "ambiguous"
    rivals = [alone.T_world_handle * S for S in PAPER.symmetries]
    assert min(np.rad2deg((one.inv() * T).rotation.magnitude()) for one in rivals) < 2.5
    assert alone.T_world_handle.rotation.magnitude() == pytest.approx(
        min(one.rotation.magnitude() for one in rivals), abs=0.01
    )
    near = RigidTransform.from_components([3.0, -2, 5], Rotation.from_rotvec([0.1, 0.15, -0.1]))
    for truth in (T, T * PAPER.symmetries[3]):
        pose = measure(images, RIG, PAPER, prior=truth * near).pose
        assert pose.status == "measured"
        assert errors(pose, truth)[1] < 2.5


def test_turned_markers_are_left_out_of_the_fit():
    # 74 deg in CCD2
    turned = T * RigidTransform.from_rotation(Rotation.from_rotvec([0, np.deg2rad(12.0), 0]))
    images = render_rig(RIG, PAPER, turned, Bench(), np.random.default_rng(0))
    every = Parameters(estimator="paper", max_slant_deg=90.0)
    all_of_them = measure(images, RIG, PAPER, parameters=every).pose
    facing = measure(images, RIG, PAPER).pose
    assert 4 <= facing.markers < all_of_them.markers
    # their centroids lie beside the images of their centres
    assert facing.residual_px < all_of_them.residual_px


def test_dark_frames_and_noise_are_lost_and_a_covered_camera_leaves_the_pair():
    black = np.zeros(IMAGE, np.uint8)
    noise = list(np.random.default_rng(0).integers(0, 256, (2, *IMAGE)).astype(np.uint8))
    for images in ([black, black], noise):
        found = measure(images, RIG, PAPER).pose
        assert (found.status, found.T_world_handle) == ("lost", None)
    pose = measure([*frames(TRIO, "coded")[:2], black], TRIO, CODED).pose
    assert (pose.status, pose.cameras) == ("measured", 2)


POSES = smooth_motion(np.random.default_rng(0), 0.4, 30.0)


@cache
def rendered(k=None):
    """Images of a moving handle in a hand, the light half as bright again from the seventh instant
    on; without a number of the empty scene.
    """
    if k is None:
        return render_rig(RIG, PAPER, None, Bench(), np.random.default_rng(0))
    rng = np.random.default_rng([0, k])
    return render_rig(RIG, PAPER, POSES[k], Bench(), rng, Arm(), 1.5 if k >= 6 else 1.0)


@pytest.mark.parametrize("every", [6, pytest.param(1, marks=pytest.mark.heavy)])
def test_a_known_start_carries_the_equivalent_through_the_clip(every):
    """Also where frames are dropped."""
    empty = rendered()
    state = start(empty, RIG, -1 / 30, POSES[0])
    for k in range(0, len(POSES), every):
        state, found = step(state, rendered(k), k / 30, RIG, PAPER)
        distance, angle = errors(found.pose, POSES[k])
        assert found.pose.status == "measured"
        assert distance < 0.5
        assert angle < 5.0  # a flip would be 60 deg
        assert state.pose is found.pose.T_world_handle
        assert (state.t_s, state.measured_s) == (k / 30, k / 30)
    # nothing moves any more: the search is where the motion leads, until that is out of sight
    gone, found = step(state, empty, state.t_s + 1 / 30, RIG, PAPER)
    assert found.pose.status == "lost"
    assert (gone.pose, gone.measured_s) == (state.pose, state.t_s)
    for before, after in zip(state.cameras, gone.cameras, strict=True):
        expected = kalman.predict_motion(before.motion, 1 / 30)
        np.testing.assert_allclose(after.motion.mean, expected.mean)
        np.testing.assert_allclose(after.motion.covariance, expected.covariance)
        assert after.window == before.window


@pytest.mark.parametrize(("pose", "t_s"), [(None, -0.1), (POSES[0], -1.0)])
def test_without_a_start_or_with_an_old_one_the_layout_is_ambiguous(pose, t_s):
    state = start(rendered(), RIG, t_s, pose)
    # a second later: any turn may have happened
    assert step(state, rendered(0), 0.0, RIG, PAPER)[1].pose.status == "ambiguous"


def test_an_empty_scene_is_lost_and_has_no_window():
    state, found = step(start(rendered(), RIG, 0.0), rendered(), 1 / 30, RIG, PAPER)
    assert found.pose.status == "lost"
    assert all(camera.window is camera.motion is None for camera in state.cameras)


def test_a_motion_is_corrected_or_begun_anew():
    p = kalman.KalmanParameters()
    first = tracker.corrected(None, [10.0, 20.0], p)
    np.testing.assert_array_equal(
        first.covariance, kalman.initial_state([10.0, 20.0], p).covariance
    )
    H, R = kalman.observation_matrix(), p.sigma_px**2 * np.eye(2)
    # S = 2 sigma^2: the gate is at chi2 with 2 degrees, -2 ln(0.001) = 13.8, so 5.26 sigma away
    near, far = (tracker.corrected(first, [10 + k * p.sigma_px, 20.0], p) for k in (5.2, 5.3))
    expected = kalman.update(first, [10 + 5.2 * p.sigma_px, 20.0], H, R)
    for one, other in zip(near, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(far.mean, [10 + 5.3 * p.sigma_px, 20, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("t_s", "count", "word"), [(1.0, 2, "t_s"), (np.nan, 2, "t_s"), (2.0, 1, "frames")]
)
def test_bad_steps_are_value_errors(t_s, count, word):
    images = frames(PAIR, "paper")
    with pytest.raises(ValueError, match=word):
        step(start(images, RIG, 1.0), images[:count], t_s, RIG, PAPER)
