"""The arguments of the command ``trinolab``: what each command takes, with an example.

One grammar holds for all: what a command reads first, most often a recording, stands without an
option's name, everything else has one. Forms that older versions took still work, and are not shown.
Each command has one example, which a test runs.
"""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from trinolab import __version__
from trinolab.methods import DEFAULT, METHODS


class _Parser(argparse.ArgumentParser):
    """Answers a wrong argument with one line, and leaves the lines of an example as they are."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **settings)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def parser() -> argparse.ArgumentParser:
    """The parser of all commands; `command` names the one that was given."""
    top = _Parser(
        prog="trinolab",
        description="The three-camera master handle: measure, evaluate, compare with the paper.",
        epilog="trinolab COMMAND --help says more and has an example.",
    )
    top.add_argument("--version", action="version", version=f"trinolab {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    # in the order in which they are used
    _add_render(commands)
    _add_track(commands)
    _add_evaluate(commands)
    _add_measure(commands)
    _add_kit(commands)
    _add_capture(commands)
    _add_calibrate(commands)
    _add_preflight(commands)
    _add_refine(commands)
    _add_teleop(commands)
    _add_live(commands)
    _add_bag(commands)
    _add_sweep(commands)
    _add_accept(commands)
    _add_check(commands)
    board = _add(
        commands,
        "scoreboard",
        "print the paper's claims beside what is computed here",
        "trinolab scoreboard --csv scoreboard.csv",
    )
    board.add_argument("--csv", metavar="FILE", help="write the table as CSV, too")
    board.add_argument(
        "--essential", action="store_true", help="print the fifteen lines of essential claims alone"
    )
    eq = _add(
        commands,
        "eq",
        "say where an equation of the paper is: function, file and line, test, chapter",
        "trinolab eq 18",
    )
    eq.add_argument("number", nargs="?", type=int, help="1 to 27; without one, all of them")
    clear = _add(
        commands,
        "clear",
        "remove the standard recordings that chapters keep in the user's cache",
        "trinolab clear",
    )
    clear.add_argument(
        "--yes", action="store_true", help="remove them without showing them and asking first"
    )
    return top


def _add_calibrate(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "calibrate",
        "calibrate two or more cameras from images of a flat target",
        "trinolab calibrate --images ccd1=photos/ccd1 ccd2=photos/ccd2 --board chessboard \\\n"
        "      --columns 9 --rows 6 --square 25 --out rig.toml",
    )
    seen = p.add_mutually_exclusive_group(required=True)
    seen.add_argument(
        "--images",
        nargs="+",
        action="extend",
        metavar="NAME=PATH",
        help="for each camera a folder of images (paired by file name), a pattern like 'photos/left*.png' "
        "(paired by what * stands for) or a video (paired by frame); the first camera is the world frame",
    )
    seen.add_argument(
        "--corners",
        metavar="TABLE",
        help="instead of images the points that another program has found of the target: caliscope's xy.csv, "
        "or Anipose's detections.pickle",
    )
    p.add_argument(
        "--size",
        nargs=2,
        type=int,
        metavar=("WIDTH", "HEIGHT"),
        help="of the images of a table of points, px (default: what camera_array.toml or calibration.toml "
        "beside it says)",
    )
    p.add_argument(
        "--board",
        required=True,
        choices=["chessboard", "circles", "charuco"],
        help="the target, dark on light or light on dark; circles are a symmetric grid",
    )
    p.add_argument(
        "--columns",
        required=True,
        type=int,
        metavar="N",
        help="points in a row: inner corners of a chessboard, circles, but squares of a charuco board",
    )
    p.add_argument(
        "--rows", required=True, type=int, metavar="N", help="rows, counted in the same way"
    )
    p.add_argument(
        "--square",
        required=True,
        type=float,
        metavar="MM",
        help="side of a square, or distance of neighbouring circles, mm",
    )
    p.add_argument(
        "--marker",
        type=float,
        metavar="MM",
        help="side of a charuco board's markers, mm (default: 0.75 of a square)",
    )
    p.add_argument(
        "--dictionary", metavar="NAME", help="of a charuco board's markers (default: 4X4_50)"
    )
    p.add_argument(
        "--out",
        required=True,
        metavar="RIG.toml",
        help="the rig to write; RIG.covariance.toml (how well it is known), RIG_views.csv and "
        "RIG_residuals.png appear beside it",
    )
    p.add_argument(
        "--views",
        type=int,
        default=50,
        metavar="N",
        help="the most views to look at; of more, some are passed over evenly (default: %(default)s)",
    )
    p.add_argument(
        "--distortions",
        type=int,
        choices=[0, 1, 2, 4, 5],
        help="how many of k1, k2, p1, p2, k3 are estimated (default: as many as views that are left "
        "out speak for)",
    )
    p.add_argument(
        "--lenses",
        metavar="RIG.toml",
        help="a rig, or caliscope's camera_array.toml, whose cameras have the lenses: these are held, and the "
        "places alone are estimated",
    )


def _add_kit(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "kit",
        "print a class kit at true scale: wraps for a rod, a ChArUco board, bars that check it",
        "trinolab kit --handle coded --diameter 20 --marker 6 --out kit.pdf",
    )
    p.add_argument(
        "--handle",
        required=True,
        metavar="HANDLE.toml",
        help="the markers to print: a file, or a shipped handle by its name; the paper's layout, or coded "
        "beside it, is printed as well",
    )
    p.add_argument(
        "--diameter", type=float, metavar="MM", help="of the rod (default: the handle's)"
    )
    p.add_argument(
        "--marker", type=float, metavar="MM", help="diameter of the markers (default: the handle's)"
    )
    p.add_argument(
        "--thickness",
        type=float,
        default=0.1,
        metavar="MM",
        help="of the paper with its glue: one turn is pi (diameter + thickness) (default: %(default)s, "
        "a sheet of 80 g/m2)",
    )
    p.add_argument("--paper", default="a4", choices=["a4", "letter"], help="(default: %(default)s)")
    p.add_argument(
        "--out",
        required=True,
        metavar="KIT.pdf",
        help="the pages; KIT_NAME.toml beside it is the handle file of each wrap",
    )


def _add_preflight(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "preflight",
        "judge a set-up by a recording: light, focus, exposure, time, baseline, calibration",
        "trinolab preflight recording",
    )
    _add_footage(p)
    _add_times(p)
    p.add_argument("--out", metavar="TABLE.csv", help="write the table as CSV, too")


def _add_measure(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "measure",
        "measure the handle's pose in every instant of a recording, each by itself",
        "trinolab measure recording --out instants.csv",
    )
    _add_recording(p, "--images")
    _add_rig_and_handle(p, required=False)
    p.add_argument(
        "--images",
        metavar="DIR",
        help="holds a folder a camera, named as in the rig, the same file names in each; a pose's frame is "
        "the number in the name, where the names differ in their numbers alone, else they count from 0",
    )
    p.add_argument("--out", required=True, metavar="POSES.csv", help="the poses to write")
    _add_method(p)
    p.add_argument(
        "--prior",
        metavar="POSES.csv",
        help="expected poses, joined on 'frame': they choose among poses that look alike",
    )


def _add_track(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "track",
        "follow the handle through a recording",
        "trinolab track recording --out poses.csv --overlay seen.webm",
    )
    _add_footage(p)
    p.add_argument(
        "--out",
        required=True,
        metavar="POSES.csv",
        help="the poses to write, and POSES.tum",
    )
    p.add_argument(
        "--start",
        metavar="POSES.csv",
        help="poses known at some frames, for handles that look alike",
    )
    p.add_argument(
        "--overlay", metavar="OUT.webm", help="write a video of windows, markers and pose"
    )
    _add_times(p)
    _add_method(p)


def _add_refine(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "refine",
        "improve a rig and a handle file by a recording of the moving handle",
        "trinolab refine slow --out refined",
    )
    _add_footage(p)
    p.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder to make: rig.toml, rig.covariance.toml, handle.toml, and views.csv with what was left "
        "out; until it is whole, finished work is in DIR.partial, from where the same command goes on",
    )
    p.add_argument(
        "--start",
        metavar="POSES.csv",
        help="poses known at some frames; needed for handles that look alike",
    )
    p.add_argument(
        "--instants",
        type=int,
        default=300,
        metavar="N",
        help="the most that are adjusted; of more, those that spread most (default: %(default)s)",
    )
    p.add_argument(
        "--length",
        nargs=3,
        metavar=("A", "B", "MM"),
        help="what holds the scale: the distance of two cameras, by their names, or of two markers, by "
        "their numbers (default: the rig's covariance, else the distance of its first two cameras)",
    )
    _add_times(p)


def _add_footage(p: argparse.ArgumentParser) -> None:
    _add_recording(p, "--video", also="track reads a ROS 2 bag as well")
    _add_rig_and_handle(p, required=False)
    p.add_argument(
        "--video",
        nargs="+",
        action="extend",
        metavar="NAME=PATH",
        help="for each camera a video, or a folder of images (in the order of their names)",
    )


def _add_recording(p: argparse.ArgumentParser, instead: str, also: str = "") -> None:
    p.add_argument(
        "folder",
        nargs="?",
        metavar="RECORDING",
        help=f"a recording folder; --rig and --handle replace its own files. Without one all of --rig, "
        f"--handle and {instead} are needed{also and '. '}{also}",
    )


def _add_times(p: argparse.ArgumentParser) -> None:
    times = p.add_mutually_exclusive_group()
    times.add_argument(
        "--fps",
        type=float,
        default=30.0,
        metavar="F",
        help="frames a second (default: %(default)s)",
    )
    times.add_argument("--timestamps", metavar="CSV", help="columns 'frame' and 't_s' (s)")


def _add_rig_and_handle(p: argparse.ArgumentParser, required: bool) -> None:
    p.add_argument(
        "--rig",
        required=required,
        metavar="RIG.toml",
        help="the cameras: a file, or a shipped rig by its name, as raised_40deg",
    )
    p.add_argument(
        "--handle",
        required=required,
        metavar="HANDLE.toml",
        help="the handle and its markers: a file, or a shipped one by its name, as coded",
    )


def _add_method(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--method",
        default=DEFAULT,
        metavar="METHOD",
        help=f"the estimator: {', '.join(METHODS)} (default: %(default)s). paper is the paper's, "
        "best is patches",
    )
    p.add_argument(
        "--check",
        action="store_true",
        help="check the paper's poses against the pixels (--method paper); who follows the handle always "
        "does",
    )


def _add_evaluate(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "evaluate",
        "compare poses with their truth (Eq. 26, 27, flips, losses)",
        "trinolab evaluate poses.csv recording/truth.csv --handle coded",
    )
    p.add_argument("poses", metavar="POSES.csv", help="what track or measure has written")
    p.add_argument(
        "truth",
        metavar="TRUTH.csv",
        help="the true poses, joined on 'frame'; refused where times or places show that the frames are others",
    )
    p.add_argument(
        "--handle",
        required=True,
        metavar="HANDLE.toml",
        help="a file, or a shipped one by its name; errors count up to its symmetry",
    )


def _add_render(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "render",
        "render a recording with its truth from the simulated bench",
        "trinolab render --rig raised_40deg --handle coded --motion calm --seconds 2 \\\n"
        "      --out recording",
    )
    _add_rig_and_handle(p, required=True)
    p.add_argument(
        "--motion",
        required=True,
        metavar="calm|hard|slow|POSES.csv",
        help="a script (slow is for refine), or poses along which a hand holds the handle",
    )
    p.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="the recording to write; until it is whole it is DIR.partial, and goes on where it stopped",
    )
    p.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="of motion and noise (default: %(default)s)",
    )
    p.add_argument(
        "--seconds", type=float, metavar="S", help="length (default: 10, or all of POSES.csv)"
    )
    p.add_argument(
        "--fps",
        type=float,
        default=30.0,
        metavar="F",
        help="frames a second; the times of POSES.csv go before it (default: %(default)g)",
    )


def _add_teleop(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "teleop",
        "let the simulated slave arm follow the handle",
        "trinolab teleop recording --out session",
    )
    source = p.add_mutually_exclusive_group(required=True)
    source.add_argument("folder", nargs="?", metavar="RECORDING", help="a recording folder")
    source.add_argument("--recording", dest="older", help=argparse.SUPPRESS)
    source.add_argument(
        "--live-simulation",
        action="store_true",
        help="images of a moving hand, taken by the simulated bench as they are asked for",
    )
    source.add_argument(
        "--task",
        action="store_true",
        help="a task of 15 s on the simulated bench, with its own rig, clutch and scales: a block "
        "touched, a camera covered, a pose lost",
    )
    _add_rig_and_handle(p, required=False)
    _add_robot(p)
    p.add_argument(
        "--start",
        nargs="+",
        default=[],
        metavar="JOINT=RAD",
        help="where the arm starts, by its joints' names, rad; those that are not named as at home",
    )
    p.add_argument(
        "--view",
        metavar="CAMERA.toml",
        help="the surveillance camera in the robot's base frame (default: a shipped one)",
    )
    p.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder to make: poses.csv, joints.csv, events.csv, monitor.webm",
    )
    p.add_argument(
        "--scale",
        type=float,
        default=1.0,
        metavar="RATIO",
        help="tool : handle, distances (default: 1)",
    )
    p.add_argument(
        "--turn-scale",
        type=float,
        default=1.0,
        metavar="RATIO",
        help="tool : handle, angles (default: 1)",
    )
    p.add_argument(
        "--clutch",
        metavar="CSV",
        help="columns t_s (s) and closed (0 or 1), which holds from then on, and if wanted scale; "
        "without it the clutch is closed while the handle is measured",
    )
    p.add_argument(
        "--seconds",
        type=float,
        default=10.0,
        metavar="S",
        help="length of the simulation (default: %(default)g)",
    )
    p.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of the simulation (default: %(default)s)"
    )
    p.add_argument("--no-video", action="store_true", help="leave the monitor's video out")
    _add_method(p)


def _add_robot(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--robot",
        default="ur5",
        metavar="ARM.xml",
        help="a shipped arm, or a file (default: %(default)s)",
    )


def _add_device_rate(p: argparse.ArgumentParser) -> None:
    p.add_argument(
        "--fps",
        type=float,
        metavar="F",
        help="frames a second to ask of cameras, or to play videos with",
    )


def _add_live(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "live",
        "follow the handle live and let the simulated arm go along, on a page in the browser",
        "trinolab live --simulation",
    )
    source = p.add_mutually_exclusive_group(required=True)
    source.add_argument("folder", nargs="?", metavar="RECORDING", help="plays a recording folder")
    source.add_argument("--recording", dest="older", help=argparse.SUPPRESS)
    source.add_argument(
        "--camera",
        nargs="+",
        action="extend",
        metavar="NAME=INDEX",
        help="a camera by its index at this computer; NAME=VIDEO for all plays videos in their place",
    )
    source.add_argument(
        "--simulation",
        action="store_true",
        help="the simulated bench; a hand moves the rod by itself, or the mouse does",
    )
    _add_rig_and_handle(p, required=False)
    _add_device_rate(p)
    p.add_argument(
        "--out",
        default=".",
        metavar="DIR",
        help="folder in which recordings get theirs (default: this one)",
    )
    p.add_argument(
        "--log",
        metavar="FILE",
        help="log of the pointing task, which grows by each trial (default: pointing.csv in that folder)",
    )
    _add_robot(p)
    p.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="where the page is; with another one than 127.0.0.1 other computers get in who know "
        "the page's whole address, over a connection that is not encrypted",
    )
    p.add_argument(
        "--port", type=int, default=0, metavar="N", help="of the page (default: any that is free)"
    )
    p.add_argument(
        "--no-browser", action="store_true", help="print the page's address, and open nothing"
    )
    _add_method(p)


def _add_check(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "check",
        "check the answers to a chapter's exercises, or those of a whole class",
        "trinolab check 04",
    )
    p.add_argument(
        "chapter",
        nargs="?",
        metavar="CHAPTER",
        help="the chapter's number, as in 04",
    )
    p.add_argument(
        "file",
        nargs="?",
        metavar="FILE",
        help="a notebook or a Python file with the answers (default: the one file here whose name "
        "begins with the chapter's number)",
    )
    p.add_argument(
        "--all",
        metavar="DIR",
        dest="folder",
        help="the folder of a class: in it a folder a student, and in that a file a chapter, as in "
        "04_kalman.ipynb, or files as Canvas names them; what is checked already is not checked "
        "again. Each file runs as a program: on Linux kept from other files and the network, "
        "elsewhere with your rights",
    )
    p.add_argument(
        "--out",
        metavar="FILE",
        help="the table to write: with --all, points and what is said, a row a student (default: "
        "points.csv in the class's folder)",
    )


def _add_accept(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "accept",
        "measure a rig and its handle by a series of tests, and write a data sheet",
        "trinolab accept recording --rig raised_40deg --handle coded --out sheet",
    )
    p.add_argument(
        "folders",
        nargs="*",
        metavar="RECORDING",
        help="recording folders in the place of rendered images; then the tests are run that need no "
        "truth: jitter if the handle rests, a pointer if it turns about one point, availability",
    )
    p.add_argument(
        "--recording", nargs="+", action="extend", default=[], dest="older", help=argparse.SUPPRESS
    )
    _add_rig_and_handle(p, required=True)
    p.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder for index.html, numbers.csv, sheet.json and measured.jsonl, the finished parts: "
        "the same command goes on where it was stopped",
    )
    p.add_argument(
        "--poses",
        type=int,
        default=512,
        metavar="N",
        help="of the static test; the other tests grow and shrink with it (default: %(default)s)",
    )
    p.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of poses and noise (default: %(default)s)"
    )
    p.add_argument(
        "--chart",
        metavar="CHART.csv",
        help="a control chart over the commits, to which this sheet is added",
    )


def _add_sweep(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "sweep",
        "run a notebook with many settings of its parameters",
        "trinolab sweep notebooks/06_matching.ipynb -p ncc_threshold=0.5:0.9:5 \\\n"
        "      --workers 2 --out sweeps/ncc",
    )
    p.epilog = (
        f"{p.epilog}\n\nexit status: 0 if every run is ok, 1 if one is not, 2 if nothing was run"
    )
    p.add_argument(
        "notebook",
        metavar="NOTEBOOK",
        help="has a code cell tagged 'parameters'; what it glues is the result",
    )
    p.add_argument(
        "-p",
        "--parameter",
        required=True,
        action="append",
        metavar="NAME=VALUES",
        help="a:b:n, n values from a to b; log:a:b:n, the same in equal ratios; a list like 0,1,2 (TOML "
        "literals); @FILE.csv, a column a parameter and a row a run. Each is combined with each",
    )
    p.add_argument(
        "--out",
        metavar="DIR",
        help="folder for table.csv, figure.png, manifest.json and "
        "runs.jsonl, the finished runs: the same command goes on where it was stopped",
    )
    p.add_argument(
        "--sample",
        type=int,
        metavar="N",
        help="N runs instead of all, a Latin hypercube; then NAME=a:b and NAME=log:a:b are intervals",
    )
    p.add_argument(
        "--sample-seed",
        type=int,
        default=0,
        metavar="N",
        help="of that draw (default: %(default)s)",
    )
    where = p.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="kernels at a time (default: one a core)"
    )
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask cluster that runs already, like tcp://host:8786: its workers run the notebooks",
    )
    p.add_argument(
        "--fresh-kernels",
        action="store_true",
        help="the same as --whole",
    )
    p.add_argument(
        "--timeout",
        type=float,
        metavar="S",
        help="the longest time that a cell may take (default: as long as it takes; a first run may "
        "render a recording)",
    )
    p.add_argument(
        "--whole",
        action="store_true",
        help="run all cells at each setting, in a fresh kernel; otherwise a cell tagged 'once' runs "
        "once, one tagged 'figure' does not run, and two settings are compared with the whole notebook",
    )
    p.add_argument(
        "--explain",
        action="store_true",
        help="say of each cell whether it runs once, at each setting, or not, and why; run nothing",
    )
    p.add_argument(
        "--keep", action="store_true", help="keep the executed notebooks, too; they are run whole"
    )
    p.add_argument("--yes", action="store_true", help="more than 100,000 runs are meant")


def _add_bag(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "bag",
        "write a recording, its poses and the arm's motion as a ROS 2 bag (MCAP)",
        "trinolab bag recording --poses poses.csv --joints session/joints.csv --out bag",
    )
    p.add_argument(
        "folder", metavar="RECORDING", help="a recording folder with its rig and its handle"
    )
    p.add_argument("--poses", metavar="POSES.csv", help="the handle's poses, as track writes them")
    p.add_argument(
        "--joints", metavar="JOINTS.csv", help="the arm's motion, as teleop writes it (rad)"
    )
    p.add_argument(
        "--out",
        required=True,
        metavar="BAG",
        help="the folder to make: metadata.yaml and an MCAP file",
    )


def _add_capture(commands: argparse._SubParsersAction) -> None:
    p = _add(
        commands,
        "capture",
        "record a folder of images from cameras; Ctrl-C ends it",
        "trinolab capture --camera ccd1=0 ccd2=2 ccd3=4 --rig raised_40deg --out filmed",
    )
    p.add_argument(
        "--list",
        action="store_true",
        help="show the cameras of this computer with their indices, and record nothing",
    )
    p.add_argument(
        "--camera",
        nargs="+",
        action="extend",
        metavar="NAME=INDEX",
        help="a camera by its index at this computer; NAME=VIDEO plays a video in its place",
    )
    p.add_argument("--out", metavar="DIR", help="the recording to write: images, timestamps.csv")
    which = p.add_mutually_exclusive_group()
    which.add_argument(
        "--rig",
        metavar="RIG.toml",
        help="the cameras' names and sizes, a file or a shipped name; goes into the recording",
    )
    which.add_argument(
        "--size",
        nargs=2,
        type=int,
        metavar=("WIDTH", "HEIGHT"),
        help="px, to ask of cameras without a rig",
    )
    p.add_argument("--handle", metavar="HANDLE.toml", help="goes into the recording")
    p.add_argument(
        "--seconds", type=float, metavar="S", help="to record for (default: until Ctrl-C)"
    )
    _add_device_rate(p)
    p.add_argument(
        "--preview",
        action="store_true",
        help="keep preview.png in DIR.partial up to date: what the cameras see",
    )


def _add(
    commands: argparse._SubParsersAction, name: str, about: str, example: str
) -> argparse.ArgumentParser:
    return commands.add_parser(
        name,
        help=about,
        description=about[0].upper() + about[1:] + ".",
        epilog=f"example:\n  {example}",
    )
