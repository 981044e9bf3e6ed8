"""The command line: what a person reads, the exit codes, and that an interruption costs one line
and no file.
"""

import io
import json
import logging
import os
import shlex
import shutil
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pandas as pd
import pytest
from healthy import contents, run
from processes import CLI, ended, started
from scipy.spatial.transform import RigidTransform

from trinolab import __version__
from trinolab import evaluation as evaluate
from trinolab.datasets import data_path, load_handle, load_rig, load_table1
from trinolab.evaluation import TrackQuality, how_long
from trinolab.files.poses import read_poses, truth_table, write_poses
from trinolab.files.rigs import write_handle, write_rig
from workbench import cli
from workbench.cli import measure as measure_command
from workbench.cli import refine
from workbench.studies import scoreboard

COMMANDS = (
    "calibrate",
    "measure",
    "track",
    "refine",
    "evaluate",
    "kit",
    "capture",
    "preflight",
    "run",
    "render",
    "teleop",
    "accept",
    "sweep",
    "clear",
    "scoreboard",
)
HEAVY = {"numpy", "scipy", "pandas", "cv2"}
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


def test_measure_says_what_it_found_and_where_it_is(folder, capfd):
    assert run(MEASURE) == 0
    out, err = capfd.readouterr()
    assert out == "2 instants: 2 lost; written to poses.csv\n"
    assert err == ""  # no progress bar where standard error is no terminal
    assert len((folder / "poses.csv").read_text().splitlines()) == 3


def test_measure_keeps_the_numbers_of_the_images(folder, capfd):
    for camera in ("ccd1", "ccd2"):
        for k in (0, 1):
            Path(f"images/{camera}/{k}.png").rename(f"images/{camera}/{k + 20:06d}.png")
    assert run(MEASURE) == 0
    assert capfd.readouterr().out == (
        "2 instants: 2 lost; frames 20 to 21, as the images are called; written to poses.csv\n"
    )
    assert read_poses("poses.csv")["frame"].tolist() == [20, 21]
    assert run(MEASURE + " --prior truth.csv") == 2
    assert "no frame in common with the images, which are frames 20 to 21" in capfd.readouterr().err


def test_measure_says_what_it_converts(folder, capfd, caplog):
    colour, deep = np.zeros((*SIZE[::-1], 3), np.uint8), np.zeros(SIZE[::-1], np.uint16)
    cv2.imwrite("images/ccd1/0.png", colour)
    cv2.imwrite("images/ccd1/1.png", colour)
    cv2.imwrite("images/ccd2/1.png", deep)
    with caplog.at_level("INFO", logger="trinolab"):
        assert run(MEASURE) == 0
    assert capfd.readouterr().out == "2 instants: 2 lost; written to poses.csv\n"
    assert caplog.messages == [
        "images/ccd1/0.png: colour converted to grey; said once",
        "images/ccd2/1.png: 16 bit scaled to grey levels 0 to 255; said once",
        "2 of 2 instants have no measured pose; the images are dark (99.9 % of the pixels are at most 0 of "
        "255): likely too little light, or too short an exposure",
    ]


def test_evaluate_prints_a_table(folder, capfd):
    assert run(EVALUATE) == 0
    assert (
        capfd.readouterr().out
        == """\
instants          3
measured          3   100.0 %
ambiguous         0     0.0 %
predicted         0     0.0 %
lost              0     0.0 %
errors of 3 poses, up to the handle's symmetry:
              mean   median      max
E_t          1.000    1.000    2.000 mm    (Eq. 26)
E_alpha      0.000    0.000          deg   (Eq. 27)
E_beta       0.000    0.000          deg   (Eq. 27)
E_gamma      0.000    0.000          deg   (Eq. 27)
geodesic     0.000    0.000    0.000 deg
near gimbal lock: |beta| > 60 deg in 3 of 3, up to 76.8 deg; alpha and gamma err more there than the rotation (geodesic)
the measured poses as one track:
flips             0
far off           0   by more than 2 mm or 5 deg
losses            0
"""
    )


def test_evaluate_tells_how_a_track_was_lost(folder, capfd):
    truth = truth_table(load_table1().set_poses[:12]).assign(markers=[5] * 10 + [3] * 2)
    write_poses(truth, folder / "truth.csv")
    lost = [1, 2, 3, 6, 11]
    truth.loc[lost, "status"] = "predicted"
    write_poses(truth, folder / "found.csv")
    assert run(EVALUATE) == 0
    out = capfd.readouterr().out
    assert "visible          10    60.0 % measured\n" in out
    assert out.endswith(
        "losses            3   back after 3, 1 instants, not back in the last 0 instants\n"
    )


def test_many_losses_are_summed_up():
    assert (
        how_long(TrackQuality(0, 0, (1,) * 8, None))
        == "   back after 1, 1, 1, 1, 1, 1, 1, 1 instants"
    )
    assert how_long(TrackQuality(0, 0, (1,) * 9 + (7,), None)) == "   back after at most 7 instants"
    assert how_long(TrackQuality(0, 0, (), 4)) == "   not back in the last 4 instants"


def test_evaluate_without_a_pose_says_so(folder, capfd):
    assert run(MEASURE) == 0
    assert run(EVALUATE.replace("found", "poses")) == 0
    out = capfd.readouterr().out
    assert "lost              3   100.0 %" in out  # the truth has three instants, the recording two
    assert out.endswith("no pose to compare\n")


def test_scoreboard_prints_and_writes(folder, capfd, monkeypatch):
    monkeypatch.setattr(scoreboard, "CHECKS", dict.fromkeys(scoreboard.CHECKS, lambda: 0.31))
    run("scoreboard --csv board.csv")
    lines = capfd.readouterr().out.splitlines()
    assert lines[0].split() == ["no", "claim", "paper", "ours", "unit", "verdict"]
    assert lines[1].split()[0] == "1"
    assert lines[1].split()[-4:] == ["0.31", "0.31", "mm", "match"]
    written = (folder / "board.csv").read_text(encoding="utf-8").splitlines()
    assert written[0] == (
        "no,claim,paper,ours,unit,verdict,reason,low,high,n,seed,kind,criterion,can_show,sensitivity"
    )
    assert len(written) == len(lines)
    run("scoreboard --essential")
    short = capfd.readouterr().out.splitlines()
    assert short[0].split() == lines[0].split()
    assert len(short) == 16
    assert max(map(len, short)) <= 120


@pytest.mark.parametrize(("value", "code"), [(0.312, 0), (0.5, 1)])
def test_scoreboard_fails_where_a_verdict_is_not_the_declared_one(monkeypatch, capfd, value, code):
    first = scoreboard.load_claims()[0]
    monkeypatch.setattr(scoreboard, "load_claims", lambda: (first,))
    monkeypatch.setitem(scoreboard.CHECKS, "table1_position", lambda: value)
    assert run("scoreboard") == code
    out, err = capfd.readouterr()
    assert err == ("not as declared in the ledger: claim 1\n" if code else "")
    assert len(out.splitlines()) == 2


@pytest.mark.parametrize(
    ("line", "workflow"),
    [
        ("track --rig R --handle H --video a=b --out o", "trinolab.following.track.track_files"),
        ("track rec --rig R --handle H --out o", "satellites.bags.bags.track_recording"),
        ("refine --rig R --handle H --video a=b --out o", "trinolab.following.refine.refine_files"),
        ("refine rec --rig R --handle H --out o", "trinolab.following.refine.refine_folder"),
        ("render --rig R --handle H --motion calm --out o", "trinolab.bench.rendering.render"),
        ("measure rec --rig R --handle H --out o", "workbench.cli.measure.measure_recording"),
        (
            "teleop rec --rig R --handle H --out o",
            "workbench.teleop.teleoperate.recorded",
        ),
        (
            "teleop --recording rec --rig R --handle H --out o",
            "workbench.teleop.teleoperate.recorded",
        ),
        (
            "teleop --live-simulation --rig R --handle H --out o",
            "workbench.teleop.teleoperate.simulated",
        ),
        ("capture --camera a=0 --rig R --handle H --out o", "workbench.capture.capture.capture"),
        ("measure --rig R --handle H --images i --out o", "workbench.cli.measure.measure_folder"),
        ("evaluate p.csv t.csv --handle H", "trinolab.evaluation.evaluate"),
    ],
)
def test_every_command_knows_the_shipped_files_by_name(line, workflow, monkeypatch):
    if "teleop" in workflow:
        pytest.importorskip("mink", reason="the extra 'slave' is missing")
    given = []

    def stop(*arguments, **_):
        given.extend(arguments)
        raise ValueError

    monkeypatch.setattr(workflow, stop)
    monkeypatch.setattr(cli, "_open_first", lambda *_: None)  # there is no recording
    assert run(line.replace(" R ", " raised_40deg ").replace(" H", " coded")) == 2
    assert data_path("handles", "coded.toml") in given
    assert data_path("rigs", "raised_40deg.toml") in given or " R " not in line


@pytest.mark.usefixtures("folder")
def test_a_file_goes_before_the_name_of_a_shipped_one(capfd):
    Path("handle.toml").rename("coded")
    Path("coded").write_text("name = 1\n")
    assert run(EVALUATE.replace("handle.toml", "coded")) == 2
    assert "coded: 'radius_mm' is missing" in capfd.readouterr().err


@pytest.mark.usefixtures("folder")
def test_who_has_seen_enough_of_an_answer_is_not_told_so():
    reader, writer = os.pipe()
    os.close(reader)
    with started(EVALUATE, stdout=writer) as process:
        os.close(writer)
        assert ended(process) == (0, [])


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_names_that_a_locale_cannot_show_do_not_end_a_command():
    """In ASCII a name's bytes stay undecoded; they are printed as what Python calls them."""
    ascii_only = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    for line, said in (
        (MEASURE.replace("poses.csv", "p\u00e4.csv"), rb"written to p\udcc3\udca4.csv"),
        ("kit --handle handle.toml --out k\u00e4.pdf", rb"k\udcc3\udca4.pdf: print it"),
    ):
        command = [sys.executable, "-m", "trinolab", *map(os.fsencode, shlex.split(line))]
        done = subprocess.run(command, env=ascii_only, capture_output=True)
        assert done.returncode == 0
        assert b"codec" not in done.stderr
        assert said in done.stdout
    assert {"p\u00e4.csv", "k\u00e4.pdf"} <= {path.name for path in Path().iterdir()}


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("closed", ["<&- >&-", "<&- >&- 2>&-"])
def test_closed_streams_change_nothing(closed):
    for line, codes in ((MEASURE, (0,)), ("clear", (0, 2))):
        shell = f"{shlex.quote(sys.executable)} -m trinolab {line} {closed}"
        done = subprocess.run(shell, shell=True, capture_output=True, text=True)
        assert "Traceback" not in done.stderr
        assert done.returncode in codes


# --- help


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_narrow(command, capfd, monkeypatch):
    """Its example is run by test_help_examples."""
    monkeypatch.setenv("COLUMNS", "80")
    assert run(f"{command} --help") == 0
    assert max(map(len, capfd.readouterr().out.splitlines())) <= 90


def test_help_lists_the_commands(capfd):
    assert run("--help") == 0
    text = capfd.readouterr().out
    assert all(f"\n    {command}" in text for command in COMMANDS)


# --- forms that older versions took still work


@pytest.mark.parametrize(
    ("line", "workflow", "given"),
    [
        ("teleop --recording rec --out o", "workbench.teleop.teleoperate.recorded", "rec"),
        ("teleop rec --out o", "workbench.teleop.teleoperate.recorded", "rec"),
        ("live --recording rec", "satellites.live.command.chosen", "rec"),
        ("live rec", "satellites.live.command.chosen", "rec"),
        (
            "accept --recording a b --rig raised_40deg --handle coded --out o",
            "satellites.accept.command.accept",
            ["a", "b"],
        ),
        (
            "accept a b --rig raised_40deg --handle coded --out o",
            "satellites.accept.command.accept",
            ["a", "b"],
        ),
        (
            "accept a --recording b --rig raised_40deg --handle coded --out o",
            "satellites.accept.command.accept",
            ["a", "b"],
        ),
    ],
)
def test_a_recording_is_positional_and_its_older_option_means_the_same(
    line, workflow, given, monkeypatch
):
    if "teleop" in workflow or "live" in workflow:
        pytest.importorskip("mink", reason="the extra 'slave' is missing")
    seen = []

    def stop(*arguments, **_):
        seen.extend(arguments)
        raise ValueError

    monkeypatch.setattr(workflow, stop)
    monkeypatch.setattr(cli, "_open_first", lambda *_: None)  # there is no recording
    assert run(line) == 2
    assert given in seen


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "measure rec --images images --out p.csv",
            "--images: not beside a recording folder (rec)",
        ),
        (
            "measure --images images --out p.csv",
            "expected a recording folder, or else all of --rig",
        ),
        ("measure nowhere --out p.csv", "nowhere: no such folder"),
        ("teleop --out o", "one of the arguments RECORDING --live-simulation --task is required"),
        ("live rec --simulation", "not allowed with argument RECORDING"),
    ],
)
def test_a_source_is_named_once(line, said, capfd):
    assert run(line) == 2
    (refusal,) = capfd.readouterr().err.splitlines()
    assert said in refusal


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("trak rec", "trinolab: argument COMMAND: invalid choice: 'trak', did you mean track?"),
        ("clibrate", "trinolab: argument COMMAND: invalid choice: 'clibrate', did you mean calib"),
        ("xyzzy", "trinolab: argument COMMAND: invalid choice: 'xyzzy' (choose from render, tr"),
        (
            "track rec --out p --overly x",
            "trinolab track: unrecognized arguments: --overly, did you mean --overlay?; see "
            "trinolab track --help",
        ),
        ("eq 18 19", "trinolab eq: unrecognized arguments: 19; see trinolab eq --help"),
        (
            "preflight rec --methd=paper",
            "trinolab preflight: unrecognized arguments: --methd; see",
        ),
        (
            "kit --handle coded --out k --paper a5",
            "trinolab kit: argument --paper: invalid choice: 'a5' (choose from a4, letter); see",
        ),
        ("evaluate p t --handel coded", "trinolab evaluate: unrecognized arguments: --handel, did"),
    ],
)
def test_a_mistyped_word_is_named_with_its_command_and_its_neighbour(line, said, capfd):
    assert run(line) == 2
    (refusal,) = capfd.readouterr().err.splitlines()
    assert refusal.startswith(said)


@pytest.mark.parametrize(
    ("statuses", "said"),
    [
        ("llmm", "4 instants: 2 measured, 2 before the first pose"),
        ("mmlm", "4 instants: 3 measured, 1 lost"),
        ("lamll", "5 instants: 2 lost, 1 ambiguous, 1 measured, 1 before the first pose"),
        ("ll", "2 instants: 2 lost"),
        ("mm", "2 instants: 2 measured"),
    ],
)
def test_instants_before_the_first_pose_count_apart(statuses, said):
    names = {"l": "lost", "m": "measured", "a": "ambiguous"}
    table = pd.DataFrame({"status": [names[letter] for letter in statuses]})
    assert cli._counted(table) == said


@pytest.mark.parametrize(
    "line", ["measure rec --out p", "track rec --out p", "live rec", "teleop --out o --task"]
)
@pytest.mark.parametrize(
    ("method", "said"),
    [
        ("--method outline", "--method: 'outline' is gone, take patches"),
        (
            "--method paper_checked",
            "--method: 'paper_checked' is gone, take paper with check=True (--check)",
        ),
        (
            "--method magic",
            "--method: expected one of paper, reprojection, patches, best, got 'magic'",
        ),
        ("--check", "--check: only the estimator paper has it, got 'patches'"),
    ],
)
def test_a_method_that_is_not_there_is_refused(line, method, said, capfd):
    assert run(f"{line} {method}") == 2
    assert capfd.readouterr() == ("", f"trinolab {line.split()[0]}: {said}\n")


# --- what is wrong: test_faults


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
    monkeypatch.setattr(evaluate, "read_poses", lambda _: (_ for _ in ()).throw(error))
    assert run(EVALUATE) == 2
    assert capfd.readouterr() == ("", f"trinolab evaluate: {said}\n")


# --- interrupted


def interrupted(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize("line", [MEASURE, EVALUATE, "scoreboard --csv board.csv"])
def test_an_interruption_costs_one_line_and_no_file(folder, line, capfd, monkeypatch):
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
    done = subprocess.run([script, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"trinolab {__version__}\n"
    module = [sys.executable, "-m", "trinolab", "--version"]
    assert subprocess.run(module, capture_output=True, text=True, check=True).stdout == done.stdout
    (folder / "handle.toml").write_text("name = 1\n")
    failed = subprocess.run(
        [script, *shlex.split(MEASURE)], capture_output=True, text=True, check=False
    )
    assert (failed.returncode, failed.stdout) == (2, "")
    assert failed.stderr == "trinolab measure: handle.toml: 'radius_mm' is missing\n"


def test_help_and_interruption_do_not_wait_for_heavy_imports():
    code = "import sys, json, workbench.cli; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(json.loads(done.stdout))


def test_the_place_of_an_equation_is_said_without_heavy_imports():
    code = (
        "import sys, workbench.cli as c; c.main(['eq', '18']); print(*sys.modules, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(done.stderr.split())


@pytest.mark.parametrize(("call", "frozen"), [("", False), ("workbench.cli.main(['eq'])", True)])
def test_only_the_command_itself_leaves_all_that_is_loaded_to_the_end_of_the_process(call, frozen):
    # what is registered first is called last
    code = f"""
import atexit, gc, sys
atexit.register(lambda: print(gc.get_freeze_count(), file=sys.stderr))
import workbench.cli
{call}
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (int(done.stderr) > 0) == frozen


@pytest.mark.usefixtures("folder")
def test_times_that_are_likely_in_ms_are_asked_about(caplog):
    (Path("images") / "timestamps.csv").write_text("frame,t_s\n0,0\n1,33.3\n")
    footage = "ccd1=images/ccd1 ccd2=images/ccd2"
    line = f"track --rig rig.toml --handle handle.toml --video {footage} --out poses.csv"
    caplog.set_level("INFO", logger="trinolab")
    assert run(f"{line} --timestamps images/timestamps.csv") in (0, 2)
    said = "images/timestamps.csv: 33.3 s from frame to frame: are its times in ms?"
    assert caplog.messages.count(said) == 1
    caplog.clear()
    (Path("images") / "timestamps.csv").write_text("frame,t_s\n0,0\n1,0.0333\n")
    assert run(f"{line} --timestamps images/timestamps.csv") in (0, 2)
    assert "are its times in ms" not in caplog.text


def test_where_matplotlib_keeps_its_fonts_is_not_said(caplog):
    run("eq 99")
    logging.getLogger("matplotlib.font_manager").warning("generated new fontManager")
    assert not caplog.messages


def in_one_process(lines):
    """The exit codes of commands, the modules that are loaded after them, and their lines on errors."""
    code = (
        "import sys, json, shlex, workbench.cli\n"
        f"codes = [workbench.cli.main(shlex.split(line)) for line in {lines}]\n"
        "print(json.dumps([codes, sorted(sys.modules)]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    codes, loaded = json.loads(done.stdout)
    return codes, set(loaded), done.stderr.splitlines()


def test_a_refusal_loads_neither_the_tracker_nor_figures():
    refused = [
        "track none --out poses.csv",
        "refine none --out refined",
        "preflight none",
        "teleop none --out session",
        "live none",
        "bag none --out bag",
        "kit --handle coded --diameter -3 --out kit.pdf",
        "accept none --rig raised_40deg --handle coded --out sheet",
        "scoreboard --csv none/board.csv",
    ]
    codes, loaded, _ = in_one_process(refused)
    assert codes == [2] * len(refused)
    heavy = {"matplotlib", "scipy.stats", "rosbags", "trinolab.following.posetracker"}
    assert not heavy & loaded


def test_a_plain_argument_is_refused_before_the_work_is_loaded():
    shipped = "--rig raised_40deg --handle coded"
    accept = f"accept {shipped} --out sheet"
    simulation = f"teleop --live-simulation {shipped} --out session"
    target = "calibrate --images a=b c=d --board chessboard --rows 6 --square 25 --out rig.toml"
    words = {
        f"{accept} --poses 0": "accept: poses: expected a number in [8, 8192], got 0",
        f"{accept} --poses 8193": "accept: poses: expected a number in [8, 8192], got 8193",
        f"{accept} --seed -1": "accept: seed: expected a number in [0, 2.14748e+09], got -1",
        f"{accept} none --chart c.csv": "accept: chart: expected no recordings beside it, it holds "
        "what is rendered",
        f"{target} --columns 0": "calibrate: columns: expected a number in [3, 200], got 0",
        "measure --out poses.csv": "measure: expected a recording folder, or else all of --rig, "
        "--handle and --images",
        "track --out poses.csv": "track: expected a recording folder, or else all of --rig, --handle "
        "and --video",
        "refine none --video a=b --out new": "refine: --video: not beside a recording folder (none), "
        "which has its own",
        "refine none --length 0 1 x --out new": "refine: --length: expected a number of mm, got 'x'",
        f"{simulation} --scale 0": "teleop: scale: expected a number above 0, got 0.0",
        f"{simulation} --turn-scale -1": "teleop: turn_scale: expected a number above 0, got -1.0",
        f"{simulation} --start elbow": "teleop: --start: expected JOINT=RAD, got 'elbow'",
        "teleop --live-simulation --out session": "teleop: --live-simulation: needs --rig and --handle",
        "teleop --task --start elbow=1 --out session": "teleop: --task: brings its own start",
        f"teleop --live-simulation {shipped} --out none/session": "teleop: none/session: no such folder "
        "to write into",
    }
    codes, loaded, errors = in_one_process(list(words))
    assert codes == [2] * len(words)
    assert errors == [f"trinolab {said}" for said in words.values()]
    heavy = {"matplotlib", "mujoco", "scipy.stats", "scipy.optimize", "rosbags"}
    work = {"satellites.accept.setup", "trinolab.following.track", "trinolab.slave.arm"}
    assert not (heavy | work) & loaded


@pytest.mark.parametrize(
    "files",
    [
        (data_path("rigs", "paper_pair.toml"), data_path("handles", "coded.toml")),
        ("paper_pair", "coded"),
    ],
    ids=["paths", "names"],
)
def test_shipped_files_are_fit_for_the_command(folder, capfd, files):
    line = f"measure --rig {files[0]} --handle {files[1]} --images images --out poses.csv"
    assert run(line) == 2
    assert "32 x 24 pixels, the rig says 1280 x 1024" in capfd.readouterr().err
    assert not (folder / "poses.csv").exists()


# --- what a command asks for, and what it prints of what it gets


class Full(io.StringIO):
    """A standard output, with a descriptor of its own, that takes nothing."""

    def __init__(self, path, error):
        super().__init__()
        self.file = path.open("w")
        self.error = error

    def write(self, text):
        raise self.error

    def fileno(self):
        return self.file.fileno()


@pytest.fixture
def full(tmp_path, monkeypatch):
    opened = []

    def of(error):
        stdout = Full(tmp_path / "stdout", error)
        opened.append(stdout)
        monkeypatch.setattr(sys, "stdout", stdout)
        return stdout

    yield of
    for one in opened:
        one.file.close()


def goes_nowhere(stdout):
    return os.path.samestat(os.fstat(stdout.fileno()), os.stat(os.devnull))


def test_an_answer_that_cannot_be_written_is_a_refusal(full):
    stdout = full(OSError(28, "No space left on device"))
    with pytest.raises(
        ValueError, match=r"standard output: cannot be written \(No space left on device\)"
    ):
        cli.say("42")
    assert goes_nowhere(stdout)  # what Python writes at its end


def test_an_answer_that_nobody_reads_any_more_is_none(full):
    stdout = full(BrokenPipeError(32, "Broken pipe"))
    cli.say("42")
    assert goes_nowhere(stdout)


@pytest.mark.parametrize(("option", "shown"), [("", True), (" --no-browser", False)])
@pytest.mark.parametrize(
    ("said", "last"), [("recorded to x", "recorded to x"), ("", "ended; nothing was recorded")]
)
def test_live_says_where_its_page_is_before_it_begins(
    monkeypatch, capfd, option, shown, said, last
):
    from satellites.live import command

    pages = []

    @contextmanager
    def show(address):
        pages.append(address)
        yield
        pages.append("closed")

    def live(source, out, *_, on_open, **__):
        on_open("http://localhost:1")
        assert "closed" not in pages
        return said

    monkeypatch.setattr(command, "chosen", lambda cameras, *_: cameras)
    monkeypatch.setattr(command, "live", live)
    monkeypatch.setattr(command, "show", show)
    assert run(f"live --simulation{option}") == 0
    lines = capfd.readouterr().out.splitlines()
    assert lines == ["http://localhost:1", "is the page; Ctrl-C ends it", last]
    assert pages == (["http://localhost:1", "closed"] if shown else [])


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("check 04 --out points.csv", "--out: is of use with --all alone"),
        ("check", "expected a chapter, as in 04, or --all with the folder of a class"),
        ("check 04 --all answers", "expected a chapter"),
        ("check 4", ".: expected one file 04*.ipynb or 04*.py, found none"),
    ],
)
def test_a_check_is_of_a_chapter_or_of_a_class(folder, capfd, line, said):
    assert run(line) == 2
    (refusal,) = capfd.readouterr().err.splitlines()
    assert refusal.startswith(f"trinolab check: {said}")


@pytest.mark.parametrize(("uncertain", "logged"), [(False, 1), (True, 0)])
def test_poses_that_contradict_the_rig_are_said_unless_the_rig_is_known_as_uncertain(
    folder, monkeypatch, caplog, uncertain, logged
):
    monkeypatch.setattr(measure_command, "is_uncertain", lambda *_: uncertain)
    monkeypatch.setattr(
        measure_command, "contradictions", lambda table, rig: [f"{len(table)} poses, {rig}"]
    )
    with caplog.at_level("INFO", "trinolab"):
        table = measure_command.measure_folder(
            "rig.toml", "handle.toml", "images", "poses.csv", progress=False
        )
    assert len(table) == 2
    assert [text for text in caplog.messages if "poses, " in text] == ["2 poses, rig.toml"] * logged


def test_what_was_assumed_of_files_that_state_nothing_is_said(folder, caplog):
    for name in ("rig.toml", "handle.toml"):
        stated = Path(name).read_text(encoding="utf-8")
        silent = stated.replace("[metadata]\nexact = true", "").replace(
            "placement_sigma_mm = 0.0", ""
        )
        Path(name).write_text(silent, encoding="utf-8")
    with caplog.at_level("INFO", "trinolab"):
        measure_command.measure_folder(
            "rig.toml", "handle.toml", "images", "poses.csv", progress=False
        )
    of_rig, of_handle, *_ = caplog.messages
    assert of_rig.startswith("rig.toml: does not say how well the cameras are known")
    assert of_handle.startswith("handle.toml: does not say how well the markers are placed")


def test_the_scale_is_held_by_a_length_or_by_what_is_known():
    rig = load_rig("paper_pair")

    def scale(length):
        return refine.scale(SimpleNamespace(prior=SimpleNamespace(length=length), start_rig=rig))

    assert scale(None) == "by the covariances of rig and markers; no length was given"
    of_cameras = SimpleNamespace(of="cameras", first=0, second=1, mm=99.19)
    of_markers = SimpleNamespace(of="markers", first=0, second=7, mm=20.5)
    assert scale(of_cameras) == "cameras ccd1 and ccd2 are 99.1900 mm apart"
    assert scale(of_markers) == "markers 0 and 7 are 20.5000 mm apart"


@pytest.mark.parametrize(
    ("count", "named", "last"), [(0, 0, "none"), (10, 10, "9"), (13, 10, "3 more")]
)
def test_ten_of_the_views_that_were_left_out_are_named(count, named, last):
    views = pd.DataFrame(
        {
            "frame": range(count + 1),
            "camera": "ccd1",
            "status": [*["left out"] * count, "used"],
            "reason": "too far off",
        }
    )
    first, *others = refine.view_lines(SimpleNamespace(views=views))
    assert first == f"views left out: {count or 'none'}"
    assert sum("ccd1, frame" in line and line.endswith(": too far off") for line in others) == named
    assert last in [first, *others][-1]


@pytest.mark.parametrize(
    ("package", "line", "extra"),
    [
        (
            "matplotlib",
            "kit --handle coded --diameter 20 --marker 6 --out kit.pdf",
            "workbench",
        ),
        ("grimp", "sweep notebook.ipynb -p a=1 --out o", "workbench"),
    ],
)
def test_a_missing_extra_is_named_in_one_line(package, line, extra):
    """In a process in which the package cannot be imported."""
    code = f"import sys; sys.modules[{package!r}] = None\n{CLI}"
    done = subprocess.run(
        [sys.executable, "-c", code, *line.split()], capture_output=True, text=True
    )
    command = line.split()[0]
    needed = f"trinolab {command}: needs {package}: pip install 'trinolab[{extra}]'\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", needed)


def test_a_control_character_in_a_name_does_not_steer_the_terminal(tmp_path, capfd):
    assert run(f"track '{tmp_path}/a\x1b[31mb\x07' --out p.csv") == 2
    assert (
        capfd.readouterr().err == f"trinolab track: {tmp_path}/a\\x1b[31mb\\x07: no such folder\n"
    )
    cli.say("one\ttwo\n\x9bthree")
    assert capfd.readouterr().out == "one\ttwo\n\\x9bthree\n"


def test_what_the_system_refuses_is_said_with_the_file_first(tmp_path, capfd):
    name = tmp_path / ("a" * 300)
    assert run(f"track {name} --out p.csv") == 2
    err = capfd.readouterr().err
    assert err.startswith(f"trinolab track: {name}")
    assert err.endswith(": File name too long\n")


def test_a_file_that_is_its_own_truth_is_said(folder, capfd, caplog):
    assert run("evaluate truth.csv truth.csv --handle paper") == 0
    assert "truth.csv: is given as the poses and as their truth" in caplog.messages
