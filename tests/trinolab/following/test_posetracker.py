"""The tracker on short rendered clips: followed, lost and found, ambiguous instead of guessed,
smeared.
"""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scenes import close_up, pose

from trinolab import kalman, measurement
from trinolab.bench.optics import Bench, blurred, digitise
from trinolab.bench.scene import exposed, render_rig
from trinolab.datasets import load_handle, load_rig
from trinolab.estimators.pixels import fit_patches
from trinolab.files.recording import Frames
from trinolab.following import look as look_module
from trinolab.following import posefilter, posetracker
from trinolab.following.look import Guess, Setup, expect, follow
from trinolab.following.parameters import FollowParameters
from trinolab.following.posefilter import PoseFilterParameters
from trinolab.pose import LOST
from trinolab.rigid import apart, motion_between, shifted
from trinolab.work import Work

CODED, PAPER, SIDE = load_handle("coded"), load_handle("paper"), 720
RIG = close_up(load_rig("raised_40deg"), [8.0, -14.0, 572.0], SIDE)
FPS, BEST = 30.0, FollowParameters(estimator="patches")
FIRST = pose([-20.0, 5.0, 560.0], [170.0, 15.0, 10.0])  # the free end upwards
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
    """Four instants, twelve without the handle, two more."""
    return clip(CODED, 18, range(4, 16)), clip(PAPER, 18, range(4, 16))


def statuses(found):
    return [one.measurement.pose.status for one in found]


def test_a_coded_handle_is_followed_lost_and_found_at_once(with_a_gap):
    found = tracked(with_a_gap[0], CODED)
    # predicted for 0.3 s from the last measurement
    wanted = ["measured"] * 4 + ["predicted"] * 9 + ["lost"] * 3 + ["measured"] * 2
    assert statuses(found) == wanted
    for k in (1, 3, 16, 17):
        one = found[k].measurement.pose
        assert not apart(one.T_world_handle, path(k), 0.3, np.deg2rad(2.0))
        assert np.isfinite(one.covariance).all()
    sigmas = [found[k].measurement.pose.sigma_mm for k in (3, 4, 12)]
    assert sigmas == sorted(sigmas)
    # only windows are searched while it is followed
    searched = [sum(window.area for window in filter(None, one.windows)) for one in found[:4]]
    assert searched[0] == 3 * SIDE**2
    assert max(searched[1:]) < 0.1 * searched[0]


def test_a_handle_that_looks_alike_is_sure_from_a_known_pose_until_it_was_lost(with_a_gap):
    """A known pose counts only as long as it is ambiguous which one holds."""
    turned, other = PAPER.symmetries[5], PAPER.symmetries[3]
    frames = [Frames(k, k / FPS, images) for k, images in enumerate(with_a_gap[1])]
    known = {1: path(1) * turned, 2: path(2) * other, 17: path(17) * other}
    found = list(posetracker.track_instants(frames, RIG, PAPER, BEST, known))
    assert [now for now, _ in found] == frames
    status = statuses(one for _, one in found)
    assert status[:4] == ["ambiguous", *["measured"] * 3]
    assert status[16:] == ["ambiguous", "measured"]
    for k, symmetry in ((1, turned), (2, turned), (3, turned), (17, other)):
        one = found[k][1].measurement.pose.T_world_handle
        assert not apart(one, path(k) * symmetry, 0.1, np.deg2rad(0.5))
    for k in (0, 16):
        one = found[k][1].measurement.pose.T_world_handle
        away = [np.linalg.norm(motion_between(one, path(k) * S)) for S in PAPER.symmetries]
        assert min(away) < 0.1


def test_times_may_be_uneven_and_have_to_rise(with_a_gap):
    state, frames = posetracker.start(-1.0), with_a_gap[0]
    for k in (0, 1, 3):
        state, one = posetracker.step(state, frames[k], k / FPS, RIG, CODED, BEST)
        assert one.measurement.pose.status == "measured"
    with pytest.raises(ValueError, match="t_s"):
        posetracker.step(state, frames[3], 3 / FPS, RIG, CODED, BEST)
    with pytest.raises(ValueError, match="frames: expected one for each of 3 cameras"):
        posetracker.step(state, frames[3][:2], 4 / FPS, RIG, CODED)


@pytest.mark.parametrize("grey", [0, 255])
def test_black_and_white_frames_hold_no_pose(with_a_gap, grey):
    nothing = [np.full((SIDE, SIDE), grey, np.uint8)] * 3
    found = tracked([nothing, *with_a_gap[0][:2], nothing], CODED)
    assert statuses(found) == ["lost", "measured", "measured", "predicted"]


def test_a_frozen_camera_is_outvoted(with_a_gap):
    """CCD3 stands still while the handle moves on, by 3 mm an instant."""
    frames = [[*images[:2], with_a_gap[0][0][2]] for images in with_a_gap[0][:4]]
    for k, one in enumerate(tracked(frames, CODED)):
        found = one.measurement.pose
        is_off = found.T_world_handle is None or apart(found.T_world_handle, path(k), 2.0, 0.09)
        assert not (found.status == "measured" and is_off)


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


@cache
def smeared_images(velocity):
    """Images of a handle that moves while the shutter is open; `exposed` renders every step of
    that.
    """
    bench, rng = Bench(), np.random.default_rng(2)
    images = []
    for camera in RIG.cameras:
        light = exposed(camera, CODED, FIRST, bench, velocity[:3], velocity[3:])
        images.append(digitise(blurred(light, bench), bench, rng))
    return images


def is_covered(pose):
    """Whether its covariance explains how far it is off: chi-square of six, 99.97 %."""
    away = motion_between(pose.T_world_handle, FIRST)
    return away @ np.linalg.solve(pose.covariance, away) < 25.0


FAST = (350.0, -120.0, 60.0, 0.3, 0.2, -0.4)


def test_a_smear_is_fitted_with_the_pose():
    """Expected of the motion is a fifth too much. With less work than it takes the pose so far has a
    wider covariance; there is none where there is no work for a step.
    """
    frames = smeared_images(FAST)
    start = shifted(FIRST, np.array([0.2, -0.3, 0.3, 0.01, -0.01, 0.01]))
    expected = 0.012 * np.array(FAST), np.diag(np.repeat([1.0, 0.01], 3) ** 2)

    def fitted(work):
        return fit_patches(frames, RIG, CODED, start, motion_blur=expected, work=work)

    whole, none = Work(1e3), Work(1.0)
    moving = fitted(whole)
    assert not apart(moving.T_world_handle, FIRST, 0.05, np.deg2rad(0.3))
    assert is_covered(moving)
    assert np.median(moving.misfit) < 1.5
    still = fit_patches(frames, RIG, CODED, start)
    assert still is None or np.median(still.misfit) > 3.0
    short = fitted(Work(0.6 * (1e3 - whole.remaining)))
    assert np.trace(short.covariance) > np.trace(moving.covariance)
    assert is_covered(short)
    assert fitted(none) is None
    assert none.remaining == 1.0


def test_smeared_markers_leave_a_rig_as_sharp_ones_have_seen_it():
    """A rig that does not say how far it is off."""
    motion = posefilter.begin(0.0, FIRST, np.diag([0.1] * 3 + [1e-4] * 3), BEST.motion)
    rates = np.concatenate([FAST, np.zeros(6)])
    setup = Setup(replace(RIG, covariance=None), CODED, BEST)
    guess = Guess(motion._replace(rates=rates), expect(setup, motion), True)
    followed = follow(smeared_images(FAST), guess, setup)
    assert followed.pose.status == "measured"
    assert not apart(followed.pose.T_world_handle, FIRST, 0.5, np.deg2rad(0.5))


@pytest.mark.parametrize("velocity", [(0.0, 90.0, 300.0), (100.0, 0.0, 0.0)])
def test_a_smeared_handle_is_measured_where_nothing_is_known_of_its_motion(velocity):
    """The smear says how long and along which line the motion is."""
    (one,) = tracked([smeared_images((*velocity, 0.3, -0.2, 0.4))], CODED)
    found = one.measurement.pose
    assert found.status == "measured"
    assert not apart(found.T_world_handle, FIRST, 0.05, np.deg2rad(0.3))
    assert is_covered(found)


@pytest.mark.parametrize("is_cut", [False, True])
def test_one_camera_of_three_is_believed_after_a_whole_search(is_cut, monkeypatch):
    """What the two others show may be the handle, too."""

    def identified(*arguments):
        found = measurement.identified(*arguments)
        arguments[-1].was_cut |= is_cut
        return found

    rig, rng = load_rig("raised_40deg"), np.random.default_rng(0)
    first, second = (render_rig(rig, CODED, path(k), Bench(), rng) for k in range(2))
    state, _ = posetracker.step(posetracker.start(-1.0), first, 0.0, rig, CODED, BEST)
    monkeypatch.setattr(posetracker, "identified", identified)
    alone = [np.zeros_like(second[0]), np.zeros_like(second[1]), second[2]]
    _, one = posetracker.step(state, alone, 1 / FPS, rig, CODED, BEST)
    assert one.measurement.pose.status == ("predicted" if is_cut else "measured")


@pytest.mark.parametrize(("share", "most"), [(0.8, 1), (0.5, 2), (0.1, 3)])
def test_an_instant_begins_no_guess_without_its_work(share, most, with_a_gap, monkeypatch):
    """Whatever a fit says, which takes a share of the work; the handle has jumped, so that further
    guesses are tried: shifted, and from a search of the whole images.
    """
    first = with_a_gap[0][0]
    state, _ = posetracker.step(posetracker.start(-1.0), first, 0.0, RIG, CODED, BEST)
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


def with_spots(frames, count, grey=240.0):
    """The images with still spots of the size of markers and more, each with the noise of a pixel."""
    rng = np.random.default_rng(1)
    lit = []
    for camera in RIG.cameras:
        lamps = np.zeros(camera.size[::-1])
        for centre in rng.uniform(30.0, np.array(camera.size) - 30.0, (count, 2)).astype(int):
            cv2.circle(lamps, tuple(centre.tolist()), int(rng.integers(4, 9)), 1.0, -1, cv2.LINE_AA)
        lit.append(lamps)

    def added(image, lamps):
        mixed = (1 - lamps) * image + lamps * rng.normal(grey, 3.0, image.shape)
        return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)

    return [list(map(added, images, lit)) for images in frames]


def off_mm(pose, k):
    return float(np.linalg.norm(pose.T_world_handle.translation - path(k).translation))


@pytest.mark.slow
@pytest.mark.parametrize(("empty", "spots"), [(3, 40), (1, 5)])
def test_what_the_empty_bench_shows_is_no_marker(empty, spots):
    """Of spots that are brighter than the markers there are more than are looked at, where they need
    a background.
    """
    state, poses = posetracker.start(-1 / FPS), []
    frames = with_spots(clip(CODED, empty + 2, range(empty)), spots)
    for k, images in enumerate(frames):
        state, one = posetracker.step(state, images, k / FPS, RIG, CODED, BEST)
        poses.append(one.measurement.pose)
        assert (state.backgrounds is not None) == (spots == 40)
    assert [pose.status for pose in poses] == ["lost"] * empty + ["measured"] * 2
    assert max(off_mm(pose, empty + k) for k, pose in enumerate(poses[empty:])) < 0.05


def test_where_nothing_moves_the_whole_images_are_searched():
    """A handle that rests has been in the background from the first instant on."""
    rests = [render_rig(RIG, CODED, path(0), Bench(), np.random.default_rng(k)) for k in range(2)]
    state = posetracker.start(-1.0)._replace(
        backgrounds=tuple(image.astype(np.float32) for image in rests[0])
    )
    _, one = posetracker.step(state, rests[1], 0.0, RIG, CODED, BEST)
    assert one.measurement.pose.status == "measured"
    assert off_mm(one.measurement.pose, 0) < 0.05
