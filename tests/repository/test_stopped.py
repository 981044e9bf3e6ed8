"""Commands that are stopped: by Ctrl-C, by kill -9 at the worst moment, by another one, by a full
disk.

A file appears whole or not at all. A track and a calibration that are stopped begin anew; a rendering
and a sweep go on.
"""

import os
import shutil
import signal
from pathlib import Path

import pytest
from healthy import BOARDS, EVALUATE, MEASURE, RENDER, TRACK, contents, make_healthy, run
from processes import CLI, GATE, ended, open_gate, started, wait_until

from trinolab.files import images
from trinolab.files.journal import locked, sole_writer
from trinolab.files.poses import read_poses
from trinolab.files.rigs import read_rig

resource = pytest.importorskip("resource", reason="limits of a process are set as POSIX does")

COUNT = 12  # instants of the recording
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
# Tracks four instants, then waits for the gate before each.
WAITS = (
    f"""
import time
from pathlib import Path
from trinolab.following import track
real = track.pose_row
def pose_row(frame, *others):
    while frame >= 4 and not Path({GATE!r}).exists():
        Path({REACHED!r}).touch()
        time.sleep(0.01)
    return real(frame, *others)
track.pose_row = pose_row
"""
    + CLI
)


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """A folder with all that the commands read, and a track that nothing has interrupted."""
    root = tmp_path_factory.mktemp("long")
    make_healthy(root, COUNT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        assert run("track rec --out whole.csv") == 0
    return root


@pytest.fixture
def folder(healthy, tmp_path, monkeypatch):
    """The working folder: a copy of the healthy one."""
    shutil.copytree(healthy, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def started_on_a_full_disk(line, limit, code=CLI):
    """A command as a process; no file that it writes may be longer than `limit` bytes, as if the
    disk were full.

    It stores no bytecode: Python does not notice that such a file was cut off, and later processes
    could not load it.
    """
    import matplotlib.font_manager  # noqa: F401  # its cache is not to be written by the command

    return started(
        line,
        code,
        lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )


def names(hidden=True):
    """What is in the folder; hidden files are nobody's input."""
    return {path.name for path in Path().iterdir() if hidden or path.name[0] != "."}


def whole(suffix="csv"):
    """Whether the track is that of a run without interruption to the last digit."""
    return Path(f"poses.{suffix}").read_bytes() == Path(f"whole.{suffix}").read_bytes()


def heavy(*values):
    return pytest.param(*values, marks=pytest.mark.heavy)


# --- Ctrl-C and kill -9


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), heavy(signal.SIGKILL, -signal.SIGKILL)]
)
def test_a_track_that_is_stopped_leaves_nothing_to_read_and_begins_anew(folder, number, code):
    before = names()
    with started(TRACK, WAITS) as process:
        wait_until(Path(REACHED).exists, process)
        process.send_signal(number)
        result = ended(process)
    said = "trinolab track: interrupted, nothing was written\n"
    assert result == (code, [said] * (number == signal.SIGINT))
    assert names(hidden=False) == before | {REACHED}
    open_gate()
    assert run(TRACK) == 0
    assert whole("csv")
    assert whole("tum")
    assert read_poses("poses.csv")["status"].tolist() == ["measured"] * COUNT
    assert names() == before | {REACHED, GATE, "poses.csv", "poses.tum"}


def test_a_calibration_that_is_stopped_leaves_nothing(folder, monkeypatch, capfd):
    real, before = images._read, names()

    def read(path, *others):
        if str(path) == "b/04.png":
            raise KeyboardInterrupt
        return real(path, *others)

    with monkeypatch.context() as patch:
        patch.setattr(images, "_read", read)
        assert run(BOARDS) == 130
    assert capfd.readouterr().err == "trinolab calibrate: interrupted, nothing was written\n"
    assert names() == before
    assert run(BOARDS) == 0
    written = {"new.toml", "new.covariance.toml", "new_views.csv", "new_residuals.png"}
    assert names() == before | written
    assert read_rig("new.toml").names == ("a", "b")


@pytest.mark.parametrize(
    ("line", "moment", "there"),
    [(TRACK, 1, {"poses.csv"}), heavy(TRACK, 0, set()), heavy(BOARDS, 0, set())],
)
def test_killed_while_it_names_its_files_a_command_leaves_whole_ones(folder, line, moment, there):
    before = names()
    with started(f"{moment} {line}", DIES) as process:
        assert ended(process) == (-signal.SIGKILL, [])
    assert names(hidden=False) == before | there
    assert not there or whole("csv")
    assert run(line) == 0
    assert line != TRACK or (whole("csv") and whole("tum"))


@pytest.mark.parametrize("moment", [2, heavy(7), heavy(12)])
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


# --- two commands with one output


@pytest.mark.parametrize(
    ("line", "target", "lock"),
    [
        (TRACK, "poses.csv", sole_writer),
        (BOARDS, "new.toml", sole_writer),
        (RENDER, "out.partial", lambda name: locked(Path(name))),
    ],
)
def test_what_another_process_writes_is_refused(folder, line, target, lock, capfd):
    if line == RENDER:
        Path(target).mkdir()
    with lock(target):
        before = contents(folder)
        assert run(line) == 2
        assert contents(folder) == before
    err = capfd.readouterr().err
    assert err.endswith(f"{target}: another process works on it\n")
    assert err.count("\n") == 1


# --- full disks

# what a limit of the file size says; a disk has other words
FULL = "cannot be written (File too large)"


@pytest.mark.parametrize(
    ("line", "limit", "message"),
    [
        (TRACK, 100, "poses.csv"),
        heavy(MEASURE, 900, "poses.csv"),
        heavy(BOARDS, 40_000, "new_residuals.png"),
        heavy(BOARDS, 10_000, "new.covariance.toml"),
        heavy(RENDER, 100, "made_from.json"),
        heavy(RENDER, 2000, "out.partial/background/ccd1.png"),
    ],
)
def test_a_full_disk_costs_one_line_and_leaves_nothing_unfinished(folder, line, limit, message):
    before = names()
    with started_on_a_full_disk(line, limit) as process:
        code, err = ended(process)
    assert (code, len(err)) == (2, 1)
    assert err[0].endswith(f"{message}: {FULL}\n")
    assert names() - {"out.partial"} == before
    assert line != RENDER or run(line) == 0


# a video of twelve pictures of noise
FILM = """
import numpy as np
from workbench.films.video import Film
with Film("o.webm", 25.0) as film:
    for picture in np.random.default_rng(0).integers(0, 256, (12, 64, 128, 3), np.uint8):
        film.add(picture)
"""


def test_a_film_that_the_disk_cuts_off_does_not_appear(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with started_on_a_full_disk("", 100, FILM) as process:
        code, err = ended(process)
    assert (code, names()) == (1, set())
    assert err[-1].endswith("o.webm: cannot be written as a whole (is the disk full?)\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.usefixtures("folder")
def test_an_answer_that_nobody_takes_costs_one_line():
    with Path("/dev/full").open("w") as full, started(EVALUATE, stdout=full) as process:
        code, (line,) = ended(process)
    assert code == 2
    assert "standard output: cannot be written (No space left on device)" in line
