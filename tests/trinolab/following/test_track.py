"""`trinolab track` on a short recording: what it writes, that an interruption loses nothing."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import trinolab
from trinolab import following, pose
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import handle_file, load_handle, load_rig, rig_file
from trinolab.files import recorder
from trinolab.files.poses import read_poses, transforms, truth_table
from trinolab.following import posetracker, track
from trinolab.following.clocks import late_lines
from trinolab.following.track import Rows, track_folder
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
    partial = recorder.begin(root, RIG, PAPER)
    for k, T in enumerate(PATH):
        recorder.add(partial, RIG, k, render_rig(RIG, PAPER, T, Bench(), rng))
    recorder.finish(root, np.arange(COUNT) / FPS, truth_table(PATH))
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
def test_it_writes_poses_and_tum_and_a_video(folder, tmp_path):
    table = track_folder(
        folder, tmp_path / "p.csv", start=folder / "truth.csv", overlay=tmp_path / "o.webm"
    )
    assert table["status"].tolist() == ["measured"] * COUNT
    back = read_poses(tmp_path / "p.csv")
    assert back["t_s"].tolist() == pytest.approx(np.arange(COUNT) / FPS)
    off = transforms(back).translation - PATH.translation
    assert np.linalg.norm(off, axis=1).max() < 0.1  # mm
    assert np.loadtxt(tmp_path / "p.tum").shape == (COUNT, 8)
    video = cv2.VideoCapture(str(tmp_path / "o.webm"))
    assert video.read()[1].shape == (512, 1280, 3)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["o.webm", "p.csv", "p.tum"]


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


def test_without_a_start_the_paper_s_handle_is_ambiguous(folder, tmp_path):
    assert set(track_folder(folder, tmp_path / "p.csv")["status"]) == {"ambiguous"}


def interrupted(folder, out, count, monkeypatch, **options):
    """Stop a track after some instants, whose rows are then there."""
    with monkeypatch.context() as patch:
        stopped_after(patch, count)
        with pytest.raises(
            KeyboardInterrupt, match=rf"{count} rows are kept in .*{out.name}\.partial"
        ):
            track_folder(folder, out, **options)


@pytest.mark.parametrize("method", ["paper", pytest.param("best", marks=pytest.mark.slow)], ids=str)
def test_an_interrupted_track_goes_on_as_if_nothing_had_stopped_it(
    folder, tmp_path, monkeypatch, method
):
    """It tracks again what came after the state that was kept last, of every second frame here."""
    monkeypatch.setattr(track, "STATE_EVERY", 2)
    options = {"start": folder / "truth.csv", "method": method}
    table = track_folder(folder, tmp_path / "whole.csv", **options)
    assert table["status"].tolist() == ["measured"] * COUNT
    interrupted(folder, tmp_path / "p.csv", 5, monkeypatch, **options)
    with (tmp_path / "p.csv.partial").open("a") as file:
        file.write("5,0.2,1.0")  # cut off in the middle
    with monkeypatch.context() as patch:
        stopped_after(patch, 2)  # frame 4 again, and the one that is left
        track_folder(folder, tmp_path / "p.csv", **options)
    for suffix in ("csv", "tum"):
        files = [tmp_path / f"{name}.{suffix}" for name in ("p", "whole")]
        assert files[0].read_bytes() == files[1].read_bytes()
    assert not list(tmp_path.glob("*.partial*"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "",
        lambda text: text[:-200],
        lambda text: text.replace(" 3\n", " 300\n", 1),
        lambda text: "x" + text,
        lambda text: text.replace("[", "{"),
        lambda text: text.partition("\n")[0] + "\n{}\n",
    ],
    ids=["empty", "cut off", "of no row", "of another track", "no JSON", "says nothing"],
)
def test_without_the_state_that_was_kept_it_tracks_all_frames_again(
    folder, tmp_path, monkeypatch, damage
):
    monkeypatch.setattr(track, "STATE_EVERY", 2)
    options = {"start": folder / "truth.csv", "method": "paper"}
    track_folder(folder, tmp_path / "whole.csv", **options)
    interrupted(folder, tmp_path / "p.csv", 4, monkeypatch, **options)
    kept = (tmp_path / "p.csv.partial").read_text()
    state = tmp_path / "p.csv.partial.state"
    state.write_text(damage(state.read_text()))
    interrupted(folder, tmp_path / "p.csv", 4, monkeypatch, **options)  # no row is lost
    assert (tmp_path / "p.csv.partial").read_text() == kept
    track_folder(folder, tmp_path / "p.csv", **options)
    assert (tmp_path / "p.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()


@pytest.mark.slow
def test_another_track_begins_anew(folder, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        stopped_after(patch, 4)
        with pytest.raises(KeyboardInterrupt):
            track_folder(folder, tmp_path / "p.csv", method="paper")
    with monkeypatch.context() as patch:
        stopped_after(patch, COUNT - 1)
        with pytest.raises(KeyboardInterrupt, match="5 rows"):
            track_folder(folder, tmp_path / "p.csv", method="best")


def test_footage_that_was_changed_begins_anew(folder, tmp_path, monkeypatch):
    shutil.copytree(folder, tmp_path / "r")
    with monkeypatch.context() as patch:
        stopped_after(patch, 4)
        with pytest.raises(KeyboardInterrupt):
            track_folder(tmp_path / "r", tmp_path / "p.csv", method="paper")
    path = tmp_path / "r" / "images" / "ccd2" / "000005.png"
    path.write_bytes(path.read_bytes() + b"IEND")
    with monkeypatch.context() as patch:
        stopped_after(patch, 1)
        with pytest.raises(KeyboardInterrupt, match="1 rows"):
            track_folder(tmp_path / "r", tmp_path / "p.csv", method="paper")


def test_rows_that_are_damaged_are_dropped_with_those_behind(tmp_path):
    with Rows(tmp_path / "p.partial", "x") as rows:
        for frame in range(5):
            rows.add(frame, frame / 25, pose.LOST)
    whole = (tmp_path / "p.partial").read_text()
    for old, new, left in (
        ("\n3,", "\n4,", 3),
        ("\n2,0.08", "\n2,\0\0\0\0", 2),
        ("\n1,0.04,", "\n1,", 1),
        ("lost,,\n4", "los,,\n4", 3),
        ("\n0,0,", "\n0,0,x", 0),
        ("\n4,0.16", "\n4,0.16\n", 4),
    ):
        (tmp_path / "p.partial").write_text(whole.replace(old, new, 1))
        with Rows(tmp_path / "p.partial", "x") as again:
            assert again.table()["frame"].tolist() == list(range(left)), old
            again.add(left, left / 25, pose.LOST)
            assert len(again.table()) == left + 1
    with Rows(tmp_path / "p.partial", "another") as other:
        assert len(other.table()) == 0


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
    seen = track.Seen([], [])
    for k in range(count):
        uv = [
            RIG.cameras[c].project(T.apply(PAPER.marker_centres))
            for c, T in enumerate((path[k], late[k]))
        ]
        seen.times_s.append(k / FPS)
        seen.uv.append(np.stack(uv) + rng.normal(0, 0.05, (2, 12, 2)))
    (line,) = late_lines(seen.offsets(RIG), RIG)
    assert line.startswith("ccd2: 6.")
    assert "later than ccd1; the cameras are not synchronised" in line
    together = track.Seen(
        seen.times_s,
        [
            np.stack([RIG.cameras[c].project(T.apply(PAPER.marker_centres)) for c in (0, 1)])
            for T in path
        ],
    )
    assert late_lines(together.offsets(RIG), RIG) == []
    assert track.Seen([], []).offsets(RIG) is None


def test_values_track_as_their_files_do(folder, tmp_path):
    """A `Rig` and a `Handle` in the place of files, and with another one nothing is taken up."""
    files = {"rig": rig_file("paper_pair"), "handle": "paper"}
    values = {"rig": load_rig("paper_pair"), "handle": load_handle("paper")}
    track_folder(folder, tmp_path / "files.csv", **files, method="paper")
    track_folder(folder, tmp_path / "values.csv", **values, method="paper")
    assert (tmp_path / "values.csv").read_bytes() == (tmp_path / "files.csv").read_bytes()
    larger = replace(values["handle"], marker_diameter_mm=4.0)
    assert track.content_of(larger) != track.content_of(values["handle"])
    unsure = replace(values["rig"], covariance=None)
    assert track.content_of(unsure) != track.content_of(values["rig"])


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
