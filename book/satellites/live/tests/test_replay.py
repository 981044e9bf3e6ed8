"""What was recorded, replayed on the page while the live loop goes on, and the log of it."""

import shlex

import numpy as np
import pytest
from livepage import HANDLE, RIG, Tab, shows
from scipy.spatial.transform import RigidTransform

from satellites.live.sources import HOME, QUICK
from trinolab.bench.scene import render_rig
from workbench.cli import main

THERE = RigidTransform.from_translation([20.0, 0.0, 0.0]) * HOME
BRIGHT = "$('camera-0').getContext('2d').getImageData(0, 0, 480, 384).data.reduce((a, b) => a + b)"


def recorded(live, browser, count=6):
    """Record so many instants at least."""
    browser.click("#record")
    shows(browser, "last.recording")
    number = live.loop.newest.frames.number
    live.seen(lambda now: now.frames.number > number + count)
    browser.click("#record")
    shows(browser, "last.folder")


def test_what_cannot_be_used_says_why(live, browser):
    for control, words in (
        ("play", "nothing is recorded yet"),
        ("scrub", "nothing is recorded yet"),
        ("set-update_rate", "only the paper’s windows"),
        ("set-ncc_threshold", "only the paper’s windows"),
    ):
        described = f"$($('{control}').getAttribute('aria-describedby'))"
        said = browser.evaluate(f"[$('{control}').title, {described}.innerText]")
        assert all(words in one for one in said), control
        assert browser.evaluate(f"$('{control}').disabled && {described}.checkVisibility()")
    grey = "[...document.querySelectorAll('main :disabled')].map(one => one.title)"
    assert all(browser.evaluate(grey))
    browser.evaluate("document.querySelector('[name=tracker][value=paper]').click()")
    shows(browser, "!$('set-update_rate').disabled && !$('set-update_rate').title")
    assert not browser.evaluate("$('why-paper').checkVisibility()")
    browser.click("#begin")
    shows(browser, "$('begin').disabled && $('begin').title.includes('a task goes on')")
    browser.click("#end")
    shows(browser, "!$('begin').disabled && !$('why-begin').checkVisibility()")
    other = Tab(live.address)
    other.say(take=True)
    shows(browser, "$('clutch').disabled && !$('busy').hidden")
    shows(browser, "$('clutch').title.includes('another tab')")
    browser.click("#take")
    shows(browser, "last && $('busy').hidden && !$('clutch').disabled")
    other.close()


def test_the_last_recording_is_replayed_and_live_goes_on(live, bench, browser):
    recorded(live, browser)
    assert not browser.evaluate("$('play').disabled || Replay.on()")
    then, bright = browser.evaluate("last.pose.x_mm"), browser.evaluate(BRIGHT)
    bench.images = render_rig(RIG, HANDLE, THERE, QUICK, np.random.default_rng(5))
    shows(browser, f"last.pose.x_mm > {then} + 15 && last.status === 'measured'")
    shows(browser, f"Math.abs({BRIGHT} - {bright}) > 1000")  # a picture comes after its pose
    there = browser.evaluate(BRIGHT)
    browser.evaluate("$('scrub').focus()")
    for _ in range(4):
        browser.press("ArrowRight")
    shows(browser, "Replay.on() && Number($('scrub').value) >= 0.15")
    shows(browser, f"Number($('pose-x_mm').textContent) < {then} + 5")  # as it was
    shows(browser, f"Math.abs({BRIGHT} - {there}) > 1000")
    assert browser.evaluate("$('replaying').checkVisibility()")
    assert browser.evaluate("$('scrub').getAttribute('aria-valuetext')").endswith("measured")
    number = browser.evaluate("last.number")
    shows(browser, f"last.number > {number} + 3 && last.pose.x_mm > {then} + 15 && Replay.on()")
    browser.press("p")
    shows(browser, "Replay.playing()")
    shows(browser, "!Replay.playing() && Replay.on()")  # at its end
    assert browser.evaluate("$('scrub').max - $('scrub').value") < 0.051  # s, a step
    browser.press("p")
    shows(browser, "Replay.playing()")  # again from the start
    browser.click("#back")
    shows(browser, f"!Replay.on() && Number($('pose-x_mm').textContent) > {then} + 15")
    # who closes the clutch sees what is, and not what was
    browser.press("p")
    shows(browser, "Replay.on() && !last.clutch")
    browser.press("c")
    shows(browser, "last.clutch && !Replay.on()")
    assert browser.errors == []


def test_of_a_long_recording_every_second_instant_is_given_up(live, browser):
    browser.click("#record")
    shows(browser, "last.recording")
    kept = browser.evaluate(
        "(() => { const one = {size: 1e6};"
        " for (let k = 0; k < 500; k++) Replay.keep({...last, recording: true}, [one]);"
        " return [Replay.size().count, Replay.size().bytes]; })()"
    )
    assert 30 < kept[0] < 110
    assert kept[1] < 97e6
    browser.click("#record")


def test_the_page_says_how_a_recording_becomes_a_log(live, browser, tmp_path, monkeypatch, capsys):
    """Its two commands make the file that it names."""
    pytest.importorskip("rosbags", reason="the extra 'ros' is missing")
    recorded(live, browser, 3)
    browser.evaluate("$('log').open = true")
    shown = browser.evaluate(
        "['log-commands', 'log-rerun', 'log-file'].map(one => $(one).innerText)"
    )
    monkeypatch.chdir(tmp_path)
    for command in shown[0].splitlines():
        program, *arguments = shlex.split(command)
        assert program == "trinolab"
        assert main(arguments) == 0
    capsys.readouterr()
    program, file = shlex.split(shown[1])
    assert (program, (tmp_path / file).name) == ("rerun", shown[2])
    assert (tmp_path / file).is_file()
