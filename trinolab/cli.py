"""The command ``trinolab``: thin, each command calls one workflow.

Exit code 0 is success, 1 a result that is not as declared, 2 a mistake in the input, 130 an interruption.
"""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from . import __version__

if TYPE_CHECKING:  # what takes a second to load is imported where an interruption is answered
    import pandas as pd


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return the exit code."""
    arguments = _parser().parse_args(argv)
    logging.basicConfig(format="%(message)s", stream=sys.stderr, level=logging.INFO)
    try:
        return arguments.run(arguments)
    except (ValueError, OSError) as error:
        print(f"trinolab {arguments.command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(f"trinolab {arguments.command}: interrupted, {str(stop) or 'nothing was written'}", file=sys.stderr)
        return 130


def _measure(a: argparse.Namespace) -> int:
    from .workflows import measure_folder

    table = measure_folder(a.rig, a.handle, a.images, a.out, a.method, a.prior)
    counts = ", ".join(f"{n} {status}" for status, n in table["status"].value_counts().items())
    print(f"{len(table)} instants: {counts}; written to {a.out}")
    return 0


def _calibrate(a: argparse.Namespace) -> int:
    from .calibrating import as_lines, calibrate_rig
    from .targets import Target

    sources = _named(a.images, "--images")
    target = Target(a.board, a.columns, a.rows, a.square, a.marker, a.dictionary)
    result = calibrate_rig(sources, target, a.out, a.views, a.distortions)
    print("\n".join([*as_lines(result), "", f"written: {', '.join(str(path) for path in result.files)}"]))
    return 0


def _named(items: Sequence[str], option: str) -> dict[str, str]:
    """NAME=PATH arguments as a mapping; ValueError for another form or a name that comes twice."""
    found: dict[str, str] = {}
    for item in items:
        name, equals, path = item.partition("=")
        if not (name.strip() and equals and path):
            raise ValueError(f"{option}: expected NAME=PATH, got {item!r}")
        if name in found:
            raise ValueError(f"{option}: camera {name} is named twice")
        found[name] = path
    return found


def _evaluate(a: argparse.Namespace) -> int:
    from .evaluation import as_lines, evaluate

    print("\n".join(as_lines(evaluate(a.poses, a.truth, a.handle))))
    return 0


def _capture(a: argparse.Namespace) -> int:
    from .capturing import capture

    done = capture(_named(a.camera, "--camera"), a.out, a.rig, a.handle, a.seconds, a.fps, a.size, a.preview)
    n, last = len(done.times_s), done.times_s[-1]
    rate = f" in {last:.2f} s ({(n - 1) / last:.1f} a second)" if n > 1 else ""
    spread = sorted(1e3 * done.spread_s)
    print(f"{n} instants{rate}, {done.dropped} dropped; cameras within {spread[n // 2]:.1f} ms (median), "
          f"{spread[-1]:.1f} ms (longest); written to {a.out}")
    return 0


def _render(a: argparse.Namespace) -> int:
    from .rendering import render

    try:
        truth = render(a.rig, a.handle, a.motion, a.out, a.seed, a.seconds, a.fps)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("run it again in the same way to go on") from None
    print(f"{len(truth)} instants, the handle is there in {(truth['status'] != 'lost').sum()}; written to {a.out}")
    return 0


def _clear(a: argparse.Namespace) -> int:
    from .standard import clear_recordings, recordings_folder

    print(f"{clear_recordings() / 1e6:.0f} MB of standard recordings removed from {recordings_folder()}")
    return 0


def _scoreboard(a: argparse.Namespace) -> int:
    from .outputs import check_target, write_whole
    from .scoreboard import disagreements, scoreboard

    if a.csv:
        check_target(a.csv)
    board = scoreboard(progress=True)
    if a.csv:
        write_whole(a.csv, board.assign(ours=board["ours"].map(_digits)).to_csv(index=False))
    print(as_text(board))
    if wrong := disagreements(board):
        print(f"not as declared in the ledger: claim {', '.join(wrong)}", file=sys.stderr)
        return 1
    return 0


def as_text(board: pd.DataFrame, width: int = 76) -> str:
    """The scoreboard as plain text of under 120 columns; long claims are cut."""
    short = board["claim"].where(board["claim"].str.len() <= width, board["claim"].str.slice(stop=width - 3) + "...")
    table = board.assign(claim=short, paper=board["paper"].map(_digits), ours=board["ours"].map(_digits))
    table = table[["no", "claim", "paper", "ours", "unit", "verdict"]]
    left = {"claim": f"{{:<{width}s}}".format, "verdict": "{:<16s}".format}
    return table.to_string(index=False, justify="left", formatters=left)


def _digits(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return "" if value != value else f"{value:.3g}"


class _Parser(argparse.ArgumentParser):
    """Answers a wrong argument with one line, and leaves the lines of an example as they are."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **settings)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="trinolab", description="The three-camera master handle: measure, evaluate, compare with the "
                     "paper.", epilog="trinolab COMMAND --help says more and has an example.")
    parser.add_argument("--version", action="version", version=f"trinolab {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_calibrate(commands)
    _add_measure(commands)
    _add_evaluate(commands)
    _add_render(commands)
    _add(commands, "clear", _clear, "remove the standard recordings that chapters keep in the user's cache",
         "trinolab clear")
    _add_capture(commands)
    board = _add(commands, "scoreboard", _scoreboard, "print the paper's claims beside what is computed here",
                 "trinolab scoreboard --csv scoreboard.csv")
    board.add_argument("--csv", metavar="FILE", help="write the table as CSV, too")
    return parser


def _add_calibrate(commands: argparse._SubParsersAction) -> None:
    p = _add(commands, "calibrate", _calibrate, "calibrate two or more cameras from images of a flat target",
             "trinolab calibrate --images ccd1=photos/ccd1 ccd2=photos/ccd2 --board chessboard \\\n"
             "      --columns 9 --rows 6 --square 25 --out rig.toml")
    p.add_argument("--images", required=True, nargs="+", action="extend", metavar="NAME=PATH",
                   help="for each camera a folder of images (paired by file name), a pattern like 'photos/left*.png' "
                   "(paired by what * stands for) or a video (paired by frame); the first camera is the world frame")
    p.add_argument("--board", required=True, choices=["chessboard", "circles", "charuco"],
                   help="the target; circles are a symmetric grid, dark on light")
    p.add_argument("--columns", required=True, type=int, metavar="N",
                   help="points in a row: inner corners of a chessboard, circles, but squares of a charuco board")
    p.add_argument("--rows", required=True, type=int, metavar="N", help="rows, counted in the same way")
    p.add_argument("--square", required=True, type=float, metavar="MM",
                   help="side of a square, or distance of neighbouring circles, mm")
    p.add_argument("--marker", type=float, metavar="MM",
                   help="side of a charuco board's markers, mm (default: 0.75 of a square)")
    p.add_argument("--dictionary", metavar="NAME", help="of a charuco board's markers (default: 4X4_50)")
    p.add_argument("--out", required=True, metavar="RIG.toml",
                   help="the rig to write; RIG_views.csv and RIG_residuals.png appear beside it")
    p.add_argument("--views", type=int, default=50, metavar="N",
                   help="the most views to look at; of more, some are passed over evenly (default: %(default)s)")
    p.add_argument("--distortions", type=int, default=5, choices=[0, 1, 2, 4, 5],
                   help="how many of k1, k2, p1, p2, k3 are estimated (default: %(default)s)")


def _add_measure(commands: argparse._SubParsersAction) -> None:
    p = _add(commands, "measure", _measure, "measure the handle's pose in every instant of a folder of images",
             "trinolab measure --rig rig.toml --handle handle.toml --images images --out poses.csv")
    p.add_argument("--rig", required=True, metavar="RIG.toml", help="the cameras")
    p.add_argument("--handle", required=True, metavar="HANDLE.toml", help="the handle and its markers")
    p.add_argument("--images", required=True, metavar="DIR",
                   help="holds a folder a camera, named as in the rig, the same file names in each")
    p.add_argument("--out", required=True, metavar="POSES.csv", help="the poses to write")
    p.add_argument("--method", default="paper",
                   choices=["paper", "weighted", "reprojection", "patches", "outline", "best"],
                   help="the estimator: the paper's, or better ones (default: %(default)s; best is patches)")
    p.add_argument("--prior", metavar="POSES.csv",
                   help="expected poses, joined on 'frame': they choose among poses that look alike")


def _add_evaluate(commands: argparse._SubParsersAction) -> None:
    p = _add(commands, "evaluate", _evaluate, "compare poses with their truth (Eq. 26, 27, flips, losses)",
             "trinolab evaluate poses.csv truth.csv --handle handle.toml")
    p.add_argument("poses", metavar="POSES.csv", help="what 'trinolab measure' has written")
    p.add_argument("truth", metavar="TRUTH.csv", help="the true poses, joined on 'frame'")
    p.add_argument("--handle", required=True, metavar="HANDLE.toml", help="errors count up to its symmetry")


def _add_render(commands: argparse._SubParsersAction) -> None:
    p = _add(commands, "render", _render, "render a recording with its truth from the simulated bench",
             "trinolab render --rig rig.toml --handle handle.toml --motion calm --out recording")
    p.add_argument("--rig", required=True, metavar="RIG.toml", help="the cameras")
    p.add_argument("--handle", required=True, metavar="HANDLE.toml", help="the handle and its markers")
    p.add_argument("--motion", required=True, metavar="calm|hard|POSES.csv",
                   help="a standard recording's script, or poses along which a hand holds the handle")
    p.add_argument("--out", required=True, metavar="DIR",
                   help="the recording to write; until it is whole it is DIR.partial, and goes on where it stopped")
    p.add_argument("--seed", type=int, default=0, metavar="N", help="of motion and noise (default: %(default)s)")
    p.add_argument("--seconds", type=float, metavar="S", help="length (default: 10, or all of POSES.csv)")
    p.add_argument("--fps", type=float, default=30.0, metavar="F", help="frames a second, if POSES.csv has no times")


def _add_capture(commands: argparse._SubParsersAction) -> None:
    p = _add(commands, "capture", _capture, "record a folder of images from cameras; Ctrl-C ends it",
             "trinolab capture --camera ccd1=0 ccd2=2 --rig rig.toml --preview --out recording")
    p.add_argument("--camera", required=True, nargs="+", action="extend", metavar="NAME=INDEX",
                   help="a camera by its index at this computer; NAME=PATH plays a video in its place")
    p.add_argument("--out", required=True, metavar="DIR", help="the recording to write: images, timestamps.csv")
    which = p.add_mutually_exclusive_group()
    which.add_argument("--rig", metavar="RIG.toml", help="the cameras' names and sizes; goes into the recording")
    which.add_argument("--size", nargs=2, type=int, metavar=("WIDTH", "HEIGHT"), help="to ask of cameras without a rig")
    p.add_argument("--handle", metavar="HANDLE.toml", help="goes into the recording")
    p.add_argument("--seconds", type=float, metavar="S", help="to record for (default: until Ctrl-C)")
    p.add_argument("--fps", type=float, metavar="F", help="frames a second to ask of cameras, or to play videos with")
    p.add_argument("--preview", action="store_true",
                   help="keep preview.png in DIR.partial up to date: what the cameras see")


def _add(commands: argparse._SubParsersAction, name: str, run: object, about: str, example: str
         ) -> argparse.ArgumentParser:
    parser = commands.add_parser(name, help=about, description=about[0].upper() + about[1:] + ".",
                                 epilog=f"example:\n  {example}")
    parser.set_defaults(run=run)
    return parser


if __name__ == "__main__":
    sys.exit(main())
