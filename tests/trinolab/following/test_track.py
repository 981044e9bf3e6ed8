"""`trinolab track` on a short recording: what it writes, whole or not at all."""

import shutil

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import trinolab
from trinolab import following
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import handle_file, load_handle, load_rig, rig_file
from trinolab.files import recording_writer
from trinolab.files.poses import read_poses, transforms, truth_table
from trinolab.following import posetracker
from trinolab.following.clocks import late_lines
from trinolab.following.sync import estimate_offsets
from trinolab.following.track import track_folder
from trinolab.rigid import shifted

RIG, PAPER = load_rig("paper_pair"), load_handle("paper")
FIRST = RigidTransform.from_components(
    [0.0, 5.0, 560.0], Rotation.from_euler("ZYX", [170.0, 15.0, 40.0], degrees=True)
)
COUNT, FPS = 6, 25.0
PATH = RigidTransform.concatenate(
    [shifted(FIRST, np.array([90.0, -60, 40, 0.2, 0.3, -0.2]) * k / FPS) for k in range(COUNT)]
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording of the paper's handle."""
    root, rng = tmp_path_factory.mktemp("track") / "r", np.random.default_rng(0)
    partial = recording_writer.begin(root, RIG, PAPER)
    for k, T in enumerate(PATH):
        recording_writer.add(partial, RIG, k, render_rig(RIG, PAPER, T, Bench(), rng))
    recording_writer.finish(root, np.arange(COUNT) / FPS, truth_table(PATH))
    return root


def stopped_after(monkeypatch, count, error=KeyboardInterrupt):
    """From here on the tracker stops after some instants."""
    real, calls = posetracker.step, []

    def step(*arguments):
        calls.append(1)
        if len(calls) > count:
            raise error
        return real(*arguments)

    monkeypatch.setattr(following.posetracker, "step", step)


@pytest.mark.slow
def test_it_writes_poses_and_tum_and_shows_every_instant(folder, tmp_path):
    watched = []
    table = track_folder(
        folder,
        tmp_path / "p.csv",
        start=folder / "truth.csv",
        watch=lambda recording, now, tracked: watched.append(
            (recording.rate, now.frame, tracked.measurement.pose.status)
        ),
    )
    assert table["status"].tolist() == ["measured"] * COUNT
    back = read_poses(tmp_path / "p.csv")
    assert back["t_s"].tolist() == pytest.approx(np.arange(COUNT) / FPS)
    off = transforms(back).translation - PATH.translation
    assert np.linalg.norm(off, axis=1).max() < 0.1  # mm
    assert np.loadtxt(tmp_path / "p.tum").shape == (COUNT, 8)
    assert watched == [(pytest.approx(FPS), k, "measured") for k in range(COUNT)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.csv", "p.tum"]


@pytest.mark.slow
def test_a_recording_may_be_tracked_with_another_rig_and_handle(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "r")
    for name in ("rig.toml", "handle.toml"):
        (tmp_path / "r" / name).unlink()
    other = {"rig": rig_file("paper_pair"), "handle": handle_file("paper")}
    table = track_folder(tmp_path / "r", tmp_path / "p.csv", **other, method="paper")
    assert set(table["status"]) == {"ambiguous"}
    assert table["t_s"].tolist() == pytest.approx(np.arange(COUNT) / FPS)
    (tmp_path / "t.csv").write_text("frame,t_s\n" + "".join(f"{k},{5 + k}\n" for k in range(COUNT)))
    table = track_folder(
        tmp_path / "r", tmp_path / "q.csv", **other, timestamps=tmp_path / "t.csv", method="paper"
    )
    assert table["t_s"].tolist() == [5, 6, 7, 8, 9, 10]


def test_the_overlay_of_before_is_refused_with_what_to_give(folder, tmp_path):
    with pytest.raises(ValueError, match=r"^overlay: give watch, as "):
        track_folder(folder, tmp_path / "p.csv", overlay=tmp_path / "o.webm")


def test_without_a_start_the_paper_s_handle_is_ambiguous(folder, tmp_path):
    assert set(track_folder(folder, tmp_path / "p.csv")["status"]) == {"ambiguous"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError("a broken image")], ids=str)
def test_a_track_that_is_stopped_leaves_nothing_and_begins_anew(
    folder, tmp_path, monkeypatch, error
):
    with monkeypatch.context() as patch:
        stopped_after(patch, 4, error)
        with pytest.raises(type(error) if isinstance(error, ValueError) else error):
            track_folder(folder, tmp_path / "p.csv", method="paper")
    assert not list(tmp_path.iterdir())
    table = track_folder(folder, tmp_path / "p.csv", method="paper")
    assert table["frame"].tolist() == list(range(COUNT))
    back = read_poses(tmp_path / "p.csv")
    pd.testing.assert_frame_equal(back, table, rtol=1e-8, check_dtype=False)  # nine digits


def test_a_camera_that_is_late_is_said():
    """CCD2's images are those of 6 ms later; the motion is faster than elsewhere in this module."""
    rng, late_s, count = np.random.default_rng(1), 0.006, 30
    path = [
        shifted(
            FIRST, np.array([60 * np.sin(4 * t), 40 * np.sin(5 * t), 0, 0, 0, 0.3 * np.sin(3 * t)])
        )
        for t in np.arange(count) / FPS
    ]
    late = [
        shifted(
            FIRST, np.array([60 * np.sin(4 * t), 40 * np.sin(5 * t), 0, 0, 0, 0.3 * np.sin(3 * t)])
        )
        for t in np.arange(count) / FPS + late_s
    ]
    first, second = RIG.cameras
    times_s = np.arange(count) / FPS
    exact, delayed = (
        np.stack([camera.project(T.apply(PAPER.marker_centres)) for T in poses])
        for camera, poses in ((first, path), (second, late))
    )
    uv = np.stack([exact, delayed]) + rng.normal(0, 0.05, (2, count, 12, 2))
    (line,) = late_lines(estimate_offsets(times_s, uv, RIG), RIG)
    assert line.startswith("ccd2: 6.")
    assert "later than ccd1; the cameras are not synchronised" in line
    together = np.stack([second.project(T.apply(PAPER.marker_centres)) for T in path])
    assert late_lines(estimate_offsets(times_s, np.stack([exact, together]), RIG), RIG) == []


def test_values_track_as_their_files_do(folder, tmp_path):
    """A `Rig` and a `Handle` in the place of files."""
    files = {"rig": rig_file("paper_pair"), "handle": "paper"}
    values = {"rig": load_rig("paper_pair"), "handle": load_handle("paper")}
    track_folder(folder, tmp_path / "files.csv", **files, method="paper")
    track_folder(folder, tmp_path / "values.csv", **values, method="paper")
    assert (tmp_path / "values.csv").read_bytes() == (tmp_path / "files.csv").read_bytes()


def test_a_recording_is_read_by_names_files_or_values(folder):
    for rig, handle in (
        ("paper_pair", "paper"),
        (rig_file("paper_pair"), str(handle_file("paper"))),
        (load_rig("paper_pair"), load_handle("paper")),
    ):
        recording, read = trinolab.read_recording(folder, rig, handle)
        assert recording.rig.names == ("ccd1", "ccd2")
        assert read.name == "paper"
    with pytest.raises(ValueError, match="likely rig and handle are exchanged"):
        trinolab.read_recording(folder, "coded")
