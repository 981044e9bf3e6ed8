"""Each command's ``--help`` has one example, and each example runs: on the recording that the page of
the commands makes, in one folder, in the order of the page.

What needs cameras, a board or a class gets a stand-in, and the commands that take minutes get little
to do; the lines are those of the help.
"""

import re
import shlex
import signal

import cv2
import numpy as np
import pytest
from firsthour import EMPTY, INSTANTS, ROOT, write_recording
from healthy import run, write_video
from makenotebook import glued, make_notebook
from processes import started, wait_until

from satellites.accept import arm
from trinolab.bench import rendering
from trinolab.bench.board import board_positions, render_board
from trinolab.bench.optics import Bench
from trinolab.calibration.target import Board
from trinolab.camera import Camera, Rig
from trinolab.files.poses import read_poses
from trinolab.files.recording import open_folder
from workbench.cli import arguments
from workbench.pages import commandhelp
from workbench.studies import scoreboard

PAGE = (ROOT / "book" / "commands.md").read_text(encoding="utf-8")
# what another command of the page has to make first
AFTER = {"evaluate": ("track",), "bag": ("track", "teleop")}
# what the examples say, and what they make, that need nothing in particular
EXAMPLES = {
    "track": (f": {INSTANTS - EMPTY} measured, {EMPTY} before the first pose; ", "seen.webm"),
    "kit": ("kit.pdf: print it at 100 %", "kit.pdf"),
    "preflight": ("ccd1", "recording"),
    "run": ("recording$ trinolab evaluate", "recording/seen.webm"),
    "teleop": (f"{INSTANTS} instants: ", "session/joints.csv"),
    "bag": (f"{INSTANTS}  /ccd1/image", "bag/metadata.yaml"),
    "sweep": ("5 runs: 5 ok; written to sweeps/ncc", "sweeps/ncc/table.csv"),
    "accept": ("written to sheet", "sheet/index.html"),
    "check": ("0 of", "04_kalman.py"),
    "scoreboard": ("match", "scoreboard.csv"),
    "eq": ("trinolab/matching.py", "."),
    "clear": ("no standard recording is kept", "."),
}
NEEDS = {"teleop": ("mink",), "bag": ("mink", "rosbags")}


def example(command):
    """The example of a command's help, on one line."""
    text = commandhelp.help_text(command)
    (lines,) = re.findall(r"^examples?:\n((?:  .*\n)+)", text, flags=re.MULTILINE)
    assert lines.count("trinolab ") == 1, "one example"
    return " ".join(lines.replace("\\\n", " ").split()).removeprefix("trinolab ")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A folder with the page's recording, a small notebook in a chapter's place, a file without answers
    in a student's, and the commands that have run in it.
    """
    folder = tmp_path_factory.mktemp("page")
    write_recording(folder / "recording")
    (folder / "notebooks").mkdir()
    make_notebook(
        folder / "notebooks" / "06_matching.ipynb",
        glued(found="2 * ncc_threshold"),
        parameters="ncc_threshold = 0.7",
    )
    (folder / "04_kalman.py").write_text("pass\n")
    return folder, set()


@pytest.fixture
def ran(page, monkeypatch, capfd):
    """Runs the example of a command, and before it those that it needs; gives what it printed."""
    folder, done = page
    monkeypatch.chdir(folder)

    def of(command, line=None, codes=(0,)):
        for before in AFTER.get(command, ()):
            if before not in done:
                of(before)
        capfd.readouterr()
        assert run(line or example(command)) in codes, capfd.readouterr().err
        done.add(command)
        return capfd.readouterr().out

    return of


# --- what the help says


@pytest.mark.parametrize("command", commandhelp.commands())
def test_the_one_example_of_a_help_parses_and_is_tested_here(command):
    assert arguments.parser().parse_args(shlex.split(example(command))).command == command
    assert command in EXAMPLES or f"test_{command}" in globals()


# --- the page's commands, one after the other


@pytest.mark.slow
@pytest.mark.parametrize("command", EXAMPLES)
def test_an_example_says_what_it_has_made(command, ran, page, monkeypatch, tmp_path):
    """Without the arm's test, which takes minutes, with one claim, and nothing in the cache to clear."""
    for package in NEEDS.get(command, ()):
        pytest.importorskip(package, reason=f"{package} is not installed")
    monkeypatch.setattr(arm, "why_not", lambda: "it takes minutes")
    first = scoreboard.load_claims()[0]
    monkeypatch.setattr(scoreboard, "load_claims", lambda: (first,))
    monkeypatch.setitem(scoreboard.CHECKS, "table1_position", lambda: 0.312)
    if command == "clear":
        monkeypatch.setattr(rendering, "cache_folder", lambda: tmp_path)
    said, made = EXAMPLES[command]
    is_verdict = command in ("preflight", "run", "check")
    assert said in ran(command, codes=(0, 1) if is_verdict else (0,))
    assert (page[0] / made).stat().st_size > 0


def test_render(page, ran):
    """Its first instants are those of the recording that the other examples get."""
    line = example("render").replace("--seconds 2", "--seconds 0.1")
    assert line != example("render")
    out = ran("render", line.replace("--out recording", "--out short"))
    assert out == "3 instants, the handle is there in 0; written to short\n"
    folder = page[0]
    for name in ("ccd1", "ccd2", "ccd3"):
        images = [folder / root / "images" / name / "000001.png" for root in ("short", "recording")]
        assert images[0].read_bytes() == images[1].read_bytes()


@pytest.mark.slow
def test_evaluate(ran):
    out = ran("evaluate")
    (mean,) = re.findall(r"E_t +([\d.]+) ", out)
    assert float(mean) < 0.01  # mm


@pytest.mark.slow
def test_measure(ran, page):
    """Each instant by itself, with its time, by the same estimator as `track`."""
    assert ran("measure").startswith(f"{INSTANTS} instants: ")
    table = read_poses(page[0] / "instants.csv")
    truth = read_poses(page[0] / "recording" / "truth.csv")
    assert table["t_s"].tolist() == pytest.approx(truth["t_s"].tolist(), abs=1e-6)
    both = table[table["status"] == "measured"]
    assert len(both) == INSTANTS - EMPTY
    there = truth.set_index("frame").loc[both["frame"]]
    away = both[["x_mm", "y_mm", "z_mm"]].to_numpy() - there[["x_mm", "y_mm", "z_mm"]].to_numpy()
    assert np.linalg.norm(away, axis=1).max() < 0.02  # mm


def test_capture(ran, page):
    """Videos of the recording stand in for the cameras."""
    line = example("capture")
    for name in ("ccd1", "ccd2", "ccd3"):
        files = sorted((page[0] / "recording" / "images" / name).iterdir())[:4]
        frames = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files]
        write_video(page[0] / f"{name}.mkv", frames)
        line, count = re.subn(rf"\b{name}=\d", f"{name}={name}.mkv", line)
        assert count == 1
    assert ran("capture", line).startswith("4 instants")
    filmed, _ = open_folder(page[0] / "filmed", handle=page[0] / "recording" / "handle.toml")
    assert filmed.length == 4


@pytest.mark.slow
def test_calibrate(ran, page):
    """Six views of the board stand in for photographs."""
    asked = arguments.parser().parse_args(shlex.split(example("calibrate")))
    board = Board(asked.columns, asked.rows, asked.square)
    cameras = [
        Camera.look_at(name, (640, 480), 900.0, [x, 0, 0], [0, 0, 700])
        for name, x in (("ccd1", 0.0), ("ccd2", 150.0))
    ]
    rng = np.random.default_rng(0)
    places = board_positions(Rig(cameras), board, 6, rng, 700.0)
    for camera in cameras:
        (page[0] / "photos" / camera.name).mkdir(parents=True)
        for k, T in enumerate(places):
            image = render_board(camera, board, T, Bench(supersampling=4), rng)
            cv2.imwrite(str(page[0] / "photos" / camera.name / f"{k}.png"), image)
    assert "written: rig.toml" in ran("calibrate")


@pytest.mark.heavy
def test_refine(ran):
    """The page renders a slow recording for it; here a shorter one."""
    (line,) = re.findall(r"^trinolab (render .*--motion slow .*)$", PAGE, re.MULTILINE)
    short, count = re.subn(r"--seconds \d+", "--seconds 4", line)
    assert count == 1
    ran("render slow", short)
    out = ran("refine")
    assert "12 show the handle still enough" in " ".join(out.split())
    before, after = map(float, re.findall(r"([\d.]+) (?:before|after)", out))
    assert after <= before


@pytest.mark.slow
def test_live(page):
    pytest.importorskip("mink", reason="the extra 'slave' is missing")
    process = started(f"{example('live')} --no-browser", cwd=page[0])
    try:
        address = wait_until(process.stdout.readline, process)
        assert address.startswith("http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        assert process.communicate()[0].endswith("ended; nothing was recorded\n")
        assert process.returncode == 0
    finally:
        process.kill()
