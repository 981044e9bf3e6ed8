"""The steps of a folder: which they are, from which on they run, and a whole folder with a known truth."""

import re
import shlex

import numpy as np
import pytest
from boards import board_frames, make_rig, write_views
from healthy import run as command_line
from healthy import write_video
from scipy.spatial.transform import RigidTransform, Rotation
from setups import ROD

from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.files.poses import read_poses, truth_table, write_poses
from trinolab.files.rigs import write_handle
from workbench.cli.run import run

BOARD = """[calibrate]
images = { a = "a", b = "b" }
board = "chessboard"
columns = 7
rows = 6
square = 15
distortions = 5
"""
PROJECT = 'handle = "rod.toml"\nvideo = { a = "left.mkv", b = "right.mkv" }\n'
OUTPUTS = ("rig.toml", "preflight.csv", "poses.csv", "seen.webm")


def called(folder, codes=()):
    """The commands that a folder's run calls, which write what they are asked for and return the
    given codes, and its exit code.
    """
    lines = []

    def command(words):
        for option in ("--out", "--overlay"):
            if option in words:
                (folder / words[words.index(option) + 1]).touch()
        return dict(codes).get(words[0], 0)

    code = run(folder, command, lines.append)
    return [line.split()[1] for line in lines], lines, code


@pytest.fixture
def project(tmp_path):
    """A folder with a project file and a truth; none of its images is opened."""
    (tmp_path / "project.toml").write_text(PROJECT + BOARD)
    (tmp_path / "truth.csv").touch()
    return tmp_path


@pytest.mark.parametrize(
    ("text", "files", "expected"),
    [
        (None, ("rig.toml",), ["preflight", "track"]),
        (None, ("rig.toml", "truth.csv"), ["preflight", "track", "evaluate"]),
        ('rig = "raised_40deg"\n', ("truth.csv",), ["preflight", "track", "evaluate"]),
        (BOARD, (), ["calibrate", "preflight", "track"]),
        (BOARD, ("rig.toml",), ["preflight", "track"]),
        (PROJECT + BOARD, OUTPUTS, []),
        (PROJECT + BOARD, (*OUTPUTS, "truth.csv"), ["evaluate"]),
        (BOARD, OUTPUTS[1:], ["calibrate", "preflight", "track"]),
        (BOARD, (*OUTPUTS[:2], "seen.webm"), ["track"]),
    ],
)
def test_the_steps_are_those_from_the_first_missing_output(text, files, expected, tmp_path):
    if text is not None:
        (tmp_path / "project.toml").write_text(text)
    for name in files:
        (tmp_path / name).touch()
    assert called(tmp_path)[0] == expected


def test_a_line_has_the_options_of_the_project_file(project):
    _, lines, _ = called(project)
    footage = "--rig rig.toml --handle rod.toml --video a=left.mkv b=right.mkv"
    assert lines == [
        "trinolab calibrate --images a=a b=b --board chessboard --columns 7 --rows 6 --square 15 "
        "--distortions 5 --out rig.toml",
        f"trinolab preflight {footage} --out preflight.csv",
        f"trinolab track {footage} --out poses.csv --overlay seen.webm",
        "trinolab evaluate poses.csv truth.csv --handle rod.toml",
    ]


def test_a_verdict_goes_on_and_a_mistake_does_not(project):
    assert called(project, {"calibrate": 2}.items())[::2] == (["calibrate"], 2)
    (project / "rig.toml").unlink()
    names, _, code = called(project, {"preflight": 1}.items())
    assert (len(names), code) == (4, 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "expected rig.toml in the folder, or a project.toml with a rig"),
        ('handle = "coded"\n', "expected rig.toml in the folder, or a project.toml with a rig"),
        (f'rig = "paper_pair"\n{BOARD}', "expected a rig or a table calibrate, got both"),
        ('handel = "coded"\n', "expected rig, handle, video, fps, timestamps, bits and"),
        ("calibrate = 3\n", "project.toml: calibrate: expected a table, got 3"),
        ("rig = \n", "project.toml: no valid TOML"),
        (BOARD.replace("columns", "colums"), "--colums, did you mean --columns?"),
        (f'fps = "fast"\n{BOARD}', "argument --fps: invalid float value: 'fast'"),
    ],
)
def test_a_project_that_cannot_run_is_refused_before_anything_runs(
    text, said, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    if text is not None:
        (tmp_path / "project.toml").write_text(text)
    assert command_line("run .") == 2
    out, err = capfd.readouterr()
    (refusal,) = err.splitlines()
    assert said in refusal
    assert not out


@pytest.mark.slow
def test_a_board_and_videos_of_a_known_rig(tmp_path, monkeypatch, capfd):
    """The rig that made the images is known, and so is each pose; without the film the track is
    made again, and nothing before it.
    """
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "filmed"
    folder.mkdir()
    (folder / "project.toml").write_text(PROJECT + BOARD)
    write_views(folder, board_frames(10))
    write_handle(ROD, folder / "rod.toml")
    turn = Rotation.from_euler("ZYX", [170.0, 15.0, 40.0], degrees=True)
    poses = RigidTransform.from_components([[40.0 + 2 * k, 3.0, 470.0 + k] for k in range(8)], turn)
    rng = np.random.default_rng(0)
    shown = [render_rig(make_rig(), ROD, T, Bench(), rng) for T in poses]
    for name, frames in zip(("left", "right"), zip(*shown, strict=True), strict=True):
        write_video(folder / f"{name}.mkv", frames)
    write_poses(truth_table(poses), folder / "truth.csv")
    assert command_line("run filmed") in (0, 1)  # the set-up's verdict is not asked
    out = capfd.readouterr().out
    (mean,) = re.findall(r"E_t +([\d.]+) ", out)
    assert float(mean) < 1.0  # mm, by a calibration from ten views
    assert set(read_poses(folder / "poses.csv")["status"]) == {"measured"}
    kept = (folder / "rig.toml").stat().st_mtime_ns
    (folder / "seen.webm").unlink()
    assert command_line("run filmed") == 0
    lines = re.findall(r"^filmed\$ (.*)$", capfd.readouterr().out, re.MULTILINE)
    assert [shlex.split(line)[1] for line in lines] == ["track", "evaluate"]
    assert (folder / "rig.toml").stat().st_mtime_ns == kept
