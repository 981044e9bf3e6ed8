"""`trinolab refine` on a short recording of small images: what it writes and prints, that an
interruption loses nothing, what it refuses.
"""

import io
import re
import shutil
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
import pytest
from healthy import contents, run, write_video
from scipy.spatial.transform import RigidTransform, Rotation
from verification.refined import (
    INSTANTS,
    MOST_DEG,
    MOST_MM,
    NEW,
    Truth,
    errors_of_new_instants,
    placed_by,
    rendered,
)

import trinolab
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Rig, displaced
from trinolab.datasets import load_handle, load_rig
from trinolab.files import recording_writer
from trinolab.files.journal import locked
from trinolab.files.poses import truth_table
from trinolab.files.rigs import read_handle, read_rig, write_handle
from trinolab.following import centres
from trinolab.following.centres import motion, spread_out
from trinolab.following.refine import refine_files, refine_folder
from trinolab.rigid import shifted

CODED = load_handle("coded")
COUNT, CHOSEN, FPS = 14, 12, 5.0
FILES = ["handle.toml", "rig.covariance.toml", "rig.toml", "views.csv"]
REFINE = f"refine rec --instants {CHOSEN} --out new"


def cropped(camera, side=400):
    """A camera's image about the handle alone, at the full resolution."""
    corner = np.round(camera.project(path().translation.mean(axis=0)[None])[0]) - side / 2
    matrix = camera.matrix.copy()
    matrix[:2, 2] -= corner
    return replace(camera, size=(side, side), matrix=matrix)


def truth():
    """Cameras that are off by 0.3 px and 0.02 deg, and markers by 0.05 mm."""
    rng = np.random.default_rng(5)
    sigma = np.zeros((2, 15))
    sigma[:, 2:4], sigma[1, 9:12] = 0.3, np.deg2rad(0.02)
    rig = displaced(RIG, sigma.ravel() * rng.standard_normal(30))
    return Truth(rig, placed_by(CODED, 0.05, rng))


def path():
    """The handle turns about its axis, and wanders."""
    first = RigidTransform.from_components(
        [0.0, 5.0, 560.0], Rotation.from_euler("ZYX", [170.0, 15.0, 40.0], degrees=True)
    )
    wave = np.sin(np.arange(COUNT)[:, None] / [3.0, 4.0, 5.0])
    return RigidTransform.concatenate(
        [
            shifted(first, np.r_[[12, 8, 20] * w, 0.2 * w])
            * RigidTransform.from_rotation(Rotation.from_rotvec([0, 0.4 * k, 0]))
            for k, w in enumerate(wave)
        ]
    )


RIG = Rig(tuple(cropped(camera) for camera in load_rig("paper_pair").cameras))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A folder with the recording, whose files say what rig and handle should have been."""
    root, rng = tmp_path_factory.mktemp("refine"), np.random.default_rng(0)
    true = truth()
    partial = recording_writer.begin(root / "rec", RIG, CODED)
    for k, T in enumerate(path()):
        recording_writer.add(partial, RIG, k, render_rig(true.rig, true.handle, T, Bench(), rng))
    recording_writer.finish(root / "rec", np.arange(COUNT) / FPS, truth_table(path()))
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


def test_the_table_has_every_view_of_the_chosen_instants(done):
    views = pd.read_csv(done.out / "views.csv")
    assert len(views) == 2 * CHOSEN
    assert set(views["status"]) <= {"used", "left out", "nothing seen"}
    used = views["status"] == "used"
    assert (views["rms_px"] > 0).equals(used)
    assert (views["centres"] > 0).equals(views["status"] != "nothing seen")
    assert views["reason"].notna().equals(views["status"] == "left out")


def test_what_the_command_prints(done):
    said = done.said
    assert said[0].startswith("instants       ")
    assert f"of {CHOSEN} chosen; {COUNT} of {COUNT} show the handle still enough" in said[0]
    before, after = re.findall(r"[\d.]+", said[1])[:2]
    assert float(before) > 3 * float(after)
    assert said[2] == "scale          cameras ccd1 and ccd2 are 99.1945 mm apart"
    assert "ccd1, the world frame" in said
    assert "places change as T_cam_world, world to camera, turned in the camera's own frame" in said
    assert any(line.startswith("  rotation_x / deg") and " +- " in line for line in said)
    assert any(line.startswith("markers of coded: moved by 0.") for line in said)
    assert said[-1] == f"written to {done.out}"


def test_values_do_as_well_as_files(done, recorded, tmp_path):
    refined = trinolab.refine(recorded / "rec", tmp_path / "new", RIG, CODED, instants=CHOSEN)
    assert sorted(file.name for file in (tmp_path / "new").iterdir()) == FILES
    # mm: a file has the last digits of a handle's angles otherwise
    ours, files = (read_handle(out / "handle.toml") for out in (tmp_path / "new", done.out))
    np.testing.assert_allclose(ours.marker_centres, files.marker_centres, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(refined.start_handle.marker_centres, CODED.marker_centres)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((np.zeros(3), "new"), "folder: expected a recording folder, got ndarray"),
        (("rec", "new", "no_such_rig"), "no_such_rig"),
        (("rec", "new", None, RIG), "handle"),
    ],
)
def test_a_wrong_value_is_named(folder, arguments, says):
    with pytest.raises(ValueError, match=says):
        trinolab.refine(*arguments)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("count", [5, pytest.param(14, marks=pytest.mark.heavy)])
def test_an_interruption_loses_nothing(done, monkeypatch, capsys, count):
    with monkeypatch.context() as patch:
        stopped_after(patch, count)
        assert run(REFINE) == 130
    said = "interrupted, what is finished is kept in "
    assert said in capsys.readouterr().err
    assert not Path("new").exists()
    calls = stopped_after(monkeypatch, 1000)
    assert run(REFINE) == 0
    assert len(calls) == 2 * CHOSEN - count  # no centre is measured again
    assert contents_of("new") == contents_of(done.out)
    assert not Path("new.partial").exists()


def contents_of(folder):
    return {path.name: text for path, text in contents(Path(folder)).items()}


@pytest.mark.heavy
@pytest.mark.usefixtures("folder")
def test_a_stated_length_holds_the_scale():
    refine_folder("rec", "new", instants=CHOSEN, length=("ccd2", "ccd1", 99.4))
    cameras = read_rig("new/rig.toml").cameras
    assert np.linalg.norm(cameras[0].centre - cameras[1].centre) == pytest.approx(99.4, rel=1e-5)


@pytest.mark.heavy
@pytest.mark.usefixtures("folder")
def test_videos_do_as_well(done):
    sources = {name: f"{name}.mkv" for name in RIG.names}
    for name, video in sources.items():
        images = sorted(Path("rec/images", name).iterdir())
        write_video(video, [cv2.imread(str(image), cv2.IMREAD_GRAYSCALE) for image in images])
    refine_files("rec/rig.toml", "rec/handle.toml", sources, "new", fps=FPS, instants=CHOSEN)
    assert contents_of("new") == contents_of(done.out)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"{REFINE} --length ccd1 ccd3 99", "length: expected two cameras of ccd1, ccd2, or two"),
        (f"{REFINE} --length 0 12 20", "or two markers of 0 to 11, got 0 and 12"),
        (f"{REFINE} --length 3 3 20", "got 3 and 3"),
        (f"{REFINE} --length 0 1 long", "--length: expected a number of mm, got 'long'"),
        (f"{REFINE} --length 0 1 0", "length: expected a number in (0, 1e+06], got 0.0"),
        (f"{REFINE} --video ccd1=1.mkv", "--video: not beside"),
        ("refine --out new", "expected a recording folder"),
        ("refine rec --instants 3 --out new", "instants: expected a number of 10 or more, got 3"),
        ("refine rec --out rec", "rec: exists already; name another folder, or remove it"),
        ("refine rec --out no/new", "no/new"),
        ("refine gone --out new", "gone: no such folder"),
    ],
)
def test_what_it_refuses(folder, capsys, line, said):
    before = contents(folder)
    assert run(line) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert error.startswith("trinolab refine: ")
    assert said in error
    assert contents(folder) == before


def test_a_handle_that_looks_alike_needs_a_start(folder, capsys):
    write_handle(load_handle("paper"), "rec/handle.toml")
    assert run(REFINE) == 2
    assert "looks alike from 12 sides; expected a pose that says" in capsys.readouterr().err
    assert not Path("new.partial").exists()


def test_too_few_instants_are_refused_and_leave_nothing(folder, capsys):
    for name in RIG.names:
        for image in sorted(Path("rec/images", name).iterdir())[3:]:
            image.unlink()
    assert run(REFINE) == 2
    said = capsys.readouterr().err
    assert "3 instants show the handle still enough, expected 10 or more" in said
    assert "it is measured in 3 of 3; record a minute at about 30 mm/s" in said
    assert not Path("new").exists()
    assert not Path("new.partial").exists()


def test_a_handle_that_moves_is_refused_with_how_still_it_was(folder, capsys):
    times = Path("rec/timestamps.csv")
    table = pd.read_csv(times)
    # the same poses, in a tenth of the time
    table.assign(t_s=table["t_s"] / 10).to_csv(times, index=False)
    assert run(REFINE) == 2
    said = capsys.readouterr().err
    numbers = re.search(
        r"[0-9] instants show the handle still enough, expected 10 or more; it is measured in (\d+) of 14, and "
        r"moves at (\d+) mm/s there: ([\d.]+) px while the shutter is open \(([\d.]+) px in the stillest "
        r"tenth\), where 4 px or (\d+) mm/s count as still; record a minute",
        said,
    )
    assert numbers is not None, said
    _, speed, way, stillest, enough = map(float, numbers.groups())
    steps = np.linalg.norm(np.diff(path().translation, axis=0), axis=1) * FPS * 10
    assert np.median(steps) < speed <= 1.1 * steps.max()
    # both by the same pixels a mm, to the digits printed
    assert enough == pytest.approx(4 * speed / way, rel=0.05)
    assert 4 < stillest < way
    assert not Path("new.partial").exists()


@pytest.mark.usefixtures("folder")
def test_two_commands_do_not_write_the_same_files(capsys):
    Path("new.partial").mkdir()
    with locked(Path("new.partial")):
        assert run(REFINE) == 2
    assert "new.partial" in capsys.readouterr().err
    assert not any(Path("new.partial").iterdir())


def test_a_fast_motion_counts_as_no_rest():
    table = truth_table(path()).assign(t_s=np.arange(COUNT) / FPS)
    assert motion(table, RIG, 0.01).still.all()
    fast = table.assign(t_s=table["t_s"] / 1000)
    assert not motion(fast, RIG, 0.01).still.any()


def test_a_single_pose_has_no_motion_to_be_judged_by():
    table = truth_table(path()).assign(t_s=np.arange(COUNT) / FPS)[:1]
    assert motion(table, RIG, 1e6).still.tolist() == [True]


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


@pytest.mark.heavy
def test_a_recording_of_a_minute_mends_rig_and_handle(tmp_path):
    # one of the recordings that `make verify` renders
    before, after = rendered(tmp_path, load_rig("paper_pair"), CODED, 0, INSTANTS, NEW)
    assert after.mm < MOST_MM
    assert after.deg < MOST_DEG
    assert after.measured >= 0.9 * NEW
    assert not before.deg < 3 * after.deg  # nor where too little is measured to say
