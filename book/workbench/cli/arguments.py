"""The arguments of the command ``trinolab``: a table of the commands, each with an example and its options.

All commands have the same grammar: the main input, most often a recording, has no option name, and
everything else has one. Forms of older versions still work and are not shown. A test runs each
command's example.
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
    "check each pose of --method paper against the pixels; track, teleop and live always do so",
)
BITS = option(
    "--bits N",
    "bits per pixel that the cameras really use, for 16-bit files (default: the fewest that the first images need)",
)
DEVICE_FPS = option(
    "--fps F", "frame rate requested from the cameras, or at which videos are played"
)
REPLACED = "a recording folder, whose own rig and handle are overridden by --rig and --handle"
FPS = option("--fps F", "frames per second (default: that of the videos, or else 30)")
HANDLE = option(
    "--handle HANDLE.toml",
    "the rod and its markers: a file, or the name of an included handle, such as coded",
)
METHOD = option(
    "--method METHOD",
    f"the estimator: {', '.join(METHODS)} (default: %(default)s). paper is the paper's own; best means patches",
    default=DEFAULT,
)
OLDER = option("--recording", argparse.SUPPRESS, dest="older")
RIG = option(
    "--rig RIG.toml",
    "the cameras and their calibration: a file, or the name of an included rig, such as raised_40deg",
)
ROBOT = option(
    "--robot ARM.xml", "an included arm, or a file (default: %(default)s)", default="ur5"
)
SEED = option("--seed N", "seed of the random draws (default: %(default)s)", default=0)
TIMESTAMPS = option(
    "--timestamps CSV", "times of the frames, with the columns 'frame' and 't_s' (s)"
)
VIDEO = several(
    "--video NAME=PATH",
    "a video for each camera, or a folder of images in the order of their names",
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
                "a scripted motion (slow is for refine), or poses through which a hand moves the handle",
            ),
            option(
                "--out DIR",
                "the recording to write; until it is complete it is called DIR.partial, and a repeated command "
                "continues it",
            ),
            SEED,
            option("--seconds S", "length (default: 10, or all of POSES.csv)"),
            option(
                "--fps F",
                "frames per second; times in POSES.csv take precedence (default: %(default)g)",
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
                f"{REPLACED}; or a ROS 2 bag. Without it, --rig, --handle and --video are required",
                nargs="?",
            ),
            RIG,
            HANDLE,
            VIDEO,
            option(
                "--out POSES.csv",
                "the poses to write; POSES.tum is written as well",
            ),
            option(
                "--start POSES.csv",
                "known poses at some frames, for handles that look the same in several poses",
            ),
            option(
                "--overlay OUT.webm", "write a video that shows search windows, markers and pose"
            ),
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
            option("poses POSES.csv", "poses written by track or measure"),
            option(
                "truth TRUTH.csv",
                "the true poses, joined on 'frame'; refused if times or positions show that these are other frames",
            ),
            option(
                "--handle HANDLE.toml",
                "a file, or the name of an included handle; errors are computed up to its symmetry",
            ),
        ],
        required="--handle",
    ),
    Command(
        "measure",
        "measure the handle's pose at every instant of a recording, each by itself",
        "trinolab measure recording --out instants.csv",
        [
            option(
                "folder RECORDING",
                f"{REPLACED}. Without it, --rig, --handle and --images are required",
                nargs="?",
            ),
            RIG,
            HANDLE,
            option(
                "--images DIR",
                "contains one folder per camera, named as in the rig, with the same file names in each. If the "
                "names differ only in a number, it becomes the frame; otherwise frames count from 0",
            ),
            option("--out POSES.csv", "the poses to write"),
            METHOD,
            BITS,
            CHECK,
            option(
                "--prior POSES.csv",
                "expected poses, joined on 'frame', which decide between poses that look the same",
            ),
        ],
        required="--out",
    ),
    Command(
        "kit",
        "print a class kit at true scale: wraps for a rod, a ChArUco board, bars to check the scale",
        "trinolab kit --handle coded --diameter 20 --marker 6 --out kit.pdf",
        [
            option(
                "--handle HANDLE.toml",
                "the markers to print: a file, or the name of an included handle; a second layout, the paper's or "
                "coded, is printed as well",
            ),
            option("--diameter MM", "diameter of the rod (default: the handle's)"),
            option("--marker MM", "diameter of the markers (default: the handle's)"),
            option(
                "--thickness MM",
                "thickness of the paper with its glue; one turn is pi (diameter + thickness) long (default: "
                "%(default)s, a sheet of 80 g/m2)",
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
                "the pages to write; the handle file of each wrap is KIT_NAME.toml beside them",
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
                "a camera, by its index on this computer; NAME=VIDEO plays a video instead",
            ),
            option("--out DIR", "the recording to write: images and timestamps.csv"),
            [
                option(
                    "--rig RIG.toml",
                    "names and image sizes of the cameras: a file, or the name of an included rig; copied into the "
                    "recording",
                ),
                option(
                    "--size WIDTH HEIGHT",
                    "image size requested from the cameras, px, if there is no rig",
                ),
            ],
            option("--handle HANDLE.toml", "a handle, copied into the recording"),
            option("--seconds S", "length of the recording (default: until Ctrl-C)"),
            DEVICE_FPS,
            flag(
                "--preview",
                "show what the cameras see in DIR.partial/preview.png, which is updated",
            ),
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
                    "for each camera a folder of images (paired by file name), a pattern like 'photos/left*.png' "
                    "(paired by what * stands for) or a video (paired by frame); the frame of the first camera is "
                    "the world frame",
                ),
                option(
                    "--corners TABLE",
                    "instead of images, points of the target detected by another program: caliscope's xy.csv, or "
                    "Anipose's detections.pickle",
                ),
            ],
            option(
                "--size WIDTH HEIGHT",
                "image size for a table of points, px (default: from camera_array.toml or calibration.toml beside "
                "it)",
            ),
            option(
                "--board",
                "the target, dark on light or light on dark; circles is a symmetric grid, acircles an asymmetric "
                "one",
                choices=["chessboard", "circles", "acircles", "charuco"],
            ),
            option(
                "--columns N",
                "inner corners of a chessboard, circles, or squares of a charuco board, per row",
            ),
            option("--rows N", "number of rows, counted in the same way"),
            option(
                "--square MM",
                "side of a square, or distance between neighbouring circles (acircles: between rows), mm",
            ),
            option(
                "--marker MM", "side of a charuco board's markers, mm (default: 0.75 of a square)"
            ),
            option(
                "--dictionary NAME", "dictionary of a charuco board's markers (default: 4X4_50)"
            ),
            option(
                "--first-marker N",
                "number of a charuco board's first marker (default: %(default)s)",
                default=0,
            ),
            option(
                "--out RIG.toml",
                "the rig to write; RIG.covariance.toml (its uncertainty), RIG_views.csv and RIG_residuals.png are "
                "written beside it",
            ),
            option(
                "--views N",
                "largest number of views that are used; of more, an even selection (default: %(default)s)",
                default=50,
            ),
            option(
                "--distortions",
                "number of coefficients k1, k2, p1, p2, k3, k4, k5, k6 to estimate (default: chosen by "
                "cross-validation over the views)",
                type=int,
                choices=[0, 1, 2, 4, 5, 8],
            ),
            option(
                "--lenses RIG.toml",
                "a rig, or caliscope's camera_array.toml, whose lenses are kept, so that only the cameras' poses "
                "are estimated",
            ),
            BITS,
        ],
        required="--images --board --columns --rows --square --out",
    ),
    Command(
        "preflight",
        "assess a set-up from a recording: light, focus, exposure, timing, baseline, calibration",
        "trinolab preflight recording",
        [
            option(
                "folder RECORDING",
                f"{REPLACED}, and which may lack both. Without it, --video is required",
                nargs="?",
            ),
            RIG,
            HANDLE,
            VIDEO,
            [FPS, TIMESTAMPS],
            BITS,
            option("--out TABLE.csv", "also write the table as CSV"),
        ],
    ),
    Command(
        "run",
        "calibrate, check, track and evaluate in one folder, beginning with the first missing output",
        "trinolab run recording",
        [
            option(
                "folder FOLDER",
                "a recording folder, completed by its project.toml; rig.toml, preflight.csv, poses.csv, poses.tum "
                "and seen.webm are written into it",
            ),
        ],
        note="""

project.toml contains options of preflight and track and, under [calibrate], those of
calibrate; paths are relative to the folder; rig = ... may replace [calibrate]:
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
        "improve a rig and a handle file with a recording of the moving handle",
        "trinolab refine slow --out refined",
        [
            option(
                "folder RECORDING",
                f"{REPLACED}. Without it, --rig, --handle and --video are required",
                nargs="?",
            ),
            RIG,
            HANDLE,
            VIDEO,
            option(
                "--out DIR",
                "folder to write: rig.toml, rig.covariance.toml, handle.toml, and views.csv, which lists what was "
                "left out; until it is complete, finished work is in DIR.partial, and a repeated command continues "
                "it",
            ),
            option(
                "--start POSES.csv",
                "known poses at some frames, required for handles that look the same in several poses",
            ),
            option(
                "--instants N",
                "largest number of instants that are adjusted; of more, the most widely spread (default: "
                "%(default)s)",
                default=300,
            ),
            option(
                "--length A B MM",
                "distance that fixes the scale, between two cameras (by name) or two markers (by number) (default: "
                "the rig's covariance, or else the distance between its first two cameras)",
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
                    "images of a moving hand, rendered by the simulated bench on demand",
                ),
                flag(
                    "--task",
                    "a task of 15 s on the simulated bench, with its own rig, clutch and scales, in which a block "
                    "is touched, a camera covered and a pose lost",
                ),
            ],
            RIG,
            HANDLE,
            ROBOT,
            option(
                "--start JOINT=RAD",
                "initial angles of the named joints, rad; the others start at the home position",
                nargs="+",
                default=[],
            ),
            option(
                "--view CAMERA.toml",
                "the surveillance camera in the robot's base frame (default: an included one)",
            ),
            option("--out DIR", "folder to write: poses.csv, joints.csv, events.csv, monitor.webm"),
            option(
                "--scale RATIO",
                "tool's distances divided by the handle's (default: 1)",
                default=1.0,
            ),
            option(
                "--turn-scale RATIO",
                "tool's angles divided by the handle's (default: 1)",
                default=1.0,
            ),
            option(
                "--clutch CSV",
                "a table with the columns t_s (s), closed (0 or 1) and optionally scale, each valid until the next "
                "row; without it, the clutch is closed whenever the handle is measured",
            ),
            option("--seconds S", "length of the simulation (default: %(default)g)", default=10.0),
            SEED,
            flag("--no-video", "write no video of the monitor"),
            METHOD,
            CHECK,
        ],
        required="folder --out",
    ),
    Command(
        "live",
        "follow the handle live with the simulated arm, on a page in the browser",
        "trinolab live --simulation",
        [
            [
                option("folder RECORDING", "a recording folder to play", nargs="?"),
                OLDER,
                several(
                    "--camera NAME=INDEX",
                    "a camera, by its index on this computer; NAME=VIDEO for all cameras plays videos instead",
                ),
                flag(
                    "--simulation",
                    "the simulated bench, on which a simulated hand or the mouse moves the rod",
                ),
            ],
            RIG,
            HANDLE,
            DEVICE_FPS,
            option(
                "--out DIR",
                "folder for recordings, each in a folder of its own (default: this one)",
                default=".",
            ),
            option(
                "--log FILE",
                "log of the pointing task, to which each trial is added (default: pointing.csv in that folder)",
            ),
            ROBOT,
            option(
                "--host ADDRESS",
                "address of the page; if it is not 127.0.0.1, other computers that have the complete address can "
                "open the page, over an unencrypted connection",
                default="127.0.0.1",
            ),
            option("--port N", "port of the page (default: any free one)", default=0),
            flag("--no-browser", "only print the page's address"),
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
            option("--poses POSES.csv", "poses of the handle, as written by track"),
            option("--joints JOINTS.csv", "motion of the arm, as written by teleop (rad)"),
            option("--out BAG", "the folder to write: metadata.yaml and an MCAP file"),
        ],
        required="--out",
    ),
    Command(
        "sweep",
        "run a notebook once for each combination of parameter values",
        "trinolab sweep notebooks/06_matching.ipynb -p ncc_threshold=0.5:0.9:5 \\\n"
        "      --workers 2 --out sweeps/ncc",
        [
            option(
                "notebook NOTEBOOK",
                "a notebook with a code cell tagged 'parameters'; the numbers that it exports with glue are the "
                "results",
            ),
            option(
                "-p --parameter NAME=VALUES",
                "a:b:n, n values from a to b; log:a:b:n, n values in equal ratios; a list like 0,1,2 (TOML "
                "literals); @FILE.csv, one column per parameter and one row per run. All values of several "
                "parameters are combined",
                action="append",
            ),
            option(
                "--out DIR",
                "folder for table.csv, figure.png, manifest.json and the finished runs, runs.jsonl, which a "
                "repeated command continues",
            ),
            option(
                "--sample N",
                "a Latin hypercube of N runs instead of all combinations; NAME=a:b and NAME=log:a:b are then "
                "intervals",
            ),
            option("--sample-seed N", "seed of that draw (default: %(default)s)", default=0),
            [
                option("--workers N", "number of kernels at a time (default: one per core)"),
                option(
                    "--scheduler ADDRESS",
                    "address of a running Dask cluster whose workers run the notebooks, such as tcp://host:8786",
                ),
            ],
            flag("--fresh-kernels", argparse.SUPPRESS),
            option(
                "--timeout S",
                "time limit per cell (default: none, since a first run may render a recording)",
            ),
            flag(
                "--whole",
                "run all cells for each combination, in a fresh kernel; otherwise a cell tagged 'once' runs once, "
                "one tagged 'figure' does not run, and two combinations are compared with the whole notebook",
            ),
            flag(
                "--explain",
                "say for each cell whether it runs once, for each combination, or not, and why; run nothing",
            ),
            flag("--keep", "also keep the executed notebooks, which are then run whole"),
            flag("--yes", "allow more than 100,000 runs"),
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
                "recording folders instead of rendered images, for the tests that need no truth: jitter if the "
                "handle rests, a pointer if it turns about one point, and availability",
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
                "folder for index.html, numbers.csv, sheet.json and the finished parts, measured.jsonl, which a "
                "repeated command continues",
            ),
            option(
                "--poses N",
                "number of poses of the static test, to which the size of the other tests is proportional (default: "
                "%(default)s)",
                default=512,
            ),
            SEED,
            option(
                "--chart CHART.csv",
                "a control chart over commits, to which this sheet is added",
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
                "a notebook or a Python file with the answers (default: the only file here whose name begins with "
                "the chapter's number)",
                nargs="?",
            ),
            option(
                "--all DIR",
                "the folder of a class, with one folder per student and in it one file per chapter, such as "
                "04_kalman.ipynb, or with files as named by Canvas; a file that has not changed is not checked "
                "again. Each file runs as a program: inside bwrap where that works, otherwise with your rights",
                dest="folder",
            ),
            option(
                "--out FILE",
                "with --all, the table of points and remarks to write, one row per student (default: points.csv in "
                "the class's folder)",
            ),
        ],
    ),
    Command(
        "scoreboard",
        "print the paper's claims with our results",
        "trinolab scoreboard --csv scoreboard.csv",
        [
            option("--csv FILE", "also write the table as CSV"),
            flag("--essential", "print only the fifteen lines of essential claims"),
        ],
    ),
    Command(
        "eq",
        "show where an equation of the paper is implemented, tested and derived",
        "trinolab eq 18",
        [
            option("number NUMBER", "1 to 27 (default: all)", type=int, nargs="?"),
        ],
    ),
    Command(
        "clear",
        "remove the recordings that chapters keep in the user's cache",
        "trinolab clear",
        [
            flag("--yes", "remove them without listing them and asking first"),
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
        epilog="trinolab COMMAND --help gives details and an example.",
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
