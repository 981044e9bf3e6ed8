"""The command ``trinolab``: thin, each command calls one workflow.

Exit code 0 is success, 1 a result that is not as declared, 2 a mistake in the input, 130 an
interruption.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import logging
import os
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from datetime import datetime
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trinolab.methods import check_option, estimator_of

from .alive import Quiet, hush, shown, watched
from .arguments import parser

if TYPE_CHECKING:
    import pandas as pd

    from trinolab.bench.rendering import CachedRecording
    from trinolab.files.recording import Recording

    from ..teleop.teleoperate import Done

__all__ = ["QUESTION_WIDTH", "as_text", "digits", "essential", "main", "not_run", "say"]


log = logging.getLogger("trinolab")

LONGEST_STEP_S = 2.0  # from frame to frame, that needs no question
LONGEST_LINE = 1000  # letters of what is wrong
QUESTION_WIDTH = 41  # columns of a question in the board as text
# The extra of this distribution that brings what a command imports.
EXTRAS = {
    "IPython": "book",
    "cloudpickle": "course",
    "grimp": "workbench",
    "jinja2": "workbench",
    "dask": "cluster",
    "distributed": "cluster",
    "matplotlib": "workbench",
    "mink": "slave",
    "mitsuba": "second",
    "mujoco": "slave",
    "nbclient": "book",
    "nbformat": "course",
    "pooch": "workbench",
    "psutil": "course",
    "pyvista": "slave",
    "rosbags": "ros",
    "tornado": "live",
}


# They answer at once, ask a question, run until they are stopped, or run commands that are watched.
UNWATCHED = ("eq", "clear", "live", "run")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return the exit code."""
    # At its end Python would walk through all that is loaded, to free what ends with the process anyhow.
    atexit.register(gc.freeze)
    _fit_for_all_words()
    arguments = parser().parse_args(argv)
    arguments.line = shlex.join(["trinolab", *(sys.argv[1:] if argv is None else argv)])
    logging.basicConfig(format="%(message)s", level=logging.INFO, handlers=[Quiet(sys.stderr)])
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # where it keeps its fonts is no news
    try:
        if hasattr(arguments, "method"):
            check_option(arguments.check, estimator_of(arguments.method, "--method"), "--check")
        _find_shipped(arguments)
        if arguments.command in UNWATCHED:
            return _RUN[arguments.command](arguments)
        with _camera_bits(getattr(arguments, "bits", None)), watched():
            return _RUN[arguments.command](arguments)
    except ModuleNotFoundError as error:
        what = (error.name or "").partition(".")[0]
        if what not in EXTRAS:
            raise
        needed = f"needs {what}: pip install 'trinolab[{EXTRAS[what]}]'"
        print(f"trinolab {arguments.command}: {needed}", file=sys.stderr)
        return 2
    except (ValueError, OSError, MemoryError) as error:
        print(f"trinolab {arguments.command}: {_one_line(_what_is_wrong(error))}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(
            f"trinolab {arguments.command}: interrupted, {str(stop) or 'nothing was written'}",
            file=sys.stderr,
        )
        return 130


def _camera_bits(bits: int | None) -> AbstractContextManager[None]:
    if bits is None:
        return nullcontext()
    from trinolab.files.images import camera_bits

    return camera_bits(bits)


def _fit_for_all_words() -> None:
    """Make the standard streams fit for every text, and those that are closed fit for use.

    A closed one would also leave its number to the next file that is opened, into which libraries then
    write their warnings.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115, as long as the process lives
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # names of files may have what a terminal cannot show
            stream.reconfigure(errors="backslashreplace")


def _what_is_wrong(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return f"not enough memory ({error})"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def _one_line(text: str) -> str:
    """What is wrong as one line; of a value that a file makes as long as itself only the beginning."""
    line = shown(" ".join(text.splitlines()))
    return line if len(line) <= LONGEST_LINE else f"{line[:LONGEST_LINE]} ..."


@contextmanager
def _loading() -> Iterator[None]:
    """Load modules without looking for garbage, which takes a tenth of the time and finds none."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@_loading()
def _find_shipped(a: argparse.Namespace) -> None:
    """Put the files in the place of the names of shipped rigs and handles."""
    rig, handle = getattr(a, "rig", None), getattr(a, "handle", None)
    if rig is None and handle is None:
        return
    from trinolab.datasets import handle_file, rig_file

    a.rig = None if rig is None else rig_file(rig)
    a.handle = None if handle is None else handle_file(handle)


def say(text: str) -> None:
    """Print an answer. Raises ValueError where it cannot be written: on a full disk.

    Whoever reads it through a pipe may have seen enough, as `head` has: that is no mistake.
    """
    hush()
    try:
        print(shown(text), flush=True)
    except OSError as error:
        # or Python, at its end, would complain as well
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            raise ValueError(f"standard output: cannot be written ({error.strerror})") from None


def _measure(a: argparse.Namespace) -> int:
    _check_source(a, "--images", a.images)
    with _loading():
        from .measure import measure_folder, measure_recording

    if a.folder is not None:
        table = measure_recording(
            a.folder, a.out, a.rig, a.handle, a.method, a.prior, check=a.check
        )
    else:
        table = measure_folder(a.rig, a.handle, a.images, a.out, a.method, a.prior, check=a.check)
    frames = table["frame"].tolist()
    named = frames != list(range(len(frames)))
    span = f"; frames {frames[0]} to {frames[-1]}, as the images are called" if named else ""
    say(f"{_counted(table)}{span}; written to {a.out}")
    return 0


def _check_source(a: argparse.Namespace, option: str, images: object) -> None:
    """Refuse, with a ValueError, all but a recording folder, or else rig, handle and images."""
    if a.folder is None and not (a.rig and a.handle and images):
        raise ValueError(
            f"expected a recording folder, or else all of --rig, --handle and {option}"
        )
    if a.folder is not None and images:
        raise ValueError(f"{option}: not beside a recording folder ({a.folder}), which has its own")


def _joints(items: Sequence[str]) -> dict[str, float]:
    """JOINT=RAD arguments as a mapping; ValueError for another form."""
    joints: dict[str, float] = {}
    for item in items:
        joint, _, value = item.partition("=")
        try:
            joints[joint] = float(value)
        except ValueError:
            raise ValueError(f"--start: expected JOINT=RAD, got {item!r}") from None
    return joints


def _calibrate(a: argparse.Namespace) -> int:
    from trinolab.calibration.target import Target

    sources = a.corners or _named(a.images, "--images")
    target = Target(a.board, a.columns, a.rows, a.square, a.marker, a.dictionary, a.first_marker)
    with _loading():
        from trinolab.calibration.calibrate import as_lines, calibrate_rig

    def picture(*of: Any) -> bytes:
        """Loads matplotlib, which a refusal need not wait for."""
        from ..plotting.calibration import picture_of_residuals

        return picture_of_residuals(*of)

    result = calibrate_rig(
        sources,
        target,
        a.out,
        a.views,
        a.distortions,
        picture=picture,
        size=a.size,
        lenses=a.lenses,
    )
    say(
        "\n".join(
            [*as_lines(result), "", f"written: {', '.join(str(path) for path in result.files)}"]
        )
    )
    for line in result.warnings:
        log.warning(line)
    return 0


def _named(items: Sequence[str], option: str, form: str = "NAME=PATH") -> dict[str, str]:
    """Arguments like NAME=PATH as a mapping; ValueError for another form, or a name or a path that
    comes twice.
    """
    paths: dict[str, str] = {}
    for item in items:
        name, equals, path = item.partition("=")
        if not (name.strip() and equals and path):
            raise ValueError(f"{option}: expected {form}, got {item!r}")
        if name in paths:
            raise ValueError(f"{option}: camera {name} is named twice")
        if Path(path) in map(Path, paths.values()):
            raise ValueError(f"{option}: {path} is given for more than one camera")
        paths[name] = path
    return paths


def _track(a: argparse.Namespace) -> int:
    _check_source(a, "--video", a.video)
    _open_first(a, [] if a.folder is None else [a.folder], a.out)
    with _loading():
        from satellites.bags.bags import track_recording
        from trinolab.following.track import track_files

    options = {"start": a.start, "method": a.method}
    with nullcontext() if a.overlay is None else _filmed(a) as watch:
        table = _on_footage(a, track_recording, track_files, {**options, "watch": watch})
    say(f"{_counted(table)}; written to {a.out}")
    return 0


def _filmed(a: argparse.Namespace) -> AbstractContextManager[Any]:
    """The film of a track, whose file is none that the command reads or writes otherwise."""
    from trinolab.files.outputs import check_targets

    from ..films.overlay import filmed

    read = [path for path in (a.rig, a.handle, a.start, a.timestamps) if path is not None]
    check_targets([a.out, a.overlay], read)
    return filmed(a.overlay)


def _refine(a: argparse.Namespace) -> int:
    _check_source(a, "--video", a.video)
    length = None if a.length is None else (a.length[0], a.length[1], _number(a.length[2]))
    _open_first(a, [] if a.folder is None else [a.folder], a.out)
    with _loading():
        from trinolab.following.refine import refine_files, refine_folder

        from .refine import as_lines

    options = {"start": a.start, "instants": a.instants, "length": length}
    refined = _on_footage(a, refine_folder, refine_files, options)
    say("\n".join([*as_lines(refined), "", f"written to {a.out}"]))
    return 0


@_loading()
def _open_first(a: argparse.Namespace, folders: Sequence[str], out: str | None = None) -> None:
    """Refuse a rig, a handle, videos, bags or recording folders that cannot be opened, and an output
    that has no folder, before the modules of the work are loaded, which takes as long as all the rest
    of a refusal.
    """
    from satellites.bags.bags import is_bag
    from satellites.bags.reader import opened
    from trinolab.files.outputs import check_parent
    from trinolab.files.recording import find_footage, open_folder, open_recording
    from trinolab.files.rigs import read_handle, read_rig

    if out is not None:
        check_parent(out)
    rig = None if a.rig is None else read_rig(a.rig)
    handle = None if a.handle is None else read_handle(a.handle)
    timestamps = getattr(a, "timestamps", None)
    if getattr(a, "video", None) and rig is not None:
        _ask_about_times(open_recording(_named(a.video, "--video"), rig, a.fps, timestamps))
    for folder in folders:
        if is_bag(folder):
            with opened(folder):
                continue
        recording, _ = open_folder(folder, rig, handle)
        if timestamps is not None:
            sources = find_footage(folder, recording.rig)
            recording = open_recording(sources, recording.rig, timestamps=timestamps)
        _ask_about_times(recording)


def _ask_about_times(recording: Recording) -> None:
    """A line about times that are likely in ms, which one sees only by lost instants otherwise."""
    if recording.times_s is not None and len(recording.times_s) > 1:
        step_s = 1 / recording.rate
        if step_s >= LONGEST_STEP_S:
            log.info(
                f"{recording.times_from}: {step_s:.3g} s from frame to frame: are its times in ms?"
            )


def _on_footage(
    a: argparse.Namespace,
    of_folder: Callable[..., Any],
    of_files: Callable[..., Any],
    options: Mapping[str, Any],
) -> Any:
    """Call what takes a recording folder, or else what takes rig, handle and videos."""
    options = {**options, "fps": a.fps, "timestamps": a.timestamps}
    if a.folder is not None:
        return of_folder(a.folder, a.out, a.rig, a.handle, **options)
    return of_files(a.rig, a.handle, _named(a.video, "--video"), a.out, **options)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"--length: expected a number of mm, got {text!r}") from None


def _counted(table: pd.DataFrame) -> str:
    """How many instants, and how many of each status; those before the first pose count apart."""
    since = (table["status"] != "lost").cummax()
    if since.all() or not since.any():
        return f"{len(table)} instants: {_statuses(table)}"
    before = int((~since).sum())
    return f"{len(table)} instants: {_statuses(table[since])}, {before} before the first pose"


def _statuses(table: pd.DataFrame) -> str:
    return ", ".join(f"{n} {status}" for status, n in table["status"].value_counts().items())


def _evaluate(a: argparse.Namespace) -> int:
    from trinolab.evaluation import as_lines, evaluate

    say("\n".join(as_lines(evaluate(a.poses, a.truth, a.handle))))
    return 0


def _eq(a: argparse.Namespace) -> int:
    from ..paper.places import equation, list_lines, place_lines

    say("\n".join(list_lines() if a.number is None else place_lines(equation(a.number))))
    return 0


def _kit(a: argparse.Namespace) -> int:
    from satellites.classkit.kit import as_lines, make_kit

    printed = make_kit(a.handle, a.out, a.diameter, a.marker, a.paper, a.thickness)
    say("\n".join(as_lines(printed)))
    return 0


def _preflight(a: argparse.Namespace) -> int:
    from satellites.classkit.criteria import NOT_USABLE, overall
    from satellites.classkit.preflight import as_lines, preflight

    sources = _named(a.video, "--video") if a.video else None
    table = preflight(a.folder, sources, a.rig, a.handle, a.fps, a.timestamps, a.out)
    say("\n".join(as_lines(table)))
    return int(overall(table) == NOT_USABLE)


def _run(a: argparse.Namespace) -> int:
    from .run import run

    return run(a.folder, main, lambda line: say(f"{a.folder}$ {line}"))


def _capture(a: argparse.Namespace) -> int:
    from ..capture.capture import capture, timing

    if a.list:
        return _list_cameras()
    if missing := [name for name in ("camera", "out") if getattr(a, name) is None]:
        raise ValueError(
            f"the following arguments are required: {', '.join(f'--{m}' for m in missing)}"
        )
    done = capture(
        _named(a.camera, "--camera", "NAME=INDEX, as ccd1=0, or NAME=VIDEO"),
        a.out,
        a.rig,
        a.handle,
        a.seconds,
        a.fps,
        a.size,
        a.preview,
    )
    n = len(done.times_s)
    last = done.times_s[-1]
    rate = f" in {last:.2f} s ({(n - 1) / last:.1f} a second)" if n > 1 else ""
    spread = sorted(1e3 * done.spread_s)
    within = (
        f"cameras within {spread[n // 2]:.1f} ms (median), {spread[-1]:.1f} ms (longest)"
        if done.live
        else "the times are the videos'"
    )
    say(f"{n} instants{rate}, {done.dropped} dropped; {within}; written to {a.out}")
    if verdict := timing(done):
        say(verdict)
    return 0


def _list_cameras() -> int:
    from ..capture.devices import list_cameras

    cameras = list_cameras()
    for one in cameras:
        what = "{} x {} px, {:g} frames per second".format(*(one.size or (0, 0)), one.fps)
        say(f"{one.number:3d}  {one.name or 'camera'}: {one.problem or what}")
    if not cameras:
        say("no camera; a container or a virtual machine has those that are handed through to it")
    return 0


def _render(a: argparse.Namespace) -> int:
    from trinolab.bench.rendering import render

    try:
        truth = render(a.rig, a.handle, a.motion, a.out, a.seed, a.seconds, a.fps)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("run it again in the same way to go on") from None
    say(
        f"{len(truth)} instants, the handle is there in {(truth['status'] != 'lost').sum()}; written to {a.out}"
    )
    return 0


def _teleop(a: argparse.Namespace) -> int:
    from trinolab.slave.mapping import MappingParameters

    if a.live_simulation and not (a.rig and a.handle):
        raise ValueError("--live-simulation: needs --rig and --handle")
    if a.task:
        return _task(a)
    MappingParameters(a.scale, a.turn_scale)  # refuses those that are out of range
    start = _joints(a.start)
    recording = a.folder or a.older
    _open_first(a, [] if recording is None else [recording], a.out)
    with _loading():
        from ..teleop.teleoperate import recorded, simulated, teleoperate

    source = (
        simulated(a.rig, a.handle, a.seconds, a.seed)
        if a.live_simulation
        else recorded(recording, a.rig, a.handle)
    )
    done = teleoperate(
        source,
        a.out,
        a.robot,
        a.scale,
        a.turn_scale,
        a.clutch,
        a.view,
        a.method,
        start,
        not a.no_video,
    )
    return _say_session(done, a.out)


def _task(a: argparse.Namespace) -> int:
    for name in ("rig", "handle", "clutch", "view", "start"):
        if getattr(a, name):
            raise ValueError(f"--task: brings its own {name}")
    with _loading():
        from ..teleop.task import perform

    return _say_session(perform(a.out, a.seed, a.method, not a.no_video), a.out)


def _say_session(done: Done, out: str) -> int:
    """What a session came to, in one line."""
    holds = done.events.loc[done.events["event"] == "hold", "detail"]
    say(
        f"{_counted(done.poses)}; {len(done.joints)} ticks of the arm, {len(holds)} holds"
        f"{f' (the first: {holds.iloc[0]})' if len(holds) else ''}; written to {out}"
    )
    return 0


def _bag(a: argparse.Namespace) -> int:
    from satellites.bags.bags import write_bag

    with _ended_in_order():
        counts = write_bag(a.folder, a.out, a.poses, a.joints)
    say("\n".join([*(f"{n:7d}  {topic}" for topic, n in counts.items()), f"written to {a.out}"]))
    return 0


def _live(a: argparse.Namespace) -> int:
    recording = a.folder or a.older
    _open_first(a, [] if recording is None else [recording])
    with _loading():
        from satellites.live.command import chosen, live, show

    cameras = _named(a.camera or [], "--camera", "NAME=INDEX, as ccd1=0, or NAME=VIDEO")
    source = chosen(cameras, recording, a.rig, a.handle, a.fps)

    with ExitStack() as shown:

        def on_open(address: str) -> None:
            say(f"{address}\nis the page; Ctrl-C ends it")
            if not a.no_browser:
                shown.enter_context(show(address))

        summary = live(source, a.out, a.robot, a.method, a.host, a.port, log=a.log, on_open=on_open)
    say(summary or "ended; nothing was recorded")
    return 0


def _accept(a: argparse.Namespace) -> int:
    from satellites.accept.size import check_chart, checked_size

    folders = [*a.folders, *a.older]
    checked_size(a.poses, a.seed)
    check_chart(a.chart, folders)
    _open_first(a, folders)
    with _loading():
        from satellites.accept.command import accept, as_lines

    done = accept(a.rig, a.handle, a.out, folders, a.poses, a.seed, a.chart)
    say("\n".join([*as_lines(done), f"{done.cpu_s:.0f} s of processor time; written to {a.out}"]))
    return 0


def _check(a: argparse.Namespace) -> int:
    from ..course import sandbox
    from ..course.submissions import as_text, check_class, check_file, file_of

    if (a.chapter is None) == (a.folder is None):
        raise ValueError("expected a chapter, as in 04, or --all with the folder of a class")
    if a.folder is not None:
        out = Path(a.folder) / "points.csv" if a.out is None else Path(a.out)
        with _ended_in_order():
            table = check_class(Path(a.folder), out)
        if not sandbox.works():
            print(sandbox.ADVICE, file=sys.stderr)
        say(f"{table.drop(columns='said').to_string(index=False, na_rep='')}\nwritten to {out}")
        return 0
    if a.out is not None:
        raise ValueError("--out: is of use with --all alone")
    chapter = a.chapter.zfill(2)
    file = file_of(chapter, Path()) if a.file is None else Path(a.file)
    with _ended_in_order():
        verdicts = check_file(chapter, file)
    say(as_text(verdicts))
    return 0 if all(one.right for one in verdicts) else 1


@contextmanager
def _ended_in_order() -> Iterator[None]:
    """Asked to end, this command ends what it has started as well."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _sweep(a: argparse.Namespace) -> int:
    from trinolab.checks import as_number, as_whole

    from ..sweep.engines import cluster, kernels
    from ..sweep.grid import parse
    from ..sweep.runs import compute, of_notebook

    if a.timeout is not None:
        as_number(a.timeout, "--timeout", low=1.0)
    job = of_notebook(
        a.notebook,
        parse(a.parameter),
        a.sample,
        a.sample_seed,
        a.yes,
        a.timeout,
        a.keep,
        a.whole or a.fresh_kernels,
    )
    if a.explain:
        say(job.cells)
        return 0
    if a.out is None:
        raise ValueError("--out: expected a folder for the runs")
    workers = as_whole(
        (os.cpu_count() or 1) if a.workers is None else a.workers, "--workers", low=1
    )
    local = kernels(min(workers, len(job.settings)), job.kernels)
    engine = local if a.scheduler is None else cluster(a.scheduler, job.kernels)
    runs = compute(job, engine, a.out, {"command": a.line, "workers": a.scheduler or workers})
    say(f"{len(runs)} runs: {_statuses(runs)}; written to {a.out}")
    for status, rows in runs[runs["status"] != "ok"].groupby("status"):
        say(f"the first {status}: {rows['error'].iloc[0]}")
    return 0 if (runs["status"] == "ok").all() else 1


def _clear(a: argparse.Namespace) -> int:
    from trinolab.bench.rendering import cached_recordings, clear_recordings, recordings_folder

    folder = recordings_folder()
    recordings = cached_recordings()
    if not recordings:
        say(f"no standard recording is kept in {folder}")
        return 0
    if not a.yes:
        if not sys.stdin.isatty():
            raise ValueError(
                f"no terminal to ask on; --yes removes {len(recordings)} standard recordings, "
                f"{_megabytes(recordings)}, from {folder}"
            )
        say(
            "\n".join(
                [
                    f"in {folder}, for all copies of trinolab on this account:",
                    *map(_line, recordings),
                ]
            )
        )
        if not _confirmed(f"remove {_megabytes(recordings)}?"):
            say("nothing was removed")
            return 0
    gone = clear_recordings(recordings)
    for one in recordings:
        if one not in gone:
            say(f"{one.name}: left, it is being rendered")
    say(f"{_megabytes(gone)} of standard recordings removed from {folder}")
    return 0


def _megabytes(kept: Sequence[CachedRecording]) -> str:
    return f"{sum(one.size for one in kept) / 1e6:.0f} MB"


def _line(kept: CachedRecording) -> str:
    when = datetime.fromtimestamp(kept.written_s).strftime("%Y-%m-%d %H:%M")
    return f"  {_megabytes([kept]):>7}  {when}  {kept.name}"


def _confirmed(question: str) -> bool:
    """Whether a person at the terminal says yes; no answer is none."""
    try:
        return input(f"{question} [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        print()
        return False


def _scoreboard(a: argparse.Namespace) -> int:
    from trinolab.files.outputs import check_target, write_whole

    if a.csv:
        check_target(a.csv)
    from ..studies.scoreboard import disagreements, scoreboard

    board = scoreboard(progress=True)
    if a.csv:
        texts = {name: board[name].map(digits) for name in ("ours", "low", "high")}
        texts |= {name: board[name].map(_whole) for name in ("n", "seed")}
        write_whole(a.csv, board.assign(**texts).to_csv(index=False))
    say(as_text(essential(board), QUESTION_WIDTH) if a.essential else as_text(board))
    if note := not_run(board):
        say(note)
    if wrong := disagreements(board):
        print(f"not as declared in the ledger: claim {', '.join(wrong)}", file=sys.stderr)
        return 1
    return 0


def as_text(board: pd.DataFrame, width: int = 76) -> str:
    """The scoreboard as plain text of under 120 columns; long claims are cut."""
    short = board["claim"].where(
        board["claim"].str.len() <= width, board["claim"].str.slice(stop=width - 3) + "..."
    )
    table = board.assign(
        claim=short, paper=board["paper"].map(digits), ours=board["ours"].map(digits)
    )
    table = table[["no", "claim", "paper", "ours", "unit", "verdict"]]
    formatters = {"claim": f"{{:<{width}s}}".format, "verdict": "{:<16s}".format}
    return table.to_string(index=False, justify="left", formatters=formatters)


def essential(board: pd.DataFrame) -> pd.DataFrame:
    """The board that a reader sees first: one line per question, for which its rows stand together.

    Returns
    -------
    pandas.DataFrame
        Columns no, claim (the question), paper, ours, unit and verdict, as text. What all rows of a
        line have in common stands there once.
    """
    import pandas as pd

    from ..studies.scoreboard import essential_rows

    lines = list[dict[str, str]]()
    for question, rows in essential_rows(board).items():
        texts = {
            name: [digits(value) for value in rows[name]]
            for name in ("paper", "ours", "unit", "verdict")
        }
        joined = {name: ", ".join(_once(values)) for name, values in texts.items()}
        lines.append({"no": ", ".join(rows["no"]), "claim": question, **joined})
    return pd.DataFrame(lines)


def _once(texts: list[str]) -> list[str]:
    return texts[:1] if len(set(texts)) == 1 else texts


def not_run(board: pd.DataFrame) -> str:
    """What a reader of a scoreboard as text should know of the rows that were not run; nothing if all
    were.
    """
    rows = board[board["verdict"] == "not run"]
    numbers = ", ".join(map(str, rows["no"]))
    return f"claim {numbers}: {rows['reason'].iloc[0]}" if len(rows) else ""


def _whole(value: float | str) -> str:
    return "" if value == "" or value != value else f"{float(value):.0f}"


def digits(value: float | str) -> str:
    """A number with the digits that a board shows; "" for NaN."""
    if isinstance(value, str):
        return value
    return "" if value != value else f"{value:.3g}"


_RUN = {
    "calibrate": _calibrate,
    "measure": _measure,
    "kit": _kit,
    "preflight": _preflight,
    "run": _run,
    "track": _track,
    "refine": _refine,
    "evaluate": _evaluate,
    "render": _render,
    "teleop": _teleop,
    "live": _live,
    "accept": _accept,
    "check": _check,
    "bag": _bag,
    "sweep": _sweep,
    "clear": _clear,
    "capture": _capture,
    "scoreboard": _scoreboard,
    "eq": _eq,
}
