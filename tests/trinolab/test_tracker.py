"""The chain of one instant, on rendered frames."""

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import measurement
from trinolab.bench.hand import Arm
from trinolab.bench.motion import smooth_motion
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.identity import labelled_pixels
from trinolab.parameters import Parameters
from trinolab.pose import fit_pose
from trinolab.tracker import start, step
from trinolab.window import Window

RIG, TRIO = load_rig("paper_pair"), load_rig("raised_40deg")
PAPER, CODED = load_handle("paper"), load_handle("coded")
T = load_table1().set_poses[4]

measure = partial(measurement.measure, parameters=Parameters(estimator="paper"))


def errors(pose, truth=T):
    return (
        np.linalg.norm(pose.T_world_handle.translation - truth.translation),
        np.rad2deg((pose.T_world_handle.inv() * truth).rotation.magnitude()),
    )


@pytest.fixture(scope="module")
def frames():
    """Rendered once: [layout][cameras] of one pose."""
    return {
        (h.name, len(rig.cameras)): render_rig(rig, h, T, Bench(), np.random.default_rng(0))
        for h in (PAPER, CODED)
        for rig in (RIG, TRIO)
    }


@pytest.mark.parametrize("rig", [RIG, TRIO], ids=["two", "three"])
def test_coded_layout_is_measured_without_a_prior(frames, rig):
    pose = measure(frames["coded", len(rig.cameras)], rig, CODED).pose
    distance, angle = errors(pose)
    assert (pose.status, pose.cameras) == ("measured", len(rig.cameras))
    assert distance < 0.3  # mm; the centroid's bias allows 0.2
    assert angle < 2.5  # deg
    assert pose.residual_px < 1.5


def test_paper_layout_is_ambiguous_without_and_measured_with_a_prior(frames):
    alone = measure(frames["paper", 2], RIG, PAPER).pose
    assert alone.status == "ambiguous"
    rivals = [
        errors(replace(alone, T_world_handle=alone.T_world_handle * S)) for S in PAPER.symmetries
    ]
    assert min(rivals, key=lambda e: e[1])[1] < 2.5
    assert alone.T_world_handle.rotation.magnitude() == pytest.approx(
        min((alone.T_world_handle * S).rotation.magnitude() for S in PAPER.symmetries), abs=0.01
    )
    near = T * RigidTransform.from_components([3.0, -2, 5], Rotation.from_rotvec([0.1, 0.15, -0.1]))
    pose = measure(frames["paper", 2], RIG, PAPER, prior=near).pose
    assert pose.status == "measured"
    assert errors(pose)[1] < 2.5


def test_a_prior_of_another_equivalent_gives_that_one(frames):
    S = PAPER.symmetries[3]
    pose = measure(frames["paper", 2], RIG, PAPER, prior=T * S).pose
    assert errors(pose, T * S)[1] < 2.5


def test_world_frame_is_the_rigs(frames):
    """The same images with the rig written in another frame: the pose moves along, to rounding.

    The covariance of the fit, too; that of the estimate to 2 % of the standard deviations, as the
    image model has its part in it, which counts in single precision.
    """
    M = RigidTransform.from_components([300.0, -200, 900], Rotation.from_rotvec([0.4, 1.2, -0.3]))
    moved = replace(
        TRIO, cameras=tuple(replace(c, T_cam_world=c.T_cam_world * M.inv()) for c in TRIO.cameras)
    )
    found = [measure(frames["coded", 3], rig, CODED) for rig in (TRIO, moved)]
    here, there = (m.pose for m in found)
    assert (
        np.abs((M * here.T_world_handle).as_matrix() - there.T_world_handle.as_matrix()).max()
        < 1e-9
    )
    rotate = np.kron(np.eye(2), M.rotation.as_matrix())
    n = len(CODED.marker_centres)
    uv = [labelled_pixels(m.labels, tuple(markers.uv for markers in m.found), n) for m in found]
    # Of the pixels' noise alone: no image is in it.
    plain, also = (
        fit_pose(pixels, rig, CODED).covariance
        for pixels, rig in zip(uv, (TRIO, moved), strict=True)
    )
    np.testing.assert_allclose(also, rotate @ plain @ rotate.T, atol=1e-9)
    sigma = np.sqrt(np.diag(there.covariance))
    assert (
        np.abs(there.covariance - rotate @ here.covariance @ rotate.T)
        < 0.02 * np.outer(sigma, sigma)
    ).all()


def test_camera_order_does_not_matter_much(frames):
    """Eq. 20 keeps the point on the left ray, so the order changes the estimate a little, not the
    pose.
    """
    turned = Rig(RIG.cameras[::-1])
    pose = measure(frames["coded", 2][::-1], turned, CODED).pose
    assert errors(pose)[0] < 0.3


def test_turned_markers_are_left_out_of_the_fit():
    # 74 deg in CCD2
    turned = T * RigidTransform.from_rotation(Rotation.from_rotvec([0, np.deg2rad(12.0), 0]))
    frames = render_rig(RIG, PAPER, turned, Bench(), np.random.default_rng(0))
    all_of_them = measure(
        frames, RIG, PAPER, parameters=Parameters(estimator="paper", max_slant_deg=90.0)
    ).pose
    facing = measure(frames, RIG, PAPER).pose
    assert 4 <= facing.markers < all_of_them.markers
    # their centroids lie beside the images of their centres
    assert facing.residual_px < all_of_them.residual_px


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f[:1], "frames: expected one for each of 2 cameras, got 1"),
        (lambda f: [*f, f[0]], "frames: expected one for each of 2 cameras, got 3"),
        (lambda f: [f[0], f[1][:-1]], "frames: ccd2: expected 1280 x 1024 pixels, got 1280 x 1023"),
        (lambda f: [f[0].T, f[1]], "frames: ccd1: expected 1280 x 1024 pixels, got 1024 x 1280"),
        (lambda f: [f[0], np.dstack([f[1]] * 3)], "frames: ccd2: expected a grey image of shape"),
        (
            lambda f: [f[0], f[1].astype(np.uint16) * 257],
            "frames: ccd2: expected grey levels from 0 to 255, got",
        ),
        (lambda f: [f[0], None], "frames: ccd2: expected a grey image"),
        (
            lambda f: [f[0], np.where(f[1] > 200, np.nan, f[1])],
            "frames: ccd2: expected finite grey values",
        ),
    ],
)
def test_frames_that_are_none_of_the_rig_are_named(frames, change, message):
    for call in (lambda f: measure(f, RIG, CODED), lambda f: start(f, RIG, 0.0)):
        with pytest.raises(ValueError, match=message):
            call(change(frames["coded", 2]))


@pytest.mark.parametrize("kind", [np.uint16, np.int64, np.float32])
def test_any_number_type_holds_grey_levels(frames, kind):
    same, other = (
        measure(images, RIG, CODED).pose
        for images in (frames["coded", 2], [image.astype(kind) for image in frames["coded", 2]])
    )
    assert other.T_world_handle.as_matrix() == pytest.approx(
        same.T_world_handle.as_matrix(), abs=1e-3
    )


@pytest.mark.parametrize("with_handle", [False, True])
@pytest.mark.parametrize("estimator", ["paper", "patches"])
def test_five_hundred_spurious_markers(frames, with_handle, estimator):
    """Discs like a marker that faces the camera, at random all over the images: no pose, or the
    right one.
    """
    rng, spoiled = np.random.default_rng(5), []
    for image in frames["coded", 2]:
        drawn = image.copy() if with_handle else np.full_like(image, 45)
        for u, v in rng.integers(20, [1260, 1004], (500, 2)):
            cv2.circle(drawn, (int(u), int(v)), 7, 220, -1, cv2.LINE_AA)
        spoiled.append(cv2.GaussianBlur(drawn, (0, 0), 0.7))
    pose = measure(spoiled, RIG, CODED, parameters=Parameters(estimator=estimator)).pose
    assert pose.status == "lost" or errors(pose)[0] < 2.0


def test_dark_frames_are_lost_without_an_exception():
    black = [np.zeros((1024, 1280), np.uint8)] * 2
    measurement = measure(black, RIG, PAPER)
    assert measurement.pose.status == "lost"
    assert measurement.pose.T_world_handle is None
    assert np.isnan(measurement.pose.sigma_mm)


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_is_lost(seed):
    rng = np.random.default_rng(seed)
    noise = [rng.integers(0, 256, (1024, 1280)).astype(np.uint8) for _ in range(2)]
    assert measure(noise, RIG, PAPER).pose.status == "lost"


def test_one_covered_camera_leaves_the_pair(frames):
    covered = [*frames["coded", 3][:2], np.zeros((1024, 1280), np.uint8)]
    pose = measure(covered, TRIO, CODED).pose
    assert (pose.status, pose.cameras) == ("measured", 2)


@pytest.mark.slow
def test_covariance_is_of_the_errors_size():
    """Over eight noise seeds the scatter about the mean stays within what 0.1 px of centroid error
    predicts.
    """
    drawn = [
        measure(render_rig(RIG, CODED, T, Bench(), np.random.default_rng(s)), RIG, CODED).pose
        for s in range(8)
    ]
    scatter = np.std([pose.T_world_handle.translation for pose in drawn], axis=0, ddof=1)
    assert np.linalg.norm(scatter) < drawn[0].sigma_mm
    assert 0.01 < drawn[0].sigma_mm < 0.5


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda f: measure(f[:1], RIG, PAPER), "frames"),
        (lambda f: measure([f[0], f[1][:100]], RIG, PAPER), "ccd2"),
        (lambda f: measure([f[0], f[1][..., None]], RIG, PAPER), "ccd2"),
        (lambda f: measure(f, RIG, PAPER, prior=np.eye(4)), "prior"),
        (lambda f: Parameters(sigma_px=0.0), "sigma_px"),
        (lambda f: Parameters(max_slant_deg=100.0), "max_slant_deg"),
    ],
)
def test_bad_input_is_a_value_error(frames, call, word):
    with pytest.raises(ValueError, match=word):
        call(frames["paper", 2])


class Rendered(dict):
    """The frames of a clip by their numbers, each rendered when it is asked for."""

    def __init__(self, poses):
        self.poses = poses

    def __missing__(self, k):
        rng = np.random.default_rng([0, k])
        light = 1.5 if k >= 6 else 1.0
        self[k] = render_rig(RIG, PAPER, self.poses[k], Bench(), rng, Arm(), light)
        return self[k]


@pytest.fixture(scope="module")
def clip():
    """Twelve instants of a moving handle in a hand, the light half as bright again from the seventh
    on.
    """
    rng = np.random.default_rng(0)
    poses = smooth_motion(rng, 0.4, 30.0)
    return render_rig(RIG, PAPER, None, Bench(), rng), poses, Rendered(poses)


def follow(clip, pose=None, keep=slice(None)):
    empty, poses, frames = clip
    state, found = start(empty, RIG, -1 / 30, pose), []
    for k in range(len(poses))[keep]:
        state, measurement = step(state, frames[k], k / 30, RIG, PAPER)
        found.append((measurement, errors(measurement.pose, poses[k])))
    return state, found


@pytest.mark.heavy
def test_a_known_start_carries_the_equivalent_through_the_clip(clip):
    state, found = follow(clip, pose=clip[1][0])
    assert {m.pose.status for m, _ in found} == {"measured"}
    assert max(angle for _, (_, angle) in found) < 5.0  # a flip would be 60 deg
    assert max(distance for _, (distance, _) in found) < 0.5
    assert state.pose is found[-1][0].pose.T_world_handle


def test_without_a_start_the_layout_stays_ambiguous(clip):
    _, found = follow(clip, keep=slice(0, 3))
    assert {m.pose.status for m, _ in found} == {"ambiguous"}


def test_dropped_frames_are_no_error(clip):
    _, found = follow(clip, pose=clip[1][0], keep=slice(0, None, 3))
    assert {m.pose.status for m, _ in found} == {"measured"}
    assert max(angle for _, (_, angle) in found) < 5.0


def test_an_old_pose_chooses_no_more(clip):
    empty, poses, frames = clip
    state = start(empty, RIG, -1.0, poses[0])
    # a second later: any turn may have happened
    _, measurement = step(state, frames[0], 0.0, RIG, PAPER)
    assert measurement.pose.status == "ambiguous"


def test_an_empty_scene_is_lost_and_has_no_window(clip):
    empty, _, _ = clip
    state, measurement = step(start(empty, RIG, 0.0), empty, 1 / 30, RIG, PAPER)
    assert measurement.pose.status == "lost"
    assert all(camera.window is None for camera in state.cameras)


def test_windows_limit_the_search(clip):
    frames, poses = clip[2][0], clip[1]
    whole = measure(frames, RIG, PAPER, prior=poses[0])
    seen = [found.uv for found in whole.found]
    tight = [
        Window(
            int(uv[:, 0].min()) - 20,
            int(uv[:, 1].min()) - 20,
            *(np.ptp(uv, axis=0).astype(int) + 41),
        ).clipped((1280, 1024))
        for uv in seen
    ]
    windowed = measure(frames, RIG, PAPER, prior=poses[0], windows=tight)
    assert (
        np.abs(
            windowed.pose.T_world_handle.as_matrix() - whole.pose.T_world_handle.as_matrix()
        ).max()
        < 0.1
    )
    assert measure(frames, RIG, PAPER, windows=[tight[0], None]).pose.status == "lost"


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda clip: step(start(clip[0], RIG, 1.0), clip[2][0], 1.0, RIG, PAPER), "t_s"),
        (lambda clip: step(start(clip[0], RIG, 1.0), clip[2][0], np.nan, RIG, PAPER), "t_s"),
        (lambda clip: step(start(clip[0], RIG, 1.0), clip[2][0][:1], 2.0, RIG, PAPER), "frames"),
        (lambda clip: start(clip[0][:1], RIG, 1.0), "frames"),
    ],
)
def test_bad_steps_are_value_errors(clip, call, word):
    with pytest.raises(ValueError, match=word):
        call(clip)
