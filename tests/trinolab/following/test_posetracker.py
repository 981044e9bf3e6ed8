"""The tracker on short rendered clips: followed, lost and found, ambiguous instead of guessed,
smeared.
"""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from trinolab import kalman, measurement
from trinolab.bench.hand import Arm
from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scenario import Job, Shot, take
from trinolab.bench.scene import exposed, render_rig
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators import pixels
from trinolab.estimators.pixels import fit_patches
from trinolab.files.recording import Frames
from trinolab.following import look as look_module
from trinolab.following import posefilter, posetracker
from trinolab.following.look import Guess, Setup, expect, follow, look
from trinolab.following.parameters import FollowParameters
from trinolab.following.posefilter import PoseFilterParameters
from trinolab.pose import LOST
from trinolab.rigid import apart, motion_between, shifted
from trinolab.work import Work
from workbench.studies.broken import jpeg

RIG, CODED, PAPER = load_rig("raised_40deg"), load_handle("coded"), load_handle("paper")
FPS, BEST = 30.0, FollowParameters(estimator="patches")
UPWARDS = Rotation.from_euler("ZYX", [170.0, 15.0, 10.0], degrees=True)  # the free end
FIRST = RigidTransform.from_components([-20.0, 5.0, 560.0], UPWARDS)
VELOCITY = np.array([90.0, -60.0, 40.0, 0.2, 0.3, -0.2])  # mm/s, rad/s


def path(k):
    return shifted(FIRST, VELOCITY * k / FPS)


def clip(handle, count, missing=()):
    """Images of `count` instants; those without the handle are all the same."""
    rng = np.random.default_rng(0)
    empty = render_rig(RIG, handle, None, Bench(), rng) if missing else None
    return [
        empty if k in missing else render_rig(RIG, handle, path(k), Bench(), rng)
        for k in range(count)
    ]


def tracked(frames, handle, start=None, parameters=BEST):
    state, found = posetracker.start(-1 / FPS, start), []
    for k, images in enumerate(frames):
        state, one = posetracker.step(state, images, k / FPS, RIG, handle, parameters)
        found.append(one)
    return found


@pytest.fixture(scope="module")
def with_a_gap():
    """Four instants, twelve without the handle, four more."""
    return clip(CODED, 20, range(4, 16)), clip(PAPER, 20, range(4, 16))


@pytest.mark.parametrize("estimator", [pytest.param("paper", marks=pytest.mark.heavy), "patches"])
def test_a_coded_handle_is_followed_lost_and_found_at_once(with_a_gap, estimator):
    found = tracked(with_a_gap[0], CODED, parameters=FollowParameters(estimator=estimator))
    status = [one.measurement.pose.status for one in found]
    assert status[:4] == ["measured"] * 4
    assert status[4:13] == ["predicted"] * 9  # 0.3 s from the last measurement
    assert status[13:16] == ["lost"] * 3
    assert status[16:] == ["measured"] * 4
    for k in (1, 3, 16, 19):
        pose = found[k].measurement.pose
        assert not apart(pose.T_world_handle, path(k), 0.3, np.deg2rad(2.0))
        assert np.isfinite(pose.covariance).all()
    assert (
        found[12].measurement.pose.sigma_mm
        > found[4].measurement.pose.sigma_mm
        > found[3].measurement.pose.sigma_mm
    )


def test_a_handle_that_looks_alike_is_sure_until_it_was_lost(with_a_gap):
    turned = path(0) * PAPER.symmetries[5]  # another one than the nearest to the identity
    found = tracked(with_a_gap[1], PAPER, start=turned)
    status = [one.measurement.pose.status for one in found]
    assert status[:4] == ["measured"] * 4
    assert status[16:] == ["ambiguous"] * 4
    for k in range(4):
        assert not apart(
            found[k].measurement.pose.T_world_handle,
            path(k) * PAPER.symmetries[5],
            0.1,
            np.deg2rad(0.5),
        )
    for k in range(16, 20):
        pose = found[k].measurement.pose.T_world_handle
        assert (
            min(np.linalg.norm(motion_between(pose, path(k) * S)) for S in PAPER.symmetries) < 0.1
        )
    assert [one.measurement.pose.status for one in tracked(with_a_gap[1][:2], PAPER)] == [
        "ambiguous"
    ] * 2


def test_only_windows_are_searched_while_it_is_followed(with_a_gap):
    whole = sum(np.prod(camera.size) for camera in RIG.cameras)
    searched = [
        sum(window.area for window in filter(None, one.windows))
        for one in tracked(with_a_gap[0][:4], CODED)
    ]
    assert searched[0] == whole
    assert max(searched[1:]) < 0.1 * whole


def test_a_predicted_pose_is_reported_with_the_windows_that_it_predicts(with_a_gap):
    """Whatever other places were tried after them."""
    p, state, frames = FollowParameters(), posetracker.start(-1 / FPS), with_a_gap[0]
    for k in range(4):
        state, _ = posetracker.step(state, frames[k], k / FPS, RIG, CODED, p)
    motion = posefilter.predict(state.motion, 4 / FPS, p.motion)
    setup = Setup(RIG, CODED, p)
    wanted = look(frames[4], expect(setup, motion), setup)
    one = posetracker.step(state, frames[4], 4 / FPS, RIG, CODED, p)[1]
    assert one.measurement.pose.status == "predicted"
    assert one.windows == tuple(sight.window for sight in wanted)


def test_uneven_times_are_no_error(with_a_gap):
    state, frames = posetracker.start(-1.0), with_a_gap[0]
    for k in (0, 1, 3):
        state, one = posetracker.step(state, frames[k], k / FPS, RIG, CODED, BEST)
        assert one.measurement.pose.status == "measured"
    with pytest.raises(ValueError, match="t_s"):
        posetracker.step(state, frames[3], 3 / FPS, RIG, CODED, BEST)


@pytest.mark.parametrize("grey", [0, 255])
def test_black_and_white_frames_hold_no_pose(with_a_gap, grey):
    nothing = [np.full((1024, 1280), grey, np.uint8)] * 3
    status = [
        one.measurement.pose.status
        for one in tracked([nothing, *with_a_gap[0][:2], nothing], CODED)
    ]
    assert status == ["lost", "measured", "measured", "predicted"]


def test_a_frozen_camera_is_outvoted(with_a_gap):
    """CCD3 stands still while the handle moves on, by 3 mm an instant."""
    frames = [[*images[:2], with_a_gap[0][0][2]] for images in with_a_gap[0][:4]]
    for k, one in enumerate(tracked(frames, CODED)):
        pose = one.measurement.pose
        assert pose.status != "measured" or not apart(
            pose.T_world_handle, path(k), 2.0, np.deg2rad(5.0)
        )


def test_frames_of_another_rig_are_refused(with_a_gap):
    with pytest.raises(ValueError, match="frames: expected one for each of 3 cameras"):
        posetracker.step(posetracker.start(0.0), with_a_gap[0][0][:2], 1.0, RIG, CODED)


def test_the_filter_follows_an_even_motion_and_knows_how_well():
    p, rng, sigma = PoseFilterParameters(), np.random.default_rng(1), np.repeat([0.05, 0.005], 3)
    motion, values = posefilter.begin(0.0, FIRST, np.diag(sigma**2), p), []
    for k in range(1, 60):
        motion = posefilter.predict(motion, k / FPS, p)
        seen = shifted(path(k), rng.normal(0, sigma))
        values.append(posefilter.nis(motion, seen, np.diag(sigma**2), p))
        motion = posefilter.update(motion, seen, np.diag(sigma**2), p)
    assert np.linalg.norm(motion.rates[:3] - VELOCITY[:3]) < 15.0  # mm/s
    assert np.linalg.norm(motion.rates[3:6] - VELOCITY[3:]) < 0.1
    assert np.mean(values[10:]) < 6.0  # of an even motion: the filter expects jerks


def test_the_filter_s_update_is_that_of_kalman():
    """The small motion and the rates are one state of 18 numbers, of which the first six are
    observed.
    """
    p, C = PoseFilterParameters(), np.diag([1e-3] * 3 + [1e-5] * 3)
    motion = posefilter.predict(posefilter.begin(0.0, FIRST, C, p), 1 / FPS, p)
    seen = shifted(motion.pose, np.array([0.2, -0.1, 0.3, 0.01, -0.02, 0.01]))
    found = posefilter.update(motion, seen, C, p)
    floor = np.diag(np.repeat([p.floor_mm, p.floor_rad], 3) ** 2)
    wanted = kalman.update(
        kalman.State(np.concatenate([np.zeros(6), motion.rates]), motion.covariance),
        motion_between(seen, motion.pose),
        np.eye(6, 18),
        C + floor,
    )
    np.testing.assert_allclose(found.rates, wanted.mean[6:], rtol=1e-9)
    np.testing.assert_allclose(motion_between(found.pose, motion.pose), wanted.mean[:6], rtol=1e-6)
    np.testing.assert_allclose(found.covariance, wanted.covariance, rtol=1e-6, atol=1e-6)


def test_prediction_in_two_steps_is_that_in_one():
    p = replace(PoseFilterParameters(), jerk_rad=1e-9)
    rates = np.array([100.0, 0, 0, 0, 0, 0, 50.0, *[0.0] * 5])
    motion = posefilter.begin(0.0, FIRST, np.eye(6), p)._replace(rates=rates)
    once = posefilter.predict(motion, 0.1, p)
    twice = posefilter.predict(posefilter.predict(motion, 0.04, p), 0.1, p)
    assert np.linalg.norm(motion_between(once.pose, twice.pose)) < 1e-9
    np.testing.assert_allclose(once.rates, twice.rates, atol=1e-9)


def smeared_images(handle, T, velocity, rng, cameras=RIG.cameras):
    """Images of a handle that moves while the shutter is open; `exposed` renders every step of
    that.
    """
    bench = Bench()
    return [
        digitise(
            blurred(exposed(camera, handle, T, bench, velocity[:3], velocity[3:]), bench),
            bench,
            rng,
        )
        for camera in cameras
    ]


def test_a_smear_is_fitted_with_the_pose():
    """Expected of the motion is a fifth too much."""
    velocity, rng = np.array([350.0, -120.0, 60.0, 0.3, 0.2, -0.4]), np.random.default_rng(2)
    frames = smeared_images(CODED, FIRST, velocity, rng)
    start = shifted(FIRST, np.array([0.2, -0.3, 0.3, 0.01, -0.01, 0.01]))
    expected = 0.012 * velocity, np.diag(np.repeat([1.0, 0.01], 3) ** 2)
    moving = fit_patches(frames, RIG, CODED, start, motion_blur=expected)
    still = fit_patches(frames, RIG, CODED, start)
    assert not apart(moving.T_world_handle, FIRST, 0.05, np.deg2rad(0.3))
    away = motion_between(moving.T_world_handle, FIRST)
    assert away @ np.linalg.solve(moving.covariance, away) < 25.0  # chi-square of six, 99.97 %
    assert np.median(moving.misfit) < 1.5
    assert still is None or np.median(still.misfit) > 3.0


def test_a_fit_that_runs_out_of_steps_says_that_it_is_not_at_its_end(monkeypatch):
    velocity, rng = np.array([350.0, -120.0, 60.0, 0.3, 0.2, -0.4]), np.random.default_rng(2)
    frames = smeared_images(CODED, FIRST, velocity, rng)
    start = shifted(FIRST, np.array([0.6, -0.9, 0.9, 0.03, -0.03, 0.03]))
    expected = 0.012 * velocity, np.diag(np.repeat([1.0, 0.01], 3) ** 2)
    settled = fit_patches(frames, RIG, CODED, start, motion_blur=expected)
    monkeypatch.setattr(pixels, "FINE", pixels.FINE._replace(steps=2))
    stopped = fit_patches(frames, RIG, CODED, start, motion_blur=expected)
    away = motion_between(stopped.T_world_handle, FIRST)
    assert away @ np.linalg.solve(settled.covariance, away) > 100.0
    assert away @ np.linalg.solve(stopped.covariance, away) < 25.0  # chi-square of six, 99.97 %


@pytest.mark.parametrize("smeared", [True, False])
def test_smeared_markers_leave_a_rig_as_sharp_ones_have_seen_it(smeared):
    """A rig that does not say how far it is off."""
    velocity = np.array([350.0, -120.0, 60.0, 0.3, 0.2, -0.4]) * smeared
    frames = smeared_images(CODED, FIRST, velocity, np.random.default_rng(2))
    silent = replace(RIG, covariance=None)
    motion = posefilter.begin(0.0, FIRST, np.diag([0.1] * 3 + [1e-4] * 3), BEST.motion)
    rates = np.concatenate([velocity, np.zeros(6)])
    setup = Setup(silent, CODED, BEST)
    guess = Guess(motion._replace(rates=rates), expect(setup, motion), smeared)
    followed = follow(frames, guess, setup)
    assert followed.pose.status == "measured"
    assert not apart(followed.pose.T_world_handle, FIRST, 0.5, np.deg2rad(0.5))


@pytest.mark.heavy
def test_a_smear_is_measured_in_the_images_of_a_fit_without_motion():
    """The longest one, in the camera that sees most of the motion; none where the handle is still,
    also in images that JPEG has made worse.
    """
    rng = np.random.default_rng(2)
    for speed_mm_s in (100.0, 200.0):
        velocity = speed_mm_s * np.array([0.8, -0.6, 0.0, 0.0, 0.0, 0.0])
        smeared = smeared_images(CODED, FIRST, velocity, rng)
        ends = [
            shifted(FIRST, share * 0.01 * velocity).apply(CODED.marker_centres)
            for share in (0.5, -0.5)
        ]
        wanted = max(
            np.nanmax(np.linalg.norm(camera.project(ends[0]) - camera.project(ends[1]), axis=1))
            for camera in RIG.cameras
        )
        fit = fit_patches(smeared, RIG, CODED, FIRST, smear_above=0.0)
        assert fit.smear_px == pytest.approx(wanted, rel=0.25)
    still = clip(CODED, 1)[0]
    for images in ([jpeg(image, 75) for image in still], still):
        fit = fit_patches(images, RIG, CODED, FIRST, smear_above=0.0)
        assert fit.smear_px < BEST.blurred_px


def test_what_shows_no_smear_is_not_fitted_as_smeared(monkeypatch):
    """JPEG leaves more than noise, and the velocity would smear by pixels if the shutter were open
    as long as it may be.
    """
    smeared = []

    def counted(*arguments, motion_blur=None, **options):
        smeared.append(motion_blur is not None)
        return fit_patches(*arguments, motion_blur=motion_blur, **options)

    monkeypatch.setattr(look_module, "fit_patches", counted)
    p = replace(BEST, still_misfit=1e-3)  # of any image, so to speak
    coded = [[jpeg(image, 75) for image in images] for images in clip(CODED, 5)]
    found = tracked(coded, CODED, None, p)
    for k, one in enumerate(found):
        assert one.measurement.pose.status == "measured"
        assert not apart(one.measurement.pose.T_world_handle, path(k), 0.05, np.deg2rad(0.5))
    assert smeared == [False] * 5


@pytest.mark.parametrize(
    ("turn_deg", "starts"),
    [
        pytest.param(turn, starts, marks=pytest.mark.heavy)
        for turn, starts in ((40.0, 1), (0.0, 3), (40.0, 3))
    ],
)
def test_markers_that_are_smeared_into_one_another_are_told_apart(turn_deg, starts):
    """Across the rod by 26 px, from one column of the paper's handle to the next, seen by two
    cameras of three.
    """
    rng = np.random.default_rng(3)
    velocity = np.array([480.0, 220.0, 60.0, 0.1, 0.1, -0.1])
    T = FIRST * RigidTransform.from_rotation(Rotation.from_rotvec([0.0, np.deg2rad(turn_deg), 0.0]))
    seen = smeared_images(PAPER, T, velocity, rng, RIG.cameras[1:])
    frames = [np.zeros_like(seen[0]), *seen]
    for _ in range(starts):
        start = shifted(
            T,
            np.concatenate(
                [rng.normal(scale=0.7, size=3), rng.normal(scale=np.deg2rad(1.0), size=3)]
            ),
        )
        expected = 0.01 * velocity + rng.normal(scale=np.repeat([0.3, 0.002], 3))
        fit = fit_patches(
            frames,
            RIG,
            PAPER,
            start,
            motion_blur=(expected, np.diag(np.repeat([0.5, 0.004], 3) ** 2)),
        )
        away = motion_between(fit.T_world_handle, T)
        assert np.linalg.norm(away[:3]) < 0.05
        assert np.linalg.norm(away[3:]) < np.deg2rad(0.5)
        assert away @ np.linalg.solve(fit.covariance, away) < 25.0  # chi-square of six, 99.97 %


def test_a_fit_whose_work_is_spent_gives_its_pose_so_far():
    """With a wider covariance; none where there is no work for a step."""
    velocity = np.array([400.0, 200.0, 0.0, 0.5, 0.5, 0.5])
    frames = smeared_images(CODED, FIRST, velocity, np.random.default_rng(0))
    start = shifted(FIRST, [0.3, -0.2, 0.3, 0.003, 0.003, -0.002])
    expected = (0.01 * velocity, np.diag(np.repeat([1.0, 0.01], 3) ** 2))
    whole = Work(1e3)
    ends = fit_patches(frames, RIG, CODED, start, motion_blur=expected, work=whole)
    used = 1e3 - whole.remaining
    cut = fit_patches(frames, RIG, CODED, start, motion_blur=expected, work=Work(0.6 * used))
    assert np.trace(cut.covariance) > np.trace(ends.covariance)
    away = motion_between(cut.T_world_handle, FIRST)
    assert away @ np.linalg.solve(cut.covariance, away) < 25.0  # chi-square of six, 99.97 %
    none = Work(1.0)
    assert fit_patches(frames, RIG, CODED, start, motion_blur=expected, work=none) is None
    assert none.remaining == 1.0


@pytest.mark.parametrize(
    "velocity", [(0.0, 90.0, 420.0), (0.0, 90.0, 300.0), (90.0, 30.0, 500.0), (100.0, 0.0, 0.0)]
)
def test_a_smeared_handle_is_measured_where_nothing_is_known_of_its_motion(velocity):
    """The smear says how long and along which line the motion is."""
    moving = np.array([*velocity, 0.3, -0.2, 0.4])
    frames = smeared_images(CODED, FIRST, moving, np.random.default_rng(3))
    pose = tracked([frames], CODED)[0].measurement.pose
    assert pose.status == "measured"
    assert not apart(pose.T_world_handle, FIRST, 0.05, np.deg2rad(0.3))
    away = motion_between(pose.T_world_handle, FIRST)
    assert away @ np.linalg.solve(pose.covariance, away) < 25.0  # chi-square of six, 99.97 %


@pytest.fixture
def cut_search(monkeypatch):
    """Searches that find what they find, and say that they were cut."""

    def identified(*arguments):
        found = measurement.identified(*arguments)
        arguments[-1].was_cut = True
        return found

    monkeypatch.setattr(posetracker, "identified", identified)


@pytest.mark.parametrize(
    ("cameras", "status"), [(1, "ambiguous"), (2, "measured"), (3, "measured")]
)
def test_a_search_that_was_cut_is_enough_where_half_of_the_cameras_show_the_pose(
    cameras, status, cut_search, monkeypatch
):
    """Of one camera a rival may not have been tried; the next instant is searched again."""

    def shown_by(*arguments):
        followed = look_module.follow(*arguments)
        return followed._replace(pose=replace(followed.pose, cameras=cameras))

    monkeypatch.setattr(posetracker, "follow", shown_by)
    found = tracked(clip(CODED, 2), CODED)
    assert [one.measurement.pose.status for one in found] == [status] * 2
    is_whole = [one.windows[0].area == 1280 * 1024 for one in found]
    assert is_whole == [True, status == "ambiguous"]


@pytest.mark.parametrize("is_cut", [False, True])
def test_one_camera_of_three_is_believed_after_a_whole_search(is_cut, request):
    """What the two others show may be the handle, too."""
    first, second = clip(CODED, 2)
    state, _ = posetracker.step(posetracker.start(-1.0), first, 0.0, RIG, CODED, BEST)
    if is_cut:
        request.getfixturevalue("cut_search")
    alone = [np.zeros_like(second[0]), np.zeros_like(second[1]), second[2]]
    _, one = posetracker.step(state, alone, 1 / FPS, RIG, CODED, BEST)
    assert one.measurement.pose.status == ("predicted" if is_cut else "measured")


@pytest.mark.parametrize(("share", "most"), [(1.0, 1), (0.8, 1), (0.5, 2), (0.1, 3)])
def test_an_instant_begins_no_guess_without_its_work(share, most, monkeypatch):
    """Whatever a fit says, which takes a share of the work; the handle has jumped, so that further
    guesses are tried: shifted, and from a search of the whole images.
    """
    state, _ = posetracker.step(posetracker.start(-1.0), clip(CODED, 1)[0], 0.0, RIG, CODED, BEST)
    jumped = render_rig(RIG, CODED, path(6), Bench(), np.random.default_rng(0))
    guesses = []

    def in_vain(*arguments):
        arguments[-1].remaining -= share * BEST.most_work
        guesses.append(look_module.follow(*arguments[:-1])._replace(pose=LOST))
        return guesses[-1]

    monkeypatch.setattr(posetracker, "follow", in_vain)
    _, one = posetracker.step(state, jumped, 1 / FPS, RIG, CODED, BEST)
    assert one.measurement.pose.status == "predicted"
    assert len(guesses) == most


def test_a_track_is_the_same_to_the_last_bit():
    """Where its work is spent as well: no time is taken."""
    rng = np.random.default_rng(1)
    frames = [render_rig(RIG, CODED, path(3 * k), Bench(), rng) for k in range(4)]
    for most in (50.0, BEST.most_work):
        p = replace(BEST, most_work=most)
        once, again = (tracked(frames, CODED, path(0), p) for _ in range(2))
        for one, other in zip(once, again, strict=True):
            a, b = one.measurement.pose, other.measurement.pose
            assert a.status == b.status
            assert (a.T_world_handle is None) == (b.T_world_handle is None)
            if a.T_world_handle is not None:
                assert (a.T_world_handle.as_matrix() == b.T_world_handle.as_matrix()).all()
                assert (a.covariance == b.covariance).all()


def with_spots(frames, count, grey=240.0):
    """The images with still spots of the size of markers and more, each with the noise of a pixel."""
    rng = np.random.default_rng(1)
    lit = []
    for camera in RIG.cameras:
        lamps = np.zeros(camera.size[::-1])
        for centre in (
            rng.uniform(30.0, np.array(camera.size) - 30.0, (count, 2)).round().astype(int)
        ):
            cv2.circle(lamps, tuple(centre.tolist()), int(rng.integers(4, 9)), 1.0, -1, cv2.LINE_AA)
        lit.append(lamps)
    return [
        [
            np.clip(np.rint((1 - k) * i + k * rng.normal(grey, 3.0, i.shape)), 0, 255).astype(
                np.uint8
            )
            for i, k in zip(images, lit, strict=True)
        ]
        for images in frames
    ]


def states_and_poses(frames):
    state, states, poses = posetracker.start(-1 / FPS), [], []
    for k, images in enumerate(frames):
        state, one = posetracker.step(state, images, k / FPS, RIG, CODED, BEST)
        states.append(state)
        poses.append(one.measurement.pose)
    return states, poses


def off_mm(pose, k):
    return float(np.linalg.norm(pose.T_world_handle.translation - path(k).translation))


@pytest.mark.slow
def test_what_the_empty_bench_shows_is_no_marker():
    """Of spots that are brighter than the markers there are more than are looked at."""
    empty = 3
    states, poses = states_and_poses(with_spots(clip(CODED, 6, range(empty)), 40))
    assert [pose.status for pose in poses] == ["lost"] * empty + ["measured"] * 3
    assert max(off_mm(poses[k], k) for k in range(empty, 6)) < 0.05
    assert all(state.backgrounds is not None for state in states)


def test_few_spots_need_no_background():
    states, poses = states_and_poses(with_spots(clip(CODED, 2, (0,)), 5))
    assert [pose.status for pose in poses] == ["lost", "measured"]
    assert [state.backgrounds for state in states] == [None, None]


def test_where_nothing_moves_the_whole_images_are_searched():
    """A handle that rests has been in the background from the first instant on."""
    rests = [render_rig(RIG, CODED, path(0), Bench(), np.random.default_rng(k)) for k in range(2)]
    state = posetracker.start(-1.0)._replace(
        backgrounds=tuple(image.astype(np.float32) for image in rests[0])
    )
    _, one = posetracker.step(state, rests[1], 0.0, RIG, CODED, BEST)
    assert one.measurement.pose.status == "measured"
    assert off_mm(one.measurement.pose, 0) < 0.05


@pytest.fixture(scope="module")
def fast():
    """From rest to 0.55 m/s and back within a third of a second; a camera is dark for two instants
    at full speed. The poses, and the images of an instant, rendered when they are asked for.
    """
    t = np.arange(11) / FPS
    phase, way = 2 * np.pi * t * FPS / 10, np.array([1.0, 0.4, 0.2, 0.0, 0.002, 0.006])
    poses = [shifted(FIRST, -25.0 * np.cos(p) * way) for p in phase]
    rates = 25.0 * 2 * np.pi * FPS / 10 * np.sin(phase)[:, None] * way
    shots = [
        Shot(T, Arm(), (1.0, 0.0 if k in (2, 3) else 1.0, 1.0), rate[:3], rate[3:], True)
        for k, (T, rate) in enumerate(zip(poses, rates, strict=True))
    ]
    job = Job(RIG, PAPER, shots, t, 0)
    return poses, cache(lambda k: [take(job, k, c) for c in range(3)])


@pytest.mark.heavy
@pytest.mark.parametrize("estimator", ["paper", "patches"])
def test_a_fast_handle_is_followed_through_its_smear(fast, estimator):
    """Up to the full speed, with a dark camera."""
    truth, frames = fast[0], [fast[1](k) for k in range(len(fast[0]))]
    found = tracked(frames, PAPER, truth[0], FollowParameters(estimator=estimator))
    assert [one.measurement.pose.status for one in found] == ["measured"] * len(truth)
    for one, T in zip(found, truth, strict=True):
        assert not apart(one.measurement.pose.T_world_handle, T, 0.5, np.deg2rad(3.0))


def test_a_sequence_is_step_after_step_and_known_poses_count_until_it_is_sure(monkeypatch):
    begun = []

    def step(state, images, t_s, *_):
        assert state.t_s < t_s
        begun.append(state.motion and state.motion.pose)
        return posetracker.TrackState(t_s, None, None, unambiguous=len(begun) == 3), images

    monkeypatch.setattr(posetracker, "step", step)
    first, second, late = (RigidTransform.from_translation([0.0, 0.0, z]) for z in (500, 510, 520))
    frames = [Frames(k, k / FPS, [k]) for k in range(2, 6)]
    found = list(
        posetracker.track_instants(frames, RIG, CODED, known={3: first, 4: second, 5: late})
    )
    assert begun == [None, first, second, None]
    assert found == [(frame, frame.images) for frame in frames]
