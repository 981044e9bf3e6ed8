"""The live loop without a browser and without waiting: its clock, frames and poses are a test's."""

import gc
import time
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

pytest.importorskip("mink", reason="the extra 'slave' is missing")

from livepage import HANDLE, HELD, NOBODY, RIG, a_loop

from satellites.live import loop as live_loop
from satellites.live import settings
from satellites.live.loop import WAIT_S
from satellites.live.picture import message
from satellites.live.pointing import GO, MARK
from satellites.live.sources import HOME, Latest
from trinolab.following.posetracker import Tracked
from trinolab.markers import Markers
from trinolab.measurement import Measurement
from trinolab.pose import Pose
from trinolab.slave.arm import load_robot
from trinolab.slave.mapping import JUMP, MappingParameters
from workbench.teleop.session import Session

FRAME_S = 1 / 30
TICK_S = 0.008


class Driven:
    """A loop that goes on by `frame` and `nothing`, whose handle is where the test has it."""

    def __init__(self, folder, monkeypatch, images=HELD, estimator="patches"):
        self.now = 100.0
        clock = SimpleNamespace(monotonic=lambda: self.now, strftime=time.strftime)
        monkeypatch.setattr(live_loop, "time", clock)
        self.images = images
        self.handle = None  # T_world_handle, for a test that needs no images
        self._next = None
        self._number = 0
        self.troubles = []
        source = SimpleNamespace(
            rig=RIG,
            handle=HANDLE,
            hand=None,
            next=lambda wait_s: self._next,
            troubles=lambda: self.troubles,
        )
        self.loop = a_loop(source, folder)
        self.loop.estimator_now = estimator
        self.loop.arm_session = Session(
            load_robot(), MappingParameters(), tick_s=TICK_S, longest_s=3.0
        )
        self.ticks = []

    def without_images(self, monkeypatch):
        """The tracker says where the handle is."""

        def follow(latest, follower):
            pose = Pose("measured", self.handle, 1e-4 * np.eye(6), 0.1, 12, 3)
            nobody = Markers(*np.split(np.empty((0, 6)), [2, 4, 5], axis=1), ())
            found = Measurement(pose, (nobody,) * 3, (np.empty(0, int),) * 3)
            return Tracked(found, (None,) * 3)

        monkeypatch.setattr(self.loop, "follow", follow)
        return self

    def frame(self, dt=FRAME_S, age_s=0.0):
        """A round with a frame that was exposed some time ago."""
        self.now += dt
        self._number += 1
        t_s = self.now - age_s
        self._next = Latest(self._number, t_s, 0.0, self.now, self.images)
        return self.go_round()

    def nothing(self):
        """A round in which no frame came."""
        self.now += WAIT_S
        self._next = None
        return self.go_round()

    def go_round(self):
        self.loop.go_round()
        self.ticks.append(self.loop.newest.moment.ticks)
        return self.loop.newest


def at(x_mm, turn_rad=0.0):
    return RigidTransform.from_components(
        [x_mm, 0.0, 570.0], Rotation.from_rotvec([0, turn_rad, 0])
    )


def swing(t_s):
    """A hand that swings slowly to both sides, from rest."""
    return at(25 * (1 - np.cos(2 * np.pi * 0.4 * t_s)), 0.2 * np.sin(2 * np.pi * 0.3 * t_s) ** 2)


def joints(folder, monkeypatch, delay_ms, length_s=2.4):
    """Times and commanded joints of the arm that follows the swing."""
    driven = Driven(folder, monkeypatch).without_images(monkeypatch)
    driven.loop.set("delay_ms", delay_ms)
    driven.handle = swing(0.0)
    driven.loop.clutch(True)
    for k in range(round(length_s / FRAME_S)):
        driven.handle = swing(k * FRAME_S)
        driven.frame()
    return tuple(
        np.concatenate([getattr(ticks, name) for ticks in driven.ticks]) for name in ("t_s", "q")
    )


def test_the_joints_lag_by_the_added_delay(tmp_path, monkeypatch):
    """The lag by which both motions are alike, sought tick by tick: of nine frames, and of one that
    ends between two frames.
    """
    times, q = joints(tmp_path, monkeypatch, 0.0)
    for delay_ms in (300.0, 150.0):
        later_times, later_q = joints(tmp_path, monkeypatch, delay_ms)
        np.testing.assert_allclose(later_times, times, atol=1e-9)
        assert lag_s(times, q, later_q) == pytest.approx(1e-3 * delay_ms, abs=TICK_S)


def lag_s(times, q, later_q):
    """The lag of the joint that moves most."""
    moved = np.ptp(q, axis=0)
    assert moved.max() > 0.05  # rad
    joint = int(moved.argmax())
    inner = slice(round(0.8 / TICK_S), None)  # where both move
    lags = np.arange(0.0, 0.6, TICK_S / 4)
    off = [
        np.std(later_q[inner, joint] - np.interp(times[inner] - lag, times, q[:, joint]))
        for lag in lags
    ]
    assert min(off) < 0.02 * np.std(q[:, joint])
    return lags[int(np.argmin(off))]


def test_a_change_of_scale_while_the_clutch_is_closed_does_not_move_the_arm(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch).without_images(monkeypatch)
    driven.handle = at(0.0)
    driven.loop.clutch(True)
    driven.frame()
    for x in np.linspace(0, 30, 15):
        driven.handle = at(x)
        driven.frame()
    for _ in range(45):  # until the filter has come to rest
        before = driven.frame()
    target = before.moment.state.target.translation
    q = before.moment.ticks.q[-1]
    driven.loop.set("scale", 4.0)
    for _ in range(15):
        now = driven.frame()
        np.testing.assert_allclose(now.moment.state.target.translation, target, atol=0.01)
        np.testing.assert_allclose(
            now.moment.ticks.q, np.tile(q, (len(now.moment.ticks.q), 1)), atol=1e-4
        )
    assert not now.moment.state.held
    assert any("scale: 4" in words for words in now.notes)
    # and from there it moves four times as far
    for x in np.linspace(30, 40, 15):
        driven.handle = at(x)
        driven.frame()
    for _ in range(60):
        now = driven.frame()
    way = now.moment.state.target.translation - target
    assert np.linalg.norm(way) == pytest.approx(40.0, abs=0.2)


def test_a_change_of_scale_while_the_hand_moves_makes_no_jump(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch).without_images(monkeypatch)
    driven.handle = at(0.0)
    driven.loop.clutch(True)
    targets, scales = [], np.repeat([1.0, 3.0, 0.5], 20)
    for k, scale in enumerate(scales):
        driven.handle = at(1.5 * k)  # 45 mm/s
        driven.loop.set("scale", scale)
        targets.append(driven.frame().moment.state.target.translation)
    steps = np.linalg.norm(np.diff(targets, axis=0), axis=1)
    assert (steps <= 1.05 * 1.5 * scales[1:]).all()  # the filter catches up by a little more
    assert not driven.loop.newest.moment.state.held


def test_a_hand_that_moves_on_between_slow_frames_is_no_jump(tmp_path, monkeypatch):
    """Rounds without a frame lie between; the frame that comes is older than the last of them."""
    driven = Driven(tmp_path, monkeypatch).without_images(monkeypatch)
    driven.handle = at(0.0)
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
    driven = Driven(tmp_path, monkeypatch).without_images(monkeypatch)
    driven.handle = at(0.0)
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
    driven = Driven(tmp_path, monkeypatch).without_images(monkeypatch)
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
    driven = Driven(tmp_path, monkeypatch).without_images(monkeypatch)
    driven.loop.arm_session.mapping = MappingParameters(stale_s=0.15)
    driven.loop.set("delay_ms", 500.0)
    driven.handle = at(0.0)
    driven.loop.clutch(True)
    targets = []
    for k in range(30):
        driven.handle = at(0.5 * k)
        targets.append(driven.frame().moment.state.target.translation)
    assert (targets[-1] != targets[-2]).any()
    driven.troubles = ["ccd2: no new image for 1 s"]
    for _ in range(6):  # 0.2 s
        now = driven.frame()
        assert (now.moment.state.target.translation == targets[-1]).all()
    assert now.moment.state.held
    # what was on its way does not come later
    driven.troubles = []
    for _ in range(20):
        now = driven.frame()
    assert now.moment.state.held
    assert (now.moment.state.target.translation == targets[-1]).all()


def test_the_papers_tracker_and_the_papers_estimator_are_in_the_loop(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch, NOBODY)
    driven.loop.follow_by(settings.PAPER)
    for _ in range(3):
        assert driven.frame().tracked.measurement.pose.status == "lost"
    driven.images = HELD
    seen = [driven.frame() for _ in range(4)]
    assert seen[-1].tracker == settings.PAPER
    is_home(seen[-1])
    # taken anew with the rod in place, the rod is background
    driven.loop.follow_by(settings.PAPER)
    driven.frame()
    assert driven.frame().tracked.measurement.pose.status == "lost"
    by_paper = Driven(tmp_path, monkeypatch, HELD, "paper")
    is_home(by_paper.frame())
    is_home(by_paper.frame())


def is_home(now):
    pose = now.tracked.measurement.pose
    assert pose.status == "measured"
    assert np.linalg.norm(pose.T_world_handle.translation - HOME.translation) < 0.5  # mm


def test_the_task_begins_with_an_open_clutch_and_the_hand_at_home_and_ends_when_it_is_told(
    tmp_path, monkeypatch
):
    driven = Driven(tmp_path, monkeypatch).without_images(monkeypatch)
    driven.handle = at(0.0)
    came_home = []
    driven.loop.source.hand = SimpleNamespace(go_home=lambda: came_home.append(True))
    driven.loop.clutch(True)
    before = driven.frame()
    assert before.clutch
    assert before.task is None
    driven.loop.begin_task("Ann", 1)
    now = driven.frame()
    assert came_home == [True]
    assert not now.clutch
    assert now.task.what in (GO, MARK)
    assert now.task.done == 0
    assert f'"what": "{now.task.what}"'.encode() in message(now, RIG, {}, True)
    driven.loop.press()  # nothing is asked for yet
    assert driven.frame().task.done == 0
    driven.loop.end_task()
    assert driven.frame().task is None
    assert list(tmp_path.iterdir()) == []  # no trial, no log


def test_a_recording_that_cannot_begin_is_said_and_not_tried_again_by_itself(tmp_path, monkeypatch):
    folder = tmp_path / "gone"
    driven = Driven(folder, monkeypatch).without_images(monkeypatch)
    driven.handle = at(0.0)
    driven.loop.record(True)
    running, said = driven.frame().recording
    assert not running
    assert said.startswith("not recording: ")
    assert "gone" in said
    folder.mkdir()
    assert not driven.frame().recording[0]
    driven.loop.record(True)
    assert driven.frame().recording[0]
    driven.loop.record(False)
    driven.frame()
    driven.loop.record_writer.close()  # waits until it is written
    assert "recorded 1 instants" in driven.loop.record_writer.status


def test_the_rate_is_that_of_the_frames_and_none_when_they_stop(tmp_path, monkeypatch):
    driven = Driven(tmp_path, monkeypatch).without_images(monkeypatch)
    driven.handle = at(0.0)
    assert driven.frame(dt=1 / 20).rate_hz == 0
    for _ in range(2):
        now = driven.frame(dt=1 / 20)
    assert now.rate_hz == pytest.approx(20, rel=1e-6)
    driven.now += 1.1
    assert driven.nothing().rate_hz == 0
