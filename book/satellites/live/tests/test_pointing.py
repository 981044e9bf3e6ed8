"""The pointing task before the live page: by hand, and played in a browser by a script."""

import re

import numpy as np
import pandas as pd
import pytest
from livepage import Live, shows
from scipy.spatial.transform import Rotation

from satellites.live import pointing, settings
from satellites.live.command import chosen
from satellites.live.pointing import GO, MARK, RESTS_S, TARGET, Pointing
from workbench.teleop.operators import point
from workbench.teleop.pointing import performance, read_log, write_log

VALUES = settings.defaults()
NEAR_MM = 4.0  # so near the script brings the tool
MIDDLE = np.array([300.0, 20.0, 100.0])


class Played:
    """A task whose tool is set by a test; the line is the base's x axis."""

    def __init__(self, path, targets, times=1):
        self.task = Pointing(path, Rotation.identity(), targets)
        self.task.begin("Ann", times, 0.0)
        self.values = VALUES
        self.number = 0
        self.t_s = 0.0
        self.along = 0.0

    def round(self, dt=0.1, coupled=True):
        """A round, and a page that draws it at once."""
        self.number += 1
        self.t_s += dt
        tool = MIDDLE + [self.along, 3.0, 0.0]
        doing = self.task.step(tool, coupled, self.values, self.number, self.t_s)
        self.task.drawn(self.number, self.t_s)
        return doing

    def press(self):
        self.task.press(MIDDLE + [self.along, 3.0, 0.0], self.values, self.t_s)

    def to_target(self):
        """Rest at the mark until the target is there."""
        self.along = self.round().aim
        while (doing := self.round()).what != TARGET:
            pass
        return doing


def test_a_trial_by_hand(tmp_path):
    played = Played(tmp_path / "log.csv", [[40.0, 10.0]])
    assert played.round(coupled=False).what == GO
    first = played.round()
    assert (first.what, first.aim, first.at) == (MARK, -20.0, (0.0, 0.0))
    played.along = -18.5  # near enough to the mark
    played.round()
    assert played.round(0.9 * RESTS_S).what == MARK
    doing = played.round(0.2 * RESTS_S)
    # the whole distance from where the tool is, and not from the mark
    assert (doing.what, doing.aim, doing.width_mm, doing.of) == (TARGET, 21.5, 10.0, 1)
    begin_s = played.t_s
    played.along = 27.0
    played.round(1.25)
    played.press()
    assert played.round() is None
    (row,) = read_log(tmp_path / "log.csv").to_dict("records")
    assert row.pop("operator") == "Ann"
    assert row == pytest.approx(
        {
            **{"task": 0, "scale": 1.0, "delay_s": 0.0, "distance_mm": 40.0, "width_mm": 10.0},
            **{"start_s": begin_s, "end_s": begin_s + 1.25, "error_mm": 5.5, "moves": 0},
        }
    )
    assert "100 % beside the target" in played.task.status


def test_the_targets_come_right_and_left_and_the_log_is_judged_as_the_studys(tmp_path):
    played = Played(tmp_path / "log.csv", [[40.0, 10.0], [80.0, 20.0]], times=3)
    sides = []
    for k in range(6):
        doing = played.to_target()
        start = played.along
        sides.append(np.sign(doing.aim - start))
        assert abs(doing.aim - start) in (40.0, 80.0)
        played.along = doing.aim + (k % 3)
        played.round(0.5 + 0.1 * k)
        played.press()
    assert sides == [1, -1, 1, -1, 1, -1]
    log = read_log(tmp_path / "log.csv")
    assert (
        sorted(zip(log["distance_mm"], log["width_mm"], strict=True))
        == [(40.0, 10.0)] * 3 + [(80.0, 20.0)] * 3
    )
    # beyond a target on the right, short of one on the left
    np.testing.assert_allclose(log["error_mm"], [0, -1, 2, 0, 1, -2], atol=1e-9)
    assert f"6 targets: {performance(log).throughput_bit_s:.2f} bit/s" in played.task.status
    assert not played.task.on


def test_what_is_not_on_the_target_or_not_seen_yet_does_not_count(tmp_path):
    played = Played(tmp_path / "log.csv", [[40.0, 10.0]])
    played.round()
    played.press()  # no target is there
    played.to_target()
    tool = MIDDLE + [20.0, 0.0, 0.0]
    # a target that the page has not drawn
    played.task.seen_s = None
    played.task.press(tool, VALUES, played.t_s)
    assert played.round().what == TARGET
    # another scale in the middle of a trial
    played.task.press(tool, {**VALUES, "scale": 2.0}, played.t_s)
    assert "once more" in played.task.status
    assert played.round().what == MARK
    assert not (tmp_path / "log.csv").exists()
    # leaving the mark begins the rest anew
    played.along = -20.0
    played.round(0.9 * RESTS_S)
    played.along = 0.0
    played.round(0.9 * RESTS_S)
    played.along = -20.0
    played.round(0.9 * RESTS_S)
    assert played.round(0.9 * RESTS_S).what == MARK
    played.task.end()
    assert played.round() is None


def test_a_second_run_adds_to_the_log_of_a_model_and_each_trial_is_kept_at_once(tmp_path):
    path = tmp_path / "log.csv"
    write_log(
        point(np.array([[40.0, 20.0]]), "continuous", 1.0, 0.0, np.random.default_rng(0)), path
    )
    played = Played(path, [[40.0, 20.0]], times=2)
    doing = played.to_target()
    played.along = doing.aim
    played.press()
    log = read_log(path)
    assert list(log["operator"]) == ["continuous", "Ann"]
    assert list(log["task"]) == [0, 1]
    assert "1 target:" in played.task.status  # its own
    played.task.end()
    assert "1 target:" in played.task.status


@pytest.mark.parametrize(
    ("operator", "times", "words"),
    [
        ("", 1, "name"),
        (3, 1, "name"),
        ("A\nB", 1, "name"),
        ("Ann", 0, "times"),
        ("Ann", 11, "times"),
        ("Ann", "2", "times"),
        ("Ann", 1, ".*column 'task' is missing"),
    ],
)
def test_what_cannot_be_is_said_and_a_file_that_is_no_log_is_left_alone(
    tmp_path, operator, times, words
):
    path = tmp_path / "log.csv"
    path.write_text("a,b\n1,2\n")
    task = Pointing(path, Rotation.identity())
    task.begin(operator, times, 0.0)
    assert not task.on
    assert re.match(f"not begun: {words}", task.status)
    assert path.read_text() == "a,b\n1,2\n"


def test_trials_are_kept_when_there_is_room_again(tmp_path, monkeypatch):
    def full(*_):
        raise ValueError("log.csv: cannot be written (No space left on device)")

    path = tmp_path / "log.csv"
    played = Played(path, [[40.0, 10.0]], times=2)
    played.along = played.to_target().aim
    monkeypatch.setattr(pointing, "write_log", full)
    played.press()
    assert "not kept: log.csv: cannot be written (No space left" in played.task.status
    monkeypatch.undo()
    played.along = played.to_target().aim
    played.press()
    assert len(read_log(path)) == 2


def test_all_targets_of_the_study_come_and_the_order_differs():
    orders = []
    for _ in range(2):
        task = Pointing(pointing.Path("none.csv"), Rotation.identity())
        for _ in range(len(orders) + 1):
            task.begin("Ann", 2, 0.0)
        orders.append(pd.DataFrame(task.trials))
    assert (orders[0].value_counts() == 2).all()
    assert len(orders[0].value_counts()) == 9
    assert not orders[0].equals(orders[1])


@pytest.mark.heavy
def test_a_scripted_person_plays_a_few_targets_with_the_mouse_and_by_keyboard(browser, tmp_path):
    with Live(chosen(seed=1), tmp_path) as live:
        browser.open(live.address, 400, 900)
        shows(browser, "last && last.status === 'measured'")
        browser.evaluate("$('operator').value = 'Ann'")
        browser.click("#begin")
        shows(browser, "last.task && last.task.what === 'close the clutch'")
        wide = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert browser.evaluate(wide) <= 0
        shows(browser, "Math.abs(last.pose.x_mm) < 1 && Math.abs(last.pose.y_mm) < 1")
        browser.press("c")
        # the first target with the mouse, the second by the arrow keys
        for k, move in enumerate((dragged, stepped)):
            steered(live, browser, MARK, move)
            steered(live, browser, TARGET, move)
            browser.press("t")
            shows(browser, f"last.task && last.task.done === {k + 1} || !last.task")
        shows(browser, "!last.task")
        said = browser.evaluate("$('points').textContent")
        assert browser.errors == []
    log = read_log(tmp_path / "pointing.csv")
    assert list(log["operator"]) == ["Ann", "Ann"]
    assert list(log["distance_mm"]) == [40.0, 40.0]
    found = performance(log)
    assert said.startswith("2 targets: ")
    assert f"{found.throughput_bit_s:.2f} bit/s, {found.movement_s:.2f} s each" in said
    assert (log["error_mm"].abs() <= NEAR_MM + 1).all()  # the tool goes on until it is pressed
    assert (log["end_s"] > log["start_s"]).all()


def steered(live, browser, what, move):
    """Move the hand once, by as much as its place is off, and wait until the tool has followed."""
    shows(browser, f"last.task.what === {what!r}")
    aim = browser.evaluate("last.task.aim")
    move(browser, aim - live.loop.source.hand.goal.translation[0])
    near = f"Math.abs(last.task.aim - last.task.at[0]) < {NEAR_MM}"
    shows(browser, f"!last.task || last.task.what !== {what!r} || {near}")


def dragged(browser, mm):
    wide = browser.evaluate("$('front').clientWidth / frontWide(last.task)")
    browser.drag("#front", mm * wide, 0)


def stepped(browser, mm):
    browser.evaluate("$('front').focus()")
    for _ in range(round(abs(mm) / 2)):
        browser.press("ArrowRight" if mm > 0 else "ArrowLeft")
