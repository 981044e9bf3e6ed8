"""The command line: what a person reads, the exit codes, and that an interruption costs one line
and no file.
"""

import json
import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import cv2
import numpy as np
import pandas as pd
import pytest
from healthy import contents, run
from processes import CLI
from scipy.spatial.transform import RigidTransform

from trinolab import __version__
from trinolab import evaluation as evaluate
from trinolab.datasets import load_handle, load_rig, load_table1
from trinolab.files.poses import read_poses, truth_table, write_poses
from trinolab.files.rigs import write_handle, write_rig
from workbench import cli
from workbench.cli import measure as measure_command
from workbench.cli import refine
from workbench.studies import scoreboard

# what a refusal need not wait for: of files, and of plain arguments
SLOW = ("matplotlib", "scipy.stats", "rosbags", "trinolab.following.posetracker")
WORK = ("mujoco", "scipy.optimize", "satellites.accept.setup", "trinolab.following.track")
SIZE = (32, 24)
MEASURE = "measure --rig rig.toml --handle handle.toml --images images --out poses.csv"
EVALUATE = "evaluate found.csv truth.csv --handle handle.toml"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder: a recording of two dark instants in tiny images, and two pose files."""
    rig = replace(
        load_rig("paper_pair"),
        cameras=tuple(replace(camera, size=SIZE) for camera in load_rig("paper_pair").cameras),
    )
    write_rig(rig, tmp_path / "rig.toml")
    write_handle(load_handle("paper"), tmp_path / "handle.toml")
    for camera in rig.names:
        (tmp_path / "images" / camera).mkdir(parents=True)
        for name in ("0.png", "1.png"):
            cv2.imwrite(str(tmp_path / "images" / camera / name), np.zeros(SIZE[::-1], np.uint8))
    truth = load_table1().set_poses[:3]
    write_poses(truth_table(truth), tmp_path / "truth.csv")
    moved = RigidTransform.from_translation([[0, 0, 1.0], [0, 0, 0], [0, 0, -2.0]]) * truth
    write_poses(truth_table(moved), tmp_path / "found.csv")
    monkeypatch.chdir(tmp_path)
    return tmp_path


# --- what is right


def test_measure_says_what_it_assumes_and_finds(folder, capfd, caplog):
    """Frames keep the numbers of their images."""
    for path in Path("images").glob("*/?.png"):
        path.rename(path.with_name(f"{int(path.stem) + 20:06d}.png"))
    for name, silent in (
        ("rig", "[metadata]\nexact = true"),
        ("handle", "placement_sigma_mm = 0.0"),
    ):
        stated = Path(f"{name}.toml").read_text(encoding="utf-8")
        Path(f"{name}.toml").write_text(stated.replace(silent, ""), encoding="utf-8")
    with caplog.at_level("INFO", logger="trinolab"):
        assert run(MEASURE) == 0
    assert capfd.readouterr().out == (
        "2 instants: 2 lost; frames 20 to 21, as the images are called; written to poses.csv\n"
    )
    assert read_poses("poses.csv")["frame"].tolist() == [20, 21]
    said = (
        "rig.toml: does not say how well the cameras are known",
        "handle.toml: does not say how well the markers are placed",
        "2 of 2 instants have no measured pose; the images are dark",
    )
    assert len(caplog.messages) == len(said)
    assert all(any(line.startswith(words) for line in caplog.messages) for words in said)
    assert run(MEASURE + " --prior truth.csv") == 2
    assert "no frame in common with the images, which are frames 20 to 21" in capfd.readouterr().err


def test_evaluate_prints_a_table(folder, capfd, caplog):
    assert run(EVALUATE) == 0
    out = capfd.readouterr().out
    for line in (
        "E_t          1.000    1.000    2.000 mm    (Eq. 26)",
        "E_alpha      0.000    0.000          deg   (Eq. 27)",
        "far off           0   by more than 2 mm or 5 deg",
    ):
        assert f"{line}\n" in out
    assert run("evaluate truth.csv truth.csv --handle paper") == 0
    assert "truth.csv: is given as the poses and as their truth" in caplog.messages


def test_evaluate_tells_how_a_track_was_lost(folder, capfd):
    truth = truth_table(load_table1().set_poses[:12]).assign(markers=[5] * 10 + [3] * 2)
    write_poses(truth, folder / "truth.csv")
    lost = [1, 2, 3, 6, 11]
    write_poses(
        truth.assign(status=truth["status"].mask(truth.index.isin(lost), "predicted")), "found.csv"
    )
    assert run(EVALUATE) == 0
    out = capfd.readouterr().out
    assert "visible          10    60.0 % measured\n" in out
    assert out.endswith(
        "losses            3   back after 3, 1 instants, not back in the last 0 instants\n"
    )
    write_poses(truth.assign(status="lost"), "found.csv")
    assert run(EVALUATE) == 0
    assert capfd.readouterr().out.endswith("no pose to compare\n")


@pytest.mark.parametrize(("value", "code"), [(0.312, 0), (0.5, 1)])
def test_scoreboard_fails_where_a_verdict_is_not_the_declared_one(monkeypatch, capfd, value, code):
    first = scoreboard.load_claims()[0]
    monkeypatch.setattr(scoreboard, "load_claims", lambda: (first,))
    monkeypatch.setitem(scoreboard.CHECKS, "table1_position", lambda: value)
    assert run("scoreboard") == code
    out, err = capfd.readouterr()
    assert err == ("not as declared in the ledger: claim 1\n" if code else "")
    assert len(out.splitlines()) == 2


@pytest.mark.usefixtures("folder")
def test_shipped_files_have_names_and_files_of_these_names_go_before_them(capfd):
    line = "measure --rig paper_pair --handle coded --images images --out poses.csv"
    assert run(line) == 2
    assert "32 x 24 pixels, the rig says 1280 x 1024" in capfd.readouterr().err
    Path("coded").write_text("name = 1\n")
    assert run(line) == 2
    assert "coded: 'radius_mm' is missing" in capfd.readouterr().err


@pytest.mark.usefixtures("folder")
def test_times_that_are_likely_in_ms_are_asked_about(caplog):
    footage = "ccd1=images/ccd1 ccd2=images/ccd2"
    line = f"track --rig rig.toml --handle handle.toml --video {footage} --out poses.csv"
    caplog.set_level("INFO", logger="trinolab")
    for step, asked in ((33.3, 1), (0.0333, 0)):
        caplog.clear()
        Path("times.csv").write_text(f"frame,t_s\n0,0\n1,{step}\n")
        assert run(f"{line} --timestamps times.csv") in (0, 2)
        said = "times.csv: 33.3 s from frame to frame: are its times in ms?"
        assert caplog.messages.count(said) == asked


def test_a_refinement_names_ten_of_the_views_that_were_left_out():
    for count, named, last in ((0, 0, "none"), (10, 10, "9"), (13, 10, "3 more")):
        status = ["left out"] * count + ["used"]
        columns = {"frame": range(count + 1), "camera": "ccd1", "reason": "too far off"}
        views = pd.DataFrame({**columns, "status": status})
        lines = refine.view_lines(SimpleNamespace(views=views))
        assert sum(line.endswith(": too far off") for line in lines) == named
        assert last in lines[-1]


# --- standard output


@pytest.fixture
def stdout(monkeypatch):
    """Put a stream in its place."""
    opened = []

    def of(stream):
        opened.append(stream)
        monkeypatch.setattr(sys, "stdout", stream)
        return stream

    yield of
    for stream in opened:
        # what Python writes at its end goes nowhere
        assert os.path.samestat(os.fstat(stream.fileno()), os.stat(os.devnull))
        stream.close()


def test_an_answer_that_cannot_be_written_is_a_refusal(stdout):
    stdout(open("/dev/full", "w"))  # noqa: SIM115
    with pytest.raises(ValueError, match="standard output: cannot be written"):
        cli.say("42")


def test_who_has_seen_enough_of_an_answer_is_not_told_so(stdout):
    reader, writer = os.pipe()
    os.close(reader)
    stdout(os.fdopen(writer, "w"))
    cli.say("42")


@pytest.mark.slow
@pytest.mark.skipif(
    not sys.prefix.isascii(), reason="Python itself cannot start from such a folder in ASCII"
)
@pytest.mark.usefixtures("folder")
def test_names_that_a_locale_cannot_show_do_not_end_a_command():
    """In ASCII a name's bytes stay undecoded; they are printed as what Python calls them."""
    ascii_only = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    line = MEASURE.replace("poses.csv", "p\u00e4.csv")
    command = [sys.executable, "-m", "trinolab", *map(os.fsencode, shlex.split(line))]
    done = subprocess.run(command, env=ascii_only, capture_output=True)
    assert done.returncode == 0
    assert rb"written to p\udcc3\udca4.csv" in done.stdout
    assert Path("p\u00e4.csv").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("closed", ["<&- >&-", "<&- >&- 2>&-"])
def test_closed_streams_change_nothing(closed):
    shell = f"{shlex.quote(sys.executable)} -m trinolab {MEASURE} {closed}"
    done = subprocess.run(shell, shell=True, capture_output=True, text=True)
    assert "Traceback" not in done.stderr
    assert done.returncode == 0


def test_a_control_character_in_a_name_does_not_steer_the_terminal(capfd):
    assert run("track 'a\x1b[31mb\x07' --out p.csv") == 2
    assert capfd.readouterr().err == "trinolab track: a\\x1b[31mb\\x07: no such folder\n"
    cli.say("one\ttwo\n\x9bthree")
    assert capfd.readouterr().out == "one\ttwo\n\\x9bthree\n"


# --- what is wrong: see also test_faults


def in_one_process(lines):
    """The exit codes of commands, the modules that are loaded after them, and their lines on errors."""
    code = (
        "import sys, json, shlex, workbench.cli\n"
        "def run(line):\n"
        "    try:\n"
        "        return workbench.cli.main(shlex.split(line))\n"
        "    except SystemExit as left:\n"
        "        return left.code\n"
        f"print(json.dumps([[run(line) for line in {lines}], sorted(sys.modules)]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    codes, loaded = json.loads(done.stdout.splitlines()[-1])
    return codes, set(loaded), done.stderr.splitlines()


SHIPPED = "--rig raised_40deg --handle coded"
ACCEPT = f"accept {SHIPPED} --out sheet"
SIMULATION = f"teleop --live-simulation {SHIPPED} --out session"
PLAIN = {
    # words that are mistyped, with their neighbours
    "trak rec": "argument COMMAND: invalid choice: 'trak', did you mean track?",
    "track rec --out p --overly x": "--overly, did you mean --overlay?; see trinolab track --help",
    "eq 18 19": "unrecognized arguments: 19; see trinolab eq --help",
    "kit --handle coded --out k --paper a5": "invalid choice: 'a5' (choose from a4, letter); see",
    # a source is named once
    "measure rec --images i --out p": "--images: not beside a recording folder (rec)",
    "teleop --out o": "RECORDING --live-simulation --task is required",
    "live rec --simulation": "not allowed with argument RECORDING",
    f"{ACCEPT} none --chart c.csv": "chart: expected no recordings beside it",
    # methods
    "measure rec --out p --method outline": "--method: 'outline' is gone, take patches",
    "teleop --out o --task --check": "--check: only the estimator paper has it, got 'patches'",
    # numbers
    f"{ACCEPT} --poses 8193": "poses: expected a number in [8, 8192], got 8193",
    "refine none --length 0 1 x --out new": "--length: expected a number of mm, got 'x'",
    f"{SIMULATION} --scale 0": "scale: expected a number above 0, got 0.0",
    # what belongs together
    f"{SIMULATION} --start elbow": "--start: expected JOINT=RAD, got 'elbow'",
    "teleop --task --start elbow=1 --out session": "--task: brings its own start",
    f"teleop --live-simulation {SHIPPED} --out none/session": "no such folder to write into",
    "capture --camera a=0": "the following arguments are required: --out",
    "check 04 --out points.csv": "--out: is of use with --all alone",
}
FILES = {
    "refine none --out refined": "none: no such folder",
    "preflight none": "none: no such folder",
    "bag none --out bag": "none: no such folder",
    # forms that older versions took
    "teleop --recording none --out session": "none: no such folder",
    "live --recording none": "none: no such folder",
    f"{ACCEPT} --recording none": "none: no such folder",
    "kit --handle coded --diameter -3 --out kit.pdf": "diameter",
    "check 4": "expected one file 04*.ipynb or 04*.py, found none",
}


@pytest.mark.parametrize(("lines", "unloaded"), [(PLAIN, SLOW + WORK), (FILES, SLOW)])
def test_what_is_wrong_is_said_in_a_line_before_the_work_is_loaded(
    lines, unloaded, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    codes, loaded, errors = in_one_process(list(lines))
    assert codes == [2] * len(lines)
    assert len(errors) == len(lines)
    for (line, said), error in zip(lines.items(), errors, strict=True):
        assert error.startswith(("trinolab: ", f"trinolab {line.split()[0]}: ")), line
        assert said in error, line
    assert not loaded & set(unloaded)


def test_help_and_places_of_equations_do_not_wait_for_heavy_imports():
    codes, loaded, _ = in_one_process(["--help", "eq 18"])
    assert codes == [0, 0]
    assert not loaded & {"numpy", "scipy", "pandas", "cv2"}


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("a\nb\r\nc"), "a b c"),
        (OSError(5, "broken", "x.csv"), "x.csv: broken"),
        (MemoryError("8 TiB"), "not enough memory (8 TiB)"),
    ],
)
def test_every_refusal_is_one_line(error, said, capfd, monkeypatch):
    monkeypatch.setattr(evaluate, "read_poses", Mock(side_effect=error))
    assert run(EVALUATE) == 2
    assert capfd.readouterr() == ("", f"trinolab evaluate: {said}\n")


@pytest.mark.parametrize("line", [MEASURE, EVALUATE, "scoreboard --csv board.csv"])
def test_an_interruption_costs_one_line_and_no_file(folder, line, capfd, monkeypatch):
    interrupted = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr(measure_command, "measure", interrupted)
    monkeypatch.setattr(evaluate, "read_poses", interrupted)
    monkeypatch.setattr(scoreboard, "CHECKS", dict.fromkeys(scoreboard.CHECKS, interrupted))
    before = contents(folder)
    assert run(line) == 130
    out, err = capfd.readouterr()
    assert (out, err) == ("", f"trinolab {line.split()[0]}: interrupted, nothing was written\n")
    assert contents(folder) == before


# --- as installed


def test_the_script_is_installed(folder):
    script = shutil.which("trinolab", path=str(Path(sys.executable).parent))
    assert script is not None, (
        "run the tests with the environment's python, where the package is installed"
    )
    for command in ([script], [sys.executable, "-m", "trinolab"]):
        done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
        assert done.stdout == f"trinolab {__version__}\n"
    (folder / "handle.toml").write_text("name = 1\n")
    failed = subprocess.run([script, *shlex.split(MEASURE)], capture_output=True, text=True)
    assert (failed.returncode, failed.stdout) == (2, "")
    assert failed.stderr == "trinolab measure: handle.toml: 'radius_mm' is missing\n"


@pytest.mark.parametrize(
    ("package", "line"),
    [
        ("matplotlib", "kit --handle coded --diameter 20 --marker 6 --out kit.pdf"),
        ("grimp", "sweep notebook.ipynb -p a=1 --out o"),
    ],
)
def test_a_missing_extra_is_named_in_one_line(package, line):
    """In a process in which the package cannot be imported."""
    code = f"import sys; sys.modules[{package!r}] = None\n{CLI}"
    done = subprocess.run(
        [sys.executable, "-c", code, *line.split()], capture_output=True, text=True
    )
    needed = f"needs {package}: pip install 'trinolab[workbench]'\n"
    said = f"trinolab {line.split()[0]}: {needed}"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", said)
