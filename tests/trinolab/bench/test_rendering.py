"""Rendered recordings: what is in the folder, that it goes on where it stopped."""

import json
import multiprocessing
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest
from healthy import run
from scipy.spatial.transform import RigidTransform

from trinolab.bench import rendering, scenario
from trinolab.bench.hand import true_visibility
from trinolab.bench.rendering import made_from, render, scripted, write_recording
from trinolab.bench.scenario import COVERED, seen_markers, take
from trinolab.bench.scene import scaled
from trinolab.datasets import load_handle, load_rig
from trinolab.files.poses import read_poses, transforms, truth_table, write_poses
from trinolab.files.recording import instants, open_folder, read_timestamps
from trinolab.files.rigs import write_handle, write_rig

CODED = load_handle("coded")
SMALL = replace(
    load_rig("raised_40deg"),
    cameras=tuple(scaled(camera, 0.125) for camera in load_rig("raised_40deg").cameras),
)
RENDER = "render --rig rig.toml --handle handle.toml --motion hard --seed 3 --out out --seconds 0.2"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    write_rig(SMALL, tmp_path / "rig.toml")
    write_handle(CODED, tmp_path / "handle.toml")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(root):
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def grey(name):
    return cv2.imread(name, cv2.IMREAD_GRAYSCALE).astype(float)


def rendered(out, motion="hard", seconds=0.2, **options):
    return render("rig.toml", "handle.toml", motion, out, 3, seconds, progress=False, **options)


# --- what is in the folder


def test_the_folder_is_a_recording_with_its_truth(folder, capfd):
    assert run(RENDER) == 0
    assert capfd.readouterr() == ("6 instants, the handle is there in 6; written to out\n", "")
    recording, _ = open_folder("out")
    frames = list(instants(recording))
    assert [frame.frame for frame in frames] == list(range(6))
    assert frames[0].images[0].shape == (128, 160)
    np.testing.assert_allclose(read_timestamps("out/timestamps.csv"), np.arange(6) / 30, atol=1e-9)
    truth, job = read_poses("out/truth.csv"), scripted("hard", SMALL, CODED, 3, 0.2)
    np.testing.assert_allclose(truth["t_s"], np.arange(6) / 30, atol=1e-9)
    expected = RigidTransform.concatenate([shot.T_world_handle for shot in job.shots])
    # mm; nine digits
    np.testing.assert_allclose(transforms(truth).as_matrix(), expected.as_matrix(), atol=1e-6)
    for name in SMALL.names:
        assert grey(f"out/background/{name}.png").shape == (128, 160)
    listed = "background handle.toml images made_from.json rig.toml timestamps.csv truth.csv"
    names = sorted(path.name for path in (folder / "out").iterdir())
    assert names == [*listed.split(), "truth_markers.csv"]
    assert not (folder / "out.partial").exists()


def test_truth_counts_the_markers_that_each_camera_truly_sees(folder):
    job = scripted("hard", SMALL, CODED, 3, 4.0, fps=8)
    covered, hidden = round(8 * (COVERED[0] + 0.25)), 8
    assert job.shots[hidden].arm.hides_from is not None
    counts = np.zeros((len(job.shots), 3), int)
    for frame in (0, hidden, covered):
        shot = job.shots[frame]
        counts[frame] = [
            true_visibility(c, CODED, shot.T_world_handle, shot.arm).sum() for c in SMALL.cameras
        ]
        counts[frame, COVERED[2]] *= frame != covered
        assert seen_markers(job, frame) == counts[frame].tolist()
    assert counts[hidden, 2] == 0 < counts[hidden].max()
    truth = rendering.truth_of(job, counts)
    assert truth["markers"].tolist() == counts.max(axis=1).tolist()
    assert truth["cameras"].tolist() == (counts > 0).sum(axis=1).tolist()
    rendered("out", seconds=0.1)
    table = pd.read_csv(folder / "out" / "truth_markers.csv")
    assert list(table) == ["frame", *SMALL.names]
    assert (table[list(SMALL.names)].max(axis=1) == read_poses("out/truth.csv")["markers"]).all()


def test_the_empty_second_of_calm_is_empty_and_then_there_is_a_handle(folder):
    truth = rendered("out", "calm", 1.5, fps=4)
    assert truth["status"].tolist() == ["lost"] * 4 + ["measured"] * 2
    assert (truth["markers"] > 0).tolist() == [False] * 4 + [True] * 2
    for name in SMALL.names:
        empty = grey(f"out/background/{name}.png")
        images = [grey(f"out/images/{name}/{k:06d}.png") - empty for k in range(6)]
        # noise is below 10
        brightest = np.array([cv2.blur(np.abs(image), (5, 5)).max() for image in images])
        assert brightest[:4].max() < 10 < 20 < brightest[4:].min()
        assert np.abs(images[0]).max() > 3  # another noise


def test_the_light_step_and_the_covered_camera_show(folder):
    job = scripted("hard", SMALL, CODED, 3, 5.0, fps=10)
    before, after = (np.median(take(job, frame, 1)) for frame in (14, 15))
    assert after / before == pytest.approx(1.5, rel=0.06)
    dark, other = take(job, 35, COVERED[2]), take(job, 35, 0)
    assert dark.max() < 10 < other.mean()
    assert dark.std() > 0.5  # its own noise is still there


def test_images_are_smeared_in_the_direction_of_the_motion(folder):
    job = scripted("hard", SMALL, CODED, 3, 1.0)
    still = [shot._replace(velocity=np.zeros(3), turn_rate=np.zeros(3)) for shot in job.shots]
    sharp, smeared = (int(take(one, 10, 0).max()) for one in (job._replace(shots=still), job))
    assert smeared < sharp


def test_equal_seeds_give_equal_recordings_and_others_do_not(folder):
    for out in ("one", "two"):
        rendered(out, seconds=0.1)
    render("rig.toml", "handle.toml", "hard", "other", 4, 0.1, progress=False)
    one, two, other = (contents(folder / out) for out in ("one", "two", "other"))
    assert one == two
    images = [name for name in one if name.startswith("images")]
    assert not any(one[name] == other[name] for name in images)
    assert len({one[name] for name in images}) == len(images)


# --- interrupted


def interrupt_after(monkeypatch, count):
    calls = []

    def counted(*arguments):
        calls.append(arguments)
        if len(calls) > count:
            raise KeyboardInterrupt
        return scenario.take(*arguments)

    monkeypatch.setattr(rendering, "take", counted)
    return calls


def test_interrupted_and_run_again_it_goes_on_to_identical_files(folder, monkeypatch, capfd):
    rendered("whole")
    interrupt_after(monkeypatch, 8)
    assert run(RENDER) == 130
    said = "trinolab render: interrupted, run it again in the same way to go on\n"
    assert capfd.readouterr().err == said
    assert not (folder / "out").exists()
    calls = interrupt_after(monkeypatch, 100)
    assert run(RENDER) == 0
    assert len(calls) == 3 * 4  # two of six instants were there
    assert contents(folder / "out") == contents(folder / "whole")


@pytest.mark.skipif(
    "fork" not in multiprocessing.get_all_start_methods(), reason="processes cannot be copied here"
)
def test_two_processes_give_what_one_gives(folder):
    job = scripted("hard", SMALL, CODED, 3, 0.27)
    for out, workers in (("one", 1), ("two", 2)):
        write_recording(job, out, made_from(job, "hard"), progress=False, workers=workers)
    assert contents(folder / "one") == contents(folder / "two")


@pytest.mark.parametrize(
    ("option", "named"),
    [
        ("--seed 3|--seed 4", "seed"),
        ("hard|calm", "motion"),
        ("0.2|0.1", "frames"),
        ("rig.toml|other.toml", "rig"),
    ],
)
def test_an_unfinished_recording_with_other_arguments_is_left_alone(
    folder, monkeypatch, capfd, option, named
):
    interrupt_after(monkeypatch, 4)
    assert run(RENDER) == 130
    write_rig(SMALL.part(range(2)), "other.toml")
    before = contents(folder)
    capfd.readouterr()
    assert run(RENDER.replace(*option.split("|"))) == 2
    err = capfd.readouterr().err
    assert f"out.partial: an unfinished recording with another {named}; remove it" in err
    assert err.count("\n") == 1
    assert contents(folder) == before


def test_the_manifest_knows_the_code(folder, monkeypatch):
    job = scripted("calm", SMALL, CODED, 0, 0.1)
    one = made_from(job, "calm")
    assert one == made_from(scripted("calm", SMALL, CODED, 0, 0.1), "calm")
    assert json.loads(json.dumps(one)) == one
    monkeypatch.setattr(rendering, "DRAWN_WITH", ("camera.py",))
    changed = made_from(job, "calm")
    assert [name for name in one if changed[name] != one[name]] == ["code"]
    brighter = job._replace(bench=replace(job.bench, body_grey=91.0))
    assert [name for name in one if made_from(brighter, "calm")[name] != changed[name]] == ["bench"]


# --- along given poses


def test_a_hand_follows_the_poses_of_a_file(folder):
    (folder / "path.csv").write_text(
        "frame,x_mm,y_mm,z_mm,qw,qx,qy,qz,status\n"
        "0,,,,,,,,lost\n1,5,10,560,1,0,0,0,measured\n2,10,10,560,1,0,0,0,predicted\n"
    )
    truth = rendered("out", "path.csv", None, fps=20)
    assert truth["status"].tolist() == ["lost", "measured", "measured"]
    np.testing.assert_allclose(truth["t_s"], [0, 0.05, 0.1])
    np.testing.assert_allclose(truth["x_mm"], [np.nan, 5, 10])
    assert rendered("short", "path.csv", 0.1, fps=20)["status"].tolist() == ["lost", "measured"]


def test_a_files_own_times_are_kept(folder):
    table = truth_table(RigidTransform.from_translation([[0.0, 0, 570]] * 3)).assign(
        t_s=[1.0, 1.5, 1.7]
    )
    write_poses(table, "path.csv")
    np.testing.assert_allclose(rendered("out", "path.csv", None)["t_s"], [1.0, 1.5, 1.7])
    assert len(rendered("short", "path.csv", 0.6)) == 2


# --- what is wrong: test_faults; a full disk: test_stopped
