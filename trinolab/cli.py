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
    except KeyboardInterrupt:
        print(f"trinolab {arguments.command}: interrupted, {arguments.interrupted}", file=sys.stderr)
        return 130


def _measure(a: argparse.Namespace) -> int:
    from .workflows import measure_folder

    table = measure_folder(a.rig, a.handle, a.images, a.out, a.method, a.prior)
    counts = ", ".join(f"{n} {status}" for status, n in table["status"].value_counts().items())
    print(f"{len(table)} instants: {counts}; written to {a.out}")
    return 0


def _evaluate(a: argparse.Namespace) -> int:
    from .workflows import evaluate

    result = evaluate(a.poses, a.truth, a.handle)
    print(f"instants   {result.instants:8d}")
    for status in ("measured", "ambiguous", "predicted", "lost"):
        count = getattr(result, status)
        print(f"{status:10s} {count:8d}   {100 * count / result.instants:5.1f} %")
    if (e := result.errors) is None:
        print("no pose to compare")
        return 0
    print(f"errors of {e.n} poses, up to the handle's symmetry:")
    print("              mean   median      max")
    print(f"E_t       {e.E_t_mm:8.3f} {e.position_median_mm:8.3f} {e.position_max_mm:8.3f} mm    (Eq. 26)")
    for name in ("alpha", "beta", "gamma"):
        mean, median = getattr(e, f"E_{name}_deg"), getattr(e, f"{name}_median_deg")
        print(f"{'E_' + name:9s} {mean:8.3f} {median:8.3f}          deg   (Eq. 27)")
    print(f"geodesic  {e.geodesic_mean_deg:8.3f} {e.geodesic_median_deg:8.3f} {e.geodesic_max_deg:8.3f} deg")
    return 0


def _render(a: argparse.Namespace) -> int:
    from .rendering import render

    truth = render(a.rig, a.handle, a.motion, a.out, a.seed, a.seconds, a.fps)
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
    _add_measure(commands)
    _add_evaluate(commands)
    _add_render(commands)
    _add(commands, "clear", _clear, "remove the standard recordings that chapters keep in the user's cache",
         "trinolab clear")
    board = _add(commands, "scoreboard", _scoreboard, "print the paper's claims beside what is computed here",
                 "trinolab scoreboard --csv scoreboard.csv")
    board.add_argument("--csv", metavar="FILE", help="write the table as CSV, too")
    return parser


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
    p = _add(commands, "evaluate", _evaluate, "compare poses with their truth (Eq. 26, 27, geodesic angle)",
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
    p.add_argument("--fps", type=float, default=30.0, metavar="F",
                   help="frames a second; times in POSES.csv go before it (default: %(default)s)")
    p.set_defaults(interrupted="run it again in the same way to go on")


def _add(commands: argparse._SubParsersAction, name: str, run: object, about: str, example: str
         ) -> argparse.ArgumentParser:
    parser = commands.add_parser(name, help=about, description=about[0].upper() + about[1:] + ".",
                                 epilog=f"example:\n  {example}")
    parser.set_defaults(run=run, interrupted="nothing was written")
    return parser


if __name__ == "__main__":
    sys.exit(main())
