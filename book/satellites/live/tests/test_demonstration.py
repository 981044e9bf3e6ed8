"""The simulated hand that plays the pointing task by itself: in the loop's own time, and in a
browser.
"""

from dataclasses import replace

import pytest
from livepage import FRAME_S, Driven, Live, Tab, shows

from satellites.live.command import chosen
from satellites.live.pointing import TARGET
from satellites.live.sources import SimulatedHand


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
    while not (now.task and now.task.what == TARGET and now.clutch):  # in the next run
        now = shown.rounds(FRAME_S)
        assert shown.now < 120
    session = shown.loop.arm_session
    session.mapping = replace(session.mapping, stale_s=0.15)
    shown.troubles = ["ccd2: no new image for 1 s"]
    assert not shown.rounds(0.4).clutch  # an open clutch lets go of what holds
    shown.troubles = []
    while (now := shown.rounds(FRAME_S)).task:
        assert shown.now < 130
    assert "0 % beside the target" in now.task_status
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
    assert shown.rounds(0.5).task
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
