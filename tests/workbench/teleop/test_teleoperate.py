"""The whole loop, from images to the arm: its files, what stops it, and what it refuses."""

from contextlib import nullcontext
from itertools import chain, islice
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from healthy import run

pytest.importorskip("mink", reason="the extra 'slave' is missing")

from trinolab.bench.rendering import standard_recording
from trinolab.datasets import data_path
from trinolab.files.poses import read_poses
from trinolab.slave.arm import load_robot
from trinolab.slave.control import TICK_S
from workbench.teleop.teleoperate import recorded, teleoperate

ROBOT = load_robot()


@pytest.fixture(scope="module")
def recording():
    return standard_recording("calm", seconds=2.0, progress=False)


def part(recording, first, last):
    source = recorded(recording)
    return source._replace(length=last - first, frames=islice(source.frames, first, last))


def check_limits(joints):
    limits, names = ROBOT.limits, ROBOT.joints
    q, speed = (joints[[f"{name}{end}" for name in names]].to_numpy() for end in ("_rad", "_rad_s"))
    assert (q >= limits.low - 1e-6).all()
    assert (q <= limits.high + 1e-6).all()
    assert (np.abs(speed) <= limits.speed + 1e-6).all()
    assert (np.abs(np.diff(speed, axis=0)) <= limits.acceleration * TICK_S + 1e-6).all()


def test_a_recording_moves_the_arm_as_the_hand_moved(recording, tmp_path):
    done = teleoperate(
        part(recording, 28, 48), tmp_path / "out", scale=0.5, video=False, progress=False
    )
    joints, events, poses = (
        pd.read_csv(tmp_path / "out" / f"{name}.csv") for name in ("joints", "events", "poses")
    )
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["events.csv", "joints.csv", "poses.csv"]
    np.testing.assert_allclose(joints, done.joints, rtol=1e-6, atol=1e-9)
    check_limits(joints)
    assert events["event"].tolist() == ["clutch closed"]
    assert (poses["status"] == "measured").sum() >= 17
    # how far the hand went since the clutch was closed, and the tool, half as far; the filters are
    # a little behind
    known = poses[poses["status"] == "measured"][["x_mm", "y_mm", "z_mm"]].to_numpy()
    tool = joints[["tool_x_mm", "tool_y_mm", "tool_z_mm"]].to_numpy()
    hand_way, tool_way = (
        np.linalg.norm(np.diff(way, axis=0), axis=1).sum() for way in (known, tool[::17])
    )
    assert 0.6 * hand_way / 2 < tool_way < 1.1 * hand_way / 2


def shortened(recording, first, last, folder):
    """A recording folder with the frames `first` to `last` of another, at times from 0."""
    for name in ("rig.toml", "handle.toml"):
        (folder / name).write_bytes((recording / name).read_bytes())
    for camera in (recording / "images").iterdir():
        (folder / "images" / camera.name).mkdir(parents=True)
        for path in sorted(camera.iterdir())[first:last]:
            (folder / "images" / camera.name / path.name).symlink_to(path)
    rows = [f"{k},{k / 30:.9f}" for k in range(last - first)]
    (folder / "timestamps.csv").write_text("\n".join(["frame,t_s", *rows, ""]))


def test_the_command_with_its_video_and_a_clutch(recording, tmp_path, monkeypatch, capsys):
    (tmp_path / "short").mkdir()
    # the hand comes with the seventh frame
    shortened(recording, 24, 42, tmp_path / "short")
    (tmp_path / "clutch.csv").write_text("t_s,closed,scale\n0.3,1,1\n0.4,0,2\n0.5,1,2\n")
    monkeypatch.chdir(tmp_path)
    assert run("teleop short --clutch clutch.csv --out new") == 0
    out = capsys.readouterr().out
    assert out.startswith("18 instants: 12 measured, 6 before the first pose; ")
    assert out.endswith("0 holds; written to new\n")
    events = pd.read_csv(tmp_path / "new" / "events.csv")
    # another scale holds from the next closing on
    wanted = ["clutch closed", "clutch open", "scale", "clutch closed"]
    assert events["event"].tolist() == wanted
    # these are the times of the frames 9, 12 and 15
    np.testing.assert_allclose(events["t_s"], [0.3, 0.4, 0.5, 0.5], atol=TICK_S)
    film = cv2.VideoCapture(str(tmp_path / "new" / "monitor.webm"))
    frames = []
    while (read := film.read())[0]:
        frames.append(read[1])
    assert len(frames) == 18
    assert frames[0].shape == (720, 1280, 3)
    assert len(read_poses(tmp_path / "new" / "poses.csv")) == 18
    joints = pd.read_csv(tmp_path / "new" / "joints.csv")
    still = joints[(joints["t_s"] > 0.1) & (joints["t_s"] < 0.3)]
    # hold: no drift
    assert np.ptp(still[["tool_x_mm", "tool_y_mm", "tool_z_mm"]], axis=0).max() < 0.01


def failing(recording, error):
    """Six instants, then something stops it."""

    def stopped():
        raise error
        yield

    source = part(recording, 30, 36)
    return source._replace(frames=chain(source.frames, stopped()))


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("x.png: cannot be read")])
def test_a_session_that_is_stopped_is_written(recording, tmp_path, caplog, error):
    is_damaged = isinstance(error, ValueError)
    with pytest.raises(ValueError, match="cannot be read") if is_damaged else nullcontext():
        teleoperate(failing(recording, error), tmp_path / "out", video=False, progress=False)
    said = "stopped at 6 of 6 instants; what is done is written" in caplog.text
    assert said != is_damaged
    assert len(pd.read_csv(tmp_path / "out" / "poses.csv")) == 6
    assert len(pd.read_csv(tmp_path / "out" / "joints.csv")) > 50


SIMULATION = "teleop --live-simulation --rig raised_40deg --handle coded --out new --no-video"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--robot ur6", "ur6: no such file, and no shipped arm (ur5)"),
        ("--turn-scale nan", "turn_scale: expected"),
        ("--clutch words.csv", "words.csv: no column 't_s'"),
        ("--clutch back.csv", "back.csv: expected times that increase, each with closed 0 or 1"),
        ("--clutch half.csv", "half.csv: expected times that increase, each with closed 0 or 1"),
        ("--clutch zero.csv", "zero.csv: column 'scale' expects numbers above 0"),
        ("--view none.toml", "none.toml: "),
        ("--out full", "full: exists already; name another folder, or remove it"),
        ("--start knee=1", "start: unknown joint 'knee'; there are shoulder_pan"),
        ("--start elbow=4", "start: elbow: expected"),
        ("--start elbow=nan", "start: elbow: expected"),
        ("--start shoulder_lift=-1.1", "q: at the start the tool"),
        ("--seed -1", "seed: expected a number in"),
    ],
)
def test_what_is_refused_in_a_line(tmp_path, monkeypatch, capsys, options, said):
    monkeypatch.chdir(tmp_path)
    Path("full").mkdir()
    for name, text in {
        "full/x": "",
        "words.csv": "a,b\n1,2\n",
        "back.csv": "t_s,closed\n1,1\n0.5,0\n",
        "half.csv": "t_s,closed\n1,0.5\n",
        "zero.csv": "t_s,closed,scale\n1,1,0\n",
    }.items():
        Path(name).write_text(text)
    before = sorted(Path().rglob("*"))
    assert run(f"{SIMULATION} {options}") == 2
    (refusal,) = capsys.readouterr().err.splitlines()
    assert said in refusal
    assert sorted(Path().rglob("*")) == before


def test_the_simulation_is_filmed_as_it_goes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(f"{SIMULATION} --seconds 0.2") == 0
    # the hand comes later
    assert pd.read_csv("new/poses.csv")["status"].tolist() == ["lost"] * 6
    assert len(pd.read_csv("new/joints.csv")) == pytest.approx(5 / 30 / TICK_S, abs=4)


def test_the_shipped_view_sees_where_the_tool_works():
    from trinolab.files.rigs import read_camera
    from trinolab.slave.arm import forward

    camera = read_camera(data_path("robots", "ur5_view.toml"))
    home = forward(ROBOT, ROBOT.home).translation
    corners = home + np.array(
        [[x, y, z] for x in (-150, 150) for y in (-150, 150) for z in (-100, 200)]
    )
    assert camera.sees(corners, 5.0).all()
