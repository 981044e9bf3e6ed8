"""Commands that are stopped: by Ctrl-C, by kill -9 at the worst moment, by a full disk. Each in a
process of its own.

A file appears whole or not at all. A track and a calibration that are stopped begin anew; a rendering
and a sweep go on.
"""

import os
import shutil
import signal
from pathlib import Path

import cv2
import numpy as np
import pytest
from healthy import BOARDS, EVALUATE, MEASURE, RENDER, SWEEP, TRACK, contents, make_healthy, run
from processes import CLI, GATE, ended, open_gate, started, wait_until

from trinolab.files.poses import read_poses
from trinolab.files.rigs import read_rig
from workbench.films.video import Film

resource = pytest.importorskip("resource", reason="limits of a process are set as POSIX does")

COUNT = 24  # instants of the recording: a second to track
# Ends itself, as by kill -9, when it gives a finished file its name for the n-th time from 0.
DIES = (
    """
import os, signal, sys
real, left = os.replace, [int(sys.argv.pop(1))]
def replace(*paths):
    left[0] or os.kill(os.getpid(), signal.SIGKILL)
    left[0] -= 1
    real(*paths)
os.replace = replace
"""
    + CLI
)
REACHED = "reached"  # a file that is there when a process waits for the gate
# Tracks eight instants, then waits for the gate before each.
WAITS = (
    f"""
import time
from pathlib import Path
from trinolab.following import track
real = track.pose_row
def pose_row(frame, *others):
    while frame >= 8 and not Path({GATE!r}).exists():
        Path({REACHED!r}).touch()
        time.sleep(0.01)
    return real(frame, *others)
track.pose_row = pose_row
"""
    + CLI
)

# Reads the last image of a camera when the gate is open.
READS = (
    f"""
import time
from pathlib import Path
from trinolab.files import images
real = images._read
def read(path, size, bits):
    while str(path) == "b/04.png" and not Path({GATE!r}).exists():
        Path({REACHED!r}).touch()
        time.sleep(0.01)
    return real(path, size, bits)
images._read = read
"""
    + CLI
)
# Ends itself, as by kill -9, before it writes its third message.
BAG = "bag rec --out new"
BAG_DIES = (
    """
import os, signal
from rosbags.rosbag2 import Writer
real, left = Writer.write, [3]
def write(*arguments):
    left[0] -= 1
    left[0] or os.kill(os.getpid(), signal.SIGKILL)
    real(*arguments)
Writer.write = write
"""
    + CLI
)

# A video of twelve pictures of noise.
FILM = """
import sys
import numpy as np
from workbench.films.video import Film
rng = np.random.default_rng(0)
try:
    with Film("o.webm", 25.0) as film:
        for _ in range(12):
            film.add(rng.integers(0, 256, (64, 128, 3), np.uint8))
except ValueError as error:
    sys.exit(str(error))
"""


FILM_DIES = """
import os, signal
import numpy as np
from workbench.films.video import Film
with Film("o.webm", 25.0) as film:
    film.add(np.zeros((64, 128, 3), np.uint8))
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """A folder with all that the commands read, and a track that nothing has interrupted."""
    root = tmp_path_factory.mktemp("long")
    make_healthy(root, COUNT)
    assert run(f"track {root / 'rec'} --out {root / 'whole.csv'}") == 0
    return root


@pytest.fixture
def folder(healthy, tmp_path, monkeypatch):
    """The working folder: a copy of the healthy one."""
    shutil.copytree(healthy, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def started_on_a_full_disk(line, limit, code=CLI, **options):
    """A command as a process; no file that it writes may be longer than `limit` bytes, as if the
    disk were full.

    It stores no bytecode: Python does not notice that such a file was cut off, and later processes
    could not load it.
    """
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    return started(
        line,
        code,
        lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        env=environment,
        **options,
    )


def files():
    return {path.name for path in Path().iterdir() if path.is_file()}


def visible():
    """The files without hidden ones, which are nobody's input."""
    return {name for name in files() if name[0] != "."}


def assert_like_uninterrupted():
    """The track is whole, and that of a run without interruption to the last digit."""
    for suffix in ("csv", "tum"):
        assert Path(f"poses.{suffix}").read_bytes() == Path(f"whole.{suffix}").read_bytes()
    assert read_poses("poses.csv")["status"].tolist() == ["measured"] * COUNT


# --- Ctrl-C and kill -9


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGINT, 130),
        pytest.param(signal.SIGKILL, -signal.SIGKILL, marks=pytest.mark.heavy),
    ],
)
def test_a_track_that_is_stopped_leaves_nothing_to_read_and_begins_anew(folder, number, code):
    before = files()
    with started(TRACK, WAITS) as process:
        wait_until(Path(REACHED).exists, process)
        process.send_signal(number)
        result = ended(process)
    said = "trinolab track: interrupted, nothing was written\n"
    assert result == (code, [said] * (number == signal.SIGINT))
    assert visible() == before | {REACHED}
    open_gate()
    assert run(TRACK) == 0
    assert_like_uninterrupted()
    assert files() == before | {REACHED, GATE, "poses.csv", "poses.tum"}


@pytest.mark.parametrize(
    ("moment", "there"),
    [
        pytest.param(0, set(), marks=pytest.mark.heavy),
        (1, {"poses.csv"}),
    ],
)
def test_a_track_that_is_killed_while_it_names_its_files(folder, moment, there):
    before = files()
    with started(f"{moment} {TRACK}", DIES) as process:
        assert ended(process) == (-signal.SIGKILL, [])
    assert visible() == before | there
    assert (
        "poses.csv" not in there or Path("poses.csv").read_bytes() == Path("whole.csv").read_bytes()
    )
    assert run(TRACK) == 0
    assert Path("poses.csv").read_bytes() == Path("whole.csv").read_bytes()
    assert Path("poses.tum").read_bytes() == Path("whole.tum").read_bytes()


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGINT, 130),
        pytest.param(signal.SIGKILL, -signal.SIGKILL, marks=pytest.mark.heavy),
    ],
)
def test_a_calibration_that_is_stopped_leaves_nothing(folder, number, code):
    before = files()
    with started(BOARDS, READS) as process:
        wait_until(Path(REACHED).exists, process)
        process.send_signal(number)
        result = ended(process)
    assert result == (
        code,
        ["trinolab calibrate: interrupted, nothing was written\n"] if code == 130 else [],
    )
    assert visible() - before == {REACHED}
    open_gate()
    assert run(BOARDS) == 0
    assert all(name[0] != "." for name in files())


@pytest.mark.heavy
def test_a_calibration_that_is_killed_while_it_names_its_files(folder):
    before = files()
    with started(f"0 {BOARDS}", DIES) as process:  # all three files are written, none has its name
        assert ended(process) == (-signal.SIGKILL, [])
    assert visible() == before
    assert run(BOARDS) == 0
    assert read_rig("new.toml").names == ("a", "b")


@pytest.mark.parametrize(
    "moment", [2, *(pytest.param(k, marks=pytest.mark.heavy) for k in (7, 12))]
)
def test_a_rendering_that_is_killed_goes_on_to_the_same_files(folder, moment):
    with started(f"{moment} {RENDER}", DIES) as process:
        assert ended(process) == (-signal.SIGKILL, [])
    assert not Path("out").exists()
    assert run(RENDER) == 0
    assert run(RENDER.replace("--out out", "--out undisturbed")) == 0
    one, other = (
        {
            path.relative_to(root): data
            for path, data in contents(Path(root)).items()
            if path.name[0] != "."
        }
        for root in ("out", "undisturbed")
    )
    assert one == other


def test_what_a_killed_bag_has_begun_goes_with_the_next_one(folder):
    pytest.importorskip("rosbags", reason="extra ros is not installed")
    before = {path.name for path in Path().iterdir()}
    with started(BAG, BAG_DIES) as process:
        assert ended(process)[0] == -signal.SIGKILL
    assert not Path("new").exists()
    assert run(BAG) == 0
    assert {path.name for path in Path().iterdir()} - before == {"new"}


def test_a_film_that_is_killed_is_none_and_the_next_one_is_whole(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for code, result in ((FILM_DIES, -signal.SIGKILL), (FILM, 0)):
        assert not Path("o.webm").exists()
        with started("", code) as process:
            assert ended(process)[0] == result
    assert files() == {"o.webm"}


# --- two commands with one output


def test_the_second_of_two_tracks_is_refused_and_the_first_one_is_whole(folder, capfd):
    before = files()
    with started(TRACK, WAITS) as first:
        wait_until(Path(REACHED).exists, first)
        assert run(TRACK) == 2
        open_gate()
        assert ended(first) == (0, [])
    said = "trinolab track: poses.csv: another process works on it\n"
    assert capfd.readouterr().err == said
    assert_like_uninterrupted()
    assert files() == before | {"poses.csv", "poses.tum", REACHED, GATE}


def test_the_second_of_two_calibrations_is_refused_and_the_first_one_is_whole(folder, capfd):
    before = files()
    with started(BOARDS, READS) as first:
        wait_until(Path(REACHED).exists, first)
        assert run(BOARDS) == 2
        open_gate()
        assert ended(first) == (0, [])
    said = "trinolab calibrate: new.toml: another process works on it\n"
    assert capfd.readouterr().err == said
    written = {"new.toml", "new.covariance.toml", "new_views.csv", "new_residuals.png"}
    assert files() == before | written | {REACHED, GATE}
    assert read_rig("new.toml").names == ("a", "b")


@pytest.mark.usefixtures("folder")
def test_the_second_of_two_tracks_with_one_overlay_is_refused(capfd):
    picture = np.zeros((64, 128, 3), np.uint8)
    with Film("o.webm", 25.0) as first:  # as the first track holds it
        first.add(picture)
        before = files()
        assert run(f"{TRACK} --overlay o.webm") == 2
        assert files() == before
        first.add(picture)
    assert capfd.readouterr().err == "trinolab track: o.webm: another process works on it\n"
    video, count = cv2.VideoCapture("o.webm"), 0
    while video.read()[0]:
        count += 1
    assert count == 2  # the first one's is whole


# --- full disks

# what a limit of the file size says; a disk has other words
FULL = "cannot be written (File too large)"


@pytest.mark.parametrize(
    ("line", "limit", "message"),
    [
        pytest.param(MEASURE, 900, f"poses.csv: {FULL}", marks=pytest.mark.heavy),
        pytest.param(BOARDS, 40_000, f"new_residuals.png: {FULL}", marks=pytest.mark.heavy),
        pytest.param(BOARDS, 10_000, f"new.covariance.toml: {FULL}", marks=pytest.mark.heavy),
        pytest.param(BOARDS, 100, f"new.toml: {FULL}", marks=pytest.mark.heavy),
        (TRACK, 100, f"poses.csv: {FULL}"),
        pytest.param(RENDER, 100, f"made_from.json: {FULL}", marks=pytest.mark.heavy),
        pytest.param(
            RENDER, 2000, f"out.partial/background/ccd1.png: {FULL}", marks=pytest.mark.heavy
        ),
    ],
)
def test_a_full_disk_costs_one_line_and_leaves_nothing_unfinished(folder, line, limit, message):
    import matplotlib.font_manager  # noqa: F401  # its cache is not to be written by the command

    before = files() | {path.name for path in Path().iterdir()}
    with started_on_a_full_disk(line, limit) as process:
        code, err = ended(process)
    assert (code, len(err)) == (2, 1)
    assert err[0].endswith(f"{message}\n")
    assert {path.name for path in Path().iterdir()} - {"out.partial"} == before
    assert line != RENDER or run(line) == 0


@pytest.mark.heavy
def test_a_sweep_on_a_full_disk_keeps_its_runs(folder):
    import matplotlib.font_manager  # noqa: F401  # its cache is not to be written by the command

    with started_on_a_full_disk(SWEEP, 2_500) as process:
        code, err = ended(process)
    assert (code, err) == (
        2,
        [
            f"trinolab sweep: new/figure.png: {FULL}; 2 of 2 runs are kept in new; the same command "
            "goes on\n"
        ],
    )
    assert {path.name for path in Path("new").iterdir()} == {"manifest.json", "runs.jsonl"}
    assert run(SWEEP) == 0
    assert {path.name for path in Path("new").iterdir()} == {
        "manifest.json",
        "runs.jsonl",
        "table.csv",
        "figure.png",
    }


@pytest.mark.parametrize("limit", [100, pytest.param(30_000, marks=pytest.mark.heavy)])
def test_an_overlay_that_the_disk_cuts_off_does_not_appear(tmp_path, monkeypatch, limit):
    monkeypatch.chdir(tmp_path)
    with started_on_a_full_disk("", limit, FILM) as process:
        assert ended(process) == (1, ["o.webm: cannot be written as a whole (is the disk full?)\n"])
    assert files() == set()
    with started("", FILM) as process:
        assert ended(process) == (0, [])
    assert files() == {"o.webm"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize("line", [EVALUATE, pytest.param(MEASURE, marks=pytest.mark.heavy)])
def test_an_answer_that_nobody_takes_costs_one_line(folder, line):
    with Path("/dev/full").open("w") as full, started(line, stdout=full) as process:
        assert ended(process) == (
            2,
            [
                f"trinolab {line.split()[0]}: standard output: cannot be written (No space left "
                "on device)\n"
            ],
        )
