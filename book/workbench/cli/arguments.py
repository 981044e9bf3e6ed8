"""The arguments of the command ``trinolab``: a table of the commands, each with an example and its options.

One grammar holds for all: what a command reads first, most often a recording, stands without an
option's name, everything else has one. Forms that older versions took still work, and are not shown.
A test runs each command's example.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple, NoReturn

from trinolab import __version__
from trinolab.methods import DEFAULT, METHODS

# what the name of a value says of its type; others are text
TYPES = {"N": int, "WIDTH": int, "F": float, "MM": float, "RATIO": float, "S": float}
Option = tuple[list[str], dict[str, Any]]  # what `argparse` takes: names, settings


class Command(NamedTuple):
    """A command of the table.

    Parameters
    ----------
    name, about, example
        Its name, what it does, and a call of it.
    options
        In the order in which help shows them; of those in a list of their own one is given at most.
    required
        The names of options that have to be given; of a list its first.
    note
        What help says at its end.
    """

    name: str
    about: str
    example: str
    options: Sequence[Option | list[Option]]
    required: str = ""
    note: str = ""


def option(usage: str, about: str, **settings: Any) -> Option:
    """Return an option or a place with its values, as in ``--size WIDTH HEIGHT``."""
    words = usage.split()
    names = [word for word in words if word.startswith("-")] or words[:1]
    values = words[len(names) :]
    if values:
        settings = {"metavar": values[0], "type": TYPES.get(values[0]), **settings}
    if len(values) > 1:
        settings |= {"metavar": tuple(values), "nargs": len(values)}
    return names, {"help": about, **settings}


def several(usage: str, about: str) -> Option:
    """Return an option that takes one value or more, also when it is given again."""
    return option(usage, about, nargs="+", action="extend")


def flag(name: str, about: str) -> Option:
    """Return an option without a value."""
    return [name], {"help": about, "action": "store_true"}


# options of several commands
CHECK = flag(
    "--check",
    "check the paper's poses against the pixels (--method paper); a handle that is followed is "
    "always checked",
)
BITS = option(
    "--bits N",
    "bits per pixel of cameras whose files have 16 (default: the fewest that hold their first images)",
)
DEVICE_FPS = option("--fps F", "frames per second to ask of cameras, or to play videos with")
REPLACED = "a recording folder; --rig and --handle replace its own files"
FPS = option("--fps F", "frames per second (default: what the videos state, or else 30)")
HANDLE = option(
    "--handle HANDLE.toml",
    "the handle and its markers: a file, or a shipped one by its name, such as coded",
)
METHOD = option(
    "--method METHOD",
    f"the estimator: {', '.join(METHODS)} (default: %(default)s). paper is the paper's own, "
    "best the same as patches",
    default=DEFAULT,
)
OLDER = option("--recording", argparse.SUPPRESS, dest="older")
RIG = option(
    "--rig RIG.toml", "the cameras: a file, or a shipped rig by its name, such as raised_40deg"
)
ROBOT = option("--robot ARM.xml", "a shipped arm, or a file (default: %(default)s)", default="ur5")
SEED = option("--seed N", "of the random draws (default: %(default)s)", default=0)
TIMESTAMPS = option("--timestamps CSV", "the times of the frames: columns 'frame' and 't_s' (s)")
VIDEO = several(
    "--video NAME=PATH",
    "for each camera a video, or a folder of images (in the order of their names)",
)

# in the order in which they are used
COMMANDS = (
    Command(
        "render",
        "render a recording with its truth from the simulated bench",
        "trinolab render --rig raised_40deg --handle coded --motion calm --seconds 2 \\\n"
        "      --out recording",
        [
            RIG,
            HANDLE,
            option(
                "--motion calm|hard|slow|POSES.csv",
                "a script (slow is for refine), or poses along which a hand holds the handle",
            ),
            option(
                "--out DIR",
                "the recording to write; until it is whole it is DIR.partial, and goes on where it "
                "stopped",
            ),
            SEED,
            option("--seconds S", "length (default: 10, or all of POSES.csv)"),
            option(
                "--fps F",
                "frames per second; the times of POSES.csv go before it (default: %(default)g)",
                default=30.0,
            ),
        ],
        required="--rig --handle --motion --out",
    ),
    Command(
        "track",
        "follow the handle through a recording",
        "trinolab track recording --out poses.csv --overlay seen.webm",
        [
            option(
                "folder RECORDING",
                f"{REPLACED}; or a ROS 2 bag. Without one all of --rig, --handle and --video are needed",
                nargs="?",
            ),
            RIG,
            HANDLE,
            VIDEO,
            option(
                "--out POSES.csv",
                "the poses to write, and POSES.tum",
            ),
            option("--start POSES.csv", "poses known at some frames, for handles that look alike"),
            option("--overlay OUT.webm", "write a video of windows, markers and pose"),
            [FPS, TIMESTAMPS],
            METHOD,
            BITS,
            CHECK,
        ],
        required="--out",
    ),
    Command(
        "evaluate",
        "compare poses with their truth (Eq. 26, 27, flips, losses)",
        "trinolab evaluate poses.csv recording/truth.csv --handle coded",
        [
            option("poses POSES.csv", "the poses that track or measure has written"),
            option(
                "truth TRUTH.csv",
                "the true poses, joined on 'frame'; refused where times or places show that the frames "
                "are others",
            ),
            option(
                "--handle HANDLE.toml",
                "a file, or a shipped one by its name; errors count up to its symmetry",
            ),
        ],
        required="--handle",
    ),
    Command(
        "measure",
        "measure the handle's pose in every instant of a recording, each by itself",
        "trinolab measure recording --out instants.csv",
        [
            option(
                "folder RECORDING",
                f"{REPLACED}. Without one all of --rig, --handle and --images are needed",
                nargs="?",
            ),
            RIG,
            HANDLE,
            option(
                "--images DIR",
                "holds one folder per camera, named as in the rig, the same file names in each; a pose's "
                "frame is the number in the name, where the names differ in their numbers alone, else "
                "they count from 0",
            ),
            option("--out POSES.csv", "the poses to write"),
            METHOD,
            BITS,
            CHECK,
            option(
                "--prior POSES.csv",
                "expected poses, joined on 'frame': they choose among poses that look alike",
            ),
        ],
        required="--out",
    ),
    Command(
        "kit",
        "print a class kit at true scale: wraps for a rod, a ChArUco board, bars that check it",
        "trinolab kit --handle coded --diameter 20 --marker 6 --out kit.pdf",
        [
            option(
                "--handle HANDLE.toml",
                "the markers to print: a file, or a shipped handle by its name; the paper's layout, or "
                "coded beside it, is printed as well",
            ),
            option("--diameter MM", "of the rod (default: the handle's)"),
            option("--marker MM", "diameter of the markers (default: the handle's)"),
            option(
                "--thickness MM",
                "of the paper with its glue: one turn is pi (diameter + thickness) (default: %(default)s, "
                "a sheet of 80 g/m2)",
                default=0.1,
            ),
            option(
                "--paper",
                "size of the sheets (default: %(default)s)",
                choices=["a4", "letter"],
                default="a4",
            ),
            option(
                "--out KIT.pdf",
                "the pages; KIT_NAME.toml beside it is the handle file of each wrap",
            ),
        ],
        required="--handle --out",
    ),
    Command(
        "capture",
        "record a folder of images from cameras; Ctrl-C ends it",
        "trinolab capture --camera ccd1=0 ccd2=2 ccd3=4 --rig raised_40deg --out filmed",
        [
            flag(
                "--list", "show the cameras of this computer with their indices, and record nothing"
            ),
            several(
                "--camera NAME=INDEX",
                "a camera by its index at this computer; NAME=VIDEO plays a video in its place",
            ),
            option("--out DIR", "the recording to write: images, timestamps.csv"),
            [
                option(
                    "--rig RIG.toml",
                    "the cameras' names and sizes, a file or a shipped name; goes into the recording",
                ),
                option("--size WIDTH HEIGHT", "px, to ask of cameras without a rig"),
            ],
            option("--handle HANDLE.toml", "goes into the recording"),
            option("--seconds S", "to record for (default: until Ctrl-C)"),
            DEVICE_FPS,
            flag("--preview", "keep preview.png in DIR.partial up to date: what the cameras see"),
        ],
    ),
    Command(
        "calibrate",
        "calibrate two or more cameras from images of a flat target",
        "trinolab calibrate --images ccd1=photos/ccd1 ccd2=photos/ccd2 --board chessboard \\\n"
        "      --columns 9 --rows 6 --square 25 --out rig.toml",
        [
            [
                several(
                    "--images NAME=PATH",
                    "for each camera a folder of images (paired by file name), a pattern like "
                    "'photos/left*.png' (paired by what * stands for) or a video (paired by frame); the first "
                    "camera is the world frame",
                ),
                option(
                    "--corners TABLE",
                    "instead of images the points that another program has found of the target: caliscope's "
                    "xy.csv, or Anipose's detections.pickle",
                ),
            ],
            option(
                "--size WIDTH HEIGHT",
                "of the images of a table of points, px (default: what camera_array.toml or "
                "calibration.toml beside it says)",
            ),
            option(
                "--board",
                "the target, dark on light or light on dark; circles are a symmetric grid, acircles an "
                "asymmetric one",
                choices=["chessboard", "circles", "acircles", "charuco"],
            ),
            option(
                "--columns N",
                "points in a row: inner corners of a chessboard, circles, but squares of a charuco board",
            ),
            option("--rows N", "rows, counted in the same way"),
            option(
                "--square MM",
                "side of a square, or distance of neighbouring circles, mm; of acircles the distance of two "
                "rows",
            ),
            option(
                "--marker MM", "side of a charuco board's markers, mm (default: 0.75 of a square)"
            ),
            option("--dictionary NAME", "of a charuco board's markers (default: 4X4_50)"),
            option(
                "--first-marker N",
                "number of a charuco board's first marker (default: %(default)s)",
                default=0,
            ),
            option(
                "--out RIG.toml",
                "the rig to write; RIG.covariance.toml (how well it is known), RIG_views.csv and "
                "RIG_residuals.png appear beside it",
            ),
            option(
                "--views N",
                "the most views to look at; of more, some are passed over evenly (default: %(default)s)",
                default=50,
            ),
            option(
                "--distortions",
                "how many of k1, k2, p1, p2, k3, k4, k5, k6 are estimated (default: as many as views that "
                "are left out speak for)",
                type=int,
                choices=[0, 1, 2, 4, 5, 8],
            ),
            option(
                "--lenses RIG.toml",
                "a rig, or caliscope's camera_array.toml, whose cameras have the lenses: these are held, "
                "and the places alone are estimated",
            ),
            BITS,
        ],
        required="--images --board --columns --rows --square --out",
    ),
    Command(
        "preflight",
        "judge a set-up by a recording: light, focus, exposure, time, baseline, calibration",
        "trinolab preflight recording",
        [
            option(
                "folder RECORDING",
                f"{REPLACED}, and may be missing. Without one --video is needed",
                nargs="?",
            ),
            RIG,
            HANDLE,
            VIDEO,
            [FPS, TIMESTAMPS],
            BITS,
            option("--out TABLE.csv", "write the table as CSV, too"),
        ],
    ),
    Command(
        "run",
        "calibrate, check, track and evaluate in a folder, from the first missing output on",
        "trinolab run recording",
        [
            option(
                "folder FOLDER",
                "a recording folder; what it lacks is in its project.toml. It gets rig.toml, preflight.csv, "
                "poses.csv, poses.tum and seen.webm",
            ),
        ],
        note="""

a project.toml: options of preflight and track, and below [calibrate] those of
calibrate; paths start in the folder; a rig may take the place of [calibrate]:
  handle = "coded"
  video = { ccd1 = "left.avi", ccd2 = "right.avi" }
  [calibrate]
  images = { ccd1 = "board/left.avi", ccd2 = "board/right.avi" }
  board = "chessboard"
  columns = 9
  rows = 6
  square = 25""",
    ),
    Command(
        "refine",
        "improve a rig and a handle file by a recording of the moving handle",
        "trinolab refine slow --out refined",
        [
            option(
                "folder RECORDING",
                f"{REPLACED}. Without one all of --rig, --handle and --video are needed",
                nargs="?",
            ),
            RIG,
            HANDLE,
            VIDEO,
            option(
                "--out DIR",
                "folder to make: rig.toml, rig.covariance.toml, handle.toml, and views.csv with what was "
                "left out; until it is whole, finished work is in DIR.partial, from where the same "
                "command goes on",
            ),
            option(
                "--start POSES.csv",
                "poses known at some frames; needed for handles that look alike",
            ),
            option(
                "--instants N",
                "the most that are adjusted; of more, those that spread most (default: %(default)s)",
                default=300,
            ),
            option(
                "--length A B MM",
                "what holds the scale: the distance of two cameras, by their names, or of two markers, by "
                "their numbers (default: the rig's covariance, else the distance of its first two "
                "cameras)",
            ),
            [FPS, TIMESTAMPS],
            BITS,
        ],
        required="--out",
    ),
    Command(
        "teleop",
        "let the simulated slave arm follow the handle",
        "trinolab teleop recording --out session",
        [
            [
                option("folder RECORDING", "a recording folder", nargs="?"),
                OLDER,
                flag(
                    "--live-simulation",
                    "images of a moving hand, taken by the simulated bench as they are asked for",
                ),
                flag(
                    "--task",
                    "a task of 15 s on the simulated bench, with its own rig, clutch and scales: a block "
                    "touched, a camera covered, a pose lost",
                ),
            ],
            RIG,
            HANDLE,
            ROBOT,
            option(
                "--start JOINT=RAD",
                "where the arm starts, by its joints' names, rad; those that are not named as at home",
                nargs="+",
                default=[],
            ),
            option(
                "--view CAMERA.toml",
                "the surveillance camera in the robot's base frame (default: a shipped one)",
            ),
            option("--out DIR", "folder to make: poses.csv, joints.csv, events.csv, monitor.webm"),
            option("--scale RATIO", "tool : handle, distances (default: 1)", default=1.0),
            option("--turn-scale RATIO", "tool : handle, angles (default: 1)", default=1.0),
            option(
                "--clutch CSV",
                "columns t_s (s) and closed (0 or 1), which holds from then on, and if wanted scale; "
                "without it the clutch is closed while the handle is measured",
            ),
            option("--seconds S", "length of the simulation (default: %(default)g)", default=10.0),
            SEED,
            flag("--no-video", "leave the monitor's video out"),
            METHOD,
            CHECK,
        ],
        required="folder --out",
    ),
    Command(
        "live",
        "follow the handle live and let the simulated arm go along, on a page in the browser",
        "trinolab live --simulation",
        [
            [
                option("folder RECORDING", "plays a recording folder", nargs="?"),
                OLDER,
                several(
                    "--camera NAME=INDEX",
                    "a camera by its index at this computer; NAME=VIDEO for all plays videos in their place",
                ),
                flag(
                    "--simulation",
                    "the simulated bench; a hand moves the rod by itself, or the mouse does",
                ),
            ],
            RIG,
            HANDLE,
            DEVICE_FPS,
            option(
                "--out DIR",
                "folder in which recordings get theirs (default: this one)",
                default=".",
            ),
            option(
                "--log FILE",
                "log of the pointing task, which grows by each trial (default: pointing.csv in that "
                "folder)",
            ),
            ROBOT,
            option(
                "--host ADDRESS",
                "where the page is; with another one than 127.0.0.1 other computers get in who know the "
                "page's whole address, over a connection that is not encrypted",
                default="127.0.0.1",
            ),
            option("--port N", "of the page (default: any that is free)", default=0),
            flag("--no-browser", "print the page's address, and open nothing"),
            METHOD,
            CHECK,
        ],
        required="folder",
    ),
    Command(
        "bag",
        "write a recording, its poses and the arm's motion as a ROS 2 bag (MCAP)",
        "trinolab bag recording --poses poses.csv --joints session/joints.csv --out bag",
        [
            option("folder RECORDING", "a recording folder with its rig and its handle"),
            option("--poses POSES.csv", "the handle's poses, as track writes them"),
            option("--joints JOINTS.csv", "the arm's motion, as teleop writes it (rad)"),
            option("--out BAG", "the folder to make: metadata.yaml and an MCAP file"),
        ],
        required="--out",
    ),
    Command(
        "sweep",
        "run a notebook with many settings of its parameters",
        "trinolab sweep notebooks/06_matching.ipynb -p ncc_threshold=0.5:0.9:5 \\\n"
        "      --workers 2 --out sweeps/ncc",
        [
            option(
                "notebook NOTEBOOK",
                "has a code cell tagged 'parameters'; what it glues is the result",
            ),
            option(
                "-p --parameter NAME=VALUES",
                "a:b:n, n values from a to b; log:a:b:n, the same in equal ratios; a list like 0,1,2 "
                "(TOML literals); @FILE.csv, one column per parameter and one row per run. Each is combined with "
                "each",
                action="append",
            ),
            option(
                "--out DIR",
                "folder for table.csv, figure.png, manifest.json and runs.jsonl, the finished runs: the "
                "same command goes on where it was stopped",
            ),
            option(
                "--sample N",
                "N runs instead of all, a Latin hypercube; then NAME=a:b and NAME=log:a:b are intervals",
            ),
            option("--sample-seed N", "of that draw (default: %(default)s)", default=0),
            [
                option("--workers N", "kernels at a time (default: one per core)"),
                option(
                    "--scheduler ADDRESS",
                    "of a Dask cluster that runs already, like tcp://host:8786: its workers run the notebooks",
                ),
            ],
            flag("--fresh-kernels", argparse.SUPPRESS),
            option(
                "--timeout S",
                "the longest time that a cell may take (default: as long as it takes; a first run may "
                "render a recording)",
            ),
            flag(
                "--whole",
                "run all cells at each setting, in a fresh kernel; otherwise a cell tagged 'once' runs "
                "once, one tagged 'figure' does not run, and two settings are compared with the whole "
                "notebook",
            ),
            flag(
                "--explain",
                "say of each cell whether it runs once, at each setting, or not, and why; run nothing",
            ),
            flag("--keep", "keep the executed notebooks, too; they are run whole"),
            flag("--yes", "more than 100,000 runs are meant"),
        ],
        required="--parameter",
        note="\n\nexit status: 0 if every run is ok, 1 if one is not, 2 if nothing was run",
    ),
    Command(
        "accept",
        "measure a rig and its handle by a series of tests, and write a data sheet",
        "trinolab accept recording --rig raised_40deg --handle coded --out sheet",
        [
            option(
                "folders RECORDING",
                "recording folders instead of rendered images; then the tests are run that need no "
                "truth: jitter if the handle rests, a pointer if it turns about one point, availability",
                nargs="*",
            ),
            option(
                "--recording",
                argparse.SUPPRESS,
                action="extend",
                nargs="+",
                default=[],
                dest="older",
            ),
            RIG,
            HANDLE,
            option(
                "--out DIR",
                "folder for index.html, numbers.csv, sheet.json and measured.jsonl, the finished parts: "
                "the same command goes on where it was stopped",
            ),
            option(
                "--poses N",
                "of the static test; the other tests grow and shrink with it (default: %(default)s)",
                default=512,
            ),
            SEED,
            option(
                "--chart CHART.csv",
                "a control chart over the commits, to which this sheet is added",
            ),
        ],
        required="--rig --handle --out",
    ),
    Command(
        "check",
        "check the answers to a chapter's exercises, or those of a whole class",
        "trinolab check 04",
        [
            option("chapter CHAPTER", "the chapter's number, as in 04", nargs="?"),
            option(
                "file FILE",
                "a notebook or a Python file with the answers (default: the one file here whose name "
                "begins with the chapter's number)",
                nargs="?",
            ),
            option(
                "--all DIR",
                "the folder of a class: in it one folder per student with one file per chapter, such as "
                "04_kalman.ipynb, or files as Canvas names them; what is checked already is not checked "
                "again. Each file runs as a program: inside bwrap where that works, else with your rights",
                dest="folder",
            ),
            option(
                "--out FILE",
                "the table to write: with --all, points and remarks, one row per student (default: "
                "points.csv in the class's folder)",
            ),
        ],
    ),
    Command(
        "scoreboard",
        "print the paper's claims beside what is computed here",
        "trinolab scoreboard --csv scoreboard.csv",
        [
            option("--csv FILE", "write the table as CSV, too"),
            flag("--essential", "print the fifteen lines of essential claims alone"),
        ],
    ),
    Command(
        "eq",
        "say where an equation of the paper is: function, file and line, test, chapter",
        "trinolab eq 18",
        [
            option("number NUMBER", "1 to 27; without one, all of them", type=int, nargs="?"),
        ],
    ),
    Command(
        "clear",
        "remove the standard recordings that chapters keep in the user's cache",
        "trinolab clear",
        [
            flag("--yes", "remove them without showing them and asking first"),
        ],
    ),
)


class _Parser(argparse.ArgumentParser):
    """Answers a wrong argument with one line, and leaves the lines of an example as they are."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **settings)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refuse an unknown option first, and in the name of the command that was given it."""
        known = self._option_string_actions
        for word in [] if self._subparsers else args:
            if word == "--":
                break  # what follows are no options
            name = word.partition("=")[0]
            if name.startswith("--") and not any(option.startswith(name) for option in known):
                self.error(f"unrecognized arguments: {name}{_nearest(name, known)}")
        namespace, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return namespace, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse what is none of the choices, which are named if none of them is near."""
        choices = [] if action.choices is None else list(map(str, action.choices))
        if choices and str(value) not in choices:
            meant = _nearest(str(value), choices) or f" (choose from {', '.join(choices)})"
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{meant}")

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _nearest(word: str, words: Iterable[str]) -> str:
    """The word that was likely meant, as the end of a refusal; nothing if none is near."""
    near = get_close_matches(word, words, 1)
    return f", did you mean {near[0]}?" if near else ""


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands; `command` names the one that was given."""
    top = _Parser(
        prog="trinolab",
        description="The three-camera master handle: measure, evaluate, compare with the paper.",
        epilog="trinolab COMMAND --help says more and has an example.",
    )
    top.add_argument("--version", action="version", version=f"trinolab {__version__}")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS:
        p = commands.add_parser(
            command.name,
            help=command.about,
            description=f"{command.about[0].upper()}{command.about[1:]}.",
            epilog=f"example:\n  {command.example}{command.note}",
        )
        required = command.required.split()
        for one in command.options:
            if isinstance(one, list):
                first = one[0][0][-1]
                group = p.add_mutually_exclusive_group(required=first in required)
                for names, settings in one:
                    group.add_argument(*names, **settings)
                continue
            names, settings = one
            if names[-1] in required:
                settings = {**settings, "required": True}
            p.add_argument(*names, **settings)
    return top
