"""`trinolab refine` on a short recording of small images: what it writes and prints, that an
interruption loses nothing, what it refuses.
"""

import io
import re
import shutil
from contextlib import redirect_stdout
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
from healthy import contents, run
from scenes import close_up, moved, pose, record
from scipy.spatial.transform import RigidTransform, Rotation
from verification.refined import (
    Truth,
    errors_of_new_instants,
    placed_by,
)

import trinolab
from trinolab.camera import displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.files.poses import truth_table
from trinolab.files.rigs import read_handle, read_rig, write_handle
from trinolab.following import centres
from trinolab.following.centres import motion, spread_out
from trinolab.rigid import shifted

CODED = load_handle("coded")
COUNT, CHOSEN, FPS = 14, 12, 5.0
FILES = ["handle.toml", "rig.covariance.toml", "rig.toml", "views.csv"]
REFINE = f"refine rec --instants {CHOSEN} --out new"


def truth():
    """Cameras that are off by 0.3 px and 0.02 deg, and markers by 0.05 mm."""
    rng = np.random.default_rng(5)
    sigma = np.zeros((2, 15))
    sigma[:, 2:4], sigma[1, 9:12] = 0.3, np.deg2rad(0.02)
    rig = displaced(RIG, sigma.ravel() * rng.standard_normal(30))
    return Truth(rig, placed_by(CODED, 0.05, rng))


def path():
    """The handle turns about its axis, and wanders."""
    first = pose([0.0, 5.0, 560.0], [170.0, 15.0, 40.0])
    wave = np.sin(np.arange(COUNT)[:, None] / [3.0, 4.0, 5.0])
    poses = [shifted(first, np.r_[[12, 8, 20] * w, 0.2 * w]) for w in wave]
    turning = [moved(T, np.array([0, 0, 0, 0, 0.4 * k, 0])) for k, T in enumerate(poses)]
    return RigidTransform.concatenate(turning)


RIG = close_up(load_rig("paper_pair"), path().translation.mean(axis=0))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with the recording, whose files say what rig and handle should have been."""
    root = tmp_path_factory.mktemp("refine")
    record(root / "rec", RIG, CODED, path(), FPS, truth())
    return root


class Done(NamedTuple):
    """What the command has written, and said."""

    out: Path
    said: list[str]


@pytest.fixture(scope="module")
def done(recorded):
    """The recording refined by the command."""
    said = io.StringIO()
    line = f"refine {recorded}/rec --instants {CHOSEN} --out {recorded}/whole"
    with redirect_stdout(said):
        assert run(line) == 0
    return Done(recorded / "whole", said.getvalue().splitlines())


@pytest.fixture
def folder(recorded, tmp_path, monkeypatch):
    """The working folder: a copy of the recording."""
    shutil.copytree(recorded / "rec", tmp_path / "rec")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def stopped_after(monkeypatch, count):
    """From here on an interruption comes when so many instants' centres were measured."""
    real, calls = centres.centre_pixels, []

    def centre_pixels(*arguments):
        calls.append(1)
        if len(calls) > count:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(centres, "centre_pixels", centre_pixels)
    return calls


def test_it_writes_a_better_rig_and_a_better_handle(done):
    assert sorted(file.name for file in done.out.iterdir()) == FILES
    assert not Path(f"{done.out}.partial").exists()
    rig, handle = read_rig(done.out / "rig.toml"), read_handle(done.out / "handle.toml")
    assert rig.covariance is not None
    assert 0 < handle.placement_sigma_mm < 0.05
    before, after = (
        errors_of_new_instants(*files, truth(), np.random.default_rng(1), new=10)
        for files in ((RIG, CODED), (rig, handle))
    )
    # some instants in one place: less than half, of either
    assert (np.array(after) < np.array(before) / 2).all()
    views = pd.read_csv(done.out / "views.csv")
    assert len(views) == 2 * CHOSEN
    assert (views["rms_px"] > 0).equals(views["status"] == "used")
    assert (views["centres"] > 0).equals(views["status"] != "nothing seen")
    assert views["reason"].notna().equals(views["status"] == "left out")


def test_what_the_command_prints(done):
    said = done.said
    assert f"of {CHOSEN} chosen; {COUNT} of {COUNT} show the handle still enough" in said[0]
    before, after = re.findall(r"[\d.]+", said[1])[:2]
    assert float(before) > 3 * float(after)
    assert said[2].endswith("cameras ccd1 and ccd2 are 99.1945 mm apart")
    assert any(line.startswith("  rotation_x / deg") and " +- " in line for line in said)
    assert any(line.startswith("markers of coded: moved by 0.") for line in said)


def test_values_do_as_well_as_files(done, recorded, tmp_path):
    refined = trinolab.refine(recorded / "rec", tmp_path / "new", RIG, CODED, instants=CHOSEN)
    assert sorted(file.name for file in (tmp_path / "new").iterdir()) == FILES
    # mm: a file has the last digits of a handle's angles otherwise
    ours, files = (read_handle(out / "handle.toml") for out in (tmp_path / "new", done.out))
    np.testing.assert_allclose(ours.marker_centres, files.marker_centres, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(refined.start_handle.marker_centres, CODED.marker_centres)


def test_a_wrong_value_is_named(folder):
    for arguments, says in (
        ((np.zeros(3), "new"), "folder: expected a recording folder, got ndarray"),
        (("rec", "new", "no_such_rig"), "no_such_rig"),
        (("rec", "new", None, RIG), "handle"),
    ):
        with pytest.raises(ValueError, match=says):
            trinolab.refine(*arguments)


@pytest.mark.usefixtures("folder")
def test_an_interruption_loses_nothing(done, monkeypatch, capsys):
    count = 5
    with monkeypatch.context() as patch:
        stopped_after(patch, count)
        assert run(REFINE) == 130
    assert "interrupted, what is finished is kept in " in capsys.readouterr().err
    assert not Path("new").exists()
    calls = stopped_after(monkeypatch, 1000)
    assert run(REFINE) == 0
    assert len(calls) == 2 * CHOSEN - count  # no centre is measured again
    assert contents_of("new") == contents_of(done.out)
    assert not Path("new.partial").exists()


def contents_of(folder):
    return {path.name: text for path, text in contents(Path(folder)).items()}


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"{REFINE} --length ccd1 ccd3 99", "length: expected two cameras of ccd1, ccd2, or two"),
        (f"{REFINE} --length 0 12 20", "or two markers of 0 to 11, got 0 and 12"),
        (f"{REFINE} --length 0 1 0", "length: expected a number in (0, 1e+06], got 0.0"),
        (f"{REFINE} --video ccd1=1.mkv", "--video: not beside"),
        ("refine --out new", "expected a recording folder"),
        ("refine rec --instants 3 --out new", "instants: expected a number of 10 or more, got 3"),
    ],
)
def test_what_it_refuses(folder, capsys, line, said):
    before = contents(folder)
    assert run(line) == 2
    error = capsys.readouterr().err
    assert said in error
    assert contents(folder) == before


def test_a_recording_that_says_too_little_is_refused_and_leaves_nothing(folder, capsys):
    for name in RIG.names:
        for image in sorted(Path("rec/images", name).iterdir())[3:]:
            image.unlink()
    write_handle(load_handle("paper"), "paper.toml")
    for line, said in (
        (
            REFINE,
            "3 instants show the handle still enough, expected 10 or more; it is measured in 3 of 3",
        ),
        (f"{REFINE} --handle paper.toml", "looks alike from 12 sides; expected a pose that says"),
    ):
        assert run(line) == 2
        assert said in capsys.readouterr().err
        assert not list(folder.glob("new*"))


def test_a_handle_that_moves_is_refused_with_how_still_it_was(folder, capsys):
    times = Path("rec/timestamps.csv")
    table = pd.read_csv(times)
    # the same poses, in a tenth of the time
    table.assign(t_s=table["t_s"] / 10).to_csv(times, index=False)
    assert run(REFINE) == 2
    said = capsys.readouterr().err
    numbers = re.search(
        r"measured in \d+ of 14, and moves at (\d+) mm/s there: ([\d.]+) px .* "
        r"\(([\d.]+) px in the stillest tenth\), where 4 px or (\d+) mm/s count as still",
        said,
    )
    assert numbers is not None, said
    speed, way, stillest, enough = map(float, numbers.groups())
    steps = np.linalg.norm(np.diff(path().translation, axis=0), axis=1) * FPS * 10
    assert np.median(steps) < speed <= 1.1 * steps.max()
    # both by the same pixels a mm, to the digits printed
    assert enough == pytest.approx(4 * speed / way, rel=0.05)
    assert 4 < stillest < way
    assert not Path("new.partial").exists()


def test_what_counts_as_still():
    table = truth_table(path()).assign(t_s=np.arange(COUNT) / FPS)
    assert motion(table, RIG, 0.01).still.all()
    fast = table.assign(t_s=table["t_s"] / 1000)
    assert not motion(fast, RIG, 0.01).still.any()
    # a single pose has no motion to be judged by
    assert motion(table[:1], RIG, 1e6).still.tolist() == [True]


def test_poses_are_chosen_that_spread():
    # by hand: on a line the ends first, then the middle
    x = np.array([0.0, 1.0, 2.0, 49.0, 50.0, 100.0])
    line = RigidTransform.from_translation(np.column_stack([x, 0 * x, 0 * x]))
    assert spread_out(line, 2).tolist() == [0, 5]
    assert spread_out(line, 3).tolist() == [0, 4, 5]
    assert spread_out(line, 6).tolist() == list(range(6))
    # half a radian counts as 50 mm
    turns = RigidTransform.from_rotation(
        Rotation.from_rotvec([[0, 0, 0], [0, 0.4, 0], [0, 1.0, 0]])
    )
    assert spread_out(turns, 2).tolist() == [0, 2]
