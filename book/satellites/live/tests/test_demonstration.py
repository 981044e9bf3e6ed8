"""The simulated hand that plays the pointing task by itself: in the loop's own time, and in a
browser.
"""

import numpy as np
import pytest
from livepage import FRAME_S, Driven, Live, Tab, shows
from scipy.spatial.transform import Rotation

from satellites.live import settings
from satellites.live.command import chosen
from satellites.live.demonstration import NAME, OPEN_S, Demonstration, Seen
from satellites.live.pointing import TARGET, Pointing
from satellites.live.sources import SimulatedHand

LAG_S = 0.25  # of a tool that follows the hand with a lag of the first order


class Line:
    """The task along the base's x axis; the tool follows the hand while the clutch is closed."""

    def __init__(self, path, scale=1.0, frame_s=FRAME_S):
        self.pointing = Pointing(path, Rotation.identity())
        self.player = Demonstration()
        self.scale = scale
        self.frame_s = frame_s
        self.values = {**settings.defaults(), "scale": scale}
        self.tool, self.hand, self.t_s = np.array([300.0, 20.0, 100.0]), 0.0, 0.0
        self.clutch = False
        self.held = False
        self.number = 0
        self.done = []  # when each trial was done, s

    def round(self):
        """A round; what there is to do."""
        self.number += 1
        self.t_s += self.frame_s
        p = self.pointing
        task = p.step(self.tool, self.clutch, self.values, self.number, self.t_s)
        p.drawn(self.number, self.t_s)
        act = self.player.step(Seen(self.t_s, task, self.held, self.scale, self.hand))
        if act.begin:
            p.begin(NAME, 1, self.t_s, logged=False)
            self.hand = 0.0
            self.goal = self.tool.copy()
        else:
            if self.clutch and act.clutch:
                self.goal[0] += self.scale * (act.hand_mm - self.hand)
            self.hand = act.hand_mm if task else self.hand
            if task:
                self.tool = self.tool + (1 - np.exp(-self.frame_s / LAG_S)) * (
                    self.goal - self.tool
                )
        self.clutch = act.clutch
        if act.press:
            p.press(self.tool, self.values, self.t_s)
            self.done.append(self.t_s)
        return task


@pytest.mark.parametrize("frame_s", [FRAME_S, 0.25])
def test_the_task_is_seen_in_ten_seconds_and_each_target_is_hit(tmp_path, frame_s):
    """The first target is there and done within ten seconds, at four frames a second, too."""
    line = Line(tmp_path / "log.csv", frame_s=frame_s)
    while not line.done or line.pointing.on:
        line.round()
        assert line.t_s < 90.0
    assert line.done[0] < 10.0
    assert len(line.done) == 9
    for words in ("9 targets", "0 % beside the target", "not logged"):
        assert words in line.pointing.status
    assert not (tmp_path / "log.csv").exists()
    begin_s = line.t_s
    while line.round() is None:  # it begins again, when the result has been read
        assert not line.clutch
    assert 3.0 < line.t_s - begin_s < 6.0


def test_what_holds_is_let_go_and_the_way_goes_on(tmp_path):
    line = Line(tmp_path / "log.csv")
    while (task := line.round()) is None or task.what != TARGET:
        pass
    line.held = True
    line.round()
    assert not line.clutch
    line.held = False
    at_s, hand = line.t_s, line.hand
    while not line.clutch:
        line.round()
    assert line.t_s - at_s == pytest.approx(OPEN_S, abs=0.1)
    assert line.hand == hand
    while not line.done:
        line.round()
    assert "0 % beside the target" in line.pointing.status


def test_the_arm_goes_along_until_somebody_touches_a_control(tmp_path, monkeypatch):
    shown = Driven(tmp_path, monkeypatch, SimulatedHand(3))
    shown.loop.set("scale", 2.0)
    shown.loop.demonstrate()
    now = shown.rounds(3.0, drawn=False)
    assert (now.task, now.clutch, now.demonstration) == (None, False, True)  # nobody looks
    now = shown.rounds(3.3)
    assert (now.task.what, now.clutch) == (TARGET, True)
    assert now.values["scale"] == 1.0
    assert not shown.hand.by_itself
    now = shown.rounds(2.0)
    assert "1 target" in now.task_status
    assert "0 % beside the target; a demonstration, not logged" in now.task_status
    assert "hold" not in " ".join(now.notes)
    shown.loop.touch()
    now = shown.rounds(0.1)
    assert (now.task, now.clutch, now.demonstration) == (None, False, False)
    assert shown.hand.by_itself
    now = shown.rounds(6.0)
    assert now.task is None
    assert list(tmp_path.iterdir()) == []  # no log


def test_a_page_that_is_gone_stops_it_for_as_long(tmp_path, monkeypatch):
    shown = Driven(tmp_path, monkeypatch, SimulatedHand(3))
    shown.loop.demonstrate()
    assert shown.rounds(3.0).clutch
    now = shown.rounds(2.5, drawn=False)
    assert (now.clutch, now.task_status) == (False, "")
    assert "1 target" in shown.rounds(1.5).task_status


def test_it_does_nothing_in_the_task_of_a_person(tmp_path, monkeypatch):
    shown = Driven(tmp_path, monkeypatch, SimulatedHand(3))
    shown.loop.begin_task("Ann", 5)
    shown.rounds(1.0)
    shown.loop.clutch(True)
    task = shown.rounds(0.5).task
    while task.what != TARGET:  # to the mark, until the target is there
        shown.hand.move([task.aim - task.at[0], 0.0, 0.0], [0.0, 0.0, 0.0])
        task = shown.rounds(0.3).task
        assert shown.now < 120.0
    shown.loop.demonstrate()
    shown.rounds(6.0)
    assert "not logged" in shown.loop.newest.task_status
    assert list(tmp_path.iterdir()) == []  # the hand has pressed on its own targets alone
    shown.source.hand = None
    with pytest.raises(ValueError, match="no simulated hand"):
        shown.loop.demonstrate()


def test_every_word_but_that_of_a_frame_ends_it(tmp_path):
    with Live(chosen(seed=1), tmp_path) as live:
        tab = Tab(live.address)
        for words in ({"clutch": False}, {"set": ["cutoff_hz", 2.0]}, {"hand": {"home": True}}):
            tab.say(show=True)
            tab.until(lambda said: said.get("demonstration"))
            tab.until(lambda said: said.get("number"))
            assert live.loop.newest.demonstration
            tab.say(**words)
            tab.until(lambda said: said.get("demonstration") is False)
        tab.close()


def test_the_page_plays_and_says_so_until_a_key_is_pressed(browser, tmp_path):
    visible = "['demonstration', 'front', 'there'].map(one => $(one).checkVisibility())"
    with Live(chosen(seed=1), tmp_path) as live:
        live.loop.demonstrate()
        browser.open(live.address)
        shows(browser, "last && last.task && last.task.what !== 'close the clutch'")
        # the button to press at the target is the hand's
        assert browser.evaluate(visible) == [True, True, False]
        browser.press("c")
        shows(browser, "!last.demonstration && !last.clutch && !last.task")
        assert not browser.evaluate(visible)[0]
        browser.click("#see")
        shows(browser, "last.demonstration && last.task")
        browser.click("#mine")
        shows(browser, "!last.demonstration")
        assert browser.errors == []
