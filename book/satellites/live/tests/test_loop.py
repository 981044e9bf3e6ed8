"""The live loop without a browser and without waiting: its clock, frames and poses are a test's."""

import gc
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from livepage import FRAME_S, HELD, NOBODY, RIG, TICK_S, Driven, at

from satellites.live import settings
from satellites.live.loop import Loop
from satellites.live.picture import message
from satellites.live.pointing import GO, MARK
from satellites.live.sources import HOME, SimulatedHand
from trinolab.slave.mapping import JUMP, MappingParameters


def swing(t_s):
    """A hand that swings slowly to both sides, from rest."""
    return at(25 * (1 - np.cos(2 * np.pi * 0.4 * t_s)), 0.2 * np.sin(2 * np.pi * 0.3 * t_s) ** 2)


def joints(folder, monkeypatch, delay_ms, length_s=2.4):
    """Times and commanded joints of the arm that follows the swing."""
    driven = Driven(folder, monkeypatch)
    driven.loop.set("delay_ms", delay_ms)
    driven.loop.clutch(True)
    for k in range(round(length_s / FRAME_S)):
        driven.handle = swing(k * FRAME_S)
        driven.frame()
    return tuple(
        np.concatenate([getattr(ticks, name) for ticks in driven.ticks]) for name in ("t_s", "q")
    )


def test_the_joints_lag_by_the_added_delay(tmp_path, monkeypatch):
    """Of nine frames, and of one that ends between two frames; a lag that is two ticks off is not."""
    times, q = joints(tmp_path, monkeypatch, 0.0)
    for delay_ms in (300.0, 150.0):
        later_times, later_q = joints(tmp_path, monkeypatch, delay_ms)
        np.testing.assert_allclose(later_times, times, atol=1e-9)
        joint = np.ptp(q, axis=0).argmax()  # that moves most
        inner = times > times[0] + 0.8  # where both move
        off = [
            np.std((later_q[:, joint] - np.interp(times - lag_s, times, q[:, joint]))[inner])
            for lag_s in 1e-3 * delay_ms + TICK_S * np.arange(-2, 3)
        ]
        assert min(off[1:4]) < 0.02 * np.std(q[:, joint])
        assert 0 < np.argmin(off) < 4


def test_a_change_of_scale_while_the_clutch_is_closed_does_not_move_the_arm(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch)
    driven.loop.clutch(True)
    moved(driven, 0, 30)
    before = driven.rounds(1.5)  # until the filter has come to rest
    target, q = before.moment.state.target.translation, before.moment.ticks.q[-1]
    driven.loop.set("scale", 4.0)
    for _ in range(15):
        now = driven.frame()
        np.testing.assert_allclose(now.moment.state.target.translation, target, atol=0.01)
        np.testing.assert_allclose(now.moment.ticks.q - q, 0, atol=1e-4)
    assert not now.moment.state.held
    assert any("scale: 4" in words for words in now.notes)
    # and from there it moves four times as far
    moved(driven, 30, 40)
    way = driven.rounds(2.0).moment.state.target.translation - target
    assert np.linalg.norm(way) == pytest.approx(40.0, abs=0.2)


def moved(driven, start_mm, end_mm):
    for x in np.linspace(start_mm, end_mm, 15):
        driven.handle = at(x)
        driven.frame()


def test_a_hand_that_moves_on_between_slow_frames_is_no_jump(tmp_path, monkeypatch):
    """Rounds without a frame lie between; the frame that comes is older than the last of them."""
    driven = Driven(tmp_path, monkeypatch)
    driven.loop.clutch(True)
    driven.frame()
    for k in range(1, 12):
        driven.nothing()
        driven.handle = at(8.0 * k)
        now = driven.frame(0.05, age_s=0.08)
        assert JUMP not in now.moment.state.held
        assert not now.moment.state.held
    way = np.linalg.norm(
        now.moment.state.target.translation - driven.ticks[1].reference[0].translation
    )
    assert way > 50.0


def test_each_slider_reaches_what_it_sets(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch)
    new = {slider.name: slider.high for slider in settings.SLIDERS}
    for name, value in new.items():
        driven.loop.set(name, value)
    assert driven.frame().values == new
    parameters, mapping = driven.loop.parameters_now, driven.loop.arm_session.mapping
    assert parameters.background.update_rate == new["update_rate"]
    assert parameters.matching.ncc_threshold == new["ncc_threshold"]
    assert mapping.scale == new["scale"]
    assert mapping.filtering.cutoff_hz == new["cutoff_hz"]


def test_rounds_leave_nothing_behind(tmp_path, monkeypatch):
    """What is kept is kept for so many rounds; a page that never answers adds nothing."""
    driven = Driven(tmp_path, monkeypatch)
    driven.loop.set("delay_ms", 200.0)
    driven.loop.clutch(True)

    def objects_after(rounds):
        for k in range(rounds):
            driven.handle = at(20 * np.sin(k / 5))
            driven.loop.heard(driven.frame().number)
            message(driven.loop.newest, RIG, {}, True)
            driven.ticks.clear()
        gc.collect()
        return len(gc.get_objects())

    before = objects_after(30)
    assert objects_after(60) - before < 60  # less than one a round


def test_a_camera_in_trouble_stops_the_arm_at_once_whatever_the_delay(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch)
    driven.loop.arm_session.mapping = MappingParameters(stale_s=0.15)
    driven.loop.set("delay_ms", 500.0)
    driven.loop.clutch(True)
    targets = []
    for k in range(30):
        driven.handle = at(0.5 * k)
        targets.append(driven.frame().moment.state.target.translation)
    assert (targets[-1] != targets[-2]).any()
    # 0.2 s; and what was on its way does not come later
    for troubles, rounds in ((["ccd2: no new image for 1 s"], 6), ([], 20)):
        driven.troubles = troubles
        for _ in range(rounds):
            now = driven.frame()
            assert (now.moment.state.target.translation == targets[-1]).all()
        assert now.moment.state.held


def test_the_papers_tracker_and_the_papers_estimator_are_in_the_loop(tmp_path, monkeypatch):
    follow = Loop.follow
    driven = Driven(tmp_path, monkeypatch)
    monkeypatch.setattr(driven.loop, "follow", partial(follow, driven.loop))
    driven.images = NOBODY
    driven.loop.follow_by(settings.PAPER)
    for _ in range(3):
        assert driven.frame().tracked.measurement.pose.status == "lost"
    driven.images = HELD
    for _ in range(4):
        seen = driven.frame()
    assert seen.tracker == settings.PAPER
    is_home(seen)
    # taken anew with the rod in place, the rod is background
    driven.loop.follow_by(settings.PAPER)
    driven.frame()
    assert driven.frame().tracked.measurement.pose.status == "lost"
    driven.loop.estimator_now = "paper"
    driven.loop.follow_by(settings.POSE)
    is_home(driven.frame())
    is_home(driven.frame())


def is_home(now):
    pose = now.tracked.measurement.pose
    assert pose.status == "measured"
    assert np.linalg.norm(pose.T_world_handle.translation - HOME.translation) < 0.5  # mm


def test_the_task_begins_with_an_open_clutch_and_the_hand_at_home_and_ends_when_it_is_told(
    tmp_path, monkeypatch
):
    driven = Driven(tmp_path, monkeypatch)
    came_home = []
    driven.source.hand = SimpleNamespace(go_home=lambda: came_home.append(True))
    driven.loop.clutch(True)
    before = driven.frame()
    assert (before.clutch, before.task) == (True, None)
    driven.loop.begin_task("Ann", 1)
    now = driven.frame()
    assert (came_home, now.clutch, now.task.done) == ([True], False, 0)
    assert now.task.what in (GO, MARK)
    assert f'"what": "{now.task.what}"'.encode() in message(now, RIG, {}, True)
    driven.loop.press()  # nothing is asked for yet
    assert driven.frame().task.done == 0
    driven.loop.end_task()
    assert driven.frame().task is None
    assert list(tmp_path.iterdir()) == []  # no trial, no log


def test_the_rate_is_that_of_the_frames_and_none_when_they_stop(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch)
    assert driven.frame(dt=1 / 20).rate_hz == 0
    for _ in range(2):
        now = driven.frame(dt=1 / 20)
    assert now.rate_hz == pytest.approx(20, rel=1e-6)
    driven.now += 1.1
    assert driven.nothing().rate_hz == 0


def test_a_page_that_does_not_answer_loses_the_clutch(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch, SimulatedHand(3))
    driven.loop.clutch(True)
    assert driven.rounds(2.0).clutch
    now = driven.rounds(1.5, drawn=False)  # longer than a page may be silent
    assert not now.clutch
    assert any("did not answer" in words for words in now.notes)
